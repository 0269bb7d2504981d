"""The table of results in README, written from committed results."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.figures.result_values import gap_share, share_interval, values
from experiments.pages.markdown import mean_std, plural, read_result, table
from experiments.pages.origin import origins
from labeling.core.errors import SbmError

WORLDS = {"table_5_3_final": "unseen homes", "table_5_1_final": "unseen towns"}
"""Experiment -> what its column is called. These homes and towns are set aside for the end."""
ROWS = {
    "pre-trained": "before",
    "SbM fine-tuned": "taught by labels of each episode alone",
    "SbM fine-tuned on shared labels": "taught by labels that the episodes of a scene share",
    "GT fine-tuned": "taught by ground truth",
}
"""Name of a row in results -> what README calls it."""
FIGURES = {"ap50": "masks", "box_ap50": "boxes around masks", "own_box_ap50": "detector's boxes"}
"""AP50 of what."""
SHARED, TRUTH = "SbM fine-tuned on shared labels", "GT fine-tuned"
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
    found = {file.stem: content for file in sorted(results.glob("*.json")) if (content := read_result(file))}
    if missing := [name for name in WORLDS if name not in found]:
        raise SbmError(f"{results}: no {missing[0]}.json; run python -m experiments.run {missing[0]} first")
    section = results_section(found)
    return _PLACE.sub(lambda place: f"{place.group(1)}{section}\n{place.group(2)}", text)


def results_section(contents: Mapping[str, Mapping[str, Any]]) -> str:
    """The sentence, the table, and what it was made with.

    Args:
        contents: of the files of results, by name: those in ``WORLDS``, and others, which tell which are of an earlier
            label generator.
    """
    columns = [(name, figure) for name in WORLDS for figure in FIGURES]
    titles = [f"{_episodes(contents[name])} {WORLDS[name]}, {FIGURES[figure]}" for name, figure in columns]
    rows = [
        [called, *(mean_std(_values(contents[name], row, figure)) for name, figure in columns)]
        for row, called in ROWS.items()
    ]
    closed = ["share of the gap to ground truth that shared labels close (95 % over scenes and seeds)"]
    closed += [_gap_closed(contents[name], figure) for name, figure in columns]
    seeds = {len(contents[name]["seeds"]) for name in WORLDS}
    return (
        "AP50 of masks, of the tightest boxes around them, and of boxes as the detector gives them (which COCO's "
        "metric scores), in scenes that the detector has neither been in nor been chosen by; mean ± standard deviation "
        f"over {'/'.join(map(str, sorted(seeds)))} seeds ([all tables](docs/results.md)):\n\n"
        + table(["detector `compact`", *titles], [*rows, closed], "---:")
        + "\n\n"
        + "\n".join(
            f"- {_made_with(WORLDS[name], contents[name])} {made}" for name, made in origins(contents, WORLDS).items()
        )
    )


def _made_with(title: str, content: Mapping[str, Any]) -> str:
    """What detectors have learnt from, and for how long."""
    pool, train = content["pools"]["learn"], content["settings"]["train"]
    episodes, scenes = plural(pool["episodes"], "episode"), plural(len(set(pool["scenes"])), "scene")
    return (
        f"{title.capitalize()}: learnt from {episodes} in {scenes}, "
        f"{train['iterations']} batches, {train['replay_share']:.0%} of the pictures photographs."
    )


def _episodes(content: Mapping[str, Any]) -> int:
    """Scenes that the detectors are tested in."""
    (part,) = {row["part"] for row in content["rows"] if row["name"] in ROWS}
    return len(set(content["pools"][part]["scenes"]))


def _values(content: Mapping[str, Any], name: str, figure: str) -> Sequence[float]:
    """The figure in points, by seed; none where a table does without this row."""
    return [value for row in content["rows"] if row["name"] == name for value in values(row, figure)]


def _gap_closed(content: Mapping[str, Any], figure: str) -> str:
    gap = ("pre-trained", SHARED, TRUTH)
    share, between = gap_share(content, gap, figure), share_interval(content, gap, figure)
    if share is None:
        return "-"
    return f"{share:.0%}" + ("" if between is None else " ({:.0%} to {:.0%})".format(*between))
