"""Table 5.5 on the page of results: 3-D boxes, in streets as in the thesis, and in rooms."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.figures.result_values import BOXES_3D, ratio_to_ceiling
from experiments.pages.markdown import mean_std, table
from experiments.tables.table_5_5 import CEILING, LDLS, OURS, SHARED, TUNED

MASK_SOURCES = {"recorded": "of the pre-trained detector", "told": "true ones (for LDLS, true masks)"}
"""Where the 2-D detections come from that are lifted, as results name it and as the page does."""
TARGETS = {
    "objects": "{:.0f}",
    "iou": "{:.2f}",
    "single_view_iou": "{:.2f}",
    "reach_half": "{:.0%}",
    "heading_apart_deg": "{:.0f}°",
}
"""How the figures of box targets are written."""


def boxes_section(content: Mapping[str, Any], pictured: Sequence[str]) -> dict[str, Any]:
    """What the page tells of 3-D boxes.

    Args:
        content: of ``table_5_5.json`` or of ``table_5_5_rooms.json``.
        pictured: worlds of which there are pictures of boxes in views.
    """
    return {
        **content,
        "worlds": [_world(name, found) for name, found in content["worlds"].items()],
        "pictured": pictured,
        "has_intervals": any(
            run.get("resampled") for found in content["worlds"].values() for row in found["rows"] for run in row["runs"]
        ),
        "thesis_share": BOXES_3D[OURS] / BOXES_3D[CEILING],
        "thesis_lead": BOXES_3D[OURS] - BOXES_3D[LDLS],
    }


def _world(world: str, found: Mapping[str, Any]) -> dict[str, Any]:
    means = []
    for row in found["rows"]:
        thesis = BOXES_3D.get(row["name"]) if (world, row["boxes"]) == ("streets", "recorded") else None
        cells = [mean_std(_values(row, "ap25")), "-" if thesis is None else f"{thesis:.2f}"]
        cells += [mean_std(_values(row, "ap50")), mean_std(_values(row, "bird_ap25"))]
        means.append([row["name"], MASK_SOURCES[row["boxes"]], *cells])
    scales, of_truth = found["ldls_ap25_by_scale_m"], [row for row in found["rows"] if row["boxes"] == "told"]
    counts, bins = of_truth[0]["runs"][0]["instances"], of_truth[0]["runs"][0]["by_range"]
    by_range = [
        [row["name"], *(mean_std(_values(row, "by_range", k, "ap25")) for k, _ in enumerate(bins))] for row in of_truth
    ]
    ranges = [f"{one['from_m']:g} to {one['to_m']:g} m ({one['objects']})" for one in bins]
    return {
        **found,
        "name": world,
        "best_scale": max(scales, key=lambda scale: scales[scale]),
        "means": means,
        "shares": [one for source in MASK_SOURCES for one in _shares(found, source)],
        "categories": [_by_category(of_truth, at, counts) for at in ("ap25", "ap50")],
        "ranges": table(["AP25 by distance", *ranges], by_range),
        "box_targets": {row: _targets(of_seeds) for row, of_seeds in found["targets"].items()},
    }


def _by_category(rows: Sequence[Mapping[str, Any]], at: str, counts: Mapping[str, int]) -> str:
    """AP of each category, with how many instances there are in the head of the table."""
    cells = [[row["name"], *(mean_std(_values(row, f"per_class_{at}", one)) for one in counts)] for row in rows]
    return table([at.upper(), *(f"{name} ({count})" for name, count in counts.items())], cells)


def _shares(world: Mapping[str, Any], source: str) -> list[dict[str, Any]]:
    """How near SbM comes to the supervised network, and how far it lies from LDLS; empty if the former finds none."""
    of_source, found = {row["name"]: row for row in world["rows"] if row["boxes"] == source}, []
    scenes = len(set(world["pools"]["wide"].get("scenes", ())))
    for name in (OURS, SHARED):
        reached = [ratio_to_ceiling(of_source[name], of_source[CEILING], figure, scenes) for figure in ("ap25", "ap50")]
        if reached[0][0] is None:
            continue
        found.append(
            {
                "row": name,
                "source": "that are true" if source == "told" else MASK_SOURCES[source],
                "reached": [_reached(*one) for one in reached],
                "leads": [_lead(of_source, name, figure) for figure in ("ap25", "ap50")],
            }
        )
    return found


def _lead(of_source: Mapping[str, Mapping[str, Any]], name: str, figure: str) -> float:
    """By how many points a row lies above the better one of LDLS, of means over seeds."""
    ours, *others = (float(np.mean(_values(of_source[row], figure) or [0.0])) for row in (name, LDLS, TUNED))
    return ours - max(others)


def _reached(share: float | None, between: tuple[float, float] | None) -> str:
    if share is None:
        return "-"
    return f"**{share:.2f}**" + ("" if between is None else " [{:.2f}, {:.2f}]".format(*between))


def _targets(of_seeds: Sequence[Mapping[str, Mapping[str, float | None]]]) -> list[list[str]]:
    """Means over seeds, by category."""
    rows = []
    for name in sorted({name for one in of_seeds for name in one}):
        cells = [name]
        for figure, form in TARGETS.items():
            known = [value for one in of_seeds if name in one for value in [one[name][figure]] if value is not None]
            cells.append(form.format(np.mean(known)) if known else "-")
        rows.append(cells)
    return rows


def _values(row: Mapping[str, Any], *place: str | int) -> list[float]:
    """A figure in points, one of each seed; without seeds for which it is undefined.

    Args:
        row: of the table.
        *place: where the figure stands in the record of a run.
    """
    found = []
    for run in row["runs"]:
        value: Any = run
        for key in place:
            value = value.get(key) if isinstance(value, dict) else value[key]
        if value is not None:
            found.append(100.0 * value)
    return found
