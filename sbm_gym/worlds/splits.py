"""Names of interior scenes: 15 for training, 1 for validation, 2 for testing, and any seed besides.

Source: thesis section 5 (the splits of the 18 Replica scenes).
"""

import re
from dataclasses import dataclass

from labeling.errors import UsageError

KINDS = ("living_room", "bedroom", "studio", "office", "hotel_room", "kitchen_diner")
"""Kinds of rooms, in the order in which the named scenes take turns."""


@dataclass(frozen=True)
class SceneSeed:
    """All that decides what a scene looks like."""

    seed: tuple[int, ...]
    """Entropy of its random generator; named scenes and free seeds never share one."""
    kind: str | None
    """Its kind of room; None draws one."""


SPLITS: dict[str, dict[str, SceneSeed]] = {
    "train": {f"train/{i:02d}": SceneSeed((0, 1000 + i), KINDS[i % len(KINDS)]) for i in range(15)},
    "val": {"val/00": SceneSeed((0, 2000), "studio")},
    "test": {"test/00": SceneSeed((0, 3000), "studio"), "test/01": SceneSeed((0, 3001), "living_room")},
}
"""The named scenes of each split. Changing a seed changes the data set: it is done in a new version only."""


def scene_names(split: str) -> tuple[str, ...]:
    """Names of the scenes of a split.

    Raises:
        UsageError: if there is no such split.
    """
    if split not in SPLITS:
        raise UsageError(f"there is no split {split!r}; splits are {', '.join(SPLITS)}")
    return tuple(SPLITS[split])


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
