"""What a robot can tell of its labels without ground truth, and when a loop should stop by it."""

import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

TREND_ROUNDS = 3
"""Labels are compared by means over so many rounds that follow each other: homes differ, and labels of a single round
of a dozen episodes with them (labels per view by up to half)."""
MIN_LABEL_RATIO = 0.7
"""Labels per view that fall below this share of the most before are a collapse."""
MAX_CONFIDENCE_DROP = 0.1
"""So is a mean confidence of labels that falls by more than this below the highest before."""
MAX_CATEGORY_SHARE = 0.8
"""So is a category that has at least this share of all labels, and had not at first."""


@dataclass(frozen=True)
class LabelStatistics:
    """What a robot itself can tell about its labels."""

    labels_per_view: float
    confidence: float
    """Mean over labels."""
    shares: dict[str, float]
    """Of each category among the labels."""


def label_statistics(pictures: "Sequence[AnnotatedPicture]") -> LabelStatistics:
    """What labelled pictures say about themselves.

    Args:
        pictures: at least one.
    """
    labels = [one for picture in pictures for one in picture.annotations if not one.ignore]
    counts = Counter(one.category for one in labels)
    return LabelStatistics(
        labels_per_view=len(labels) / len(pictures),
        confidence=statistics.fmean(one.weight for one in labels) if labels else 0.0,
        shares={name: count / len(labels) for name, count in sorted(counts.items())},
    )


def collapse_reason(rounds: Sequence[LabelStatistics]) -> str | None:
    """Whether labels have collapsed, and how: there are none, or the trend of the latest rounds is far below earlier.

    Args:
        rounds: all rounds so far, at least one. Up to ``TREND_ROUNDS`` of them show no trend.

    Returns:
        A sentence, None if they have not.
    """
    if rounds[-1].labels_per_view == 0.0:
        return "there are no labels"
    if len(rounds) <= TREND_ROUNDS:
        return None
    *before, now = (_mean(rounds[end - TREND_ROUNDS : end]) for end in range(TREND_ROUNDS, len(rounds) + 1))
    of_late = f"in the mean of {TREND_ROUNDS} rounds"
    most, surest = max(one.labels_per_view for one in before), max(one.confidence for one in before)
    if now.labels_per_view < MIN_LABEL_RATIO * most:
        return f"labels per view fell from {most:.2f} to {now.labels_per_view:.2f} {of_late}"
    if now.confidence < surest - MAX_CONFIDENCE_DROP:
        return f"the mean confidence of labels fell from {surest:.2f} to {now.confidence:.2f} {of_late}"
    name = max(now.shares, key=lambda one: now.shares[one])
    if now.shares[name] >= MAX_CATEGORY_SHARE > before[0].shares.get(name, 0.0):
        return f"{now.shares[name]:.0%} of all labels are {name} {of_late}"
    return None


def _mean(rounds: Sequence[LabelStatistics]) -> LabelStatistics:
    names = sorted({name for one in rounds for name in one.shares})
    return LabelStatistics(
        statistics.fmean(one.labels_per_view for one in rounds),
        statistics.fmean(one.confidence for one in rounds),
        {name: statistics.fmean(one.shares.get(name, 0.0) for one in rounds) for name in names},
    )
