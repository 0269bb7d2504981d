"""What a detector found before and after fine-tuning on its own labels: ``python -m experiments.before_after``.

As figures 5.2 and 5.3 of the thesis, but chosen by a rule: the views of unseen scenes on which it gained most, one of
each episode, and the one on which it lost most.
"""

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from experiments.cache.stages import Scale
from experiments.figures.before_after import CONFIDENT, NAME, ViewChange, draw, most_changed, net_true_positives
from labeling.core.errors import SbmError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

if TYPE_CHECKING:
    from labeling.core.detector import Detector


@dataclass(frozen=True)
class PictureConfig:
    """Draws what the pre-trained and the fine-tuned detector find in the same views of test scenes.

    The fine-tuned one is that of the thesis' tables: trained if it is not in the cache yet.
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


def run(config: PictureConfig) -> None:
    """Draws the picture.

    Raises:
        SbmError: if a world cannot be built, or no view has changed.
    """
    from experiments.cache.origin import origin
    from experiments.cache.stages import RunContext
    from experiments.tables.training_sets import Student, TrainingSets
    from labeling.detectors.registry import load_detector
    from labeling.formats.atomic import atomic_file, write_json

    sets = TrainingSets(config.world, RunContext(config.scale, (config.seed,), 1, config.cache))
    names = sets.detectors([Student(None, config.seed), Student(config.labels, config.seed)])
    changes = compare_views(sets.episodes("test"), *(load_detector(name) for name in names))
    chosen = most_changed(changes, config.best)
    if not chosen:
        raise SbmError(f"in none of {len(changes)} views has anything changed; there is nothing to draw")
    name = NAME.format(config.world)
    picture, record = config.docs / "pictures" / f"{name}.png", config.results / f"{name}.json"
    with atomic_file(picture) as temporary:
        draw(chosen, temporary)
    views = [{"episode": one.episode.name, "view": one.view, "gain": one.gain} for one in chosen]
    gains = np.sign([one.gain for one in changes])
    counts = {word: int(np.sum(gains == sign)) for word, sign in (("gained", 1), ("same", 0), ("lost", -1))}
    settings = {name: value for name, value in asdict(config).items() if not isinstance(value, Path)}
    write_json(record, {**settings, "views": views, "all_views": counts, **origin()})
    print(f"{picture}\n{record}")


def compare_views(episodes: Sequence[Path], before: "Detector", after: "Detector") -> list[ViewChange]:
    """What two detectors find in all views of episodes with ground truth."""
    from tqdm import tqdm

    from labeling.core.detector import run_detector
    from labeling.io.episodes import read_episode

    found, both = [], (before, after)
    known = None if before.categories is None else set(before.categories)
    for folder in tqdm(episodes, desc="detecting", unit="episode", file=sys.stderr):
        episode = read_episode(folder)
        detected = [[one for one in run_detector(which, episode) if one.confidence >= CONFIDENT] for which in both]
        for view in range(episode.num_views):
            old, new = (tuple(one for one in some if one.view_index == view) for some in detected)
            in_view = [one for one in episode.ground_truth or () if one.view_index == view]
            truths = [one for one in in_view if known is None or one.category in known]
            gain = net_true_positives(new, truths) - net_true_positives(old, truths)
            found.append(ViewChange(folder, view, gain, old, new))
    return found


HELP = CommandHelp(
    examples=(("", "draw the picture anew"),),
)
main = make_main("experiments.before_after", PictureConfig, run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
