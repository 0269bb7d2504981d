"""Thin parts of objects, such as legs, stems and feet, found by geometry.

Detectors leave thin parts out of their masks, so that votes count against them, and they are narrower than the kernels
of the CRF. Without the ground, the points that belong to no object fall into connected pieces. A piece that lies beside
and below an object is a part of it if it touches it and is thin (so no wall and no other object), or if it supports it.
Outlines drawn by a person have such parts in them, so a piece that lies beside them is none.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32
from numba import njit

from labeling.core.boxes3d import fit_box
from labeling.core.views import RgbdViews
from labeling.generator.cloud.connected_components import label_cells
from labeling.generator.cloud.ground import MIN_PIXELS, Ground, height_coefficients
from labeling.generator.cloud.voxel_cloud import Cloud

MARGIN = 0.15
"""Largest overhang of a part beyond the object's box, as a share of the shorter horizontal side of the box."""
RING = 0.3
"""Width of the ring around that in which pieces are followed, in object sizes: those that go on there are no parts."""
INSIDE = 0.95
"""Least share of a part's points that lie within the margin and not above the object."""
BELOW = 0.98
"""Least share of the points of what carries an object that lie under it; where no view shows that they touch, of those
in the upper half of the part."""
TOUCH_VOXELS = 2.0
"""Largest distance of points that touch, in voxels."""
BALL_VOXELS = 3.5
"""Radius of the balls in which thickness is measured, in voxels."""
THIN = 0.257
"""Greatest second principal standard deviation of a thin piece's points in such a ball, as a share of its radius; in
planes it is .5."""
MAX_VOXELS = 2000
"""Largest number of voxels of a thin piece."""
CONTACT = 0.02
"""Least share of the points of a thick piece that touch the object it supports."""
HOVERS = 0.3
"""An object needs support if its lowest points are above the ground by this share of its height."""
RISES = 0.4
"""A support whose upper end is hidden must be seen up to this share of the way from the ground to the object."""
MIN_POINTS = 4
"""Least number of points of an object that can have parts."""


@dataclass(frozen=True, eq=False)
class ThinParts:
    """Voxels that belong to objects besides those of their segments."""

    owner: Int32[np.ndarray, "n"]
    """Index of the object whose part each voxel is, -1 for none."""
    top_m: Float32[np.ndarray, "n"]
    """Height above which the pixels of each voxel show no ground, metres."""
    rows: Float64[np.ndarray, "views 4"]
    """``ground.height_coefficients`` of the views."""

    def of_objects(self, numbers: Int[np.ndarray, "k"]) -> "ThinParts":
        """The parts of some objects, which are renumbered from 0 in this order."""
        place = np.full(max(int(self.owner.max(initial=-1)), int(np.max(numbers, initial=-1))) + 2, -1, np.int32)
        place[numbers] = np.arange(len(numbers))
        return ThinParts(place[self.owner], self.top_m, self.rows)


def find_thin_parts(
    cloud: Cloud,
    views: RgbdViews,
    owner: Int32[np.ndarray, "n"],
    num_objects: int,
    ground: Ground,
    object_m: float,
    beside: Mapping[int, Float32[np.ndarray, "n"]] | None = None,
) -> ThinParts:
    """Finds the thin parts of all objects of an episode.

    Args:
        cloud: the points.
        views: those that the cloud was made from.
        owner: the object that each point belongs to, -1 for none.
        num_objects: how many objects there are.
        ground: of the same points.
        object_m: size of a typical object, metres.
        beside: of objects that a person has drawn, how many outlines more have each voxel beside than within them.

    Returns:
        The parts. A piece that could be of two objects goes to the one that it touches in more points.
    """
    free = (owner < 0) & (ground.pixels_above >= MIN_PIXELS)
    found, contact = np.full(cloud.num_points, -1, np.int32), np.full(cloud.num_points, -1)
    for k in range(num_objects):
        own = np.flatnonzero(owner == k)
        if len(own) >= MIN_POINTS:
            for piece, touching in _parts(cloud, own, free, ground, object_m):
                if beside and k in beside and beside[k][piece].sum() > 0:
                    continue
                won = piece[contact[piece] < touching]
                found[won], contact[won] = k, touching
    return ThinParts(found, ground.top_m, height_coefficients(views))


