"""What the views of an episode show of its points."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int32, UInt8

from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.draw.splatting import nearest_points
from labeling.generator.settings.label_config import LabelConfig

NO_REACH_PX = 1e-3
"""A filter of this reach leaves every pixel as it is."""


@dataclass(frozen=True)
class Views:
    """What masks are drawn from."""

    rgb: UInt8[np.ndarray, "views h w 3"]
    intrinsics: Float[np.ndarray, "views 3 3"]
    camera_to_world: Float[np.ndarray, "views 4 4"]
    cloud: Cloud
    fine: Cloud
    """The same points at the resolution of the pictures, so that what is drawn from them has sharp outlines."""


def visible_voxels(
    views: Views, view: int, voxel_of_fine: Int32[np.ndarray, "m"], config: LabelConfig
) -> Int32[np.ndarray, "h w"]:
    """The voxel that each pixel with depth shows, -1 for pixels without.

    Args:
        views: the views.
        view: index of one of them.
        voxel_of_fine: the voxel that each fine point lies in.
        config: ``visibility``: a pixel shows its own point (thesis 4.3: "only points from this view") or the nearest
            point that any view puts there (thesis A.2.1).
    """
    if config.visibility == "own":
        return views.cloud.voxel_of_pixel[view]
    camera = (views.intrinsics[view], views.camera_to_world[view], views.rgb.shape[1:3])
    drawn = nearest_points(views.fine.points, *camera, views.fine.voxel_m)
    return np.where(drawn >= 0, voxel_of_fine[drawn], np.int32(-1))


def fill_reach_px(voxel_m: float, pixel_m: float, config: LabelConfig) -> float:
    """Reach of hole filling in pixels: as configured, or half a voxel but at least 2 pixels."""
    if config.fill_px is None:
        return max(2.0, 0.5 * voxel_m / pixel_m)
    return max(config.fill_px, NO_REACH_PX)
