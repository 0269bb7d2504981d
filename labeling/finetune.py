"""Trains a detector on labels: ``python -m labeling.finetune LABELS --detector NAME --out RUN``."""

import functools
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from labeling.core.errors import UsageError
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.data.doubtful_labels import LEAST_CONFIDENCE
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.detectors.finetuning.presets import PRESETS, FinetunePreset
from labeling.detectors.registry import DEFAULT, check_name
from labeling.runtime.cli import progress_bar, run_command, say_next
from labeling.runtime.help import CommandHelp
from labeling.runtime.named_option import named_option
from labeling.runtime.ranges import Share, check_ranges
from labeling.training.command import Labels, TrainingCommand, say

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture
    from labeling.detectors.scoring import Scores


@dataclass(frozen=True)
class FinetuneCommand(TrainingCommand):
    """Makes a detector better with pseudo-labels, or with ground truth.

    Keeps the best network, by AP50 on --val, in RUN/detector.safetensors; RUN is then a detector by that name. A run
    that was killed goes on where it stopped when the same command is given again.
    """

    labels: Labels
    """What to learn from, one or several: label sets, episodes with ground truth, or COCO folders. Regions marked
    ``iscrowd`` or ``ignore`` teach nothing."""
    detector: str = DEFAULT
    """Where to start: ``compact``, ``maskrcnn_resnet50_fpn``, or the folder of another run."""
    val: Path | None = None
    """What to choose the best by: label set, episodes with ground truth, or COCO folder. Without it the last counts."""
    replay: Path | None = None
    """Source pictures (a COCO folder) to mix in, against forgetting. If it has parts "train" and "val", forgetting
    is measured on "val", else on every tenth picture, which is then not replayed."""
    least_confidence: Share[float] = LEAST_CONFIDENCE
    """Labels less confident than this are left out, in what is learnt from and in --val: what they show is background.
    Hardly any of them is right."""
    new_categories: bool = False
    """Learn categories that the detector has no name for yet; otherwise they are background."""
    preset: FinetunePreset = "default"
    """Where the settings of training start from: the best known, those for ``--new-categories``, or the thesis'
    ("paper"). Other flags change single settings of it."""
    train: tyro.conf.OmitArgPrefixes[FinetuneConfig] = field(default_factory=FinetuneConfig)
    augment: tyro.conf.OmitArgPrefixes[AugmentConfig] = field(default_factory=AugmentConfig)


def run(command: FinetuneCommand) -> dict[str, Any]:
    """Trains and prints the final table.

    Returns:
        What ``RUN/results.json`` holds: figures before and after, on the validation set and on the source pictures.

    Raises:
        SbmError: if detector, labels or settings are at fault.
    """
    from labeling.detectors.finetuning.training import FinetuneTask
    from labeling.detectors.networks.network_detector import NetworkDetector
    from labeling.detectors.networks.weights import load_network
    from labeling.detectors.registry import choose_device, load_named_network
    from labeling.detectors.scoring import evaluate
    from labeling.formats.atomic import write_json
    from labeling.runtime.interrupts import graceful_interrupt
    from labeling.training.config import RESULTS_FILE, WEIGHTS_FILE
    from labeling.training.loop import train

    check_name(command.detector)
    command.train.check()
    command.augment.check()
    device = choose_device(command.device)
    network, digest = load_named_network(command.detector)
    learn, validation, replay, source = read(command)
    known = network.spec.categories
    names = _categories(command, known, learn, validation)
    if names != known:
        from labeling.detectors.networks.mask_rcnn import with_categories

        network = with_categories(network, names)
    sets = {"validation": validation, "source pictures": source}

    def scores(which: Any) -> dict[str, "Scores"]:
        detector = NetworkDetector(which, "scored", device=device)
        return {
            name: evaluate(detector, some, functools.partial(progress_bar, desc=f"scoring on {name}"))
            for name, some in sets.items()
            if some
        }

    before = scores(network)
    task = FinetuneTask(
        network,
        learn,
        validation,
        command.train,
        command.augment,
        replay,
        device,
        {"started_from": command.detector, "started_from_digest": digest, "labels": command.sources},
        tuple(name for name in names if name not in known),
    )
    with graceful_interrupt() as stop:
        progress = train(task, command.out, say, progress_bar, stop)
    after = scores(load_network(command.out / WEIGHTS_FILE))
    results = {
        "detector": command.detector,
        "labels": command.sources,
        "best_iteration": progress.best_iteration,
        "iterations": progress.iteration,
        "before": {name: asdict(one) for name, one in before.items()},
        "after": {name: asdict(one) for name, one in after.items()},
        "seed": command.train.seed,
    }
    write_json(command.out / RESULTS_FILE, results)
    print_table(before, after)
    print(f"detector: {command.out}")
    say_next("score it", "labeling.evaluate", "EPISODES", "--detector", command.out)
    say_next("find things with it", "labeling.detect", "EPISODES", "--detector", command.out)
    return results


