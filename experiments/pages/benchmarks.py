"""The page of benchmarks: results of ``python -m experiments.bench``, beside earlier ones where known."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from experiments.benchmarks.rows import Row, row_of, seconds_per_view
from experiments.pages.markdown import Pictures, read_result, render
from labeling.core.errors import SbmError

PAGE, VIEWS_PICTURE = "benchmarks.md", "labels_views.png"
FOLDER, BEFORE = "bench", "before"
"""In the folder of results; inside it, the same benches of an older state of the project on the same machine."""
TITLES = {
    "scenes": "Resets and whole episodes",
    "env": "Steps",
    "policies": "Policies",
    "atlas": "Steps on a view atlas",
    "render": "Pictures",
    "labels": "Labels",
    "boxes": "3-D boxes",
    "memory": "A memory in 3-D",
    "detect": "Detectors",
    "cluster": "Clusters",
}


def compose(results: Path) -> tuple[str, Pictures]:
    """The page and its picture, from the benches that are there.

    Raises:
        SbmError: if there are none.
    """
    from experiments.figures.label_generator import draw_label_speed

    found = {name: read_result(results / FOLDER / f"{name}.json") for name in TITLES}
    benches = {name: content for name, content in found.items() if content is not None}
    if not benches:
        folder = results / FOLDER
        raise SbmError(f"{folder}: no results; run python -m experiments.bench --out {folder} first")
    older = {name: read_result(results / FOLDER / BEFORE / f"{name}.json") for name in benches}
    pictures: Pictures = {}
    if "labels" in benches:
        pictures[VIEWS_PICTURE] = partial(draw_label_speed, seconds_per_view(_rows(benches["labels"])))
    return page(benches, {name: content for name, content in older.items() if content is not None}), pictures


def page(benches: Mapping[str, Mapping[str, Any]], older: Mapping[str, Mapping[str, Any]]) -> str:
    """The text of the page.

    Args:
        benches: contents of files of results, by the name of the bench.
        older: those of before. A row that they do not have stands without.
    """
    sections = []
    for name, content in benches.items():
        before = {row.what: row for row in _rows(older[name])} if name in older else {}
        rows = [_cells(row, before.get(row.what)) for row in _rows(content)]
        sections.append({"name": name, "title": TITLES[name], "machine": content["machine"], "rows": rows})
    return render("benchmarks.md.jinja", sections=sections, views_picture=VIEWS_PICTURE)


def _rows(content: Mapping[str, Any]) -> Sequence[Row]:
    return [row_of(row) for row in content["rows"]]


def _cells(row: Row, before: Row | None) -> list[str]:
    what, ours, *others = row.cells("**missed**")
    return [what, ours, "" if before is None else before.ours, *others]
