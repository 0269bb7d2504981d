"""The page about fine-tuning, written from ``fine_tuning.json``, and its picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments.pages.label_report import SCALES
from labeling.core.errors import SbmError
from labeling.io.formats.atomic import atomic_file
from labeling.io.formats.checked_json import read_json

matplotlib.use("Agg")

RESULTS, PAGE, PICTURE = "fine_tuning.json", "fine-tuning.md", "pictures/fine_tuning.png"
TEACHERS = {"labels": "SbM labels", "truth": "ground truth"}
COLOURS = {"before": "#8a94a0", "labels": "#137a3e", "truth": "#2f5fb3"}
SETS = {"validation": "validation scenes", "photographs": "photographs"}


def write_page(results: Path, docs: Path) -> list[Path]:
    """Writes the page and the picture in it.

    Args:
        results: folder with ``fine_tuning.json``.
        docs: folder for the page.

    Returns:
        The files written.

    Raises:
        SbmError: if the experiment has not run yet.
    """
    path = results / RESULTS
    if not path.is_file():
        raise SbmError(f"{path} is missing; python -m experiments.run fine_tuning makes it")
    content = dict(read_json(path).mapping())
    with atomic_file(docs / PICTURE) as temporary:
        draw(content, temporary)
    with atomic_file(docs / PAGE) as temporary:
        temporary.write_text("\n\n".join(_parts(content)) + "\n", encoding="utf-8")
    return [docs / PAGE, docs / PICTURE]


def figures_of(world: dict[str, Any], teacher: str, part: str, figure: str = "mask_ap50") -> list[float]:
    """A figure of all runs with one teacher, in points; one per seed."""
    return [100 * run[part][figure] for run in world["runs"] if run["teacher"] == teacher]


def gap_closed(world: dict[str, Any], figure: str = "mask_ap50") -> float | None:
    """Share of the way from the detector before to ground-truth fine-tuning that learning from labels goes, by means
    over seeds; None where ground truth does not help.
    """
    before = 100 * world["before"]["validation"][figure]
    labels, truth = (np.mean(figures_of(world, teacher, "validation", figure)) for teacher in TEACHERS)
    return float((labels - before) / (truth - before)) if truth > before else None


def _parts(content: dict[str, Any]) -> list[str]:
    train, seeds = content["settings"]["train"], content["seeds"]
    parts = [
        "# Fine-tuning on labels that nobody made",
        "Written by `python -m experiments.run fine_tuning --report` from `experiments/results/fine_tuning.json`; do "
        "not edit by hand.",
        f"`{content['detector']}` guides the agent through training scenes (ring policy, 25 views an episode); the "
        "label generator turns its confident detections into masks of all views; the detector learns from these, with "
        "source photographs mixed in, and the best network is chosen on labels of further episodes. **No human label "
        "and no ground truth is involved.** Beside it stands the same training on ground truth of the same views: the "
        "ceiling. Both are tried on validation scenes, which neither has seen.",
        f"Scale `{content['scale']}` ({SCALES[content['scale']]}): at most {train['iterations']} batches of "
        f"{train['batch_size']}, learning rate {train['learning_rate']:g}. Mean and range over {len(seeds)} seeds of "
        "label generation and training; episodes and starting weights are the same for all.",
        f"![AP50 before and after, by world and teacher]({PICTURE})",
    ]
    for name, world in content["worlds"].items():
        parts += [f"## {name.capitalize()}", _setup(world), _table(world), _classes(world)]
    return parts


def _setup(world: dict[str, Any]) -> str:
    counts = {name: world["pools"][name]["episodes"] for name in ("learn", "choose", "val")}
    detector = 100 * world["labels"][0]["detector"]["mask_ap50"]
    made = [100 * one["pseudo_labels"]["mask_ap50"] for one in world["labels"]]
    closed = gap_closed(world)
    share = "" if closed is None else f" Share of the gap to ground truth closed, at IoU .5: **{closed:.2f}**."
    if closed is not None and closed > 1:
        share += " (More than 1: after so few batches, ground truth is no ceiling yet.)"
    homes = {name: len(set(world["pools"][name]["scenes"])) for name in counts}
    return (
        f"{counts['learn']} episodes ({homes['learn']} scenes) to learn from, {counts['choose']} ({homes['choose']}) "
        f"to choose by, {counts['val']} ({homes['val']}) to report on. On the "
        f"views learned from, AP50 of the detector is {detector:.1f}, of the labels {_spread(made)}.{share}"
    )


def _table(world: dict[str, Any]) -> str:
    lines = ["| | AP50 | AP30 | AP50 on photographs |", "|---|---|---|---|"]
    before = world["before"]
    lines.append(
        f"| before | {100 * before['validation']['mask_ap50']:.1f} | {100 * before['validation']['mask_ap30']:.1f} "
        f"| {100 * before['photographs']['mask_ap50']:.1f} |"
    )
    for teacher, words in TEACHERS.items():
        cells = [
            _spread(figures_of(world, teacher, part, figure))
            for part, figure in (
                ("validation", "mask_ap50"),
                ("validation", "mask_ap30"),
                ("photographs", "mask_ap50"),
            )
        ]
        lines.append(f"| after {words} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _classes(world: dict[str, Any]) -> str:
    """AP50 by class on validation scenes."""
    before = world["before"]["validation"]["per_class_ap50"]
    names = sorted(name for name, ap in before.items() if ap is not None)
    lines = ["| AP50 | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    lines.append("| before | " + " | ".join(f"{100 * before[name]:.1f}" for name in names) + " |")
    for teacher, words in TEACHERS.items():
        runs = [run["validation"]["per_class_ap50"] for run in world["runs"] if run["teacher"] == teacher]
        cells = [f"{100 * np.mean([run[name] for run in runs]):.1f}" for name in names]
        lines.append(f"| after {words} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _spread(values: Sequence[float]) -> str:
    """Mean and, of several, range."""
    mean = f"{np.mean(values):.1f}"
    return mean if len(values) < 2 else f"{mean} ({min(values):.1f} to {max(values):.1f})"


def draw(content: dict[str, Any], path: Path) -> None:
    """Draws AP50 before and after: a panel for each world, bars for means, dots for seeds.

    Args:
        content: of ``fine_tuning.json``.
        path: PNG to write.
    """
    worlds = content["worlds"]
    figure, panels = plt.subplots(1, len(worlds), figsize=(4.6 * len(worlds), 3.4), dpi=100, sharey=True, squeeze=False)
    for axes, (name, world) in zip(panels[0], worlds.items(), strict=True):
        _panel(axes, world)
        axes.set_title(name, fontsize=10)
    panels[0][0].set_ylabel("AP50, per cent")
    panels[0][0].legend(frameon=False, fontsize=8, loc="upper left")
    figure.tight_layout()
    figure.savefig(path, format="png")
    plt.close(figure)


def _panel(axes: Axes, world: dict[str, Any]) -> None:
    words = {"before": "before", **{teacher: f"after {text}" for teacher, text in TEACHERS.items()}}
    for group, part in enumerate(SETS):
        for place, name in enumerate(words):
            values = [100 * world["before"][part]["mask_ap50"]] if name == "before" else figures_of(world, name, part)
            x, mean = group + 0.26 * (place - 1), float(np.mean(values))
            axes.bar(x, mean, 0.24, color=COLOURS[name], label=words[name] if group == 0 else None)
            if len(values) > 1:
                axes.plot(np.full(len(values), x), values, "o", color="#1f2328", ms=3, alpha=0.7)
            axes.annotate(f"{mean:.1f}", (x, max(values)), ha="center", va="bottom", fontsize=7.5)
    axes.set_xticks(range(len(SETS)), list(SETS.values()))
    axes.set_ylim(0, 105)
    axes.grid(axis="y", color="#d8dee4", lw=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
