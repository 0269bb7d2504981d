"""The defects of the published code, each under a flag of its own, so that what it costs can be measured.

Source: field notes; the code published with the thesis (github.com/ayushjain1144/SeeingByMoving) for the details.
None is on unless asked for; ``--preset released`` turns all of them on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32

from labeling.core.types import PseudoLabel
from labeling.io.label_records import EpisodeRecord

MAX_CIRCLE = 0.5
"""Radius of the largest circle around a triangle of an outline, in sides of the mask's box: 1 / alpha, alpha 2."""
MAX_OUTLINE_POINTS = 2000
"""Bounds the time for an outline."""


@dataclass(frozen=True)
class PublishedDefects:
    """Mistakes of the published code. Each is a trap; none does any good."""

    empty_kernel: bool = False
    """The CRF's kernel matrix is all zeros (a comparison stands where an assignment was meant), so that every point is
    equally near to every other: a prior for whatever the majority of points is. Smoothness is the one kernel there;
    the appearance kernel is switched off."""
    first_two_outliers: bool = False
    """Outlier removal indexes the segmentation with integers instead of booleans: it removes points 0 and 1, and
    those alone."""
    full_confidence: bool = False
    """Every label is written with confidence 1, so that labels cannot be ranked."""
    drifting_classes: bool = False
    """Where a mask is skipped when labels are written (it has no outline) its class is not: the masks after it in that
    view each take the class of the one before."""
    whole_masks_only: bool = False
    """Labels whose mask is in two pieces or more are skipped when labels are written."""
    amodal_boxes: bool = False
    """The box written beside a modal mask is that of the amodal one."""
    missing_z_buffer: bool = False
    """All points of an object are drawn into every view, hidden ones too, and of two objects at a pixel the one written
    last wins, not the nearest."""


@dataclass(frozen=True)
class ConstantKernel:
    """The filter of a kernel matrix of zeros: no two points differ, so every point receives the sum over all points."""

    block_start: Int[np.ndarray, "b1"] | None = None
    """Where blocks of points begin that do not know of each other, and where the last one ends; None for one block."""

    def filter(self, values: Float32[np.ndarray, "n c"]) -> Float32[np.ndarray, "n c"]:
        """Sums over all points of a block, the same for each."""
        sums = np.empty_like(values)
        bounds = [0, len(values)] if self.block_start is None else self.block_start.tolist()
        for first, end in pairwise(bounds):
            sums[first:end] = values[first:end].sum(axis=0, dtype=np.float64)
        return sums


def first_two_points(count: int) -> Bool[np.ndarray, "n"]:
    """What ``segmentation[outlier.astype(int)] = 0`` removes of ``count`` points."""
    removed = np.zeros(count, bool)
    removed[:2] = True
    return removed


def with_label_defects(labels: Sequence[PseudoLabel], defects: PublishedDefects) -> tuple[PseudoLabel, ...]:
    """The labels as the defects of writing leave them.

    Args:
        labels: of all views, in the order they are written.
        defects: which there are.
    """
    found = list(labels)
    if defects.drifting_classes or defects.whole_masks_only:
        views = dict.fromkeys(one.view_index for one in labels)
        found = [
            left for view in views for left in _written([one for one in labels if one.view_index == view], defects)
        ]
    if defects.full_confidence:
        found = [replace(one, confidence=1.0, source_confidence=1.0) for one in found]
    return tuple(found)


def _written(labels: Sequence[PseudoLabel], defects: PublishedDefects) -> list[PseudoLabel]:
    """Labels of one view, less those that are skipped; with ``drifting_classes`` under the classes of all in turn."""
    kept = [
        one for one in labels if not is_line(one.modal) and (not defects.whole_masks_only or in_one_piece(one.modal))
    ]
    if not defects.drifting_classes:
        return kept
    return [replace(one, category=other.category) for one, other in zip(kept, labels, strict=False)]


def is_line(mask: Bool[np.ndarray, "h w"]) -> bool:
    """Whether all pixels of a mask lie in one row or one column, so that it has no outline; also if it has none."""
    return bool(min(np.count_nonzero(mask.any(axis=0)), np.count_nonzero(mask.any(axis=1))) < 2)


def in_one_piece(mask: Bool[np.ndarray, "h w"]) -> bool:
    """Whether the outline of a mask, as the published code draws it, is a single polygon.

    It is an alpha shape: the triangles of the Delaunay triangulation of the mask's pixels, scaled to a unit square,
    whose circumscribed circle has a radius below 1/2. Gaps small beside the mask are bridged.

    Source: published code (sparse_to_contour); Edelsbrunner et al., "On the shape of a set of points in the plane"
    (1983).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import Delaunay, QhullError

    if is_line(mask):
        return False
    pixels = np.argwhere(mask).astype(float)
    pixels = pixels[:: max(1, len(pixels) // MAX_OUTLINE_POINTS)]
    span = pixels.max(axis=0) - pixels.min(axis=0)
    try:
        triangles = Delaunay((pixels - pixels.min(axis=0)) / np.maximum(span, 1e-9))
    except QhullError:
        return False
    a, b, c = np.moveaxis(triangles.points[triangles.simplices], 1, 0)
    sides = [np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))]
    twice_area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    inside = np.prod(sides, axis=0) < 2 * twice_area * MAX_CIRCLE
    first = np.repeat(np.arange(len(inside)), 3)
    second = triangles.neighbors.ravel()
    joined = (second >= 0) & inside[first] & inside[second]
    graph = coo_array((np.ones(joined.sum()), (first[joined], second[joined])), shape=(len(inside), len(inside)))
    return len(np.unique(connected_components(graph)[1][inside])) == 1


def with_amodal_boxes(record: EpisodeRecord) -> EpisodeRecord:
    """An episode's record with the box of the whole object at each mask."""
    labels = (
        replace(label, modal=replace(label.modal, bbox=label.amodal.bbox)) if label.modal and label.amodal else label
        for label in record.labels
    )
    return replace(record, labels=tuple(labels))


def paint_in_order(drawn: Bool[np.ndarray, "k h w"]) -> Int32[np.ndarray, "h w"]:
    """What each pixel shows when objects are drawn one after the other whatever their depth: the last, -1 for none."""
    shown = np.full(drawn.shape[1:], -1, np.int32)
    for k in range(len(drawn)):
        shown[drawn[k]] = k
    return shown
