"""The ground that objects stand on (the floor and flat things on it, such as rugs), and what lies in it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32
from numba import njit

from labeling.core.views import RgbdViews
from labeling.generator.cloud.voxel_cloud import Cloud

COMMON = 0.2
"""The floor is the lowest layer with at least this share of the points of the fullest layer."""
LOW = 0.25
"""Largest height of ground above or below the floor, in object sizes."""
SIDE = 0.75
"""Side of the square that a level surface of the ground must be as large as, in object sizes: larger than a lamp's
foot."""
STEP = 0.01
"""Largest difference in height of neighbouring points of a level surface, and least height of pixels above the ground
to count as above it, in object sizes."""
DEVIATIONS = 3.0
"""The latter in standard deviations of pixels of the ground, if that is more."""
MIN_PIXELS = 2
"""Least number of pixels above the ground in a voxel; fewer are noise."""
STANDS = 0.05
"""Least share of an object's points that are higher than a voxel above the ground; what has less is flat on it, such as
a rug."""
MOSTLY = 0.5
"""A detection shows mostly ground if more than this share of its voxels is in it. Chosen in training homes, where a
third was worse: tables' legs stand in what is taken away."""
MAX_CELLS = 16_000_000
"""Most columns that the ground is looked for in, to bound memory: of wide scenes with small voxels they are wider."""
SAMPLED = 4
"""The standard deviation is measured in every so-many-th row and column."""


def floor_height(points: Float32[np.ndarray, "n 3"], voxel_m: float) -> float:
    """Height of the lowest large horizontal surface of a cloud, metres; +Z is up."""
    heights = np.asarray(points[:, 2], float)
    low = float(np.quantile(heights, 0.001))
    layer = np.floor((heights[heights >= low] - low) / voxel_m).astype(int)
    count = np.bincount(layer)
    count[:-1] += count[1:]  # a surface on the border of two layers
    lowest = int(np.flatnonzero(count >= COMMON * count.max())[0])
    inside = (heights >= low + lowest * voxel_m) & (heights < low + (lowest + 2) * voxel_m)
    return float(np.median(heights[inside]))


@dataclass(frozen=True, eq=False)
class Ground:
    """The height of the ground at each point of a cloud."""

    height_m: Float32[np.ndarray, "n"]
    """Height of the ground below each point, or nearest to it horizontally; metres, world."""
    rise_m: float
    """Pixels higher than this above the ground are not of the ground, metres."""
    pixels_above: Int32[np.ndarray, "n"]
    """Number of pixels of each voxel that are above the ground."""

    @property
    def top_m(self) -> Float32[np.ndarray, "n"]:
        """Height above which pixels of each voxel are not of the ground; metres, world."""
        return self.height_m + np.float32(self.rise_m)


def find_ground(cloud: Cloud, views: RgbdViews, free: Bool[np.ndarray, "n"], object_m: float) -> Ground:
    """Finds the ground of an episode: large level surfaces near the floor; elsewhere it is as high as the nearest one.

    Args:
        cloud: the points.
        views: those that the cloud was made from.
        free: whether each point belongs to no object.
        object_m: size of a typical object, metres.
    """
    voxel_m, points = cloud.voxel_m, cloud.points
    floor_m = floor_height(points, voxel_m)
    wide_m = np.ptp(points[:, :2].astype(float), axis=0)
    edge_m = max(voxel_m, float(np.sqrt(np.prod(wide_m) / MAX_CELLS)))
    column = np.floor(points[:, :2] / edge_m).astype(np.int64)
    column -= column.min(axis=0)
    lowest = np.full(column.max(axis=0) + 1, np.inf, np.float32)
    low = np.flatnonzero(free & (np.abs(points[:, 2] - floor_m) < max(LOW * object_m, voxel_m)))
    _lower(lowest, column, low, points)
    level_m = np.float32(STEP * object_m)
    _keep_level(lowest, level_m, (SIDE * object_m / edge_m) ** 2, np.float32(floor_m))
    height_m = lowest[column[:, 0], column[:, 1]]
    above_m, rows = points[:, 2] - height_m, height_coefficients(views)
    flat = free & (np.abs(above_m) < 0.5 * voxel_m)
    errors = _errors(views.depth_m, cloud.voxel_of_pixel, rows, height_m, flat, SAMPLED)
    spread_m = 1.4826 * float(np.median(np.abs(errors))) if len(errors) else 0.0
    rise_m = max(float(level_m), DEVIATIONS * spread_m)
    mixed = np.abs(above_m) < 2 * voxel_m + rise_m
    pixels = np.where(above_m > 0, cloud.counts, np.int32(0))
    _count_above(views.depth_m, cloud.voxel_of_pixel, rows, height_m + np.float32(rise_m), mixed, pixels)
    return Ground(height_m, rise_m, pixels)


def seeds_above_ground(cloud: Cloud, voxels: Int32[np.ndarray, "v"], ground: Ground) -> Int32[np.ndarray, "k"]:
    """What a detection shows, without the ground if that is most of it: between the spokes of a bicycle, under a table.

    Args:
        cloud: the points.
        voxels: indices of points.
        ground: of the same points.

    Returns:
        All of them if most are above the ground, or if what is shown is flat on it.
    """
    inside = _in_ground(cloud, voxels, ground)
    high = np.count_nonzero(cloud.points[voxels, 2] - ground.height_m[voxels] > cloud.voxel_m)
    if high < STANDS * len(voxels) or np.count_nonzero(inside) <= MOSTLY * len(voxels):
        return voxels
    return voxels[~inside]