def read(command: FinetuneCommand) -> "tuple[list[AnnotatedPicture], ...]":
    """Reads all pictures that the command names.

    Returns:
        Those to learn from, those to choose the best network by, and source pictures to mix in and to measure
        forgetting on.

    Raises:
        SbmError: if there is nothing to learn from, or something is malformed.
    """
    from labeling.detectors.data.annotated_pictures import is_split, read_pictures, train_val_split
    from labeling.detectors.data.doubtful_labels import without_doubtful

    command.check_sources()
    check_ranges(command)
    annotated = [picture for one in command.labels for picture in read_pictures(one, "train", command.dataset)]
    learn = without_doubtful(annotated, command.least_confidence)
    if not any(not one.ignore for picture in learn for one in picture.annotations):
        doubtful = sum(not one.ignore for picture in annotated for one in picture.annotations)
        why = f"; --least-confidence {command.least_confidence:g} leaves out {doubtful}" if doubtful else ""
        raise UsageError(f"{command.sources}: no label that could be learnt from, in {len(learn)} pictures{why}")
    validation = read_pictures(command.val, "val") if command.val is not None else []
    validation = without_doubtful(validation, command.least_confidence)
    if command.replay is None:
        return learn, validation, [], []
    if is_split(command.replay):
        return learn, validation, read_pictures(command.replay, "train"), read_pictures(command.replay, "val")
    return learn, validation, *train_val_split(read_pictures(command.replay))


def _categories(
    command: FinetuneCommand,
    known: tuple[str, ...],
    learn: "list[AnnotatedPicture]",
    validation: "list[AnnotatedPicture]",
) -> tuple[str, ...]:
    """The categories that the trained detector is to have; refuses where there is nothing to learn or validate on."""
    from labeling.detectors.data.annotated_pictures import category_names

    annotated = category_names(learn)
    new = tuple(name for name in annotated if name not in known)
    if new and command.new_categories:
        known = (*known, *new)
    elif len(new) == len(annotated):
        raise UsageError(
            f"{command.sources}: none of the categories there ({', '.join(annotated)}) is one that {command.detector} "
            f"knows ({', '.join(name for name in known if name)}); --new-categories teaches them"
        )
    elif new:
        print(f"note: {command.detector} has no name for {', '.join(new)}: background; --new-categories teaches them")
    if validation and not set(category_names(validation)) & set(known):
        raise UsageError(f"{command.val}: none of its categories is one that the detector knows")
    return known


def print_table(before: "dict[str, Scores]", after: "dict[str, Scores]") -> None:
    """Prints figures before and after, over all categories and per category; in percent."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title="AP in percent: before -> after", title_justify="left", title_style="bold")
    table.add_column("")
    table.add_column("category", overflow="fold")
    for heading in ("mask\nAP50", "mask\nAP30", "box\nAP50", "box around\nmask, AP50"):
        table.add_column(heading, justify="right", no_wrap=True)
    figures = ("mask_ap50", "mask_ap30", "own_box_ap50", "box_ap50")
    for name, old in before.items():
        new = after[name]
        cells = [_change(getattr(old, figure), getattr(new, figure)) for figure in figures]
        table.add_row(name, "all", *cells, style="bold")
        for category in sorted(new.per_class_ap50):
            ap = _change(old.per_class_ap50.get(category), new.per_class_ap50[category])
            table.add_row("", Text(category), ap, "", "", "")
        table.add_section()
    if before:
        Console(width=None if sys.stdout.isatty() else 120).print(table)
    old, new = (getattr(scores.get("source pictures"), "mask_ap50", None) for scores in (before, after))
    if old is not None and new is not None:
        print(f"forgetting: AP50 on the source pictures changed by {100 * (new - old):+.1f} points")


def _change(*values: float | None) -> str:
    return " -> ".join("-" if value is None else f"{100 * value:.1f}" for value in values)


HELP = CommandHelp(
    examples=(
        ("LABELS --out RUN", "compact, taught by a label set"),
        (
            "LABELS --val EPISODES --replay PHOTOGRAPHS --out RUN",
            "validate on episodes, replay source pictures",
        ),
    ),
)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    preset = named_option(arguments, "--preset", PRESETS)
    start = FinetuneCommand(labels=(), out=tyro.MISSING, train=PRESETS[preset], preset=preset)
    return run_command(FinetuneCommand, run, "python -m labeling.finetune", arguments, start=start, about=HELP)


if __name__ == "__main__":
    sys.exit(main())
