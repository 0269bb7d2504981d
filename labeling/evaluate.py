"""Evaluates a label set or a detector against ground truth: ``python -m labeling.evaluate LABELS_OR_EPISODES``."""

import functools
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from labeling.core.errors import UsageError
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.cli import make_main, progress_bar
from labeling.runtime.help import CommandHelp

if TYPE_CHECKING:
    from labeling.evaluation.compare import Evaluation

METRICS_FILE, REPORT_FILE = "metrics.json", "report.html"


@dataclass(frozen=True)
class EvaluateConfig:
    """Compares the detector and the pseudo-labels made from it with ground truth, on the same views.

    Prints a table and writes LABELS/metrics.json and LABELS/report.html. Given episodes instead of a label set, or a
    detector, it scores the detector alone: the detections beside the frames, or what --detector finds now.
    """

    labels: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="LABELS_OR_EPISODES")]]
    """The label set: what ``labeling.generate`` wrote to its ``--out``; or episodes with ground truth; or, with
    --detector, a COCO folder."""
    dataset: Path | None = None
    """Where the episodes lie. By default where the label set says it was made from; needed once either has moved."""
    detector: str | None = None
    """Run this detector on the pictures and score what it finds: ``compact``, the folder of a labeling.finetune run, or
    any other that ``labeling.detect`` takes."""
    metrics: Path | None = None
    """Where to write the figures of a detector alone, as JSON."""
    max_strips: int = 40
    """Views shown in the report at most. 40 keep it below a few megabytes."""
    max_worst: int = 12
    """Of those, how many show the worst pseudo-labels; as many again show the most improved, and things that are not
    there; the others are spread over the episodes."""
    recording: tyro.conf.OmitArgPrefixes[RecordingConfig] = field(default_factory=RecordingConfig)


def run_either(config: EvaluateConfig) -> None:
    """Evaluates what it was given: a label set, or a detector alone."""
    config.recording.check()
    if config.detector is not None or _holds_episodes(config.labels, config.recording):
        score_alone(config)
    else:
        run(config)


def _holds_episodes(path: Path, recording: RecordingConfig) -> bool:
    from labeling.core.errors import EpisodeFormatError
    from labeling.io.episodes import find_episodes
    from labeling.io.file_names import MODAL_FILE

    if not path.is_dir() or (path / MODAL_FILE).is_file():
        return False
    try:
        return bool(find_episodes(path, recording))
    except EpisodeFormatError:
        return False


def run(config: EvaluateConfig) -> "Evaluation":
    """Evaluates a label set, writes ``metrics.json`` and ``report.html`` into it, and prints the table.

    Raises:
        SbmError: if label set or dataset are malformed, or there is no ground truth. Nothing is written then.
    """
    from labeling.evaluation.compare import evaluate_label_set
    from labeling.evaluation.report.html import write_report
    from labeling.formats.atomic import write_json

    if config.recording != RecordingConfig():
        raise UsageError("how its recordings are read, a label set says itself; these options are for episodes")
    if config.metrics is not None:
        raise UsageError("--metrics is for a detector alone; the figures of a label set lie in it as metrics.json")
    if min(config.max_strips, config.max_worst) < 0:
        raise UsageError("--max-strips and --max-worst count views; give 0 or more")
    bar = functools.partial(progress_bar, desc="evaluating", unit="episode")
    evaluation = evaluate_label_set(config.labels, config.dataset, bar)
    write_report(config.labels / REPORT_FILE, evaluation, config.max_strips, config.max_worst)
    write_json(config.labels / METRICS_FILE, evaluation.metrics)
    print_table(evaluation.metrics)
    print(f"metrics: {config.labels / METRICS_FILE}\nreport:  {config.labels / REPORT_FILE}")
    return evaluation


def score_alone(config: EvaluateConfig) -> None:
    """Scores a detector alone, prints the table and writes ``--metrics`` if asked to.

    Raises:
        SbmError: if detector or pictures are at fault, or there is no ground truth.
    """
    from labeling.detectors.registry import load_detector
    from labeling.evaluation.detector_scores import score_detector, score_episodes
    from labeling.formats.atomic import write_json

    are_episodes = _holds_episodes(config.labels, config.recording)
    if are_episodes and config.dataset is not None:
        raise UsageError(f"--dataset is where the episodes of a label set lie; {config.labels} holds episodes itself")
    if not are_episodes and config.recording != RecordingConfig():
        raise UsageError(f"{config.labels}: holds no episodes, and how these are read is all that such options say")
    detector = None if config.detector is None else load_detector(config.detector)
    if detector is None or are_episodes:
        metrics = score_episodes(config.labels, config.recording, detector)
    else:
        metrics = score_detector(config.labels, detector, config.dataset)
    if config.metrics is not None:
        write_json(config.metrics, metrics)
    print_table(metrics)


def print_table(metrics: dict[str, Any]) -> None:
    """Prints the figures of all methods over all categories, then per category, and what there is to note."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from labeling.evaluation.compare import FIGURES, categories_by_presence
    from labeling.evaluation.report.html import plural

    counts = metrics["counts"]
    nouns = {"episodes": "episode", "views": "view", "ground_truth_instances": "instance"}
    title = ", ".join(plural(counts[key], noun) for key, noun in nouns.items() if key in counts)
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("", no_wrap=False)
    table.add_column("category", overflow="fold")
    for figure in FIGURES.values():
        table.add_column(figure.replace(" ", "\n"), justify="right", no_wrap=True)
    table.add_column("instances", justify="right", no_wrap=True)

    def add_row(method: str, category: str | Text, record: dict[str, Any], style: str | None = None) -> None:
        numbers = (_number(record[key]) for key in FIGURES)
        table.add_row(method, category, *numbers, f"{record['ground_truth_instances']}", style=style)

    methods = [name for name in ("detector", "pseudo_labels") if name in metrics]
    for method in methods:
        add_row(method, "all", metrics[method], "bold")
    shown, absent = categories_by_presence(metrics)
    for name in shown:
        table.add_section()
        for method in methods:
            if name in metrics[method]["per_class"]:
                # Text, not a string: brackets in a category name are no markup.
                add_row(method, Text(name), metrics[method]["per_class"][name])
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    labels = metrics.get("pseudo_labels")
    if labels is not None and labels["amodal_mask_ap50"] is not None:
        print(
            f"amodal masks of pseudo_labels: AP50 {_number(labels['amodal_mask_ap50'])}, "
            f"AP30 {_number(labels['amodal_mask_ap30'])}, mean IoU {_number(labels['amodal_mean_iou'])}"
        )
    if absent:
        print(f"not in the table, for these views show none: {', '.join(absent)}")
    for note in metrics["notes"]:
        print(f"note: {note}")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


HELP = CommandHelp(
    examples=(
        ("LABELS", "a label set beside its detector: table, metrics.json, report.html"),
        ("EPISODES --detector compact", "a detector alone"),
    ),
)
main = make_main("labeling.evaluate", EvaluateConfig, run_either, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
