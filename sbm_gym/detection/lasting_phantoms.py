"""Parts of a scene that a detector takes for objects again and again: doors for fridges, pictures for tvs."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from labeling.core.views import Camera


@dataclass(frozen=True)
class LastingPhantoms:
    """How often that happens. Logits are of confidence."""

    logit_when_full: float
    """Of a cell that fills the picture, without luck or bad luck."""
    size_gain: float
    """Taken away for every halving of the square root of the share of the picture."""
    cell_sigma: float
    """Spread of the bias per cell."""
    pose_sigma: float
    """Spread of the noise per pose."""
    categories: tuple[tuple[str, float], ...]
    """What cells are taken for, and their shares, which sum to 1."""
    cell_m: float = 1.0
    """Edge of the cells that a scene is divided into; what is not an object in a cell may be taken for one."""
    heights_m: tuple[float, float] = (0.3, 2.2)
    """Lowest and highest points of a scene that are taken for anything."""

    def logit(self, luck: float, area_share: float) -> float:
        """Logit of confidence without the noise per pose.

        Args:
            luck: standard normal number of the cell.
            area_share: share of the picture that shows the cell, above 0.
        """
        return self.logit_when_full + self.cell_sigma * luck + 0.5 * self.size_gain * float(np.log2(area_share))

    def category(self, luck: float) -> str:
        """What a cell is taken for.

        Args:
            luck: uniform number of the cell, in [0, 1).
        """
        ends = np.cumsum([share for _, share in self.categories])
        return self.categories[min(int(np.searchsorted(ends, luck, "right")), len(ends) - 1)][0]


def background_cells(
    depth_m: Float[np.ndarray, "h w"],
    instance_map: Int[np.ndarray, "h w"],
    camera: Camera,
    cell_m: float,
    heights_m: tuple[float, float],
    min_area_share: float,
) -> Iterator[tuple[tuple[int, int, int], Bool[np.ndarray, "h w"]]]:
    """The cells of a scene that a view shows, objects left out, in order: their numbers and the pixels that show them.

    Args:
        depth_m: z-depth, 0 = no return.
        instance_map: instance id of every pixel, 0 for none.
        camera: of the view.
        cell_m: edge of the cells; cell (0, 0, 0) has a corner at the world's origin.
        heights_m: lowest and highest points that count, world.
        min_area_share: cells with fewer pixels are left out.
    """
    codes = _cell_codes(depth_m, instance_map, camera, cell_m, heights_m)
    found, counts = np.unique(codes, return_counts=True)
    for code, count in zip(found.tolist(), counts.tolist(), strict=True):
        if code >= 0 and count >= min_area_share * codes.size:
            x, y, z = code // _SPAN**2, code // _SPAN % _SPAN, code % _SPAN
            yield (x - _HALF, y - _HALF, z - _HALF), codes == code


_SPAN, _HALF = 2048, 1024
"""Cells along each side that can be told apart, and the number of the one at the origin."""


def _cell_codes(depth_m, instance_map, camera: Camera, cell_m: float, heights_m) -> Int[np.ndarray, "h w"]:
    """The number of each pixel's cell; -1 where there is an object, nothing, or a height that does not count."""
    height_px, width_px = depth_m.shape
    x = (np.arange(width_px) - camera.intrinsics[0, 2]) / camera.intrinsics[0, 0]
    y = (np.arange(height_px) - camera.intrinsics[1, 2]) / camera.intrinsics[1, 1]
    rotation, eye_m = camera.camera_to_world[:3, :3], camera.camera_to_world[:3, 3]
    code, coordinate_m = np.zeros(depth_m.shape, np.int64), depth_m
    for axis in range(3):
        along = rotation[axis, 0] * x[None, :] + rotation[axis, 1] * y[:, None] + rotation[axis, 2]
        coordinate_m = eye_m[axis] + along * depth_m
        number = np.floor(coordinate_m / cell_m).astype(np.int64) + _HALF
        code = code * _SPAN + np.clip(number, 0, _SPAN - 1)
    low_m, high_m = heights_m
    code[(instance_map != 0) | (depth_m <= 0.0) | (coordinate_m < low_m) | (coordinate_m > high_m)] = -1
    return code
