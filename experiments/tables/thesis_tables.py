"""The thesis' tables in two dimensions, in our worlds: what each row is, and how its figures come about."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from experiments.cache.registry import Experiment, register
from experiments.cache.stages import RunContext
from experiments.tables.training_sets import NOVEL, Student, Subset, TrainingSets


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

    def run(self, context: RunContext) -> dict[str, Any]:
        """Makes what is missing and scores every row with every seed.

        Returns:
            The episodes, and by row the figures of each seed.

        Raises:
            SbmError: if a world cannot be built, or a stage fails.
        """
        sets = TrainingSets(self.world, context)
        detectors = self._detectors(sets, context.seeds)
        rows: dict[str, list[dict[str, Any]]] = {row.name: [] for row in self.rows}
        for seed, row in _with_progress(context.seeds, self.rows):
            rows[row.name].append({"seed": seed, **self._scores(sets, row, seed, detectors[row.student(seed)])})
        rows = over_shared_categories(rows)
        subsets: dict[Subset, None] = dict.fromkeys(subset for row in self.rows for subset in _subsets(row))
        return {
            "world": self.world,
            "gaps": self.gaps,
            "above": self.above,
            "pools": {subset: sets.pool_record(subset) for subset in subsets},
            "settings": sets.settings(any(row.new_categories for row in self.rows)),
            "rows": [
                {
                    "name": row.name,
                    "part": row.subset,
                    "labels": row.labels,
                    "teacher": row.teacher,
                    "runs": rows[row.name],
                }
                for row in self.rows
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
            sets.detector_scores(subset, list(some))
        return names

    def _scores(self, sets: TrainingSets, row: Row, seed: int, detector: str) -> dict[str, Any]:
        if row.labels is None:
            found = sets.detector_scores(row.subset, [detector])[0]
        else:
            found = sets.label_scores(row.subset, row.labels, seed, detector if row.teacher else None)
        return found if self.categories is None else only(self.categories, found)


def only(categories: Sequence[str], figures: dict[str, Any]) -> dict[str, Any]:
    """The figures of some categories: AP of masks of each, and its mean over those that there are.

    Means over other categories are left out; what is no mean over categories of views stays.
    """
    of_each = {
        name: {category: figures[name][category] for category in categories if category in figures[name]}
        for name in ("per_class_ap50", "per_class_ap30", "instances")
    }
    means = {}
    for figure in ("ap50", "ap30"):
        known = [value for value in of_each[f"per_class_{figure}"].values() if value is not None]
        means[f"mask_{figure}"] = sum(known) / len(known) if known else None
    rest = {name: value for name, value in figures.items() if name in ("seed", "photographs_ap50")}
    return {**rest, **means, **of_each}


def over_shared_categories(rows: dict[str, list[dict[str, Any]]]) -> dict[str, list[dict[str, Any]]]:
    """The figures of rows over the categories that all of them have: means over different ones do not compare."""
    of_rows = [tuple(run["per_class_ap50"]) for runs in rows.values() for run in runs]
    shared = [name for name in of_rows[0] if all(name in names for names in of_rows)]
    if all(len(names) == len(shared) for names in of_rows):
        return rows
    return {name: [only(shared, run) for run in runs] for name, runs in rows.items()}


def in_more_scenes(*rows: Row) -> tuple[Row, ...]:
    """Rows of detectors, scored on many unseen scenes instead of the thesis' few."""
    return tuple(replace(row, subset="wide") for row in rows)


def _subsets(row: Row) -> tuple[Subset, ...]:
    return (row.subset,) if row.teacher is None else ("learn", "choose", row.subset)


def _with_progress(seeds: Sequence[int], rows: Sequence[Row]) -> Iterator[tuple[int, Row]]:
    """Rows seed by seed, with a progress bar."""
    import sys

    from tqdm import tqdm

    every = [(seed, row) for seed in seeds for row in rows]
    with tqdm(every, desc="rows", unit="row", file=sys.stderr) as bar:
        for seed, row in bar:
            bar.set_postfix_str(f"seed {seed}: {row.name}")
            yield seed, row


PRE_TRAINED = Row("pre-trained", "test")
FINE_TUNED, CEILING = Row("SbM fine-tuned", "test", teacher="sbm"), Row("GT fine-tuned", "test", teacher="truth")
SHARED = Row("SbM fine-tuned on shared labels", "test", teacher="shared")
"""Beyond the thesis: what one episode has found is labelled in the others of its scene, too."""
SECOND = Row("SbM fine-tuned, second round", "test", teacher="second round")
"""So is this: the pre-trained detector, fine-tuned on labels made with what that one finds in the same episodes."""
BOTH = Row("SbM fine-tuned on sure labels of both detectors", "test", teacher="both detectors")
"""And this: on labels made with what that one and the pre-trained one find, as in the never-ending loop; those that are
likely to be wrong are ignored."""
GAP = (PRE_TRAINED.name, FINE_TUNED.name, CEILING.name)
SHARED_GAP = (PRE_TRAINED.name, SHARED.name, CEILING.name)
BOTH_GAP = (PRE_TRAINED.name, BOTH.name, CEILING.name)
SECOND_GAP = (PRE_TRAINED.name, SECOND.name, CEILING.name)

