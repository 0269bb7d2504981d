"""Kinds of worlds by name."""

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from labeling.core.errors import UsageError
from sbm_gym.assets.catalog.library import FurnitureLibrary
from sbm_gym.scenes.compiled import SPLITS, WorldSource
from sbm_gym.scenes.profiles import INDOOR, OUTDOOR, WorldProfile
from sbm_gym.worlds.splits import ENDLESS, INTERIORS, TOWNS, SceneNames
from sbm_gym.worlds.world import World


@dataclass(frozen=True)
class IndoorWorlds:
    """Furnished homes and offices."""

    names: ClassVar[SceneNames] = INTERIORS
    profile: WorldProfile = INDOOR
    unseen_models: bool = False
    """Keep the models that validation and test scenes show out of all others."""
    builtin: bool = False
    """Furnish from models made from seeds, of which every scene has its own, not from the installed libraries."""
    movable: bool = False
    """Have some pieces of furniture stand loose, so that episodes can move them."""

    def scenes(self, split: str | None) -> tuple[str, ...]:
        """Names of the scenes of a split, of all named scenes for None."""
        return self.names.of_split(split)

    def canonical(self, scene: str | int) -> str:
        """The name of a scene: a named one, or one with a number."""
        return self.names.resolve(scene)[0]

    def build(self, scene: str) -> World:
        """Builds a scene."""
        from sbm_gym.worlds.rooms.indoor import build_indoor

        library = self._library(scene)
        return build_indoor(scene, library=library, unseen_models=self.unseen_models, movable=self.movable)

    def _library(self, scene: str) -> FurnitureLibrary | None:
        """Where a scene's furniture comes from; None for the installed libraries."""
        if not self.builtin:
            return None
        from sbm_gym.assets.parametric.builtin import BuiltinLibrary

        digest = hashlib.sha256(self.canonical(scene).encode()).digest()
        return BuiltinLibrary(int.from_bytes(digest[:4], "big"))


@dataclass(frozen=True)
class OutdoorWorlds(IndoorWorlds):
    """Towns with vehicles, some of which can always be moved."""

    names: ClassVar[SceneNames] = TOWNS
    profile: WorldProfile = OUTDOOR

    def build(self, scene: str) -> World:
        """Builds a town."""
        from sbm_gym.worlds.towns.outdoor import build_outdoor

        return build_outdoor(scene, library=self._library(scene), unseen_models=self.unseen_models)


@dataclass(frozen=True)
class NamedWorlds:
    """Worlds of one's own: a function that builds them, and the names that it understands."""

    builder: Callable[[str], World]
    """Builds the scene of a name; the same name gives the same world in every process."""
    splits: Mapping[str, Sequence[str]]
    """Names of the scenes by split; a split that is missing has those of all others, but an endless one, which is to
    learn from, those of the training split where there is one."""
    profile: WorldProfile = INDOOR

    def __post_init__(self) -> None:
        unknown = [split for split in self.splits if split not in SPLITS]
        empty = [split for split, names in self.splits.items() if not names]
        if unknown or empty or not self.splits:
            given = f"split {unknown[0]!r}" if unknown else f"no scene for {empty[0]!r}" if empty else "no scene"
            raise UsageError(f"splits name scenes under {', '.join(SPLITS)}; {given} was given")

    def scenes(self, split: str | None) -> tuple[str, ...]:
        """Names of the scenes of a split, of all scenes for None."""
        everything = dict.fromkeys(name for names in self.splits.values() for name in names)
        others = self.splits.get("train", everything) if split == ENDLESS else everything
        return tuple(self.splits.get(split or "", others))

    def canonical(self, scene: str | int) -> str:
        """Checks a name.

        Raises:
            UsageError: if there is no such scene.
        """
        if scene not in self.scenes(None):
            raise UsageError(f"there is no scene {scene!r}; known: {', '.join(self.scenes(None))}")
        return str(scene)

    def build(self, scene: str) -> World:
        """Builds a scene."""
        return self.builder(scene)


OWN_NAME = re.compile(r"[A-Za-z0-9][\w.-]*")
"""What a kind of world of one's own may be called, as it stands in the id of its environment."""
WORLDS: dict[str, Callable[[bool], WorldSource]] = {
    "indoor": lambda unseen_models: IndoorWorlds(unseen_models=unseen_models),
    "outdoor": lambda unseen_models: OutdoorWorlds(unseen_models=unseen_models),
    "indoor-builtin": lambda unseen_models: IndoorWorlds(unseen_models=unseen_models, builtin=True),
    "outdoor-builtin": lambda unseen_models: OutdoorWorlds(unseen_models=unseen_models, builtin=True),
}
"""Every kind of world: makes its source, given whether to keep the models of validation and test scenes apart."""
SHIPPED = frozenset(WORLDS)
"""Those that come with sbm_gym."""


def world_source(worlds: str | WorldSource, unseen_models: bool = False, movable: bool = False) -> WorldSource:
    """The source of a kind of world.

    Args:
        worlds: a key of ``WORLDS``, or a source, which is returned.
        unseen_models: keep the models that validation and test scenes show out of all other scenes.
        movable: have furniture stand loose in rooms, so that episodes can move it.

    Raises:
        ValueError: if there is no such kind, or ``unseen_models`` is asked of a source that has decided already.
    """
    if not isinstance(worlds, str):
        if unseen_models:
            raise ValueError(f"unseen_models goes with worlds given by name ({', '.join(WORLDS)}), not with an object")
        if not all(hasattr(worlds, name) for name in ("profile", "scenes", "canonical", "build")):
            raise ValueError(
                f"worlds is a name ({', '.join(WORLDS)}) or an object that builds them "
                f"(sbm_gym.scenes.compiled.WorldSource), not {worlds!r}"
            )
        return worlds
    if worlds not in WORLDS:
        raise ValueError(f"unknown kind of world {worlds!r}; known: {', '.join(WORLDS)}")
    source = WORLDS[worlds](unseen_models)
    if unseen_models and isinstance(source, NamedWorlds):
        raise ValueError(f"unseen_models goes with the worlds of sbm_gym, not with {worlds!r}: it builds its own")
    if movable and type(source) is IndoorWorlds:
        return replace(source, movable=True)
    return source
