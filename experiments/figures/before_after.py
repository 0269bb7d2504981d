"""What a detector saw before and after it learnt from its own labels, as a picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from labeling.core.masks import mask_iou
from labeling.core.types import Detection, GroundTruth

CONFIDENT = 0.5
"""Detections from this confidence on count, and are drawn."""


MIN_IOU = 0.5


NAME = "before_after_{}"
"""Of the picture and of the record, by world."""


@dataclass(frozen=True)
class Pair:
    """One view."""

    episode: Path
    view: int
    gain: int
    """Objects found rightly minus false finds, after minus before."""
    before: tuple[Detection, ...]
    after: tuple[Detection, ...]


def balance(detections: Sequence[Detection], truths: Sequence[GroundTruth]) -> int:
    """Objects found rightly, each once, minus detections that are no object's; objects to be ignored count for neither.

    Args:
        detections: of one view.
        truths: of the same view.
    """
    free, balance = list(truths), 0
    for one in sorted(detections, key=lambda one: -one.confidence):
        fits = [
            (mask_iou(one.mask, truth.modal), -place)
            for place, truth in enumerate(free)
            if truth.category == one.category
        ]
        overlap, place = max(fits, default=(0.0, 0))
        if overlap < MIN_IOU:
            balance -= 1
            continue
        balance += not free.pop(-place).ignore
    return balance


def most_changed(pairs: Sequence[Pair], best: int) -> list[Pair]:
    """The views with the greatest gain, one of each episode, and the one with the greatest loss if any has lost.

    Args:
        pairs: all views.
        best: how many.
    """
    of_each: dict[Path, Pair] = {}
    for pair in pairs:
        if pair.episode not in of_each or pair.gain > of_each[pair.episode].gain:
            of_each[pair.episode] = pair
    gained = sorted((pair for pair in of_each.values() if pair.gain > 0), key=lambda pair: -pair.gain)[:best]
    worst = min(pairs, key=lambda pair: pair.gain)
    return [*gained, worst] if worst.gain < 0 else gained


def draw(pairs: Sequence[Pair], path: Path) -> None:
    """Draws views side by side: before above, after below.

    Args:
        pairs: what to draw.
        path: PNG to write.
    """
    from matplotlib import pyplot as plt

    from experiments.figures.episodes import named
    from experiments.figures.style import save
    from labeling.io.episodes import read_episode

    wide = read_episode(pairs[0].episode).size
    across = max(1, len(pairs)) if wide[1] < 2 * wide[0] else 1
    # Wide pictures stand below each other, before on the left.
    shape = (2, across) if across > 1 else (len(pairs), 2)
    size = 3.4 if across > 1 else 7.0
    figure, axes = plt.subplots(
        *shape, figsize=(size * shape[1], size * shape[0] * wide[0] / wide[1] * 1.12), dpi=80, squeeze=False
    )
    for number, pair in enumerate(pairs):
        episode = read_episode(pair.episode)
        truths = [one for one in episode.ground_truth or () if one.view_index == pair.view]
        for side, (title, detections) in enumerate((("before", pair.before), ("after", pair.after))):
            panel = axes[side, number] if across > 1 else axes[number, side]
            panel.imshow(named(episode.rgb[pair.view], detections, truths))
            panel.axis("off")
            change = f" ({pair.gain:+d})" if side else ""
            panel.set_title(f"{title}{change}", fontsize=10, pad=3)
    figure.subplots_adjust(left=0.005, right=0.995, top=0.95, bottom=0.005, wspace=0.02, hspace=0.1)
    save(figure, path)
