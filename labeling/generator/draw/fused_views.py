"""The views of an episode with the cloud they were fused into, and what each view shows of it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float32, Int32

from labeling.core.splatting import splat
from labeling.core.views import RgbdViews
from labeling.generator.cloud.fine_points import FinePoints, fine_points
from labeling.generator.cloud.free_space import MARGIN_SHARE, count_hits
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.draw.view_masks import NO_OBJECT
from labeling.generator.settings.label_config import LabelConfig

NO_REACH_PX = 1e-3
"""Reach of a filter that changes no pixel."""
MAX_HOLES = 1e-3
"""Share of a view's pixels without depth up to which it is filled from its own pixels alone."""
FINE_PX = 2.0
"""Spacing of the points that outlines are drawn from, in pixels: as fine as depth sensors sample."""


@dataclass(frozen=True, eq=False)
class FusedViews:
    """Views, segmented cloud and finer points: what masks are drawn from."""

    views: RgbdViews
    cloud: Cloud
    """The voxels that were segmented."""
    fine: FinePoints
    """The voxels of objects at the resolution of the pictures, so that what is drawn from them has sharp outlines."""

    @classmethod
    def of(
        cls, views: RgbdViews, cloud: Cloud, inside: Bool[np.ndarray, "n"], pixel_m: float, config: LabelConfig
    ) -> "FusedViews":
        """The views with the points that objects are drawn from.

        Args:
            views: of one scene.
            cloud: made from these views.
            inside: its voxels that belong to any object.
            pixel_m: edge of a pixel at the objects' depth, metres (``Scale``).
            config: settings; where other views decide what a view shows, or what its pixels without depth show, all
                voxels are drawn finely: coarse ones would cover the edges of objects behind them.
        """
        alone = config.visibility == "own" and not any(map(has_holes, cloud.voxel_of_pixel))
        chosen = inside if alone else np.ones(cloud.num_points, bool)
        return cls(views, cloud, fine_points(views, cloud, chosen, FINE_PX * pixel_m))

    def visible_voxels(self, view: int, config: LabelConfig) -> Int32[np.ndarray, "h w"]:
        """The voxel that each pixel with depth shows, -1 for pixels without.

        Args:
            view: index of the view.
            config: ``visibility``: a pixel shows its own point (thesis 4.3: "only points from this view") or the
                nearest point that any view puts there (thesis A.2.1).
        """
        return self.cloud.voxel_of_pixel[view] if config.visibility == "own" else self.rendered_voxels(view)

    def rendered_voxels(self, view: int) -> Int32[np.ndarray, "h w"]:
        """The voxel of the nearest point that any view puts at each pixel, -1 for none.

        Args:
            view: index of the view.
        """
        return self._nearest(view, least_views=1)[0]

    def filling_voxels(self, view: int, config: LabelConfig) -> Int32[np.ndarray, "h w"]:
        """What pixels without a voxel of their own are filled with: that of the nearest point that others put there.

        Where the view has measured depth that is too far away to be used (``max_range_m``), it may still tell that
        there is nothing, or nothing any more: it looks through the place (as in ``count_misses``). Where it has
        measured none, points farther than that range are taken for no more certain than its own would be.

        Args:
            view: index of the view.
            config: ``fill_views``: so many must have measured a voxel, where there are more others than that.

        Returns:
            -1 where nothing is known to fill with, ``NO_OBJECT`` where no object is.
        """
        voxels, expected_m = self._nearest(view, config.fill_views)
        depth_m, margin_m = self.views.depth_m[view], np.sqrt(3.0) * self.cloud.voxel_m
        through = depth_m > (1 + MARGIN_SHARE) * expected_m + margin_m
        unknown = (depth_m <= 0) & (expected_m > config.max_range_m)
        return np.where((voxels >= 0) & (through | unknown), np.int32(NO_OBJECT), voxels)

    def _nearest(self, view: int, least_views: int) -> tuple[Int32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        """The voxel of the nearest point that so many views put at each pixel, -1 for none, and its depth, metres."""
        points, sizes_m, voxel = self._surfaces
        chosen = self.hits[voxel] >= max(1, min(least_views, self.views.num_views - 1))
        points, voxel, camera = points[chosen], voxel[chosen], self.views.camera(view)
        nearest = splat(points, camera, sizes_m[chosen])
        if len(points) == 0:
            return nearest.astype(np.int32), np.zeros(nearest.shape, np.float32)
        depth_m = (points @ camera.world_to_camera[2, :3] + camera.world_to_camera[2, 3]).astype(np.float32)
        return np.where(nearest >= 0, voxel[nearest], np.int32(-1)), depth_m[nearest]

    @cached_property
    def hits(self) -> Int32[np.ndarray, "n"]:
        """How many views have measured each voxel."""
        return count_hits(self.cloud.voxel_of_pixel, self.cloud.num_points)

    @cached_property
    def _surfaces(
        self,
    ) -> tuple[Float32[np.ndarray, "p 3"], Float32[np.ndarray, "p"], Int32[np.ndarray, "p"]]:
        """Fine points, and the voxels that have none; the size and the voxel of each."""
        fine, cloud = self.fine, self.cloud
        rest = np.ones(cloud.num_points, bool)
        rest[fine.voxel] = False
        others = np.flatnonzero(rest).astype(np.int32)
        sizes = np.repeat([fine.spacing_m, cloud.voxel_m], [len(fine.points), len(others)]).astype(np.float32)
        return np.concatenate([fine.points, cloud.points[others]]), sizes, np.concatenate([fine.voxel, others])


def has_holes(voxels: Int32[np.ndarray, "h w"]) -> bool:
    """Whether more than ``MAX_HOLES`` of a view's pixels have no voxel (-1), so that other views fill them."""
    return bool(np.count_nonzero(voxels < 0) > MAX_HOLES * voxels.size)


def fill_reach_px(voxel_m: float, pixel_m: float, config: LabelConfig) -> float:
    """Reach of hole filling in pixels: as configured, or half a voxel but at least 2 pixels."""
    if config.fill_px is None:
        return max(2.0, 0.5 * voxel_m / pixel_m)
    return max(config.fill_px, NO_REACH_PX)
