"""The thesis' table 5.5 in our worlds, and the same indoors: 3-D boxes without a human label, on unseen scenes."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from experiments.cache.box_stages import Course3d, Finder, Trial, box_scores, target_scores, taught_3d
from experiments.cache.stages import Scale, Workplace
from experiments.cache.worlds import DETECTOR, WORLDS
from experiments.tables.training_sets import Lessons, Part
from labeling.detectors3d.train_config import Augment3dConfig, Train3dConfig

DESCRIPTION = (
    "3-D boxes on unseen towns and homes: LDLS, and frustum PointNets taught by SbM labels and by ground truth"
)
LDLS, TUNED, OURS, CEILING = "LDLS", "LDLS, tuned", "SbM F-PointNet", "supervised F-PointNet"
ROWS = (LDLS, TUNED, OURS, CEILING)
FINDERS: tuple[Finder, ...] = ("recorded", "told")
TRIED_ON: Part = "wide"
"""The thesis' single test town and two test homes have too few objects to tell networks apart."""
SCALES_M = (0.03, 0.1, 0.3, 1.0)
"""Distances over which LDLS weighs neighbours, tried for its tuned row. As published: 1 m."""


@dataclass(frozen=True)
class Size:
    """How a scale trains."""

    train: Train3dConfig
    augment: Augment3dConfig


SIZES: dict[Scale, Size] = {
    "smoke": Size(
        Train3dConfig(iterations=4, batch_size=4, num_points=64, width=0.1, validate_every=2), Augment3dConfig()
    ),
    "quick": Size(
        Train3dConfig(iterations=1000, num_points=512, width=0.5, validate_every=100, patience=0), Augment3dConfig()
    ),
    "full": Size(Train3dConfig(iterations=20_000, validate_every=500), Augment3dConfig()),
}


def run(workplace: Workplace) -> dict[str, Any]:
    """Records, labels, trains and scores, in both worlds.

    Returns:
        By world: the episodes, and by row and by who found the objects in pictures the figures of each seed.
    """
    size = SIZES[workplace.scale]
    return {
        "settings": {"train": asdict(size.train), "augment": asdict(size.augment), "ldls_scales_m": SCALES_M},
        "finder": DETECTOR,
        "worlds": {world: one_world(world, size, workplace) for world in WORLDS},
    }


def one_world(world: str, size: Size, workplace: Workplace) -> dict[str, Any]:
    """One world."""
    lessons = Lessons(world, workplace)
    parts: tuple[Part, ...] = ("learn", "choose", TRIED_ON)
    episodes = {part: lessons.episodes(part) for part in parts}
    categories = known_categories()
    courses = [
        course_of(title, lessons, seed, categories, size) for seed in workplace.seeds for title in (OURS, CEILING)
    ]
    networks = taught_3d(courses, workplace)
    tried = tried_scales(world, episodes["choose"], categories, workplace)
    detectors = {
        LDLS: ["ldls"],
        TUNED: [tuned(tried)],
        OURS: networks[0::2],
        CEILING: networks[1::2],
    }
    rows = []
    trials = [
        Trial(world, tuple(episodes[TRIED_ON]), detector, finder, categories)
        for row in ROWS
        for finder in FINDERS
        for detector in detectors[row]
    ]
    figures = iter(box_scores(trials, workplace))
    for row in ROWS:
        for finder in FINDERS:
            runs = [
                {"seed": None if len(detectors[row]) == 1 and "LDLS" in row else seed, **next(figures)}
                for seed, _ in zip(workplace.seeds, detectors[row], strict=False)
            ]
            rows.append({"name": row, "boxes": finder, "runs": runs})
    return {
        "categories": list(categories),
        "pools": {part: lessons.about(part) for part in parts},
        "ldls_ap25_by_scale_m": {str(scale): ap25 for scale, ap25 in tried.items()},
        "rows": rows,
        "targets": target_scores(
            [lessons.labels("learn", "sbm", seed) for seed in workplace.seeds], episodes["learn"], workplace
        ),
        "training": histories(networks, courses),
    }


def tried_scales(
    world: str, episodes: Sequence[Path], categories: tuple[str, ...], workplace: Workplace
) -> dict[float, float]:
    """AP25 of LDLS by the distance over which it weighs neighbours, of training scenes that no network learns from."""
    trials = [Trial(world, tuple(episodes), f"ldls:{scale}", "recorded", categories) for scale in SCALES_M]
    found = box_scores(trials, workplace)
    return {scale: figures["ap25"] or 0.0 for scale, figures in zip(SCALES_M, found, strict=True)}


def tuned(tried: Mapping[float, float]) -> str:
    """Name of LDLS with the best distance."""
    return f"ldls:{max(tried, key=lambda scale: tried[scale])}"


def course_of(title: str, lessons: Lessons, seed: int, categories: tuple[str, ...], size: Size) -> Course3d:
    """What the frustum PointNet of a row learns."""
    parts: tuple[Part, Part] = ("learn", "choose")
    if title == OURS:
        learn, choose = (lessons.labels(part, "sbm", seed) for part in parts)
    else:
        learn, choose = (lessons.episodes(part)[0].parent for part in parts)
    return Course3d(learn, choose, categories, size.train, size.augment, seed, f"{title} of {lessons.world}")


def sbm_network(world: str, seed: int, workplace: Workplace) -> tuple[str, tuple[str, ...]]:
    """The frustum PointNet that SbM labels have taught, and its categories."""
    lessons = Lessons(world, workplace)
    categories = known_categories()
    course = course_of(OURS, lessons, seed, categories, SIZES[workplace.scale])
    return taught_3d([course], workplace)[0], categories


def known_categories() -> tuple[str, ...]:
    """Those that the 2-D detector has a name for."""
    from labeling.detectors.registry import load_detector

    names = load_detector(DETECTOR).categories
    if names is None:
        raise ValueError(f"{DETECTOR} does not say what it knows")
    return tuple(sorted(names))


def histories(networks: Sequence[str], courses: Sequence[Course3d]) -> list[dict[str, Any]]:
    """Validation curves."""
    from labeling.io.formats.checked_json import read_json
    from labeling.training.run_files import HISTORY_FILE

    found = []
    for folder, course in zip(networks, courses, strict=True):
        history = read_json(Path(folder) / HISTORY_FILE).items()
        curve = [[one.integer("iteration"), one.number("mean_iou")] for one in history if one.has("mean_iou")]
        found.append({"title": course.title, "seed": course.seed, "mean_iou": curve})
    return found


def report(results: Path, docs: Path) -> list[Path]:
    """Writes the page of all results, and its pictures.

    Returns:
        The files written.
    """
    from experiments.pages.results import write_page

    return write_page(results, docs)
