"""Trains a detector on labels: ``python -m labeling.finetune LABELS --detector NAME --out RUN``."""

import functools
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from labeling.core.errors import UsageError
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.train_config import TrainConfig
from labeling.detectors.registry import DEFAULT, check_name
from labeling.runtime.cli import check_sources, run_command

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture
    from labeling.detectors.finetuning.epochs import Scores


@dataclass(frozen=True)
class FinetuneConfig:
    """Makes a detector better with pseudo-labels, or with ground truth.

    Keeps the best network, by AP50 on --val, in RUN/detector.safetensors; RUN is then a detector by that name. A run
    that was killed goes on where it stopped when the same command is given again.
    """

    labels: tyro.conf.Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LABELS [LABELS ...]", help_behavior_hint="(required)")]
    ]
    """What to learn from, one or several: label sets, episodes with ground truth, or COCO folders. The score of a label
    is its weight; regions marked ``iscrowd`` or ``ignore`` teach nothing."""
    out: Path
    """Folder of the run."""
    detector: str = DEFAULT
    """Where to start: ``compact``, ``maskrcnn_resnet50_fpn``, or the folder of another run."""
    val: Path | None = None
    """What to choose the best by: label set, episodes with ground truth, or COCO folder. Without it the last counts."""
    replay: Path | None = None
    """Source pictures (a COCO folder) to mix in, against forgetting. If it has parts ``train`` and ``val``, forgetting
    is measured on ``val``, else on every tenth picture, which is then not replayed."""
    dataset: Path | None = None
    """Where the pictures of LABELS lie, if not where the label set says; with one label set only."""
    least_confidence: float = 0.0
    """Labels less confident than this become regions to ignore."""
    new_categories: bool = False
    """Learn categories that the detector has no name for yet; otherwise they are background."""
    device: str | None = None
    """cpu, cuda, ...; by default a GPU if there is one."""
    train: tyro.conf.OmitArgPrefixes[TrainConfig] = field(default_factory=TrainConfig)
    augment: tyro.conf.OmitArgPrefixes[AugmentConfig] = field(default_factory=AugmentConfig)


def run(config: FinetuneConfig) -> dict[str, Any]:
    """Trains and prints the final table.

    Returns:
        What ``RUN/results.json`` holds: figures before and after, on the validation set and on the source pictures.

    Raises:
        SbmError: if detector, labels or settings are at fault.
    """
    from tqdm import tqdm

    from labeling.detectors.finetuning.epochs import evaluate
    from labeling.detectors.finetuning.training_run import best_of, train
    from labeling.detectors.networks.network_detector import NetworkDetector
    from labeling.detectors.registry import choose_device, load_named_network
    from labeling.io.formats.atomic import write_json
    from labeling.training.run_files import RESULTS_FILE

    check_name(config.detector)
    config.train.check()
    config.augment.check()
    device = choose_device(config.device)
    network, digest = load_named_network(config.detector)
    pictures, validation, replay, source = _read(config)
    known = network.spec.categories
    names = _categories(config, known, pictures, validation)
    if names != known:
        from labeling.detectors.networks.mask_rcnn import with_categories

        network = with_categories(network, names)
    sets = {"validation": validation, "source pictures": source}
    bar = functools.partial(tqdm, delay=2.0, leave=False, file=sys.stderr)

    def scores(which: Any) -> dict[str, "Scores"]:
        detector = NetworkDetector(which, "scored", device=device)
        return {
            name: evaluate(detector, some, functools.partial(bar, desc=f"scoring on {name}", unit="batch"))
            for name, some in sets.items()
            if some
        }

    before = scores(network)
    about = {"started_from": config.detector, "started_from_digest": digest, "labels": _sources(config)}
    state = train(
        network,
        config.out,
        pictures,
        validation,
        config.train,
        config.augment,
        replay,
        device,
        about,
        functools.partial(print, flush=True),
        functools.partial(bar, unit="batch"),
        tuple(name for name in names if name not in known),
    )
    after = scores(best_of(config.out))
    results = {
        "detector": config.detector,
        "labels": _sources(config),
        "best_iteration": state.best_iteration,
        "iterations": state.iteration,
        "before": {name: asdict(one) for name, one in before.items()},
        "after": {name: asdict(one) for name, one in after.items()},
        "seed": config.train.seed,
    }
    write_json(config.out / RESULTS_FILE, results)
    print_table(before, after)
    print(f"detector: {config.out}")
    return results


