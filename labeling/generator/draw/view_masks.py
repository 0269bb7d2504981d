"""From points with probabilities to masks: modal (what a view sees of each object) and amodal (all of it)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64, UInt8
from numba import njit

from labeling.generator.draw.edge_filter import ITERATIONS, REACH_FACTOR, feedback_maps, next_iteration, smooth_once

OTHER_VIEW_WEIGHT = np.float32(0.3)
"""Weight of the points of other views where a view has no depth itself: poses are less exact than depth."""
NO_OBJECT = -2
"""Instead of a voxel: the pixel shows none of any object."""
MIN_WEIGHT = 1e-4
"""Below this total weight nothing is known near a pixel, and it belongs to no object."""
NEGLIGIBLE_PROBABILITY = np.float32(0.005)
"""Probabilities below this are taken for 0 where a view shows nothing likelier of the object nearby."""


@dataclass(frozen=True)
class ViewChances:
    """Probability of every object at every pixel of a view, in the windows that objects can appear in."""

    size: tuple[int, int]
    windows: Int64[np.ndarray, "k 4"]
    """First row, one past the last, first column, one past the last; zeros for objects out of view."""
    start: Int64[np.ndarray, "k1"]
    """Where the window of each object starts in ``chance``."""
    chance: Float32[np.ndarray, "c"]
    """Window after window, row by row."""
    known: Bool[np.ndarray, "h w"]
    """Whether anything is known at a pixel; pixels out of all windows are of no importance."""

    def masks(
        self, exclusive: bool
    ) -> tuple[Int32[np.ndarray, "h w"], Int64[np.ndarray, "k"], Float32[np.ndarray, "k"]]:
        """The object that each pixel belongs to, -1 for none: the likeliest, if likelier than the background.

        Args:
            exclusive: whether probabilities sum to at most 1; if not, the background's is 1 - that of the likeliest.

        Returns:
            That, and for each object its pixels and its mean probability in them.
        """
        return _masks(self.windows, self.start, self.chance, self.known, exclusive)

    def dense(self) -> Float32[np.ndarray, "h w k"]:
        """The probabilities over the whole picture."""
        planes = np.zeros((len(self.windows), *self.size), np.float32)
        for plane, first, (top, bottom, left, right) in zip(planes, self.start, self.windows, strict=False):
            shape = (bottom - top, right - left)
            plane[top:bottom, left:right] = self.chance[first : first + shape[0] * shape[1]].reshape(shape)
        return np.moveaxis(planes, 0, -1)


def view_chances(
    rgb: UInt8[np.ndarray, "h w 3"],
    voxels: Int32[np.ndarray, "h w"],
    rendered: Int32[np.ndarray, "h w"] | None,
    probability: Float32[np.ndarray, "n k"],
    reach_px: float,
    edge: float,
    likely: Bool[np.ndarray, "n"] | None = None,
) -> ViewChances:
    """Probability of every object at the pixels of a view.

    A pixel with depth starts from its own 3-D point, so hidden objects do not shine through; one without depth from
    the nearest point that other views have put there. The edge-aware filter then carries values to pixels about which
    nothing is known, and from the voxel grid to the colour edges of the picture.

    Args:
        rgb: colour of the view.
        voxels: voxel of each pixel, -1 without depth.
        rendered: voxel of the nearest point that other views put at each pixel, -1 for none, ``NO_OBJECT`` where there
            is no object; None if there is no need.
        probability: of each object in each voxel.
        reach_px: reach of the filter where colour is flat.
        edge: sum of colour differences (channels in [0, 1]) that counts as much as ``reach_px`` pixels.
        likely: ``likely_voxels(probability)``, if that is known.
    """
    likely = likely_voxels(probability) if likely is None else likely
    voxels, weight = np.ascontiguousarray(voxels), np.ones(voxels.shape, np.float32)
    holes = voxels < 0
    if holes.any():
        weight[holes] = 0
        if rendered is not None:
            weight[holes & (rendered != -1)] = OTHER_VIEW_WEIGHT
            voxels = np.where(holes, rendered, voxels)
    margin = int(np.ceil(REACH_FACTOR * reach_px)) + 1
    windows = _windows(voxels, probability, likely, NEGLIGIBLE_PROBABILITY, margin)
    start = np.concatenate([[0], np.cumsum((windows[:, 1] - windows[:, 0]) * (windows[:, 3] - windows[:, 2]))])
    seen = windows[windows[:, 1] > 0]
    if len(seen) == 0:
        return ViewChances(voxels.shape, windows, start, np.zeros(0, np.float32), weight > 0)
    # Nothing outside of the windows counts.
    top, left, bottom, right = (*seen[:, [0, 2]].min(axis=0), *seen[:, [1, 3]].max(axis=0))
    crop = slice(top, bottom), slice(left, right)
    across, down = feedback_maps(rgb[crop], reach_px, edge)
    total = np.ascontiguousarray(weight[crop])
    full = not holes[crop].any()
    chance = np.empty(start[-1], np.float32)
    _fill(voxels, weight, probability, windows, start, across, down, total, full, top, left, chance)
    known = np.ones(voxels.shape, bool)
    known[crop] = total > MIN_WEIGHT
    return ViewChances(voxels.shape, windows, start, chance, known)


def likely_voxels(probability: Float32[np.ndarray, "n k"]) -> Bool[np.ndarray, "n"]:
    """Voxels that may belong to any object."""
    return np.any(probability > NEGLIGIBLE_PROBABILITY, axis=1)


@njit(cache=True, nogil=True)
def _windows(voxels, probability, likely, negligible, margin):  # pragma: no cover - compiled
    """The window of the picture that each object can appear in.

    Args:
        voxels: (h, w) int32, voxel of each pixel, below 0 for none.
        probability: (n, k) float32, of each object in each voxel.
        likely: (n,) bool, whether any of these is above ``negligible``.
        negligible: probabilities up to this count as 0.
        margin: added on all sides, pixels.

    Returns:
        (k, 4) int64: first row, one past the last, first column, one past the last; zeros for those out of view.
    """
    height, width = voxels.shape
    objects = probability.shape[1]
    windows = np.zeros((objects, 4), np.int64)
    for k in range(objects):
        windows[k, 0], windows[k, 2] = height, width
    for y in range(height):
        last = np.int32(-1)
        for x in range(width):
            voxel = voxels[y, x]
            if voxel < 0 or not likely[voxel] or (voxel == last and x + 1 < width and voxels[y, x + 1] == voxel):
                continue
            last = voxel
            for k in range(objects):
                if probability[voxel, k] > negligible:
                    windows[k, 0] = min(windows[k, 0], y)
                    windows[k, 1] = y + 1
                    windows[k, 2] = min(windows[k, 2], x)
                    windows[k, 3] = max(windows[k, 3], x + 1)
    for k in range(objects):
        if windows[k, 1] == 0:
            windows[k] = 0
        else:
            windows[k, 0], windows[k, 1] = max(0, windows[k, 0] - margin), min(height, windows[k, 1] + margin)
            windows[k, 2], windows[k, 3] = max(0, windows[k, 2] - margin), min(width, windows[k, 3] + margin)
    return windows


@njit(cache=True, nogil=True)
def _fill(
    voxels, weight, probability, windows, start, across, down, total, full, top, left, chance
):  # pragma: no cover - compiled
    """Edge-aware means of the objects' probabilities over their windows.

    Args:
        voxels: (h, w) int32, below 0 for none.
        weight: (h, w) float32, of each pixel.
        probability: (n, k) float32, of each object in each voxel.
        windows: (k, 4) int64, of ``_windows``.
        start: (k + 1,) int64, of ``ViewChances``.
        across: feedback along rows (``edge_filter.feedback_maps``) of the part of the picture that holds all windows;
            that of the last iteration afterwards.
        down: the same along columns.
        total: (ch, cw) float32, the weight in that part, filtered in place.
        full: whether it is 1 everywhere, so that there is nothing to filter.
        top: first row of the part.
        left: its first column.
        chance: (c,) float32, of ``ViewChances``, filled in place.
    """
    for k in range(len(windows)):
        place = start[k]
        for y in range(windows[k, 0], windows[k, 1]):
            for x in range(windows[k, 2], windows[k, 3]):
                voxel = voxels[y, x]
                chance[place] = weight[y, x] * probability[voxel, k] if voxel >= 0 else np.float32(0)
                place += 1
    for iteration in range(ITERATIONS):
        if iteration > 0:
            next_iteration(across, down)
        if not full:
            smooth_once(total, across, down, 0, 0)
        for k in range(len(windows)):
            height, width = windows[k, 1] - windows[k, 0], windows[k, 3] - windows[k, 2]
            if height > 0:
                plane = chance[start[k] : start[k + 1]].reshape((height, width))
                smooth_once(plane, across, down, windows[k, 0] - top, windows[k, 2] - left)
    if not full:
        for k in range(len(windows)):
            place = start[k]
            for y in range(windows[k, 0] - top, windows[k, 1] - top):
                for x in range(windows[k, 2] - left, windows[k, 3] - left):
                    chance[place] /= max(total[y, x], np.float32(1e-12))
                    place += 1


@njit(cache=True, nogil=True)
def _masks(windows, start, chance, known, exclusive):  # pragma: no cover - compiled
    """What ``ViewChances.masks`` returns; its arguments are those of ``ViewChances``."""
    height, width = known.shape
    objects = len(windows)
    owner = np.full((height, width), -1, np.int32)
    pixels, sums = np.zeros(objects, np.int64), np.zeros(objects, np.float64)
    highest, total = np.empty(width, np.float32), np.empty(width, np.float32)
    top, bottom, left, right = height, 0, width, 0
    for k in range(objects):
        if windows[k, 1] > 0:
            top, bottom = min(top, windows[k, 0]), max(bottom, windows[k, 1])
            left, right = min(left, windows[k, 2]), max(right, windows[k, 3])
    for y in range(top, bottom):
        highest[left:right], total[left:right] = np.float32(0), np.float32(0)
        for k in range(objects):
            if not windows[k, 0] <= y < windows[k, 1]:
                continue
            place = start[k] + (y - windows[k, 0]) * (windows[k, 3] - windows[k, 2])
            for x in range(windows[k, 2], windows[k, 3]):
                value = chance[place]
                place += 1
                total[x] += value
                if value > highest[x]:
                    highest[x] = value
                    owner[y, x] = k
        for x in range(left, right):
            taken = total[x] if exclusive else highest[x]
            if owner[y, x] >= 0:
                if known[y, x] and highest[x] > np.float32(1.0) - taken:
                    pixels[owner[y, x]] += 1
                    sums[owner[y, x]] += highest[x]
                else:
                    owner[y, x] = -1
    means = np.zeros(objects, np.float32)
    for k in range(objects):
        means[k] = sums[k] / max(pixels[k], 1)
    return owner, pixels, means


def point_owners(probability: Float32[np.ndarray, "n k"], exclusive: bool) -> Int32[np.ndarray, "n"]:
    """The object each point belongs to, -1 for none: the likeliest, if likelier than the background.

    Args:
        probability: of each object at each point.
        exclusive: whether they sum to at most 1; if not, the background's is 1 - that of the likeliest.
    """
    return _owners(np.ascontiguousarray(probability), exclusive)


@njit(cache=True, nogil=True)
def _owners(probability, exclusive):  # pragma: no cover - compiled
    """What ``point_owners`` returns."""
    owner = np.full(len(probability), -1, np.int32)
    for p in range(len(probability)):
        highest, total = np.float32(0), np.float32(0)
        for k in range(probability.shape[1]):
            value = probability[p, k]
            total += value
            if value > highest:
                highest, owner[p] = value, k
        if not highest > np.float32(1.0) - (total if exclusive else highest):
            owner[p] = -1
    return owner
