"""Evaluates a label set against ground truth: ``python -m labeling.evaluate LABELS [--dataset PATH]``."""

import functools
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from labeling.cli import run_command
from labeling.errors import UsageError

if TYPE_CHECKING:
    from labeling.evaluation import Evaluation

METRICS_FILE, REPORT_FILE = "metrics.json", "report.html"


@dataclass(frozen=True)
class EvaluateConfig:
    """Compares the detector and the pseudo-labels made from it with ground truth, on the same views.

    Prints a table and writes LABELS/metrics.json and LABELS/report.html.
    """

    labels: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="LABELS")]]
    """The label set: what ``labeling.generate`` wrote to its ``--out``."""
    dataset: Path | None = None
    """Where the episodes lie. By default where the label set says it was made from; needed once either has moved."""
    max_strips: int = 40
    """Views shown in the report at most. 40 keep it below a few megabytes."""
    max_worst: int = 12
    """Of those, how many show the worst pseudo-labels; the others are spread over the episodes."""


def run(config: EvaluateConfig) -> "Evaluation":
    """Evaluates, writes ``metrics.json`` and ``report.html`` into the label set, and prints the table.

    Raises:
        SbmError: if label set or dataset are malformed, or there is no ground truth. Nothing is written then.
    """
    from tqdm import tqdm

    from labeling.evaluation import evaluate_label_set
    from labeling.files import write_json
    from labeling.report import write_report

    if min(config.max_strips, config.max_worst) < 0:
        raise UsageError("--max-strips and --max-worst count views; give 0 or more")
    bar = functools.partial(tqdm, delay=2.0, leave=False, unit="episode", file=sys.stderr)
    evaluation = evaluate_label_set(config.labels, config.dataset, functools.partial(bar, desc="evaluating"))
    write_report(
        config.labels / REPORT_FILE,
        evaluation,
        config.max_strips,
        config.max_worst,
        functools.partial(bar, desc="drawing"),
    )
    write_json(config.labels / METRICS_FILE, evaluation.metrics)
    print_table(evaluation.metrics)
    print(f"metrics: {config.labels / METRICS_FILE}\nreport:  {config.labels / REPORT_FILE}")
    return evaluation


def print_table(metrics: dict[str, Any]) -> None:
    """Prints the figures of both methods over all categories, then per category, and what there is to note."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from labeling.evaluation import FIGURES
    from labeling.report import HEADINGS, plural

    counts = metrics["counts"]
    table = Table(
        title=", ".join(
            plural(counts[key], noun)
            for key, noun in (("episodes", "episode"), ("views", "view"), ("ground_truth_instances", "instance"))
        ),
        title_justify="left",
        title_style="bold",
    )
    table.add_column("", no_wrap=False)
    table.add_column("category", overflow="fold")
    for key in FIGURES:
        table.add_column(HEADINGS[key].replace(" ", "\n"), justify="right", no_wrap=True)
    table.add_column("instances", justify="right", no_wrap=True)
    methods = ("detector", "pseudo_labels")
    for method in methods:
        record = metrics[method]
        table.add_row(
            method,
            "all",
            *(_number(record[key]) for key in FIGURES),
            f"{record['ground_truth_instances']}",
            style="bold",
        )
    for name in sorted(metrics["pseudo_labels"]["per_class"].keys() | metrics["detector"]["per_class"].keys()):
        table.add_section()
        for method in methods:
            record = metrics[method]["per_class"].get(name)
            if record is None:
                continue
            # Text, not a string: brackets in a category name are no markup.
            table.add_row(
                method,
                Text(name),
                *(_number(record[key]) for key in FIGURES),
                f"{record['ground_truth_instances']}",
            )
    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    console.print(table)
    labels = metrics["pseudo_labels"]
    if labels["amodal_mask_ap50"] is not None:
        print(
            f"amodal masks of pseudo_labels: AP50 {_number(labels['amodal_mask_ap50'])}, "
            f"AP30 {_number(labels['amodal_mask_ap30'])}, mean IoU {_number(labels['amodal_mean_iou'])}"
        )
    for note in metrics["notes"]:
        print(f"note: {note}")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(EvaluateConfig, run, "python -m labeling.evaluate", arguments)


if __name__ == "__main__":
    sys.exit(main())
