"""The page about labels where things move, of the experiment ``moving_labels``."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.ablations.moving_labels import DETECTOR, MOVING, OURS, PARTS, STILL
from experiments.pages.markdown import Pictures, interval, points, read_result, render, table
from labeling.core.errors import SbmError

PAGE = "moving-labels.md"
OF_LABELS = ("moving_labels.json",)
"""Files of results whose figures depend on labels."""


def compose(results: Path) -> tuple[str, Pictures]:
    """The page; it has no pictures of its own."""
    content = read_result(results / "moving_labels.json")
    if content is None:
        raise SbmError(f"{results}: no moving_labels.json; run this experiment first")
    return page(content), {}


def page(content: Mapping[str, Any]) -> str:
    """The text of the page."""
    worlds = content["worlds"]
    return render(
        "moving-labels.md.jinja",
        content=content,
        levels={name: _levels(world["results"]) for name, world in worlds.items()},
        differences=_differences(worlds),
        shares=_shares(worlds),
    )


def _levels(found: Mapping[str, Any]) -> str:
    """AP50 of all episodes ranked together, of the detector and of both kinds of labels."""
    headings = ["things", "masks", *(f"AP50: {part}" for part in PARTS), *(f"mean IoU: {part}" for part in PARTS)]
    rows = []
    for motion, treatments in found.items():
        for treatment, parts in treatments.items():
            name = treatment if treatment == DETECTOR else f'labels, "{treatment}"'
            figures = [points(parts[part]["pooled"][one]) for one in ("mask_ap50", "mean_iou") for part in PARTS]
            rows.append([motion, name, *figures])
    return table(headings, rows, "---:")


def _differences(worlds: Mapping[str, Any]) -> str:
    """What --moving changes, paired over episodes."""
    rows = []
    for name, world in worlds.items():
        for motion, treatments in world["results"].items():
            gains = [treatments[OURS][part]["gain"]["mask_ap50"] for part in PARTS]
            rows.append([name, motion, *(interval(one) for one in gains)])
    return table(["world", "things", *PARTS], rows, "---:")


def _shares(worlds: Mapping[str, Any]) -> str:
    """How much of the AP50 that labels have where the same things stand is left where they move."""
    rows = []
    for name, world in worlds.items():
        moving, still = (world["results"][motion][OURS] for motion in (MOVING, STILL))
        cells = []
        for part in PARTS:
            before, after = (one[part]["pooled"]["mask_ap50"] for one in (still, moving))
            share = f"{100 * after / before:.0f} %" if before and after is not None else "-"
            cells += [share, interval(moving[part]["kept"]["mask_ap50"])]
        rows.append([name, *cells])
    return table(["world", *(text for part in PARTS for text in (part, "difference"))], rows, "---:")
