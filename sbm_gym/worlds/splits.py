"""Names of scenes: 15 interiors for training, 1 for validation, 2 for testing, 3, 1 and 1 towns, and any seed besides.

Source: thesis section 5 (the splits of the 18 Replica scenes) and 5.1.1 (five towns).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from numbers import Integral
from typing import Literal

from labeling.core.errors import UsageError

TRAIN_KINDS = (
    *("apartment", "office", "flat", "living_room", "hotel"),
    *("apartment", "studio_flat", "office", "flat", "apartment"),
    *("hotel", "flat", "living_room", "apartment", "office"),
)
"""Kinds of homes of the training scenes, in about Replica's proportions."""
Split = Literal["train", "val", "test", "wide", "final", "endless"]
WIDE = "wide"
"""A further split to test on, beyond the thesis': two homes and one town tell chance from gain poorly."""
FINAL = "final"
"""As many further ones, set aside for the end: tables look at them, decisions are made elsewhere."""
ENDLESS = "endless"
"""A further split to learn from: so many scenes that a robot never has to come back to one."""


@dataclass(frozen=True)
class SceneSeed:
    """All that decides what a scene looks like."""

    seed: tuple[int, ...]
    """Entropy of its random generator; named scenes and free seeds never share one."""
    kind: str | None = None
    """Its kind of home, a key of ``PROGRAMMES``; None draws one."""


@dataclass(frozen=True)
class SceneNames:
    """The scenes of one kind of world, by name."""

    noun: str
    """What messages call a scene."""
    prefix: str
    """Scenes that are numbers have it before them."""
    named: Mapping[str, Mapping[str, SceneSeed]]
    """The named scenes of each split. Changing a seed changes the data set: it is done in a new version only."""
    numbered: Mapping[str, range]
    """Numbers of the scenes of further splits."""
    entropy: int
    """First word of the seed of every numbered scene."""

    def of_split(self, split: str | None) -> tuple[str, ...]:
        """Names of the scenes of a split, a ``Split``; None for all that have names.

        Raises:
            UsageError: if there is no such split.
        """
        if split is None:
            return tuple(name for scenes in self.named.values() for name in scenes)
        if split in self.numbered:
            return _numbered(self.prefix, self.numbered[split])
        if split not in self.named:
            raise UsageError(f"there is no split {split!r}; splits are {', '.join((*self.named, *self.numbered))}")
        return tuple(self.named[split])

    def shows_held_out(self, name: str, unseen_models: bool) -> bool:
        """Whether a scene is furnished from the models that training does without.

        Args:
            name: canonical name of a scene.
            unseen_models: whether training does without them; otherwise final scenes show any.
        """
        named = any(name in self.named[split] for split in ("val", "test"))
        return named or (unseen_models and name in _set_of_numbered(self.prefix, self.numbered[FINAL]))

    def resolve(self, name: str | int) -> tuple[str, SceneSeed]:
        """The canonical name of a scene and what it is made from.

        Args:
            name: a named scene, the prefix and a number, or just the number (not negative; NumPy's, too).

        Raises:
            UsageError: if it is none of these.
        """
        if isinstance(name, bool) or not isinstance(name, Integral | str):
            raise UsageError(f"a {self.noun} is named by a text or a whole number, not {name!r}")
        text = name if isinstance(name, str) else f"{self.prefix}{int(name)}"
        for scenes in self.named.values():
            if text in scenes:
                return text, scenes[text]
        match = re.fullmatch(rf"{self.prefix}(\d+)", text)
        if match is None:
            known = ", ".join(" .. ".join(dict.fromkeys((min(scenes), max(scenes)))) for scenes in self.named.values())
            raise UsageError(
                f"there is no {self.noun} {name!r}; {self.noun}s are {known}, and {self.prefix}N for any whole number "
                "N >= 0"
            )
        return f"{self.prefix}{int(match.group(1))}", SceneSeed((self.entropy, int(match.group(1))))


@cache
def _numbered(prefix: str, numbers: range) -> tuple[str, ...]:
    return tuple(f"{prefix}{number}" for number in numbers)


@cache
def _set_of_numbered(prefix: str, numbers: range) -> frozenset[str]:
    return frozenset(_numbered(prefix, numbers))


INTERIORS = SceneNames(
    noun="scene",
    prefix="seed/",
    named={
        "train": {f"train/{i:02d}": SceneSeed((0, 1000 + i), kind) for i, kind in enumerate(TRAIN_KINDS)},
        "val": {"val/00": SceneSeed((0, 2000), "flat")},
        "test": {"test/00": SceneSeed((0, 3000), "apartment"), "test/01": SceneSeed((0, 3001), "living_room")},
    },
    # Nothing is trained or chosen on those of the wide and the final split; the wide ones have been looked at.
    numbered={WIDE: range(100_000, 100_040), FINAL: range(200_000, 200_040), ENDLESS: range(100_000)},
    entropy=1,
)
"""Homes and offices."""
TOWNS = SceneNames(
    noun="town",
    prefix="town/seed/",
    named={
        "train": {f"town/train/{i:02d}": SceneSeed((2, 1000 + i)) for i in range(3)},
        "val": {"town/val/00": SceneSeed((2, 2000))},
        "test": {"town/test/00": SceneSeed((2, 3000))},
    },
    numbered={WIDE: range(100_000, 100_012), FINAL: range(200_000, 200_012), ENDLESS: range(100_000)},
    entropy=3,
)
"""Towns."""