def _sources(config: FinetuneConfig) -> str:
    """What is learnt from, in words."""
    return ", ".join(map(str, config.labels))


def _read(
    config: FinetuneConfig,
) -> "tuple[list[AnnotatedPicture], list[AnnotatedPicture], list[AnnotatedPicture], list[AnnotatedPicture]]":
    """Pictures to learn from, to validate on, to replay, and to measure forgetting on."""
    from dataclasses import replace

    from labeling.detectors.data.annotated_pictures import hold_out, is_split, read_pictures, with_annotations

    check_sources(config.labels, config.dataset)
    if not 0 <= config.least_confidence <= 1:
        raise UsageError(f"--least-confidence must lie in [0, 1], not {config.least_confidence:g}")
    pictures = with_annotations(
        [picture for one in config.labels for picture in read_pictures(one, "train", config.dataset)],
        lambda one: replace(one, ignore=one.ignore or one.weight < config.least_confidence),
    )
    if not any(not one.ignore for picture in pictures for one in picture.annotations):
        raise UsageError(f"{_sources(config)}: no label that could be learnt from, in {len(pictures)} pictures")
    validation = read_pictures(config.val, "val") if config.val is not None else []
    if config.replay is None:
        return pictures, validation, [], []
    if is_split(config.replay):
        return pictures, validation, read_pictures(config.replay, "train"), read_pictures(config.replay, "val")
    return pictures, validation, *hold_out(read_pictures(config.replay))


def _categories(
    config: FinetuneConfig,
    known: tuple[str, ...],
    pictures: "list[AnnotatedPicture]",
    validation: "list[AnnotatedPicture]",
) -> tuple[str, ...]:
    """The categories that the trained detector is to have.

    Raises:
        UsageError: if there would be nothing to learn, or nothing to validate on.
    """
    from labeling.detectors.data.annotated_pictures import category_names

    taught = category_names(pictures)
    new = tuple(name for name in taught if name not in known)
    if new and config.new_categories:
        known = (*known, *new)
    elif len(new) == len(taught):
        raise UsageError(
            f"{_sources(config)}: none of the categories there ({', '.join(taught)}) is one that {config.detector} "
            f"knows ({', '.join(name for name in known if name)}); --new-categories teaches them"
        )
    elif new:
        print(f"note: {config.detector} has no name for {', '.join(new)}: background; --new-categories teaches them")
    if validation and not set(category_names(validation)) & set(known):
        raise UsageError(f"{config.val}: none of its categories is one that the detector knows, nothing to validate on")
    return known


def print_table(before: "dict[str, Scores]", after: "dict[str, Scores]") -> None:
    """Prints figures before and after, over all categories and per category; in percent."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title="AP in percent: before -> after", title_justify="left", title_style="bold")
    table.add_column("")
    table.add_column("category", overflow="fold")
    for heading in ("mask\nAP50", "mask\nAP30", "box\nAP50", "box\nAP30"):
        table.add_column(heading, justify="right", no_wrap=True)
    figures = ("mask_ap50", "mask_ap30", "box_ap50", "box_ap30")
    for name, old in before.items():
        new = after[name]
        cells = [_change(getattr(old, figure), getattr(new, figure)) for figure in figures]
        table.add_row(name, "all", *cells, style="bold")
        for category in sorted(new.per_class_ap50):
            ap = _change(old.per_class_ap50.get(category), new.per_class_ap50[category])
            table.add_row("", Text(category), ap, "", "", "")
        table.add_section()
    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    if before:
        console.print(table)
    if "source pictures" in before:
        old, new = before["source pictures"].mask_ap50, after["source pictures"].mask_ap50
        if old is not None and new is not None:
            print(f"forgetting: AP50 on the source pictures changed by {100 * (new - old):+.1f} points")


def _change(old: float | None, new: float | None) -> str:
    def text(value: float | None) -> str:
        return "-" if value is None else f"{100 * value:.1f}"

    return f"{text(old)} -> {text(new)}"


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(FinetuneConfig, run, "python -m labeling.finetune", arguments)


if __name__ == "__main__":
    sys.exit(main())
