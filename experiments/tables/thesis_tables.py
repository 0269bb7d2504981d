"""The thesis' tables in two dimensions, in our worlds: ``thesis_tables.yaml`` says what each row is."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from tqdm import tqdm

from experiments.cache.origin import MACHINES, machines
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.tables.training_sets import OF_DETECTORS, PARTS, PER_CLASS, Student, Subset, TrainingSets


@dataclass(frozen=True)
class Row:
    """One method: labels, or a detector."""

    name: str
    subset: Subset
    """The episodes it is scored on."""
    labels: str | None = None
    """Recipe of the labels that are scored; None scores a detector."""
    teacher: str | None = None
    """What the detector was fine-tuned on that is scored, or whose detections the labels are made from; None is the
    pre-trained one."""
    new_categories: tuple[str, ...] = ()
    """That this detector learnt beside those it knew."""

    def student(self, seed: int) -> Student:
        """The detector of a seed."""
        return Student(self.teacher, seed, self.new_categories)


@dataclass(frozen=True)
class Table:
    """Methods that are scored on the same episodes."""

    description: str
    world: str
    rows: tuple[Row, ...]
    categories: tuple[str, ...] | None = None
    """Those that count; None are all that every row has figures of."""
    gaps: tuple[tuple[str, str, str], ...] = ()
    """Rows: before, after, and the ceiling; the share of each gap that is closed is told."""
    above: tuple[tuple[str, str], ...] = ()
    """Pairs of rows of which the first should be above the second on every category."""
    unseen_models: bool = False
    """Whether training scenes do without the models that final scenes show."""
    as_command: bool = False
    """Whether detectors are fine-tuned as ``labeling.finetune`` does without options, not as the scale has it."""
    endless: int = 0
    """How many episodes of each endless scene are learnt from; 0: several of each training scene."""

    def run(self, context: RunContext) -> dict[str, Any]:
        """Makes what is missing and scores every row with every seed.

        Returns:
            The episodes, and by row the figures of each seed.

        Raises:
            SbmError: if a world cannot be built, or a stage fails.
        """
        new = any(row.new_categories for row in self.rows)
        sets = TrainingSets(
            self.world,
            context,
            unseen_models=self.unseen_models,
            new_categories=new,
            as_command=self.as_command,
            endless=self.endless,
        )
        detectors = self._detectors(sets, context.seeds)
        rows: dict[str, list[dict[str, Any]]] = {row.name: [] for row in self.rows}
        every = [(seed, row) for seed in context.seeds for row in self.rows]
        for seed, row in (bar := tqdm(every, desc="rows", unit="row", file=sys.stderr)):
            bar.set_postfix_str(f"seed {seed}: {row.name}")
            rows[row.name].append({"seed": seed, **self._scores(sets, row, seed, detectors[row.student(seed)])})
        rows = over_shared_categories(rows, {row.name: row.subset for row in self.rows})
        subsets: dict[Subset, None] = dict.fromkeys(subset for row in self.rows for subset in _subsets(row))
        return {
            "world": self.world,
            "gaps": self.gaps,
            "above": self.above,
            "pools": {subset: sets.pool_record(subset) for subset in subsets},
            "settings": sets.settings(new),
            MACHINES: machines(name for student, name in detectors.items() if student.teacher is not None),
            "rows": [
                {"name": one.name, "part": one.subset, "labels": one.labels, "teacher": one.teacher, "runs": runs}
                for one, runs in zip(self.rows, rows.values(), strict=True)
            ],
        }

    def _detectors(self, sets: TrainingSets, seeds: Sequence[int]) -> dict[Student, str]:
        """Those that rows ask for, trained and scored in parallel before they are asked for one by one."""
        students = list(dict.fromkeys(row.student(seed) for seed in seeds for row in self.rows))
        names = dict(zip(students, sets.detectors(students), strict=True))
        scored: dict[Subset, dict[str, None]] = {}
        for row in self.rows:
            if row.labels is None:
                scored.setdefault(row.subset, {}).update({names[row.student(seed)]: None for seed in seeds})
        for subset, some in scored.items():
            sets.detector_scores(subset, list(some), self.categories)
        return names

    def _scores(self, sets: TrainingSets, row: Row, seed: int, detector: str) -> dict[str, Any]:
        if row.labels is None:
            return sets.detector_scores(row.subset, [detector], self.categories)[0]
        found = sets.label_scores(row.subset, row.labels, seed, detector if row.teacher else None)
        return found if self.categories is None else only(self.categories, found)


def only(categories: Sequence[str], figures: dict[str, Any]) -> dict[str, Any]:
    """The figures of some categories: AP of masks and boxes of each, and its means over those that there are.

    Means over other categories are left out, and so is AP of boxes that was kept as a mean only, as it once was; what
    is no mean over categories of views stays.
    """
    every = {**PER_CLASS, **OF_DETECTORS}
    of_each = {
        name: {category: figures[name][category] for category in categories if category in figures[name]}
        for name in (*(f"per_class_{saved}" for saved in every.values()), "instances")
        if name in figures
    }
    means = {}
    for figure, saved in every.items():
        if f"per_class_{saved}" in of_each:
            known = [value for value in of_each[f"per_class_{saved}"].values() if value is not None]
            means[figure] = sum(known) / len(known) if known else None
    rest = {name: value for name, value in figures.items() if name in ("seed", "photographs_ap50")}
    return {**rest, **means, **of_each}


def over_shared_categories(
    rows: Mapping[str, list[dict[str, Any]]], scenes: Mapping[str, str]
) -> dict[str, list[dict[str, Any]]]:
    """The figures of rows over the categories that all rows on the same scenes have: means over others do not compare.

    Args:
        rows: the figures of each seed, by row.
        scenes: what each row is scored on. Rows on other scenes are not compared, and take no category away: buses of
            the scenes to test on count, too, where scenes to decide by show none.

    Returns:
        The same rows; one that loses a category loses figures, too, that are told of means alone.
    """
    found = {}
    for name, runs in rows.items():
        compared = [other for other in rows if scenes[other] == scenes[name]]
        beside = [tuple(run["per_class_ap50"]) for other in compared for run in rows[other]]
        shared = [one for one in beside[0] if all(one in categories for categories in beside)]
        whole = all(len(run["per_class_ap50"]) == len(shared) for run in runs)
        found[name] = runs if whole else [only(shared, run) for run in runs]
    return found


def _subsets(row: Row) -> tuple[Subset, ...]:
    scored = PARTS.get(row.subset, (row.subset,))
    return scored if row.teacher is None else ("learn", *scored)


def read_table(content: Mapping[str, Any]) -> Table:
    """A table as ``thesis_tables.yaml`` has it."""
    rows = [{**row, "new_categories": tuple(row.get("new_categories", ()))} for row in content["rows"]]
    lists = {name: tuple(map(tuple, content.get(name, ()))) for name in ("gaps", "above")}
    categories = tuple(content["categories"]) if "categories" in content else None
    flags = {name: content.get(name, False) for name in ("unseen_models", "as_command")}
    made, endless = tuple(Row(**row) for row in rows), content.get("endless", 0)
    return Table(content["description"], content["world"], made, categories, **lists, **flags, endless=endless)


_FILE = Path(__file__).with_name("thesis_tables.yaml")
TABLES = {name: read_table(content) for name, content in yaml.safe_load(_FILE.read_text(encoding="utf-8")).items()}
for _name, _table in TABLES.items():
    experiment(_name, _table.description, pages=("results",))(_table.run)
