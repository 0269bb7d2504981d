"""The worlds that experiments are run in, the detector that they begin with, and how much of everything a scale has."""

from dataclasses import asdict, dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any

from experiments.cache.origin import MASKS_FROM
from experiments.cache.stages import RunContext, Scale, digest
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.detectors.finetuning.presets import PRESETS
from labeling.detectors.networks.spec import PREDICTED_MASK_THRESHOLD

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

DETECTOR = "compact"
WORLDS = {"rooms": "sbm_gym/Indoor-v0", "streets": "sbm_gym/Outdoor-v0"}
COMMAND = FinetuneConfig(replay_share=0.0)
"""How ``labeling.finetune`` fine-tunes without options: it has no photographs to replay."""


@dataclass(frozen=True)
class Size:
    """How many episodes and photographs a scale has, and how its detectors are fine-tuned."""

    episodes: dict[str, tuple[int, int, int]]
    """By world: episodes to learn from, to choose settings of 3-D detectors by (both of training scenes), and to report
    on (of validation scenes)."""
    photographs: tuple[int, int]
    """To replay, and held out to measure forgetting on."""
    train: FinetuneConfig
    augment: dict[str, AugmentConfig] = field(default_factory=lambda: dict.fromkeys(WORLDS, AugmentConfig()))
    """By world."""
    wide: dict[str, int] = field(default_factory=lambda: dict.fromkeys(WORLDS, 1))
    """By world: episodes of many scenes beyond the thesis' to report on."""
    dev: dict[str, int] = field(default_factory=lambda: dict.fromkeys(WORLDS, 1))
    """By world: episodes of as many endless scenes, which nothing is trained in, to decide by."""
    new: FinetuneConfig | None = None
    """How detectors are fine-tuned where they learn categories that no photograph has shown; None as else."""
    new_episodes: int | None = None
    """Episodes to learn such categories from; None as many as else."""
    command: FinetuneConfig = COMMAND
    """How detectors are fine-tuned in tables of what ``labeling.finetune`` does without options."""

    def as_command(self) -> "Size":
        """The same episodes, and fine-tuning as ``labeling.finetune`` does it without options."""
        augment, held_out = dict.fromkeys(WORLDS, AugmentConfig()), self.photographs[1]
        return replace(self, train=self.command, augment=augment, photographs=(0, held_out))

    def train_new(self) -> FinetuneConfig:
        """Settings of training with such categories."""
        return self.new or self.train

    def settings(self, *worlds: str) -> dict[str, Any]:
        """What the record of results says about training in these worlds."""
        augment = {world: asdict(self.augment[world]) for world in worlds}
        about = {"train": asdict(self.train), "augment": augment, "photographs": self.photographs}
        return {**about, MASKS_FROM: PREDICTED_MASK_THRESHOLD}


QUICK_TRAIN = FinetuneConfig(iterations=240, validate_every=120, repeat_threshold=0.0, interpolate=1.0)
STREET_WINDOWS = AugmentConfig(window_px=256, scale=(0.7, 1.1))
"""Pictures of streets are three times as wide as high; windows cost less, at the scale that they are tested at."""
SIZES: dict[Scale, Size] = {
    "smoke": Size(
        dict.fromkeys(WORLDS, (1, 1, 1)),
        (12, 6),
        FinetuneConfig(iterations=4, batch_size=2, validate_every=2, warmup=2, interpolate=1.0),
        dict.fromkeys(WORLDS, AugmentConfig(short_side_px=(128, 128))),
        command=replace(COMMAND, iterations=4, batch_size=2, validate_every=2, warmup=2),
    ),
    "quick": Size(
        {"rooms": (40, 8, 16), "streets": (20, 5, 10)},
        (1200, 600),
        QUICK_TRAIN,
        {
            "rooms": AugmentConfig(short_side_px=(160, 224), scale=(0.7, 1.1)),
            "streets": STREET_WINDOWS,
        },
        {"rooms": 40, "streets": 16},
        {"rooms": 20, "streets": 8},
        # Chosen on dev homes: 240 batches are too few to know even the pictures that were learnt from.
        replace(PRESETS["new-categories"], iterations=720, interpolate=1.0),
        new_episodes=120,
    ),
    "standard": Size(
        {"rooms": (120, 12, 20), "streets": (60, 8, 16)},
        (1200, 600),
        FinetuneConfig(iterations=1440, interpolate=1.0),
        {
            "rooms": AugmentConfig(short_side_px=(160, 224), scale=(0.7, 1.1)),
            "streets": STREET_WINDOWS,
        },
        {"rooms": 40, "streets": 24},
        {"rooms": 20, "streets": 12},
        replace(PRESETS["new-categories"], interpolate=1.0),
    ),
    "full": Size(
        {"rooms": (60, 12, 20), "streets": (40, 8, 16)},
        (6000, 600),
        PRESETS["paper"],
        wide={"rooms": 80, "streets": 36},
        dev={"rooms": 40, "streets": 24},
    ),
}


@cache
def source_photographs(
    counts: tuple[int, int], context: RunContext
) -> "tuple[list[AnnotatedPicture], list[AnnotatedPicture]]":
    """Photographs that ``compact`` was pre-trained on, and others held out; taken anew where they are missing.

    Args:
        counts: how many of either; may be 0.
        context: cache and workers.
    """
    from labeling.detectors.data.annotated_pictures import read_pictures
    from labeling.runtime.code_digest import code_digest
    from sbm_gym.assets.catalog.same_libraries import library_digests
    from sbm_gym.photographs.album import AlbumSettings, make_album

    made_of = digest(code_digest(make_album), library_digests())
    found: list[list[AnnotatedPicture]] = []
    for split, count in zip(("train", "val"), counts, strict=True):
        if count == 0:
            found.append([])
            continue
        folder = context.cache / "photographs" / f"{split}_{count}-{made_of[:12]}"
        make_album(folder, AlbumSettings(split, 0, 192, False), count, context.workers, context.where)
        found.append(read_pictures(folder))
    return found[0], found[1]
