"""Figures out of the results of tables (by row, by round, and how much of a gap is closed), and those of the thesis."""

import statistics
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float
from numpy.typing import ArrayLike

from agents.evaluation.statistics import MIN_SCENES, small_sample_factor
from experiments.tables.training_sets import PARTS

_THESIS = yaml.safe_load(Path(__file__).with_name("thesis_values.yaml").read_text(encoding="utf-8"))
MEANS: dict[str, dict[str, dict[str, float]]] = _THESIS["means"]
"""What the thesis reports over all categories, in points of AP, by table, row and figure ("ap50", "ap30")."""
PER_CLASS: dict[str, dict[str, dict[str, dict[str, float]]]] = _THESIS["per_class"]
"""By table, row, figure and category."""
BOXES_3D: dict[str, float] = _THESIS["boxes_3d"]
"""AP of 3-D boxes at .25, streets, by row."""


def of_category(table: str, row: str, figure: str, category: str) -> float | None:
    """What the thesis reports of one category, if anything."""
    return PER_CLASS.get(table, {}).get(row, {}).get(figure, {}).get(category)


def values(row: Mapping[str, Any], figure: str, category: str | None = None) -> list[float]:
    """A figure of a row in points, one of each seed; without seeds for which it is undefined.

    Args:
        row: of a result.
        figure: "ap50", "ap30" or "ap" (COCO's) of masks; with "box_" before it of boxes around masks, with "own_box_"
            of boxes that detectors give. Tables of before may lack those of boxes.
        category: None for the mean over all.
    """
    mean = _name_of_mean(figure)
    found = [
        run.get(mean) if category is None else run.get(f"per_class_{figure}", {}).get(category) for run in row["runs"]
    ]
    return [100.0 * value for value in found if value is not None]


def _name_of_mean(figure: str) -> str:
    """What a figure is called where it is the mean over categories."""
    return figure if "box_" in figure else f"mask_{figure}"


def loop_values(content: Mapping[str, Any], number: int, *place: str) -> list[float]:
    """A figure of a round in points, one of each seed whose loop has come so far.

    Args:
        content: of a loop's result.
        number: of the round, from 1.
        place: where the figure stands in the round's record.
    """
    found = []
    for loop in content["loops"]:
        record: Any = loop["rounds"][number - 1] if number <= len(loop["rounds"]) else {}
        for name in place:
            record = (record or {}).get(name)
        if record is not None:
            found.append(100.0 * record)
    return found


def loop_errors(content: Mapping[str, Any], number: int) -> tuple[list[float], list[float]]:
    """What is wrong with the labels of a round's views, in percent, one of each seed whose loop has come so far: how
    many of the objects have none, and how much of the weight of all labels is that of false ones. Empty where results
    do not tell.
    """
    rounds = [loop["rounds"][number - 1] for loop in content["loops"] if number <= len(loop["rounds"])]
    errors, missing = [one["errors"] for one in rounds if "errors" in one], []
    for one in errors:
        counts = one["categories"].values()
        missing.append(
            100.0 * sum(each["missing"] for each in counts) / max(1, sum(each["objects"] for each in counts))
        )
    return missing, [100.0 * one["false_weight"] for one in errors]


def loop_error_counts(content: Mapping[str, Any]) -> list[dict[str, dict[str, int]]]:
    """By seed and category, what ``label_errors.count_errors`` counts, of all rounds together. Empty where results do
    not tell.
    """
    found = []
    for loop in content["loops"]:
        counts: dict[str, Counter[str]] = defaultdict(Counter)
        for one in loop["rounds"]:
            for category, of_round in one.get("errors", {"categories": {}})["categories"].items():
                counts[category].update(of_round)
        found.append({category: dict(of_seed) for category, of_seed in counts.items()})
    return [one for one in found if one]


Gap = Sequence[str]
"""Names of rows: before, after, and the ceiling."""
LOOP_GAP = ("pre-trained", "the loop", "the same loop, taught by ground truth")