TABLES = {
    "table_5_1": Table(
        "streets: pre-trained, SbM labels, and detectors fine-tuned on these and on ground truth, on unseen towns; "
        "labels are made of each episode alone, as in the thesis, or shared by the episodes of a town, and then a "
        "second time with what the detector finds that was fine-tuned on these",
        "streets",
        (
            PRE_TRAINED,
            Row("pre-trained, training towns", "learn"),
            Row("SbM labels, training towns", "learn", labels="sbm"),
            Row("shared SbM labels, training towns", "learn", labels="shared"),
            Row("shared SbM labels of the second round, training towns", "learn", labels="second round"),
            Row("SbM labels, test town", "test", labels="sbm"),
            FINE_TUNED,
            SHARED,
            SECOND,
            CEILING,
        ),
        gaps=(GAP, SHARED_GAP, SECOND_GAP),
        above=(
            ("SbM labels, training towns", "pre-trained, training towns"),
            ("shared SbM labels, training towns", "SbM labels, training towns"),
            ("shared SbM labels of the second round, training towns", "shared SbM labels, training towns"),
        ),
    ),
    "table_5_1_wide": Table(
        "streets: table 5.1's detectors on a dozen unseen towns besides: one test town tells chance from gain poorly",
        "streets",
        in_more_scenes(PRE_TRAINED, FINE_TUNED, SHARED, SECOND, CEILING),
        gaps=(GAP, SHARED_GAP, SECOND_GAP),
    ),
    "table_5_2": Table(
        "rooms: pre-trained, SbM labels (of each episode alone, as in the thesis, or shared by the episodes of a home) "
        "and weakly supervised SbM labels, on the views of training scenes",
        "rooms",
        (
            Row("pre-trained", "learn"),
            Row("SbM labels", "learn", labels="sbm"),
            Row("shared SbM labels", "learn", labels="shared"),
            Row("SbM-ws labels", "learn", labels="weak"),
        ),
        above=(
            ("SbM labels", "pre-trained"),
            ("shared SbM labels", "pre-trained"),
            ("shared SbM labels", "SbM labels"),
            ("SbM-ws labels", "SbM labels"),
        ),
    ),
    "table_5_3": Table(
        "rooms: pre-trained, SbM fine-tuned (on labels of each episode alone, as in the thesis; shared by the episodes "
        "of a home; or made a second time with what the detector fine-tuned on these and the pre-trained one find) and "
        "GT fine-tuned, on unseen homes",
        "rooms",
        (PRE_TRAINED, FINE_TUNED, SHARED, BOTH, CEILING),
        gaps=(GAP, SHARED_GAP, BOTH_GAP),
    ),
    "table_5_3_wide": Table(
        "rooms: table 5.3's detectors in 40 unseen interiors besides: two test homes tell chance from gain poorly",
        "rooms",
        in_more_scenes(PRE_TRAINED, FINE_TUNED, SHARED, BOTH, CEILING),
        gaps=(GAP, SHARED_GAP, BOTH_GAP),
    ),
    "table_5_4": Table(
        "rooms: labels made with the pre-trained detector, with the fine-tuned one and with both, on the views of "
        "training scenes; of each episode alone, as in the thesis, or shared by the episodes of a home",
        "rooms",
        (
            Row("SbM labels", "learn", labels="sbm"),
            Row("SbM labels of the fine-tuned detector", "learn", labels="sbm", teacher="sbm"),
            Row("shared SbM labels", "learn", labels="shared"),
            Row("shared SbM labels of the fine-tuned detector", "learn", labels="second round"),
            Row("shared SbM labels of both detectors", "learn", labels="both detectors"),
        ),
    ),
    "table_a_1": Table(
        "rooms: fine-tuned on labels with and without the consistency filter, on unseen homes",
        "rooms",
        (
            PRE_TRAINED,
            Row("SbM without consistency", "test", teacher="sbm"),
            Row("SbM with consistency", "test", teacher="consistent"),
            Row("pre-trained, more homes", "wide"),
            Row("SbM without consistency, more homes", "wide", teacher="sbm"),
            Row("SbM with consistency, more homes", "wide", teacher="consistent"),
        ),
    ),
    "table_a_2": Table(
        "rooms: weakly supervised SbM labels of categories that no photograph has shown",
        "rooms",
        (Row("SbM-ws labels", "learn", labels="weak"),),
        categories=NOVEL,
    ),
    "table_a_3": Table(
        "rooms: detectors of novel categories, trained on weak labels or on the annotated views alone, in 40 unseen "
        "interiors (the thesis: cushions only)",
        "rooms",
        (
            Row("SbM-ws labels", "learn", labels="weak"),
            Row("SbM trained", "wide", teacher="weak", new_categories=NOVEL),
            Row("trained on the annotated views alone", "wide", teacher="annotated views", new_categories=NOVEL),
            Row("GT trained, all views", "wide", teacher="truth", new_categories=NOVEL),
        ),
        categories=NOVEL,
    ),
}
for _name, _table in TABLES.items():
    register(Experiment(_name, _table.description, _table.run, pages=("results",)))
