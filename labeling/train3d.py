"""Trains a 3-D detector on labels: ``python -m labeling.train3d LABELS --out RUN``, of one view or on a memory."""

import sys
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from labeling.core.errors import UsageError
from labeling.detectors3d.config import Augment3dConfig, Train3dConfig
from labeling.memory.settings.box_settings import BOX_MODELS, MemoryBoxOptions, TrainBoxesConfig
from labeling.runtime.cli import make_main, progress_bar, say_next
from labeling.runtime.help import CommandHelp
from labeling.training.command import EVERY_HELD_OUT, Labels, TrainingCommand, held_out, say

if TYPE_CHECKING:
    from labeling.detectors3d.frustum_samples import FrustumSample
    from labeling.memory.boxes.labelled_scenes import LabelledScene
    from labeling.memory.networks.weights import Memory
    from labeling.memory.settings.grid_spec import Around
    from labeling.memory.settings.memory_spec import MemorySpec

OF_BOTH = ("iterations", "learning_rate", "validate_every", "patience", "trust_scores", "workers", "seed")
"""Settings of training that frustum PointNets and memories share."""
OF_RUNS = ("voxels", "voxel_m", "channels", "picture")
"""Settings of a memory that a run of labeling.train_memory has already."""


@dataclass(frozen=True)
class Train3dCommand(TrainingCommand):
    """Trains a 3-D detector with boxes that nobody has drawn, or with ground truth: a frustum PointNet, which looks at
    one view, or with --memory a network that looks at several views together.

    Keeps the best network on --val, by mean IoU of its boxes (of a memory: by average precision), in
    RUN/detector.safetensors; RUN is then a 3-D detector by that name (labeling.detect3d). A run that was killed goes on
    where it stopped when the same command is given again.
    """

    labels: Labels
    """What to learn from, one or several: label sets, or episodes whose ground truth has 3-D boxes."""
    val: Path | None = None
    """What to choose the best by: label set, or episodes with ground truth. Without it some objects of LABELS (with
    --memory: some episodes) are held out."""
    memory: str | None = None
    """Find boxes in a 3-D memory of several views: "grnn" or "cn3d" of random weights, or the folder of a
    labeling.train_memory run, whose weights are begun with. Without it a frustum PointNet is trained."""
    train: tyro.conf.OmitArgPrefixes[Train3dConfig] = field(default_factory=Train3dConfig)
    augment: tyro.conf.OmitArgPrefixes[Augment3dConfig] = field(default_factory=Augment3dConfig)
    boxes: tyro.conf.OmitArgPrefixes[MemoryBoxOptions] = field(default_factory=MemoryBoxOptions)

    def check(self) -> None:
        """Refuses settings that make no sense, or that do not belong to what is trained.

        Raises:
            UsageError: naming the option.
        """
        for settings in (self.train, self.augment, self.boxes):
            settings.check()
        self.check_sources()
        if self.memory is None:
            self._refuse(_changed(self.boxes), "is for --memory, which was not given")
        else:
            self._refuse(
                _changed(self.train, OF_BOTH) + _changed(self.augment), "is for frustum PointNets, not --memory"
            )
            if self.memory not in BOX_MODELS:
                names = [name for name in _changed(self.boxes) if name in OF_RUNS]
                self._refuse(names, f"is for a new memory; {self.memory} has its own")

    @staticmethod
    def _refuse(names: list[str], why: str) -> None:
        if names:
            raise UsageError(f"--{names[0].replace('_', '-')} {why}")


def _changed(settings: Any, besides: tuple[str, ...] = ()) -> list[str]:
    """Names of settings that are not what they are by default."""
    return [
        one.name
        for one in fields(settings)
        if one.name not in besides and getattr(settings, one.name) != getattr(type(settings)(), one.name)
    ]


def run(command: Train3dCommand) -> dict[str, Any]:
    """Trains and prints the final figures.

    Returns:
        What ``RUN/results.json`` holds.

    Raises:
        SbmError: if labels or settings are at fault.
    """
    from labeling.formats.atomic import write_json
    from labeling.training.config import RESULTS_FILE

    command.check()
    figures = _train_frustums(command) if command.memory is None else _train_boxes(command, command.memory)
    results = {"labels": command.sources, **figures, "seed": command.train.seed}
    write_json(command.out / RESULTS_FILE, results)
    print(f"detector: {command.out}")
    say_next("find boxes with it", "labeling.detect3d", "EPISODES", "--detector", command.out)
    return results