def _parts(cloud: Cloud, own: Int[np.ndarray, "m"], free: Bool[np.ndarray, "n"], ground: Ground, object_m: float):
    """Yields the parts of the object with the points ``own``: their points, and how many of these touch the object."""
    from scipy.spatial import cKDTree

    points, voxel_m = cloud.points, cloud.voxel_m
    box = fit_box(points[own])
    if box is None:
        return
    bottom, top = np.quantile(points[own, 2], [0.02, 0.99])
    margin_m = max(MARGIN * float(np.min(box.extent_m[:2])), 2 * voxel_m)
    ring_m = max(RING * object_m, 3 * voxel_m)
    half = 0.5 * box.extent_m[:2]
    reaches = half + voxel_m, half + margin_m, half + margin_m + ring_m
    near, zone = _around(
        points, free, box.centre_m, box.rotation, *reaches, top + 0.5 * voxel_m, top + margin_m + ring_m
    )
    if not np.any(zone > 0):
        return
    cell = np.floor(points[near] / voxel_m).astype(np.int32)
    piece, count = label_cells(cell - cell.min(axis=0))
    order = np.argsort(piece, kind="stable")
    start = np.searchsorted(piece[order], np.arange(count + 1))
    inside = np.bincount(piece, weights=zone > 0, minlength=count) / np.bincount(piece, minlength=count)
    ground_m = float(np.mean(ground.height_m[own]))
    hovers = bottom - ground_m > HOVERS * (top - ground_m)
    tree = None
    for number in np.flatnonzero(inside >= INSIDE):
        rows = order[start[number] : start[number + 1]]
        members = near[rows]
        tree = tree or cKDTree(points[own])
        distance, _ = tree.query(points[members], distance_upper_bound=TOUCH_VOXELS * voxel_m)
        touching = int(np.count_nonzero(np.isfinite(distance)))
        heights_m = points[members, 2]
        stands = np.min(heights_m - ground.top_m[members]) < 1.5 * voxel_m
        thin = _is_thin(cell[rows])
        carries = inside[number] >= BELOW and stands and touching >= max(2, CONTACT * len(members))
        hidden = (
            stands
            and hovers
            and _upper_half(zone[rows] > 1, heights_m) >= BELOW
            and heights_m.max() - ground_m > RISES * (bottom - ground_m)
        )
        if (touching and thin) or carries or (hidden and thin):
            yield members, touching


def _upper_half(under: Bool[np.ndarray, "m"], heights_m: Float32[np.ndarray, "m"]) -> float:
    """Which share of the upper half of a piece lies under an object: feet may spread, a stem may not lean."""
    return float(np.mean(under[2 * heights_m >= heights_m.min() + heights_m.max()]))


def _is_thin(cell: Int32[np.ndarray, "m 3"]) -> bool:
    """Whether a piece is thin: in small balls around its points the points lie along lines."""
    if len(cell) > MAX_VOXELS:
        return False
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(_covariances(cell, BALL_VOXELS))[:, 1], 0))
    return len(cell) < MIN_POINTS or float(spread.mean()) < THIN * BALL_VOXELS


@njit(cache=True, nogil=True)
def _around(points, free, centre, rotation, under, beside, ring, top, limit):  # pragma: no cover - compiled
    """Free points under and around an object.

    Args:
        points: (n, 3) float32, world, metres.
        free: (n,) bool, which of them belong to no object.
        centre: (3,) float64, of its box.
        rotation: (3, 3) float64, of its box, whose third axis points up.
        under: (2,) float64, how far from the centre they lie under it, along the box's horizontal axes.
        beside: (2,) float64, the same for what may be a part of it.
        ring: (2,) float64, the same for what is looked at.
        top: up to which height parts may be.
        limit: up to which height points are looked at.

    Returns:
        Their indices (m,) int64, and for each 2 under the object, 1 beside it, 0 beyond (m,) int8.
    """
    found, zone, count = np.empty(len(points), np.int64), np.empty(len(points), np.int8), 0
    for p in range(len(points)):
        if not free[p] or points[p, 2] > limit:
            continue
        x, y = points[p, 0] - centre[0], points[p, 1] - centre[1]
        along = abs(x * rotation[0, 0] + y * rotation[1, 0])
        across = abs(x * rotation[0, 1] + y * rotation[1, 1])
        if along > ring[0] or across > ring[1]:
            continue
        found[count], zone[count] = p, 0
        if points[p, 2] <= top and along <= beside[0] and across <= beside[1]:
            zone[count] = 2 if along <= under[0] and across <= under[1] else 1
        count += 1
    return found[:count].copy(), zone[:count].copy()


@njit(cache=True, nogil=True)
def _covariances(cell, radius):  # pragma: no cover - compiled
    """Covariance (m, 3, 3) of those of the cells (m, 3) that lie within ``radius`` of each."""
    found = np.zeros((len(cell), 3, 3))
    for p in range(len(cell)):
        number, mean = 0.0, np.zeros(3)
        for q in range(len(cell)):
            a, b, c = cell[q, 0] - cell[p, 0], cell[q, 1] - cell[p, 1], cell[q, 2] - cell[p, 2]
            if a * a + b * b + c * c <= radius * radius:
                number += 1
                apart = (a, b, c)
                for i in range(3):
                    mean[i] += apart[i]
                    for j in range(3):
                        found[p, i, j] += apart[i] * apart[j]
        for i in range(3):
            for j in range(3):
                found[p, i, j] = found[p, i, j] / number - mean[i] * mean[j] / number**2
    return found
