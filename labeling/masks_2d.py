"""From points with probabilities to masks: modal (what a view sees of each object) and amodal (all of it)."""

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from labeling.edge_filter import edge_aware_fill

BORROWED_TRUST = np.float32(0.3)
"""Weight of what other views show where a view has no depth: poses are less exact than a view's own depth."""
MIN_TRUST = 1e-4
"""Below this total weight nothing is known near a pixel, and it belongs to no object."""


def view_probabilities(
    rgb: UInt8[np.ndarray, "h w 3"],
    voxels: Int32[np.ndarray, "h w"],
    borrowed: Int32[np.ndarray, "h w"] | None,
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
        borrowed: voxel that other views show at each pixel, -1 for none; None if every pixel has depth.
        probability: of each object in each voxel.
        reach_px: reach of the filter where colour is flat.
        edge: sum of colour differences (channels in [0, 1]) that counts as much as ``reach_px`` pixels.

    Returns:
        The probabilities, and whether anything is known at a pixel.
    """
    trust = (voxels >= 0).astype(np.float32)
    if borrowed is not None:
        trust[(voxels < 0) & (borrowed >= 0)] = BORROWED_TRUST
        voxels = np.where(voxels >= 0, voxels, borrowed)
    values = np.where((voxels >= 0)[:, :, None], probability[np.maximum(voxels, 0)], np.float32(0))
    guide = rgb.astype(np.float32) / np.float32(255)
    filled, total = edge_aware_fill(values, trust, guide, reach_px, edge)
    return filled, total > MIN_TRUST


def modal_masks(
    probability: Float32[np.ndarray, "h w k"], known: Bool[np.ndarray, "h w"], exclusive: bool
) -> Int32[np.ndarray, "h w"]:
    """The object each pixel belongs to, -1 for none: the likeliest, if likelier than the background."""
    if probability.shape[2] == 0:
        return np.full(known.shape, -1, np.int32)
    best = probability.argmax(axis=2).astype(np.int32)
    highest = np.take_along_axis(probability, best[:, :, None], axis=2)[:, :, 0]
    background = 1 - probability.sum(axis=2) if exclusive else 1 - highest
    return np.where(known & (highest > background), best, np.int32(-1))
