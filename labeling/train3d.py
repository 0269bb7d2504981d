"""Trains a 3-D detector on labels: ``python -m labeling.train3d LABELS --out RUN``."""

import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from labeling.detectors3d.config import Augment3dConfig, Train3dConfig
from labeling.runtime.cli import make_main, progress_bar, say_next
from labeling.runtime.help import CommandHelp
from labeling.training.command import Labels, TrainingCommand, say

if TYPE_CHECKING:
    from labeling.detectors3d.frustum_samples import FrustumSample

EVERY_HELD_OUT = 10
"""Without --val every tenth object is held out to choose the best network by."""


@dataclass(frozen=True)
class Train3dCommand(TrainingCommand):
    """Trains a frustum PointNet with masks and 3-D boxes that nobody has drawn, or with ground truth.

    Keeps the best network, by mean IoU of its boxes on --val, in RUN/detector.safetensors; RUN is then a 3-D detector
    by that name (labeling.detect3d). A run that was killed goes on where it stopped when the same command is given
    again.
    """

    labels: Labels
    """What to learn from, one or several: label sets, or episodes whose ground truth has 3-D boxes."""
    val: Path | None = None
    """What to choose the best by: label set, or episodes with ground truth. Without it some objects of LABELS are held
    out."""
    train: tyro.conf.OmitArgPrefixes[Train3dConfig] = field(default_factory=Train3dConfig)
    augment: tyro.conf.OmitArgPrefixes[Augment3dConfig] = field(default_factory=Augment3dConfig)


def run(command: Train3dCommand) -> dict[str, Any]:
    """Trains and prints the final figures.

    Returns:
        What ``RUN/results.json`` holds.

    Raises:
        SbmError: if labels or settings are at fault.
    """
    from labeling.detectors.registry import choose_device
    from labeling.detectors3d.frustum_detector import load_network
    from labeling.detectors3d.frustum_samples import category_names, read_frustum_samples
    from labeling.detectors3d.frustum_training import FrustumTask, evaluate
    from labeling.formats.atomic import write_json
    from labeling.runtime.interrupts import graceful_interrupt
    from labeling.training.config import RESULTS_FILE, WEIGHTS_FILE
    from labeling.training.loop import train

    command.train.check()
    command.augment.check()
    command.check_sources()
    device, seed = choose_device(command.device), command.train.seed
    samples = [one for path in command.labels for one in read_frustum_samples(path, seed, command.dataset)]
    if command.val is not None:
        validation = read_frustum_samples(command.val, seed)
    else:
        samples, validation = train_val_split_by_object(samples)
    names = category_names(samples)
    print(f"{len(samples)} objects in views to learn from: {', '.join(names)}; {len(validation)} to choose by")
    task = FrustumTask(samples, validation, command.train, command.augment, device, {"labels": command.sources})
    with graceful_interrupt() as stop:
        progress = train(task, command.out, say, progress_bar, stop)
    network = load_network(command.out / WEIGHTS_FILE).to(device)
    best = evaluate(network, task.validation, device) if task.validation else None
    results = {
        "labels": command.sources,
        "categories": list(names),
        "best_iteration": progress.best_iteration,
        "iterations": progress.iteration,
        "seed": seed,
        "validation": None if best is None else asdict(best),
    }
    write_json(command.out / RESULTS_FILE, results)
    if best is not None:
        print(
            f"boxes on validation: mean IoU {best.mean_iou:.3f}; {100 * best.right_at_25:.1f} % right at .25, "
            f"{100 * best.right_at_50:.1f} % at .5"
        )
    print(f"detector: {command.out}")
    say_next("find boxes with it", "labeling.detect3d", "EPISODES", "--detector", command.out)
    return results


def train_val_split_by_object(samples: "list[FrustumSample]") -> "tuple[list[FrustumSample], list[FrustumSample]]":
    """Splits samples into training and validation.

    All views of an object lie on one side; objects are told apart by their boxes. Every tenth object is held out,
    unless no other one of its category would be left to learn from.
    """
    of_object: dict[tuple[float, ...], list[FrustumSample]] = {}
    for one in samples:
        of_object.setdefault((*one.box.centre_m.tolist(), *one.box.extent_m.tolist()), []).append(one)
    objects = list(of_object.values())
    learnt = {views[0].category for number, views in enumerate(objects) if (number + 1) % EVERY_HELD_OUT}
    sides: tuple[list[FrustumSample], list[FrustumSample]] = [], []
    for number, views in enumerate(objects, start=1):
        sides[number % EVERY_HELD_OUT == 0 and views[0].category in learnt].extend(views)
    return sides


HELP = CommandHelp(
    examples=(
        ("LABELS --out RUN", "the best network of a training without validation is the last"),
        ("LABELS --val EPISODES --out RUN", "choose the best by episodes with ground truth"),
    ),
)
main = make_main("labeling.train3d", Train3dCommand, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
