"""Confident detections and outlines from which no object was made, and notes to the user about the outlines."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from labeling.core.episode import Episode
from labeling.core.episode_labels import EpisodeLabels
from labeling.core.types import Detection
from labeling.generator.settings.label_config import LabelConfig


def unused_sources(
    detections: Sequence[Detection], labels: EpisodeLabels, config: LabelConfig
) -> tuple[Detection, ...]:
    """The confident detections that are no source of any object."""
    used = Counter((s.view_index, s.category, s.confidence) for one in labels.objects for s in one.sources)
    unused = []
    for one in detections:
        source = one.view_index, one.category, float(one.confidence)
        if one.confidence < config.confident:
            continue
        if used[source] > 0:
            used[source] -= 1
        else:
            unused.append(one)
    return tuple(unused)


def notes_of_outlines(episode: Episode, unused: Sequence[Detection], config: LabelConfig) -> tuple[str, ...]:
    """One sentence for each outline that gave no object, with the reason."""
    return tuple(
        f"the outline of {one.category} in {episode.file_names[one.view_index]} gave no object: "
        f"{_reason(one, episode, config)}"
        for one in unused
        if one.exact
    )


def _reason(one: Detection, episode: Episode, config: LabelConfig) -> str:
    pixels = np.count_nonzero(one.mask)
    depth_m = episode.depth_m[one.view_index][one.mask]
    if pixels < config.min_mask_px:
        return f"it has {pixels} pixels, fewer than --min-mask-px {config.min_mask_px}"
    if not np.any((depth_m > 0) & (depth_m <= config.max_range_m)):
        return f"none of its {pixels} pixels has depth within {config.max_range_m:g} m; outline it in another view, too"
    return "other views or objects claim all of its points; outline it in another view, too"
