"""Names of scenes: 15 interiors for training, 1 for validation, 2 for testing, 3, 1 and 1 towns, and any seed besides.

Source: thesis section 5 (the splits of the 18 Replica scenes).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from labeling.core.errors import UsageError

TRAIN_KINDS = (
    *("apartment", "office", "flat", "living_room", "hotel"),
    *("apartment", "studio_flat", "office", "flat", "apartment"),
    *("hotel", "flat", "living_room", "apartment", "office"),
)
"""Kinds of homes of the training scenes, in about Replica's proportions."""


@dataclass(frozen=True)
class SceneSeed:
    """All that decides what a scene looks like."""

    seed: tuple[int, ...]
    """Entropy of its random generator; named scenes and free seeds never share one."""
    kind: str | None
    """Its kind of home, a key of ``PROGRAMMES``; None draws one."""


SPLITS: dict[str, dict[str, SceneSeed]] = {
    "train": {f"train/{i:02d}": SceneSeed((0, 1000 + i), kind) for i, kind in enumerate(TRAIN_KINDS)},
    "val": {"val/00": SceneSeed((0, 2000), "flat")},
    "test": {"test/00": SceneSeed((0, 3000), "apartment"), "test/01": SceneSeed((0, 3001), "living_room")},
}
"""The named scenes of each split. Changing a seed changes the data set: it is done in a new version only."""
WIDE = "wide"
"""A further split to test on, beyond the thesis': two homes and one town tell chance from gain poorly."""
ENDLESS = "endless"
"""A further split to learn from: so many scenes that a robot never has to come back to one."""
FREE_SPLITS = {WIDE: range(100_000, 100_040), ENDLESS: range(100_000)}
"""Numbers of their interiors, which are free seeds. Nothing is trained, chosen or tuned on those of the wide split."""


def scene_names(split: str) -> tuple[str, ...]:
    """Names of the scenes of a split: train, val, test, wide or endless.

    Raises:
        UsageError: if there is no such split.
    """
    return _names_of(split, "seed/", SPLITS, FREE_SPLITS)


def scene_seed(name: str | int) -> tuple[str, SceneSeed]:
    """The canonical name of a scene and what it is made from.

    Args:
        name: a named scene, ``seed/N``, or just N (not negative).

    Raises:
        UsageError: if it is none of these.
    """
    if isinstance(name, bool) or not isinstance(name, int | str):
        raise UsageError(f"a scene is named by a text or a whole number, not {name!r}")
    text = f"seed/{name}" if isinstance(name, int) else name
    for scenes in SPLITS.values():
        if text in scenes:
            return text, scenes[text]
    match = re.fullmatch(r"seed/(\d+)", text)
    if match is None:
        known = ", ".join(f"{next(iter(scenes))} .. {list(scenes)[-1]}" for scenes in SPLITS.values())
        raise UsageError(f"there is no scene {name!r}; scenes are {known}, and seed/N for any whole number N >= 0")
    return f"seed/{int(match.group(1))}", SceneSeed((1, int(match.group(1))), None)


TOWN_SPLITS: dict[str, dict[str, tuple[int, ...]]] = {
    "train": {f"town/train/{i:02d}": (2, 1000 + i) for i in range(3)},
    "val": {"town/val/00": (2, 2000)},
    "test": {"town/test/00": (2, 3000)},
}
"""The named towns of each split, with the entropy of their generators. Source: thesis 5.1.1 (five towns, 3/1/1)."""
FREE_TOWN_SPLITS = {WIDE: range(100_000, 100_012), ENDLESS: range(100_000)}
"""Numbers of the towns of further splits."""


def town_names(split: str) -> tuple[str, ...]:
    """Names of the towns of a split: train, val, test, wide or endless.

    Raises:
        UsageError: if there is no such split.
    """
    return _names_of(split, "town/seed/", TOWN_SPLITS, FREE_TOWN_SPLITS)


def town_seed(name: str | int) -> tuple[str, tuple[int, ...]]:
    """The canonical name of a town and the entropy it is made from.

    Args:
        name: a named town, ``town/seed/N``, or just N (not negative).

    Raises:
        UsageError: if it is none of these.
    """
    if isinstance(name, bool) or not isinstance(name, int | str):
        raise UsageError(f"a town is named by a text or a whole number, not {name!r}")
    text = f"town/seed/{name}" if isinstance(name, int) else name
    for towns in TOWN_SPLITS.values():
        if text in towns:
            return text, towns[text]
    match = re.fullmatch(r"town/seed/(\d+)", text)
    if match is None:
        known = ", ".join(town for towns in TOWN_SPLITS.values() for town in towns)
        raise UsageError(f"there is no town {name!r}; towns are {known}, and town/seed/N for any whole number N >= 0")
    return f"town/seed/{int(match.group(1))}", (3, int(match.group(1)))


def _names_of(
    split: str, prefix: str, named: Mapping[str, Mapping[str, object]], free: Mapping[str, range]
) -> tuple[str, ...]:
    if split in free:
        return _numbered(prefix, free[split])
    if split not in named:
        raise UsageError(f"there is no split {split!r}; splits are {', '.join((*named, *free))}")
    return tuple(named[split])


@cache
def _numbered(prefix: str, numbers: range) -> tuple[str, ...]:
    return tuple(f"{prefix}{number}" for number in numbers)