def loop_table(content: Mapping[str, Any], number: int | None = None) -> dict[str, Any] | None:
    """A round of a loop as a table with the rows of ``LOOP_GAP``, of the seeds that have come to it; None if none has,
    or results tell of no ceiling.

    Args:
        content: of a loop's result.
        number: of the round, from 1; None takes the last.
    """
    index = (content["size"]["rounds"] if number is None else number) - 1
    there = [loop["rounds"][index] for loop in content["loops"] if len(loop["rounds"]) > index]
    ended = [one for one in there if "test" in one and "ceiling" in one]
    if not ended:
        return None
    runs = ([content["before"]] * len(ended), [one["test"] for one in ended], [one["ceiling"] for one in ended])
    rows = [{"name": name, "part": "loop", "runs": some} for name, some in zip(LOOP_GAP, runs, strict=True)]
    return {"rows": rows, "pools": {"loop": content["test"]}}


def row_interval(content: Mapping[str, Any], row: str, figure: str = "ap50") -> tuple[float, float] | None:
    """95 % interval of a row's figure, over scenes and seeds drawn again, points; None where results tell of no draws.

    Args:
        content: of a table's result.
        row: its name.
        figure: as of ``values``.
    """
    draws = _row_draws(content, (row,), figure)
    if draws is None:
        return None
    (told,) = (statistics.fmean(values(one, figure)) for one in content["rows"] if one["name"] == row)
    return interval_of_draws(draws[0], told, _num_scenes(content, (row,)))


def gap_share(content: Mapping[str, Any], gap: Gap, figure: str = "ap50") -> float | None:
    """Share of the way from before to the ceiling, of the means over seeds: a seed whose ceiling is low would outweigh
    all others in a mean of shares. None where the ceiling is none, or within
    chance of none over scenes (``gap_interval``).

    Args:
        content: of a table's result.
        gap: one of its ``gaps``.
        figure: as of ``values``; None if one of the rows lacks it.
    """
    rows, width = _gap_rows(content, gap, figure), gap_interval(content, gap, figure)
    if not all(rows) or (width is not None and width[0] <= 0.0):
        return None
    return _share(*map(statistics.fmean, rows))


def gap_interval(content: Mapping[str, Any], gap: Gap, figure: str = "ap50") -> tuple[float, float] | None:
    """95 % interval, over scenes and seeds drawn again, of the ceiling's lead over before, points; None where results
    tell of no draws: those of before, and of few scenes.
    """
    draws = _row_draws(content, gap, figure)
    if draws is None:
        return None
    before, _, ceiling = (statistics.fmean(row) for row in _gap_rows(content, gap, figure))
    return interval_of_draws(draws[2] - draws[0], ceiling - before, _num_scenes(content, gap))


def share_interval(content: Mapping[str, Any], gap: Gap, figure: str = "ap50") -> tuple[float, float] | None:
    """95 % interval of ``gap_share`` over scenes and seeds drawn again; None where there are no draws or no gap."""
    draws, share = _row_draws(content, gap, figure), gap_share(content, gap, figure)
    if draws is None or share is None:
        return None
    before, ours, ceiling = draws
    some = ceiling > before
    return interval_of_draws((ours - before)[some] / (ceiling - before)[some], share, _num_scenes(content, gap))


def _row_draws(content: Mapping[str, Any], names: Sequence[str], figure: str) -> Float[np.ndarray, "rows draws"] | None:
    """Figures of some rows in points, means over seeds drawn again, by draw of scenes; None if one has none."""
    name = _name_of_mean(figure)
    rows: dict[str, list[list[float] | None]] = {
        one["name"]: [(run.get("resampled") or {}).get(name) for run in one["runs"]] for one in content["rows"]
    }
    means = []
    for row in names:
        draws = [one for one in rows[row] if one is not None]
        if len(draws) < len(rows[row]):
            return None
        means.append(mean_of_drawn_seeds(draws))
    return 100.0 * np.array(means)


def _num_scenes(content: Mapping[str, Any], names: Sequence[str]) -> int:
    """In how many scenes some rows are scored, all in the same."""
    (part,) = {row["part"] for row in content["rows"] if row["name"] in names}
    return len({scene for name in PARTS.get(part, (part,)) for scene in content["pools"][name].get("scenes", ())})


