"""Kinds of worlds by name."""

from dataclasses import dataclass

from sbm_gym.scenes import WorldSource
from sbm_gym.worlds.world import World

WORLD_KINDS = ("indoor",)


def world_source(kind: str) -> WorldSource:
    """The source of a kind of world.

    Raises:
        ValueError: if there is no such kind, naming those there are.
    """
    if kind == "indoor":
        return IndoorWorlds()
    raise ValueError(f"unknown kind of world {kind!r}; known: {', '.join(WORLD_KINDS)}")


@dataclass(frozen=True)
class IndoorWorlds:
    """Furnished rooms, from the installed furniture libraries."""

    def scenes(self, split: str | None) -> tuple[str, ...]:
        """Names of the scenes of a split, of all named scenes for None."""
        from sbm_gym.worlds.splits import SPLITS, scene_names

        return tuple(name for known in SPLITS if split in (None, known) for name in scene_names(known))

    def canonical(self, scene: str | int) -> str:
        """The name of a scene: a named one, or ``seed/N``."""
        from sbm_gym.worlds.splits import scene_seed

        return scene_seed(scene)[0]

    def build(self, scene: str) -> World:
        """Builds a scene."""
        from sbm_gym.worlds.indoor import build_indoor

        return build_indoor(scene)