def _train_frustums(command: Train3dCommand) -> dict[str, Any]:
    """Of one view."""
    from labeling.detectors.registry import choose_device
    from labeling.detectors3d.frustum_detector import load_network
    from labeling.detectors3d.frustum_samples import read_frustum_samples
    from labeling.detectors3d.frustum_training import FrustumTask, evaluate
    from labeling.runtime.interrupts import graceful_interrupt
    from labeling.training.config import WEIGHTS_FILE
    from labeling.training.loop import train

    device, seed = choose_device(command.device), command.train.seed
    samples = [one for path in command.labels for one in read_frustum_samples(path, seed, command.dataset)]
    if command.val is not None:
        validation = read_frustum_samples(command.val, seed)
    else:
        samples, validation = train_val_split_by_object(samples)
    task = FrustumTask(samples, validation, command.train, command.augment, device, {"labels": command.sources})
    learnt, names, least = task.dataset.samples, task.dataset.categories, command.train.least_confidence
    doubtful = len(samples) - len(learnt)
    why = f"; --least-confidence {least:g} leaves out {doubtful}" if doubtful else ""
    print(f"{len(learnt)} objects in views to learn from: {', '.join(names)}; {len(task.validation)} to choose by{why}")
    with graceful_interrupt() as stop:
        progress = train(task, command.out, say, progress_bar, stop)
    network = load_network(command.out / WEIGHTS_FILE).to(device)
    best = evaluate(network, task.validation, device) if task.validation else None
    if best is not None:
        print(
            f"boxes on validation: mean IoU {best.mean_iou:.3f}; {100 * best.right_at_25:.1f} % right at .25, "
            f"{100 * best.right_at_50:.1f} % at .5"
        )
    return {
        "categories": list(names),
        "best_iteration": progress.best_iteration,
        "iterations": progress.iteration,
        "validation": None if best is None else asdict(best),
    }


def _train_boxes(command: Train3dCommand, memory: str) -> dict[str, Any]:
    """On a memory of several views."""
    from labeling.detectors.registry import choose_device
    from labeling.memory.boxes.box_detector import load_box_net
    from labeling.memory.boxes.box_evaluation import evaluate
    from labeling.memory.boxes.box_training import BoxTask
    from labeling.runtime.interrupts import graceful_interrupt
    from labeling.training.config import WEIGHTS_FILE
    from labeling.training.loop import train

    device, (begun, around) = choose_device(command.device), _memory(command, memory)
    shared = {name: getattr(command.train, name) for name in OF_BOTH}
    options = command.boxes
    config = TrainBoxesConfig(**shared, batch_size=options.scenes, views=options.views, around=around)
    scenes, validation = _read_scenes(command, begun, around)
    about = {"labels": command.sources, "memory": memory}
    task = BoxTask(begun, scenes, validation, config, device, about)
    names = task.network.spec.categories
    print(f"{len(scenes)} episodes to learn from: {', '.join(names)}; {len(validation)} to choose by")
    with graceful_interrupt() as stop:
        progress = train(task, command.out, say, progress_bar, stop)
    network = load_box_net(command.out / WEIGHTS_FILE).to(device)
    best = evaluate(network, validation, config.views, device) if validation else None
    if best is not None:
        print(f"boxes on validation: AP {100 * best['ap25']:.1f} at .25, {100 * best['ap50']:.1f} at .5")
    return {
        "categories": list(names),
        "memory": memory,
        "best_iteration": progress.best_iteration,
        "iterations": progress.iteration,
        "validation": best,
    }


def _memory(command: Train3dCommand, memory: str) -> "tuple[MemorySpec | Memory, Around]":
    """What training begins with, and what its grid stands around."""
    from labeling.memory.networks.weights import load_memory, read_around

    asked = command.boxes.around
    if memory in BOX_MODELS:
        return command.boxes.size().spec(BOX_MODELS[BOX_MODELS.index(memory)]), asked or "fixated"
    if not Path(memory).exists():
        raise UsageError(
            f"there is no memory {memory!r}; give {' or '.join(BOX_MODELS)}, or the folder of a labeling.train_memory "
            "run"
        )
    learnt, around = load_memory(Path(memory)), read_around(Path(memory))
    if asked not in (None, around):
        raise UsageError(
            f"--around {asked} contradicts {memory}, which has learnt with --around {around}; leave it out"
        )
    return learnt, around


def _read_scenes(
    command: Train3dCommand, begun: "MemorySpec | Memory", around: "Around"
) -> "tuple[list[LabelledScene], list[LabelledScene]]":
    """Episodes to learn from and to choose by."""
    from labeling.memory.boxes.labelled_scenes import read_labelled_scenes
    from labeling.memory.settings.memory_spec import MemorySpec

    spec = begun if isinstance(begun, MemorySpec) else begun.spec
    scenes, notes = read_labelled_scenes(command.labels, spec, around, command.dataset)
    validation: list[LabelledScene] = []
    if command.val is not None:
        validation, more = read_labelled_scenes([command.val], spec, around)
        notes += more
    for note in notes:
        print(f"note: left out {note}")
    return (scenes, validation) if command.val is not None else held_out(scenes)


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
    groups={
        "common options": (
            "labels", "out", "val", "memory", "dataset", "device", "iterations", "learning-rate", "validate-every",
            "patience", "trust-scores", "workers", "seed",
        ),
        "frustum PointNet": (
            "batch-size", "num-points", "width", "flip", "box-shift", "box-scale", "range-shift", "noise-m",
        ),
        "with --memory": ("views", "scenes", "around", "voxels", "voxel-m", "channels", "picture"),
    },
    examples=(
        ("LABELS --out RUN", "a frustum PointNet; without --val some objects are held out to choose the best by"),
        ("LABELS --val EPISODES --out RUN", "choose the best by episodes with ground truth"),
        ("LABELS --memory cn3d --out RUN", "boxes in a memory of up to eight views, from random weights"),
        ("LABELS --memory MEMORY_RUN --out RUN", "the same, from the weights of a labeling.train_memory run"),
    ),
)  # fmt: skip
main = make_main("labeling.train3d", Train3dCommand, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
