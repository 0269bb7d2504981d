"""Kinds of worlds by name."""

from dataclasses import dataclass

from sbm_gym.scenes.compiled import WorldSource
from sbm_gym.scenes.profiles import INDOOR, OUTDOOR, WorldProfile
from sbm_gym.worlds.world import World

WORLD_KINDS = ("indoor", "outdoor", "indoor-builtin", "outdoor-builtin")


def world_source(kind: str, unseen_models: bool = False) -> WorldSource:
    """The source of a kind of world.

    Args:
        kind: one of ``WORLD_KINDS``.
        unseen_models: keep the models that validation and test scenes show out of all other scenes.

    Raises:
        ValueError: if there is no such kind, naming those there are.
    """
    if kind == "indoor":
        return IndoorWorlds(unseen_models=unseen_models)
    if kind == "outdoor":
        return OutdoorWorlds(unseen_models=unseen_models)
    if kind == "indoor-builtin":
        return IndoorBuiltinWorlds(unseen_models=unseen_models)
    if kind == "outdoor-builtin":
        return OutdoorBuiltinWorlds(unseen_models=unseen_models)
    raise ValueError(f"unknown kind of world {kind!r}; known: {', '.join(WORLD_KINDS)}")


def chosen_source(worlds: str | WorldSource, unseen_models: bool) -> WorldSource:
    """The source that an environment was asked for, by name or itself.

    Raises:
        ValueError: if there is no such kind, or ``unseen_models`` is asked of a source that has decided already.
    """
    if isinstance(worlds, str):
        return world_source(worlds, unseen_models)
    if unseen_models:
        raise ValueError(f"unseen_models goes with worlds given by name ({', '.join(WORLD_KINDS)}), not with an object")
    return worlds


def _seed_of(name: str) -> int:
    """Seed of the builtin library that a scene has to itself."""
    import hashlib

    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")


@dataclass(frozen=True)
class IndoorWorlds:
    """Furnished homes and offices, from the installed furniture libraries."""

    profile: WorldProfile = INDOOR
    unseen_models: bool = False
    """Keep the furniture models of validation and test scenes out of all others."""

    def scenes(self, split: str | None) -> tuple[str, ...]:
        """Names of the scenes of a split, of all named scenes for None."""
        from sbm_gym.worlds.splits import SPLITS, scene_names

        return tuple(name for known in (SPLITS if split is None else (split,)) for name in scene_names(known))

    def canonical(self, scene: str | int) -> str:
        """The name of a scene: a named one, or ``seed/N``."""
        from sbm_gym.worlds.splits import scene_seed

        return scene_seed(scene)[0]

    def build(self, scene: str) -> World:
        """Builds a scene."""
        from sbm_gym.worlds.rooms.indoor import build_indoor

        return build_indoor(scene, unseen_models=self.unseen_models)


@dataclass(frozen=True)
class IndoorBuiltinWorlds(IndoorWorlds):
    """Furnished homes and offices with furniture made from seeds: nothing to install, and every scene has its own."""

    def build(self, scene: str) -> World:
        """Builds a scene."""
        from sbm_gym.assets.parametric.builtin import BuiltinLibrary
        from sbm_gym.worlds.rooms.indoor import build_indoor

        name = self.canonical(scene)
        library = BuiltinLibrary(_seed_of(name))
        return build_indoor(name, library=library, unseen_models=self.unseen_models)


@dataclass(frozen=True)
class OutdoorWorlds:
    """Towns with vehicles, from the installed furniture libraries."""

    profile: WorldProfile = OUTDOOR
    unseen_models: bool = False
    """Keep the models of vehicles of validation and test towns out of all others."""

    def scenes(self, split: str | None) -> tuple[str, ...]:
        """Names of the towns of a split, of all named towns for None."""
        from sbm_gym.worlds.splits import TOWN_SPLITS, town_names

        return tuple(name for known in (TOWN_SPLITS if split is None else (split,)) for name in town_names(known))

    def canonical(self, scene: str | int) -> str:
        """The name of a town: a named one, or ``town/seed/N``."""
        from sbm_gym.worlds.splits import town_seed

        return town_seed(scene)[0]

    def build(self, scene: str) -> World:
        """Builds a town."""
        from sbm_gym.worlds.towns.outdoor import build_outdoor

        return build_outdoor(scene, unseen_models=self.unseen_models)


@dataclass(frozen=True)
class OutdoorBuiltinWorlds(OutdoorWorlds):
    """Towns with vehicles, trees and street furniture made from seeds: nothing to install."""

    def build(self, scene: str) -> World:
        """Builds a town."""
        from sbm_gym.assets.parametric.builtin import BuiltinLibrary
        from sbm_gym.worlds.towns.outdoor import build_outdoor

        name = self.canonical(scene)
        library = BuiltinLibrary(_seed_of(name))
        return build_outdoor(name, library=library, unseen_models=self.unseen_models)
