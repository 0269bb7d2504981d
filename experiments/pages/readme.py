"""The table of results in README, written from committed results."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.pages.markdown import mean_std, read_result, table
from labeling.core.errors import SbmError

WORLDS = {"table_5_3_wide": "unseen homes", "table_5_1_wide": "unseen towns"}
"""Experiment -> what its column is called."""
ROWS = {
    "pre-trained": "before",
    "SbM fine-tuned": "taught by labels of each episode alone, as in the thesis",
    "SbM fine-tuned on shared labels": "taught by labels that the episodes of a scene share",
    "GT fine-tuned": "taught by ground truth",
}
"""Name of a row in results -> what README calls it."""
FIGURE, SHARED = "mask_ap50", "SbM fine-tuned on shared labels"
_PLACE = re.compile(r"(<!-- results: .*? -->\n).*?(<!-- end of results -->)", re.DOTALL)


def write_readme(readme: Path, results: Path) -> None:
    """Writes the table into its place in README; all else stays.

    Raises:
        SbmError: if the place is not marked there, or results are missing.
    """
    from labeling.formats.atomic import atomic_file

    text = with_results(readme.read_text(encoding="utf-8"), results)
    with atomic_file(readme) as temporary:
        temporary.write_text(text, encoding="utf-8")


def with_results(text: str, results: Path) -> str:
    """README with the table of the results in their folder; for the errors see ``write_readme``."""
    if not _PLACE.search(text):
        raise SbmError("README: there is no <!-- results: ... --> with an <!-- end of results --> after it")
    found = {name: read_result(results / f"{name}.json") for name in WORLDS}
    if missing := [name for name, content in found.items() if content is None]:
        raise SbmError(f"{results}: no {missing[0]}.json; run python -m experiments.run {missing[0]} first")
    section = results_section({name: content for name, content in found.items() if content is not None})
    return _PLACE.sub(lambda place: f"{place.group(1)}{section}\n{place.group(2)}", text)


def results_section(contents: Mapping[str, Mapping[str, Any]]) -> str:
    """The sentence and the table.

    Args:
        contents: of the files of results, by the names in ``WORLDS``.
    """
    headings = ["detector `compact`", *(f"{_episodes(contents[name])} {called}" for name, called in WORLDS.items())]
    rows = [[called, *(mean_std(_values(contents[name], row)) for name in WORLDS)] for row, called in ROWS.items()]
    closed = ["share of the gap to ground truth that shared labels close"]
    closed += [f"{_gap_closed(contents[name]):.0%}" for name in WORLDS]
    seeds = {len(content["seeds"]) for content in contents.values()}
    return (
        "AP50 of masks in scenes that the detector has neither been in nor been chosen by, mean ± standard deviation "
        f"over {'/'.join(map(str, sorted(seeds)))} seeds ([all tables](docs/results.md)):\n\n"
        + table(headings, [*rows, closed], "---:")
    )


def _episodes(content: Mapping[str, Any]) -> int:
    """Scenes that the detectors are tested in."""
    return len(set(content["pools"]["wide"]["scenes"]))


def _values(content: Mapping[str, Any], name: str) -> Sequence[float]:
    """The figure in points, by seed."""
    (row,) = (one for one in content["rows"] if one["name"] == name)
    return [100.0 * run[FIGURE] for run in row["runs"]]


def _gap_closed(content: Mapping[str, Any]) -> float:
    before, shared, truth = (float(np.mean(_values(content, one))) for one in ("pre-trained", SHARED, "GT fine-tuned"))
    return (shared - before) / (truth - before)