def mean_of_drawn_seeds(runs: ArrayLike) -> Float[np.ndarray, "draws"]:
    """Means over seeds, by draw of scenes, of seeds that are drawn again for each: other seeds would have given others.

    Args:
        runs: (seeds, draws), a figure by draw of scenes, of each seed. Deviations from their mean are drawn as much
            larger as those of so few seeds are too small; of a single seed nothing can be told.
    """
    by_seed = np.array(runs, float)
    count, draws = by_seed.shape
    mean = by_seed.mean(axis=0)
    if count == 1:
        return mean
    chosen = np.random.default_rng(0).integers(count, size=(count, draws))
    drawn = np.take_along_axis(by_seed, chosen, axis=0).mean(axis=0)
    return mean + np.sqrt(count / (count - 1)) * (drawn - mean)


def interval_of_draws(values: Float[np.ndarray, "n"], told: float, scenes: int) -> tuple[float, float]:
    """The middle 95 % of drawn values, as much further from the value that is told as those of few scenes are too near
    to it.
    """
    low, high = told + (np.quantile(values, [0.025, 0.975]) - told) * small_sample_factor(scenes)
    return float(low), float(high)


def ratio_to_ceiling(
    ours: Mapping[str, Any], ceiling: Mapping[str, Any], figure: str, scenes: int
) -> tuple[float | None, tuple[float, float] | None]:
    """What one row of table 5.5 reaches of another, of means over seeds.

    Args:
        ours: a row.
        ceiling: another one, on the same views.
        figure: "ap25" or "ap50".
        scenes: how many there are.

    Returns:
        The ratio, None if the ceiling finds nothing; and its 95 % interval over scenes and seeds drawn again, None
        where results tell of no draws.
    """
    rows = [[run for run in row["runs"] if run[figure] is not None] for row in (ours, ceiling)]
    reached, most = (statistics.fmean(run[figure] for run in runs) if runs else 0.0 for runs in rows)
    if most <= 0:
        return None, None
    draws = [[(run.get("resampled") or {}).get(figure) for run in runs] for runs in rows]
    if any(one is None for of_row in draws for one in of_row):
        return reached / most, None
    drawn_ours, drawn_ceiling = (mean_of_drawn_seeds(np.array(of_row, float)) for of_row in draws)
    some = drawn_ceiling > 0
    return reached / most, interval_of_draws(drawn_ours[some] / drawn_ceiling[some], reached / most, scenes)


def gap_shares(content: Mapping[str, Any], gap: Gap, figure: str = "ap50") -> list[float | None]:
    """The same of each seed."""
    return [_share(*one) for one in zip(*_gap_rows(content, gap, figure), strict=True)]


def _gap_rows(content: Mapping[str, Any], gap: Gap, figure: str) -> list[list[float]]:
    rows = {one["name"]: values(one, figure) for one in content["rows"]}
    return [rows[name] for name in gap]


def _share(before: float, ours: float, ceiling: float) -> float | None:
    return (ours - before) / (ceiling - before) if ceiling > before else None


def thesis_gap_share(name: str, gap: Gap, figure: str = "ap50") -> float | None:
    """The same of the thesis' figures; None if it has none of these rows."""
    theirs = MEANS.get(name, {})
    if not all(row in theirs for row in gap):
        return None
    return _share(*(theirs[row][figure] for row in gap))


def widened(difference: Mapping[str, Any] | None, scenes: int) -> dict[str, Any] | None:
    """A difference with an interval as wide as that of so few scenes is; None of fewer than ``MIN_SCENES``.

    Records of before have percentiles over episodes; those of ``paired_record``, which say in how many scenes, are
    returned as they are.
    """
    if difference is None or difference["low"] is None or "scenes" in difference:
        return None if difference is None else dict(difference)
    if scenes < MIN_SCENES:
        return {**difference, "low": None, "high": None}
    mean, factor = difference["mean"], small_sample_factor(scenes)
    low, high = (mean + factor * (difference[end] - mean) for end in ("low", "high"))
    return {**difference, "low": low, "high": high}
