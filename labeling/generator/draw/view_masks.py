"""From points with probabilities to masks: modal (what a view sees of each object) and amodal (all of it)."""

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8
from numba import njit

from labeling.generator.draw.edge_filter import REACH_FACTOR, feedback_maps, smooth

OTHER_VIEW_WEIGHT = np.float32(0.3)
"""Weight of the points of other views where a view has no depth itself: poses are less exact than depth."""
MIN_WEIGHT = 1e-4
"""Below this total weight nothing is known near a pixel, and it belongs to no object."""
NEGLIGIBLE_PROBABILITY = np.float32(0.005)
"""Probabilities below this are taken for 0 where a view shows nothing likelier of the object nearby."""


def view_probabilities(
    rgb: UInt8[np.ndarray, "h w 3"],
    voxels: Int32[np.ndarray, "h w"],
    rendered: Int32[np.ndarray, "h w"] | None,
    probability: Float32[np.ndarray, "n k"],
    reach_px: float,
    edge: float,
) -> tuple[Float32[np.ndarray, "h w k"], Bool[np.ndarray, "h w"]]:
    """Probability of every object at every pixel of a view.

    A pixel with depth starts from its own 3-D point, so hidden objects do not shine through; one without depth from
    the nearest point that other views have put there. The edge-aware filter then carries values to pixels about which
    nothing is known, and from the voxel grid to the colour edges of the picture.

    Args:
        rgb: colour of the view.
        voxels: voxel of each pixel, -1 without depth.
        rendered: voxel of the nearest point that any view puts at each pixel, -1 for none; None if every pixel has
            depth.
        probability: of each object in each voxel.
        reach_px: reach of the filter where colour is flat.
        edge: sum of colour differences (channels in [0, 1]) that counts as much as ``reach_px`` pixels.

    Returns:
        The probabilities, and whether anything is known at a pixel.
    """
    weight = (voxels >= 0).astype(np.float32)
    if rendered is not None:
        weight[(voxels < 0) & (rendered >= 0)] = OTHER_VIEW_WEIGHT
        voxels = np.where(voxels >= 0, voxels, rendered)
    across, down = feedback_maps(rgb, reach_px, edge)
    total = weight.copy()
    smooth(total, across, down)
    margin = int(np.ceil(REACH_FACTOR * reach_px)) + 1
    windows = _windows(np.ascontiguousarray(voxels), probability, NEGLIGIBLE_PROBABILITY, margin)
    planes = np.zeros((probability.shape[1], *voxels.shape), np.float32)
    for k, (top, bottom, left, right) in enumerate(windows.tolist()):
        if bottom > top:
            window = slice(top, bottom), slice(left, right)
            maps = across[:, *window], down[:, *window]
            planes[k][window] = _fill(voxels[window], weight[window], total[window], probability[:, k], *maps)
    return np.moveaxis(planes, 0, -1), total > MIN_WEIGHT


@njit(cache=True, nogil=True)
def _windows(voxels, probability, negligible, margin):  # pragma: no cover - compiled
    """The window of the picture that each object can appear in.

    Args:
        voxels: (h, w) int32, voxel of each pixel, -1 for none.
        probability: (n, k) float32, of each object in each voxel.
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
        x = 0
        while x < width:
            voxel, first = voxels[y, x], x
            while x < width and voxels[y, x] == voxel:
                x += 1
            if voxel < 0:
                continue
            for k in range(objects):
                if probability[voxel, k] > negligible:
                    windows[k, 0] = min(windows[k, 0], y)
                    windows[k, 1] = y + 1
                    windows[k, 2] = min(windows[k, 2], first)
                    windows[k, 3] = max(windows[k, 3], x)
    for k in range(objects):
        if windows[k, 1] == 0:
            windows[k] = 0
        else:
            windows[k, 0], windows[k, 1] = max(0, windows[k, 0] - margin), min(height, windows[k, 1] + margin)
            windows[k, 2], windows[k, 3] = max(0, windows[k, 2] - margin), min(width, windows[k, 3] + margin)
    return windows


@njit(cache=True, nogil=True)
def _fill(voxels, weight, total, probability, across, down):  # pragma: no cover - compiled
    """Edge-aware means of one object's probability over a window of the picture.

    Args:
        voxels: (h, w) int32, -1 for none.
        weight: (h, w) float32, of each pixel.
        total: (h, w) float32, the filtered weight.
        probability: (n,) float32, of the object in each voxel.
        across: (i, h, w) float32, feedback along rows (``edge_filter.feedback_maps``).
        down: the same along columns.

    Returns:
        (h, w) float32.
    """
    height, width = voxels.shape
    plane = np.zeros((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            if voxels[y, x] >= 0:
                plane[y, x] = weight[y, x] * probability[voxels[y, x]]
    smooth(plane, across, down)
    for y in range(height):
        for x in range(width):
            plane[y, x] /= max(total[y, x], np.float32(1e-12))
    return plane


def modal_masks(
    probability: Float32[np.ndarray, "h w k"], known: Bool[np.ndarray, "h w"], exclusive: bool
) -> Int32[np.ndarray, "h w"]:
    """The object each pixel belongs to, -1 for none: the likeliest, if likelier than the background."""
    if probability.shape[2] == 0:
        return np.full(known.shape, -1, np.int32)
    planes = np.ascontiguousarray(np.moveaxis(probability, -1, 0), np.float32)
    return _argmax_masks(planes, np.ascontiguousarray(known), exclusive)


@njit(cache=True, nogil=True)
def _argmax_masks(planes, known, exclusive):  # pragma: no cover - compiled
    """The likeliest object at each pixel, (h, w) int32, -1 where the background is likelier or nothing is known.

    Args:
        planes: (k, h, w) float32, probabilities.
        known: (h, w) bool.
        exclusive: whether probabilities sum to at most 1; if not, the background's is 1 - that of the likeliest.
    """
    objects, height, width = planes.shape
    best = np.full((height, width), -1, np.int32)
    highest, total = np.empty(width, np.float32), np.empty(width, np.float32)
    for y in range(height):
        highest[:], total[:] = np.float32(0.0), np.float32(0.0)
        for k in range(objects):
            for x in range(width):
                value = planes[k, y, x]
                total[x] += value
                if value > highest[x]:
                    highest[x] = value
                    best[y, x] = k
        for x in range(width):
            taken = total[x] if exclusive else highest[x]
            if not (known[y, x] and highest[x] > np.float32(1.0) - taken):
                best[y, x] = -1
    return best


def point_owners(probability: Float32[np.ndarray, "n k"], exclusive: bool) -> Int32[np.ndarray, "n"]:
    """The object each point belongs to, -1 for none: as pixels are decided."""
    return modal_masks(probability[None], np.ones((1, len(probability)), bool), exclusive)[0]
