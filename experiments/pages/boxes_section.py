"""Table 5.5 on the page of results: 3-D boxes, in streets as in the thesis, and in rooms."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.figures.thesis_values import BOXES_3D
from experiments.pages.label_report import SCALES

NAME, TITLE = "table_5_5", "Table 5.5: boxes in three dimensions"
PICTURE, VIEWS = "results_table_5_5.png", "boxes_{}.png"
WORDS = {"recorded": "of the pre-trained detector", "told": "true ones"}
TARGETS = {
    "objects": "{:.0f}",
    "iou": "{:.2f}",
    "single_view_iou": "{:.2f}",
    "reach_half": "{:.0%}",
    "heading_apart_deg": "{:.0f}°",
}
"""How the figures of box targets are written."""
COLOURS = ("#8a94a0", "#b9c0c8", "#137a3e", "#2f5fb3")


@dataclass(frozen=True)
class Boxes:
    """What there is to tell of 3-D boxes."""

    content: Mapping[str, Any]
    """Of ``table_5_5.json``."""
    views: tuple[str, ...]
    """Worlds of which there are pictures of boxes in views."""


def read_boxes(results: Path) -> Boxes | None:
    """Table 5.5, and of which worlds there are pictures; None if it has not been run."""
    from experiments.cache.worlds import WORLDS
    from experiments.figures.boxes import RECORD
    from labeling.io.formats.checked_json import read_json

    file = results / f"{NAME}.json"
    if not file.is_file():
        return None
    views = tuple(world for world in WORLDS if (results / f"{RECORD.format(world)}.json").is_file())
    return Boxes(dict(read_json(file).mapping()), views)


def boxes_section(content: Mapping[str, Any], views: Sequence[str]) -> list[str]:
    """The section's parts.

    Args:
        content: of ``table_5_5.json``.
        views: worlds of which there are pictures of boxes in views.
    """
    seeds, train = len(content["seeds"]), content["settings"]["train"]
    parts = [
        "Boxes in the world, found from one view each, in unseen scenes. LDLS diffuses the masks of the 2-D detector "
        "over the points of the view and fits boxes to what it gets; as published, and with the neighbourhood that "
        "suits training scenes best. The frustum PointNets learn from masks and boxes that the label generator has "
        "made of many views of training scenes (SbM), or from ground truth of the same views (supervised). "
        f"Scale `{content['scale']}` ({SCALES[content['scale']]}), {seeds} {'seed' if seeds == 1 else 'seeds'}; at "
        f"most {train['iterations']} batches of {train['batch_size']}, {train['num_points']} points, layers "
        f"{train['width']:g} times as wide as published.",
        f"![AP of 3-D boxes](pictures/{PICTURE})",
    ]
    for world, found in content["worlds"].items():
        parts += _world(world, found)
        if world in views:
            parts.append(
                "Boxes of LDLS and of the SbM frustum PointNet (seed 0) on the same view and from above; in black the "
                f"true ones:\n\n![3-D boxes on views of {world}](pictures/{VIEWS.format(world)})"
            )
    return parts


def _world(world: str, found: Mapping[str, Any]) -> list[str]:
    episodes = {part: pool["episodes"] for part, pool in found["pools"].items()}
    lines = ["| | 2-D boxes | AP25 | thesis | AP50 | AP25 from above |", "|---" * 6 + "|"]
    for row in found["rows"]:
        theirs = BOXES_3D.get(row["name"]) if (world, row["boxes"]) == ("streets", "recorded") else None
        cells = [spread(row, "ap25"), "-" if theirs is None else f"{theirs:.2f}"]
        cells += [spread(row, "ap50"), spread(row, "bird_ap25")]
        lines.append(f"| {row['name']} | {WORDS[row['boxes']]} | {' | '.join(cells)} |")
    tried = found["ldls_ap25_by_scale_m"]
    best = max(tried, key=lambda scale: tried[scale])
    text = [
        f"### {world.capitalize()}",
        f"{episodes['learn']} episodes to learn from, {episodes['choose']} to choose the best network by, "
        f"{episodes['wide']} of unseen scenes to test on. LDLS as published weighs neighbours over 1 m; tuned over "
        f"{best} m, the best on the episodes to choose by "
        f"({', '.join(f'{scale} m: AP25 {100 * ap25:.1f}' for scale, ap25 in tried.items())}).",
        "\n".join(lines),
    ]
    their_share = BOXES_3D["SbM F-PointNet"] / BOXES_3D["supervised F-PointNet"]
    their_lead = BOXES_3D["SbM F-PointNet"] - BOXES_3D["LDLS"]
    for boxes in WORDS:
        rows = {row["name"]: row for row in found["rows"] if row["boxes"] == boxes}
        ours, ceiling, rival = (
            mean(rows[name], "ap25") for name in ("SbM F-PointNet", "supervised F-PointNet", "LDLS")
        )
        tuned = mean(rows["LDLS, tuned"], "ap25")
        if ceiling:
            text.append(
                f"With 2-D boxes {'that are true' if boxes == 'told' else WORDS[boxes]}: SbM reaches "
                f"**{ours / ceiling:.2f}** of supervised at .25 (thesis: {their_share:.2f}), and lies "
                f"**{ours - max(rival, tuned):+.1f}** points from the better LDLS (thesis: {their_lead:+.1f})."
            )
    return [
        *text,
        "AP25 by category, with true 2-D boxes, and how many instances:",
        _categories(found),
        _ranges(found),
        "What the SbM networks are taught: IoU of the labels' boxes with the nearest true object of their category, "
        "from the fused views and, for comparison, from the points of the label's mask in one view:",
        _targets(found["targets"]),
    ]


def _targets(of_seeds: Sequence[Mapping[str, Mapping[str, float | None]]]) -> str:
    """Means over seeds, by category."""
    lines = [
        "| | labelled objects | IoU, many views | IoU, one view | reach .5 | heading off by |",
        "|---" * 6 + "|",
    ]
    for name in sorted({name for one in of_seeds for name in one}):
        cells = [name]
        for figure, form in TARGETS.items():
            known = [value for one in of_seeds if name in one for value in [one[name][figure]] if value is not None]
            cells.append(form.format(np.mean(known)) if known else "-")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _categories(found: Mapping[str, Any]) -> str:
    rows = [row for row in found["rows"] if row["boxes"] == "told"]
    names = rows[0]["runs"][0]["instances"]
    lines = [
        f"| | {' | '.join(f'{name} ({count})' for name, count in names.items())} |",
        "|---" * (len(names) + 1) + "|",
    ]
    for row in rows:
        lines.append(f"| {row['name']} | {' | '.join(spread(row, 'per_class_ap25', name) for name in names)} |")
    return "\n".join(lines)


def _ranges(found: Mapping[str, Any]) -> str:
    rows = [row for row in found["rows"] if row["boxes"] == "told"]
    bins = rows[0]["runs"][0]["by_range"]
    heads = [f"{one['from_m']:g} to {one['to_m']:g} m ({one['objects']})" for one in bins]
    lines = [f"| AP25 by distance | {' | '.join(heads)} |", "|---" * (len(bins) + 1) + "|"]
    for row in rows:
        cells = [_text([run["by_range"][place]["ap25"] for run in row["runs"]]) for place in range(len(bins))]
        lines.append(f"| {row['name']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def values(row: Mapping[str, Any], figure: str, category: str | None = None) -> list[float]:
    """A figure in points, one of each seed; without seeds for which it is undefined."""
    found = [run[figure] if category is None else run[figure].get(category) for run in row["runs"]]
    return [100.0 * value for value in found if value is not None]


def mean(row: Mapping[str, Any], figure: str) -> float:
    """Over seeds, in points; 0 where it is undefined."""
    found = values(row, figure)
    return float(np.mean(found)) if found else 0.0


def spread(row: Mapping[str, Any], figure: str, category: str | None = None) -> str:
    """Mean and standard deviation over seeds."""
    return _text([value / 100.0 for value in values(row, figure, category)])


def _text(found: Sequence[float | None]) -> str:
    known = [100.0 * value for value in found if value is not None]
    if not known:
        return "-"
    return f"{np.mean(known):.1f}" if len(known) == 1 else f"{np.mean(known):.1f} ± {np.std(known, ddof=1):.1f}"


def draw(content: Mapping[str, Any], path: Path) -> None:
    """AP25 by world and by who found the objects in pictures, one bar for each row, with a dot for each seed."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    groups = [(world, boxes) for world in content["worlds"] for boxes in WORDS]
    figure, axes = plt.subplots(figsize=(8.0, 3.4), dpi=110, layout="constrained")
    for place, (world, boxes) in enumerate(groups):
        rows = [row for row in content["worlds"][world]["rows"] if row["boxes"] == boxes]
        for number, row in enumerate(rows):
            x = place + (number - (len(rows) - 1) / 2) * 0.2
            found = values(row, "ap25")
            axes.bar(x, mean(row, "ap25"), 0.2, color=COLOURS[number], label=row["name"] if place == 0 else None)
            axes.plot([x] * len(found), found, ".", color="black", markersize=2.5)
    axes.set_xticks(range(len(groups)), [f"{world},\n2-D boxes {WORDS[boxes]}" for world, boxes in groups], fontsize=8)
    axes.set_ylabel("AP of 3-D boxes at .25")
    axes.set_ylim(0, 100)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False, ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.15))
    figure.savefig(path, format="png")
    plt.close(figure)