def ground_of_objects(
    cloud: Cloud, owner: Int32[np.ndarray, "n"], num_objects: int, ground: Ground
) -> Bool[np.ndarray, "n"]:
    """Points that objects have of the ground they stand on; none of objects that are flat on it.

    Args:
        cloud: the points.
        owner: the object that each point belongs to, -1 for none.
        num_objects: how many objects there are.
        ground: of the same points.
    """
    above_m, owned = cloud.points[:, 2] - ground.height_m, owner >= 0
    high = np.bincount(owner[owned & (above_m > cloud.voxel_m)], minlength=num_objects)
    stands = high >= STANDS * np.bincount(owner[owned], minlength=num_objects)
    inside = np.zeros(cloud.num_points, bool)
    inside[owned] = stands[owner[owned]] & _in_ground(cloud, np.flatnonzero(owned), ground)
    return inside


def _in_ground(cloud: Cloud, voxels: Int[np.ndarray, "v"], ground: Ground) -> Bool[np.ndarray, "v"]:
    """Which of some voxels are of the ground."""
    near = np.abs(cloud.points[voxels, 2] - ground.height_m[voxels]) < 0.5 * cloud.voxel_m
    return near & (ground.pixels_above[voxels] < MIN_PIXELS)


def height_coefficients(views: RgbdViews) -> Float64[np.ndarray, "views 4"]:
    """For each view a, b, c, d: the height of what pixel (x, y) shows at depth z is (a x + b y + c) z + d, metres."""
    k, pose = np.asarray(views.intrinsics, float), np.asarray(views.camera_to_world, float)
    a, b = pose[:, 2, 0] / k[:, 0, 0], pose[:, 2, 1] / k[:, 1, 1]
    return np.stack([a, b, pose[:, 2, 2] - a * k[:, 0, 2] - b * k[:, 1, 2], pose[:, 2, 3]], axis=1)


@njit(cache=True, nogil=True)
def _lower(lowest, column, chosen, points):  # pragma: no cover - compiled
    """Lowers ``lowest`` (a, b) to the heights of the ``chosen`` points (n, 3) in its columns (n, 2), in place."""
    for p in chosen:
        i, j = column[p]
        lowest[i, j] = min(lowest[i, j], points[p, 2])


@njit(cache=True, nogil=True)
def _keep_level(height, step, cells, floor):  # pragma: no cover - compiled
    """Keeps the heights of large level surfaces; all others become that of the nearest of these, in place.

    Args:
        height: (a, b) float32, metres, infinite where nothing is known.
        step: by which neighbours in a level surface differ at most, metres.
        cells: that a surface has at least.
        floor: the height everywhere if there is no surface, metres.
    """
    rows, columns = height.shape
    queue, count = np.empty(rows * columns, np.int64), 0
    seen, ground = np.zeros((rows, columns), np.bool_), np.zeros((rows, columns), np.bool_)
    for start in range(rows * columns):
        if seen[start // columns, start % columns] or not np.isfinite(height[start // columns, start % columns]):
            continue
        seen[start // columns, start % columns] = True
        first, last = count, count + 1
        queue[first] = start
        while first < last:
            y, x = queue[first] // columns, queue[first] % columns
            first += 1
            for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                v, u = y + dy, x + dx
                if 0 <= v < rows and 0 <= u < columns and not seen[v, u] and abs(height[v, u] - height[y, x]) <= step:
                    seen[v, u] = True
                    queue[last] = v * columns + u
                    last += 1
        if last - count >= cells:
            for place in queue[count:last]:
                ground[place // columns, place % columns] = True
            count = last
    if count == 0:
        height[:] = floor
    first = 0
    while first < count:
        y, x = queue[first] // columns, queue[first] % columns
        first += 1
        for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            v, u = y + dy, x + dx
            if 0 <= v < rows and 0 <= u < columns and not ground[v, u]:
                ground[v, u] = True
                height[v, u] = height[y, x]
                queue[count] = v * columns + u
                count += 1


@njit(cache=True, nogil=True)
def _errors(depth_m, voxels, rows, ground_m, flat, stride):  # pragma: no cover - compiled
    """How far pixels in the ground lie above or below it, metres.

    Args:
        depth_m: (views, h, w) float32.
        voxels: (views, h, w) int32, voxel of each pixel, -1 for none.
        rows: (views, 4) float64, of ``height_coefficients``.
        ground_m: (n,) float32.
        flat: (n,) bool, which voxels are ground.
        stride: of the pixels looked at.

    Returns:
        (e,) float32.
    """
    views, height, width = voxels.shape
    found, count = np.empty(views * (height // stride + 1) * (width // stride + 1), np.float32), 0
    for view in range(views):
        a, b, c, d = rows[view]
        for y in range(0, height, stride):
            for x in range(0, width, stride):
                voxel = voxels[view, y, x]
                if voxel >= 0 and flat[voxel]:
                    found[count] = (a * x + b * y + c) * depth_m[view, y, x] + d - ground_m[voxel]
                    count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def _count_above(depth_m, voxels, rows, top_m, mixed, pixels):  # pragma: no cover - compiled
    """Counts the pixels above the ground in voxels that may hold both, in place; arguments as for ``_errors``.

    Args:
        depth_m: (views, h, w) float32.
        voxels: (views, h, w) int32.
        rows: (views, 4) float64.
        top_m: (n,) float32, height above which pixels show no ground.
        mixed: (n,) bool, the voxels to look at.
        pixels: (n,) int32, receives the counts of these.
    """
    views, height, width = voxels.shape
    for voxel in range(len(mixed)):
        if mixed[voxel]:
            pixels[voxel] = 0
    for view in range(views):
        a, b, c, d = rows[view]
        for y in range(height):
            for x in range(width):
                voxel = voxels[view, y, x]
                if voxel >= 0 and mixed[voxel] and (a * x + b * y + c) * depth_m[view, y, x] + d > top_m[voxel]:
                    pixels[voxel] += 1
