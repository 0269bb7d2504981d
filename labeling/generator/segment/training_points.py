"""Where an object may be, and which of its points a classifier learns from."""

import numpy as np
from jaxtyping import Bool, Float32, Int

from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.settings.label_config import LabelConfig

CROP_STEP_M = 1.0
"""By this much a crop grows at a time. Source: field notes (published code)."""
TRAINING_POINTS = 300
"""Per class. Source: field notes (published code)."""
HARD_SHARE = 0.5
"""Share of the background's training points that comes from next to the masks. Source: field notes."""
OUTER_SHARE = 0.2
"""Share of the seeds that count as the outer ones. Source: published code."""


def crop_around(
    cloud: Cloud,
    foreground: Int[np.ndarray, "f"],
    against: Bool[np.ndarray, "n"],
    size_m: float,
    config: LabelConfig,
    is_cut: bool = False,
) -> tuple[Float32[np.ndarray, "3"], Bool[np.ndarray, "n"]]:
    """Centre of an object's seeds, and the points that may belong to it.

    Args:
        cloud: the points.
        foreground: indices of the seeds; at least one.
        against: which points are known not to belong to it.
        size_m: of the object.
        config: settings. By default the box of the seeds grown by ``crop`` sizes; with ``crop_m`` a cube of that half
            edge around their centre, grown in steps of 1 m up to ``max_crop_m`` until it holds seeds of both classes
            (field notes, published code).
        is_cut: whether the border of the picture cuts the object off: the box is grown by ``crop_cut`` of its longest
            side.
    """
    seeds = cloud.points[foreground]
    centre = np.median(seeds, axis=0)
    if config.crop_m is None:
        half = np.quantile(np.abs(seeds - centre), 0.98, axis=0)
        half += config.crop_cut * 2 * half.max() if is_cut else config.crop * size_m
        return centre, cloud.within(centre - half, centre + half)
    reach = np.abs(cloud.points - centre).max(axis=1)
    # The nearest background decides how far the cube has to grow; the centre lies among the seeds.
    wanted = max(reach[foreground].min(), reach[against].min() if against.any() else 0.0)
    steps = np.ceil(max(0.0, wanted - config.crop_m) / CROP_STEP_M)
    half = max(config.crop_m, min(config.crop_m + steps * CROP_STEP_M, config.max_crop_m))
    return centre, reach <= half


def sample_foreground(
    points: Float32[np.ndarray, "n 3"],
    foreground: Int[np.ndarray, "f"],
    centre: Float32[np.ndarray, "3"],
    config: LabelConfig,
    rng: np.random.Generator,
) -> Int[np.ndarray, "s"]:
    """Seeds of the object to learn from: any, or a share of them from the outermost fifth, where mistakes are made."""
    wanted = round(config.outer_share * TRAINING_POINTS)
    outer = np.zeros(0, np.int64)
    if wanted and len(foreground) > TRAINING_POINTS:
        distance = np.linalg.norm(points[foreground] - centre, axis=1)
        outermost = foreground[np.argsort(-distance, kind="stable")[: max(1, int(OUTER_SHARE * len(foreground)))]]
        outer = _sample(outermost, wanted, rng)
        foreground = np.setdiff1d(foreground, outermost)
    return np.concatenate([outer, _sample(foreground, TRAINING_POINTS - len(outer), rng)])


def sample_background(
    background: Int[np.ndarray, "b"], hard: Bool[np.ndarray, "n"], rng: np.random.Generator
) -> Int[np.ndarray, "s"]:
    """Background to learn from: a share of it from the ``hard`` points next to the masks, the rest from anywhere."""
    near = _sample(background[hard[background]], round(HARD_SHARE * TRAINING_POINTS), rng)
    return np.concatenate([near, _sample(background, TRAINING_POINTS - len(near), rng)])


def _sample(members: Int[np.ndarray, "m"], count: int, rng: np.random.Generator) -> Int[np.ndarray, "s"]:
    return rng.choice(members, min(count, len(members)), replace=False)
