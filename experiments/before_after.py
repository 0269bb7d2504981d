"""What a detector saw before and after it learnt from its own labels: ``python -m experiments.before_after``.

As figures 5.2 and 5.3 of the thesis, but chosen by a rule: the views of unseen scenes on which it gained most, one of
each episode, and the one on which it lost most.
"""

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from experiments.stages import Scale
from labeling.cli import run_command
from labeling.errors import SbmError
from labeling.instances import Detection, GroundTruth, mask_iou

SURE = 0.5
"""Detections from this confidence on count, and are drawn."""
OVERLAP = 0.5
NAME = "before_after_{}"
"""Of the picture and of the record, by world."""


@dataclass(frozen=True)
class PictureConfig:
    """Draws what the pre-trained and the fine-tuned detector find in the same views of test scenes.

    The fine-tuned one is that of the thesis' tables: taught if it is not in the cache yet.
    """

    world: Literal["rooms", "streets"] = "rooms"
    """Which world."""
    scale: Scale = "quick"
    """Of the tables."""
    labels: Literal["sbm", "shared"] = "shared"
    """What the fine-tuned one has learnt from: SbM labels of each episode alone, or shared by those of a scene."""
    seed: int = 0
    """Of labels and training."""
    best: int = 4
    """Views with the greatest gain."""
    cache: Path = Path("out/experiments")
    """Folder for recorded episodes and intermediate results."""
    results: Path = Path("experiments/results")
    """Folder for the record of what is drawn."""
    docs: Path = Path("docs")
    """Folder for the picture."""


@dataclass(frozen=True)
class Pair:
    """One view."""

    episode: Path
    view: int
    gain: int
    """Objects found rightly minus false finds, after minus before."""
    before: tuple[Detection, ...]
    after: tuple[Detection, ...]


def run(config: PictureConfig) -> None:
    """Draws the picture.

    Raises:
        SbmError: if a world cannot be built, or no view has changed.
    """
    from experiments.lessons import Lessons, Pupil
    from experiments.stages import Workplace
    from labeling.detectors.registry import load_detector
    from labeling.files import atomic_file, write_json

    lessons = Lessons(config.world, Workplace(config.scale, (config.seed,), 1, config.cache))
    names = lessons.detectors([Pupil(None, config.seed), Pupil(config.labels, config.seed)])
    pairs = pairs_of(lessons.episodes("test"), *(load_detector(name) for name in names))
    chosen = most_changed(pairs, config.best)
    if not chosen:
        raise SbmError(f"in none of {len(pairs)} views has anything changed; there is nothing to draw")
    name = NAME.format(config.world)
    picture, record = config.docs / "pictures" / f"{name}.png", config.results / f"{name}.json"
    with atomic_file(picture) as temporary:
        draw(chosen, temporary)
    views = [{"episode": pair.episode.name, "view": pair.view, "gain": pair.gain} for pair in chosen]
    gains = np.sign([pair.gain for pair in pairs])
    counts = {word: int(np.sum(gains == sign)) for word, sign in (("gained", 1), ("same", 0), ("lost", -1))}
    settings = {name: value for name, value in asdict(config).items() if not isinstance(value, Path)}
    write_json(record, {**settings, "views": views, "all_views": counts})
    print(f"{picture}\n{record}")


def pairs_of(episodes: Sequence[Path], before, after) -> list[Pair]:
    """What two detectors find in all views.

    Args:
        episodes: folders, with ground truth.
        before: a detector.
        after: another.
    """
    from tqdm import tqdm

    from labeling.detector_call import run_detector
    from labeling.episodes import read_episode

    found = []
    known = None if before.categories is None else set(before.categories)
    for folder in tqdm(episodes, desc="detecting", unit="episode", file=sys.stderr):
        episode = read_episode(folder)
        truths = [one for one in episode.ground_truth or () if known is None or one.category in known]
        both = [[one for one in run_detector(which, episode) if one.confidence >= SURE] for which in (before, after)]
        for view in range(episode.num_views):
            here = [tuple(one for one in some if one.view_index == view) for some in both]
            there = [one for one in truths if one.view_index == view]
            gain = balance(here[1], there) - balance(here[0], there)
            found.append(Pair(folder, view, gain, here[0], here[1]))
    return found


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
        if overlap < OVERLAP:
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
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    from experiments.drawing import named
    from labeling.episodes import read_episode

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
    figure.savefig(path, format="png")
    plt.close(figure)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(PictureConfig, run, "python -m experiments.before_after", arguments)


if __name__ == "__main__":
    sys.exit(main())
