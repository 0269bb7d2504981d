"""Trains a 3-D detector on labels: ``python -m labeling.train3d LABELS --out RUN``."""

import functools
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from labeling.detectors3d.train_config import Augment3dConfig, Train3dConfig
from labeling.runtime.cli import check_sources, run_command

if TYPE_CHECKING:
    from labeling.detectors3d.frustum_dataset import Lesson

HELD_OUT = 0.1
"""Share of the objects that choose the best network, without --val."""


@dataclass(frozen=True)
class Train3dCommand:
    """Trains a frustum PointNet with masks and 3-D boxes that nobody has drawn, or with ground truth.

    Keeps the best network, by mean IoU of its boxes on --val, in RUN/detector.safetensors; RUN is then a 3-D detector
    by that name (labeling.detect3d). A run that was killed goes on where it stopped when the same command is given
    again.
    """

    labels: tyro.conf.Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LABELS [LABELS ...]", help_behavior_hint="(required)")]
    ]
    """What to learn from, one or several: label sets, or episodes whose ground truth has 3-D boxes."""
    out: Path
    """Folder of the run."""
    val: Path | None = None
    """What to choose the best by: label set, or episodes with ground truth. Without it some objects of LABELS are held
    out."""
    dataset: Path | None = None
    """Where the recordings of LABELS lie, if not where the label set says; with one label set only."""
    device: str | None = None
    """cpu, cuda, ...; by default a GPU if there is one."""
    train: tyro.conf.OmitArgPrefixes[Train3dConfig] = field(default_factory=Train3dConfig)
    augment: tyro.conf.OmitArgPrefixes[Augment3dConfig] = field(default_factory=Augment3dConfig)


def run(config: Train3dCommand) -> dict[str, Any]:
    """Trains and prints the final figures.

    Returns:
        What ``RUN/results.json`` holds.

    Raises:
        SbmError: if labels or settings are at fault.
    """
    from tqdm import tqdm

    from labeling.detectors.registry import choose_device
    from labeling.detectors3d.frustum_dataset import category_names, read_lessons
    from labeling.detectors3d.frustum_weights import load_network
    from labeling.detectors3d.training_run import evaluate, train
    from labeling.io.formats.atomic import write_json
    from labeling.training.run_files import RESULTS_FILE, WEIGHTS_FILE

    config.train.check()
    config.augment.check()
    check_sources(config.labels, config.dataset)
    device = choose_device(config.device)
    lessons = [one for path in config.labels for one in read_lessons(path, config.train.seed, config.dataset)]
    sources = ", ".join(map(str, config.labels))
    if config.val is not None:
        validation = read_lessons(config.val, config.train.seed)
    else:
        lessons, validation = held_out(lessons)
    names = category_names(lessons)
    print(f"{len(lessons)} objects in views to learn from: {', '.join(names)}; {len(validation)} to choose by")
    state = train(
        lessons,
        validation,
        config.out,
        config.train,
        config.augment,
        device,
        {"labels": sources},
        functools.partial(print, flush=True),
        functools.partial(tqdm, delay=2.0, leave=False, file=sys.stderr, unit="batch"),
    )
    known = [one for one in validation if one.category in names]
    best = evaluate(load_network(config.out / WEIGHTS_FILE).to(device), known, device) if known else None
    results = {
        "labels": sources,
        "categories": list(names),
        "best_iteration": state.best_iteration,
        "iterations": state.iteration,
        "seed": config.train.seed,
        "validation": None if best is None else asdict(best),
    }
    write_json(config.out / RESULTS_FILE, results)
    if best is not None:
        print(
            f"boxes on validation: mean IoU {best.mean_iou:.3f}; {100 * best.right_at_25:.1f} % right at .25, "
            f"{100 * best.right_at_50:.1f} % at .5"
        )
    print(f"detector: {config.out}")
    return results


def held_out(lessons: "list[Lesson]") -> "tuple[list[Lesson], list[Lesson]]":
    """Splits lessons; all views of an object lie on one side. Objects are told apart by their boxes."""
    of_object: dict[tuple[float, ...], list[Lesson]] = {}
    for one in lessons:
        of_object.setdefault((*one.box.centre_m.tolist(), *one.box.extent_m.tolist()), []).append(one)
    every = max(2, round(1 / HELD_OUT))
    groups = list(of_object.values())
    held = [one for number, group in enumerate(groups) if number % every == every - 1 for one in group]
    kept = [one for number, group in enumerate(groups) if number % every != every - 1 for one in group]
    return kept, held


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(Train3dCommand, run, "python -m labeling.train3d", arguments)


if __name__ == "__main__":
    sys.exit(main())
