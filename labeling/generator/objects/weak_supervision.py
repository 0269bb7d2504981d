"""Weak supervision: one annotated view per object takes the place of the detector's confident detections.

Source: thesis A.6 (SbM-ws): any category name, also of things no detector knows.
"""

import zlib
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from labeling.core.types import Detection, GroundTruth

MIN_COVERED = 0.5
"""Of the share of an object's mask that depth covers in its best view."""


def one_view_per_object(
    truths: Sequence[GroundTruth],
    depth_m: Float32[np.ndarray, "views h w"],
    min_mask_px: int,
    seed: int,
    name: str = "",
) -> tuple[Detection, ...]:
    """For each object its true mask in one random view, as a detection with confidence 1 that is not eroded.

    The views of an object that can be drawn are those in which depth covers at least half the share of its mask that it
    covers at best: with dense depth, as in the thesis, all of them; with a sparse sensor not those that it is blind in,
    which nobody would choose to annotate.

    Args:
        truths: ground truth of an episode. What is to be ignored, or is smaller than ``min_mask_px``, is never chosen.
        depth_m: z-depth of the views, 0 where there is no return.
        min_mask_px: smallest mask that label generation uses, pixels.
        seed: chooses the views.
        name: of the episode, so that episodes draw independently.

    Returns:
        One detection per object, in the order of their ids; none for an object that no view shows large enough.
    """
    rng = np.random.default_rng([seed, zlib.crc32(name.encode(errors="surrogateescape"))])
    by_object: dict[int, list[GroundTruth]] = {}
    for truth in truths:
        if not truth.ignore and np.count_nonzero(truth.modal) >= max(1, min_mask_px):
            by_object.setdefault(truth.instance_id, []).append(truth)
    chosen = []
    for instance_id in sorted(by_object):
        views = sorted(by_object[instance_id], key=lambda truth: truth.view_index)
        covered = np.array([np.mean(depth_m[truth.view_index][truth.modal] > 0) for truth in views])
        views = [truth for truth, share in zip(views, covered, strict=True) if share >= MIN_COVERED * covered.max()]
        truth = views[int(rng.integers(len(views)))]
        chosen.append(Detection(truth.view_index, truth.category, 1.0, truth.modal, exact=True))
    return tuple(chosen)
