"""``compact`` before and after it learned from labels that an agent made itself, beside ground truth as the ceiling."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.cache.stages import Scale, Workplace
from experiments.cache.worlds import DETECTOR, WORLDS
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.train_config import TrainConfig

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

DESCRIPTION = "compact fine-tuned on pseudo-labels and on ground truth of training scenes, tried on validation scenes"
TEACHERS = ("labels", "truth")
"""What a run learns from: the label generator's output, or what the simulator knows."""


@dataclass(frozen=True)
class Size:
    """How much of everything a scale has."""

    episodes: dict[str, tuple[int, int, int]]
    """By world: episodes to learn from, to choose the best network by (both of training scenes), and to report on (of
    validation scenes)."""
    photographs: tuple[int, int]
    """To replay, and held out to measure forgetting on."""
    train: TrainConfig
    augment: dict[str, AugmentConfig] = field(default_factory=lambda: dict.fromkeys(WORLDS, AugmentConfig()))
    """By world."""
    wide: dict[str, int] = field(default_factory=lambda: dict.fromkeys(WORLDS, 1))
    """By world: episodes of many scenes beyond the thesis' to report on."""
    new: dict[str, Any] = field(default_factory=dict)
    """Settings of training that differ where categories are learnt that no photograph has taught: that takes more than
    getting better at those that one knows."""

    def train_new(self) -> TrainConfig:
        """Settings of training with such categories."""
        return replace(self.train, **self.new)


SIZES: dict[Scale, Size] = {
    "smoke": Size(
        {"rooms": (1, 1, 1), "streets": (1, 1, 1)},
        (12, 6),
        TrainConfig(iterations=4, validate_every=2, warmup=2),
        dict.fromkeys(WORLDS, AugmentConfig(short_side_px=(128, 128))),
    ),
    "quick": Size(
        {"rooms": (40, 8, 16), "streets": (20, 5, 10)},
        (1200, 600),
        TrainConfig(
            iterations=240,
            batch_size=8,
            optimizer="adamw",
            learning_rate=3e-4,
            weight_decay=0.01,
            schedule="cosine",
            warmup=20,
            validate_every=120,
            average=0.97,
            replay_share=0.5,
            frozen_stages=4,
        ),
        # Pictures of streets are three times as wide as high; windows cost less, at the scale that they are tried at.
        {
            "rooms": AugmentConfig(short_side_px=(160, 224), scale=(0.7, 1.1)),
            "streets": AugmentConfig(window_px=256, scale=(0.7, 1.1)),
        },
        {"rooms": 40, "streets": 16},
        {"learning_rate": 6e-4, "replay_share": 0.3},
    ),
    "full": Size(
        {"rooms": (60, 12, 20), "streets": (40, 8, 16)}, (6000, 600), TrainConfig(), wide={"rooms": 80, "streets": 36}
    ),
}


def run(workplace: Workplace) -> dict[str, Any]:
    """Records, labels, trains and scores.

    Returns:
        For each world: the episodes, how good the labels are, the detector before, and every run by teacher and seed.
    """
    size = SIZES[workplace.scale]
    photographs = replayed_photographs(size.photographs, workplace)
    return {
        "detector": DETECTOR,
        "settings": {
            "train": asdict(size.train),
            "augment": {world: asdict(size.augment[world]) for world in size.episodes},
            "photographs": size.photographs,
        },
        "worlds": {
            world: _one_world(world, size, photographs[0], photographs[1], workplace) for world in size.episodes
        },
    }


def _one_world(
    world: str,
    size: Size,
    replay: "list[AnnotatedPicture]",
    held_out: "list[AnnotatedPicture]",
    workplace: Workplace,
) -> dict[str, Any]:
    from experiments.cache.detector_stages import Course, detector_scores, label, label_scores, taught
    from experiments.cache.episode_pool import Pool, about, record
    from labeling.detectors.data.annotated_pictures import read_pictures

    counts = size.episodes[world]
    pools = {
        "learn": Pool(f"{world}_learn", WORLDS[world], "train", counts[0], 0, DETECTOR),
        "choose": Pool(f"{world}_choose", WORLDS[world], "train", counts[1], 1, DETECTOR),
        "val": Pool(f"{world}_val", WORLDS[world], "val", counts[2], 0, DETECTOR),
    }
    folders = {name: record(pool, workplace) for name, pool in pools.items()}
    sets = {"validation": read_pictures(folders["val"][0].parent), "photographs": held_out}
    courses, labels = [], []
    for seed in workplace.seeds:
        made = {name: label(folders[name], seed, workplace) for name in ("learn", "choose")}
        labels.append({"seed": seed, **label_scores(made["learn"])})
        for teacher in TEACHERS:
            source = made if teacher == "labels" else {name: folders[name][0].parent for name in made}
            learn, choose = (read_pictures(source[name]) for name in ("learn", "choose"))
            title = f"{teacher} of {world}"
            courses.append(Course(DETECTOR, learn, choose, replay, size.train, size.augment[world], seed, title))
    before, *after = detector_scores([DETECTOR, *taught(courses, workplace)], sets, workplace)
    who = [{"teacher": teacher, "seed": seed} for seed in workplace.seeds for teacher in TEACHERS]
    return {
        "pools": {name: about(pool, folders[name]) for name, pool in pools.items()},
        "labels": labels,
        "before": before,
        "runs": [{**one, **scores} for one, scores in zip(who, after, strict=True)],
    }


def replayed_photographs(
    counts: tuple[int, int], workplace: Workplace
) -> "tuple[list[AnnotatedPicture], list[AnnotatedPicture]]":
    """The photographs that ``compact`` was pre-trained on, and those held out, taken anew where they are missing."""
    from labeling.detectors.data.annotated_pictures import read_pictures
    from sbm_gym.photographs.album import AlbumSettings, make_album

    found = []
    for split, count in zip(("train", "val"), counts, strict=True):
        folder = workplace.cache / "photographs" / f"{split}_{count}"
        make_album(folder, AlbumSettings(split, 0, 192, False), count, workplace.workers)
        found.append(read_pictures(folder))
    return found[0], found[1]


def report(results: Path, docs: Path) -> list[Path]:
    """Writes the page about fine-tuning, and the picture in it.

    Returns:
        The files written.
    """
    from experiments.pages.fine_tuning import write_page

    return write_page(results, docs)
