"""What a detector found before and after fine-tuning, as a picture."""

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
class ViewChange:
    """What was detected in one view before and after."""

    episode: Path
    view: int
    gain: int
    """True positives minus false positives, after minus before."""
    before: tuple[Detection, ...]
    after: tuple[Detection, ...]


def net_true_positives(detections: Sequence[Detection], truths: Sequence[GroundTruth]) -> int:
    """True positives minus false positives; objects to be ignored count for neither.

    Args:
        detections: of one view.
        truths: of the same view.
    """
    unmatched, net = list(truths), 0
    for one in sorted(detections, key=lambda one: -one.confidence):
        of_category = [truth for truth in unmatched if truth.category == one.category]
        best = max(of_category, key=lambda truth: mask_iou(one.mask, truth.modal), default=None)
        if best is None or mask_iou(one.mask, best.modal) < MIN_IOU:
            net -= 1
        else:
            net += not best.ignore
            unmatched = [truth for truth in unmatched if truth is not best]
    return net


def most_changed(changes: Sequence[ViewChange], best: int) -> list[ViewChange]:
    """The views with the greatest gain, one of each episode, and the one with the greatest loss if any has lost.

    Args:
        changes: all views.
        best: how many.
    """
    of_each: dict[Path, ViewChange] = {}
    for one in sorted(changes, key=lambda one: -one.gain):
        of_each.setdefault(one.episode, one)
    worst = min(changes, key=lambda one: one.gain)
    gained = [one for one in of_each.values() if one.gain > 0][:best]
    return [*gained, worst] if worst.gain < 0 else gained


def draw(changes: Sequence[ViewChange], path: Path) -> None:
    """Draws views side by side: before above, after below.

    Args:
        changes: what to draw.
        path: PNG to write.
    """
    from matplotlib import pyplot as plt

    from experiments.figures.episodes import named
    from experiments.figures.style import save
    from labeling.io.episodes import read_episode

    wide = read_episode(changes[0].episode).size
    across = max(1, len(changes)) if wide[1] < 2 * wide[0] else 1
    # Wide pictures stand below each other, before on the left.
    rows, columns, width_in = (2, across, 3.4) if across > 1 else (len(changes), 2, 7.0)
    size_in = (width_in * columns, width_in * rows * wide[0] / wide[1] * 1.12)
    figure, axes = plt.subplots(rows, columns, figsize=size_in, dpi=80, squeeze=False)
    for number, one in enumerate(changes):
        episode = read_episode(one.episode)
        truths = [truth for truth in episode.ground_truth or () if truth.view_index == one.view]
        for side, (title, detections) in enumerate((("before", one.before), ("after", one.after))):
            panel = axes[side, number] if across > 1 else axes[number, side]
            panel.imshow(named(episode.rgb[one.view], detections, truths))
            panel.axis("off")
            change = f" ({one.gain:+d})" if side else ""
            panel.set_title(f"{title}{change}", fontsize=10, pad=3)
    figure.subplots_adjust(left=0.005, right=0.995, top=0.95, bottom=0.005, wspace=0.02, hspace=0.1)
    save(figure, path)
