"""The views of an episode with the clouds they were fused into, and what each view shows of these."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Int32

from labeling.core.splatting import splat
from labeling.core.views import RgbdViews
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.settings.label_config import LabelConfig

NO_REACH_PX = 1e-3
"""A filter of this reach leaves every pixel as it is."""


@dataclass(frozen=True, eq=False)
class FusedViews:
    """What masks are drawn from."""

    views: RgbdViews
    cloud: Cloud
    """The voxels that were segmented."""
    fine: Cloud
    """The same views at the resolution of the pictures, so that what is drawn from them has sharp outlines."""

    @cached_property
    def voxel_of_fine(self) -> Int32[np.ndarray, "m"]:
        """The voxel of ``cloud`` that each point of ``fine`` lies in."""
        return self.cloud.parents_of(self.fine)

    def visible_voxels(self, view: int, config: LabelConfig) -> Int32[np.ndarray, "h w"]:
        """The voxel that each pixel with depth shows, -1 for pixels without.

        Args:
            view: index of the view.
            config: ``visibility``: a pixel shows its own point (thesis 4.3: "only points from this view") or the
                nearest point that any view puts there (thesis A.2.1).
        """
        return self.cloud.voxel_of_pixel[view] if config.visibility == "own" else self.rendered_voxels(view)

    def rendered_voxels(self, view: int) -> Int32[np.ndarray, "h w"]:
        """The voxel of the nearest point that any view puts at each pixel, -1 for none."""
        nearest = splat(self.fine.points, self.views.camera(view), self.fine.voxel_m)
        return np.where(nearest >= 0, self.voxel_of_fine[nearest], np.int32(-1))


def fill_reach_px(voxel_m: float, pixel_m: float, config: LabelConfig) -> float:
    """Reach of hole filling in pixels: as configured, or half a voxel but at least 2 pixels."""
    if config.fill_px is None:
        return max(2.0, 0.5 * voxel_m / pixel_m)
    return max(config.fill_px, NO_REACH_PX)
