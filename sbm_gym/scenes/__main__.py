"""Compiles scenes ahead of time, and lists those there are: ``python -m sbm_gym.scenes``."""

import functools
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from labeling.cluster.cluster_config import ClusterConfig
from labeling.runtime.cli import run_command
from labeling.runtime.help import CommandHelp
from labeling.runtime.ranges import Count, check_ranges
from sbm_gym.worlds.splits import Split

if TYPE_CHECKING:
    from sbm_gym.scenes.compiled import WorldSource


@dataclass(frozen=True)
class Which:
    """Some scenes of an environment."""

    env: str = "sbm_gym/Indoor-v0"
    """Gymnasium id of an environment that comes with sbm_gym; scenes of others are not cached."""
    split: Split = "train"
    """Scenes of this split."""
    scenes: Count | None = None
    """Only the first so many of them."""
    unseen_models: bool = False
    """As environments with unseen_models=True have them."""
    renderer: Literal["auto", "rays", "gl"] = "auto"
    """As environments with this renderer have them."""


@dataclass(frozen=True)
class Build(Which):
    """Compile scenes into the cache, so that environments open them without delay. Cached scenes are skipped, so that a
    command that was stopped goes on where it was.
    """

    workers: Count = 1
    """Processes side by side."""
    where: tyro.conf.OmitArgPrefixes[ClusterConfig] = field(default_factory=ClusterConfig)


@dataclass(frozen=True)
class ListScenes(Which):
    """Print the names of scenes, and which of them are in the cache."""


Command = Annotated[Build, tyro.conf.subcommand("build")] | Annotated[ListScenes, tyro.conf.subcommand("list")]


DOES = "Compiles scenes ahead of time, and lists those there are."
HELP = CommandHelp(
    examples=(
        ("build --split train --workers 4", "the scenes of the training split"),
        ("list --split train", "which of them are there"),
    ),
)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns the exit code."""
    return run_command(Command, _run, "python -m sbm_gym.scenes", arguments, description=DOES, about=HELP)


def _run(command: Build | ListScenes) -> None:
    from labeling.core.errors import UsageError
    from sbm_gym.scenes.scene_cache import is_kept
    from sbm_gym.scenes.world_sources import NamedWorlds, world_source
    from sbm_gym.store.cache_folder import SCENES_VARIABLE, max_bytes

    check_ranges(command)
    if max_bytes() == 0:
        raise UsageError(f"{SCENES_VARIABLE} says that no scenes are kept")
    source = world_source(_worlds(command.env), command.unseen_models)
    if isinstance(source, NamedWorlds) and isinstance(command, Build):
        raise UsageError(f"{command.env!r} is a world of one's own, of which no compiled scenes are kept")
    names = source.scenes(command.split)[: command.scenes]
    missing = [name for name in names if not is_kept(source, command.renderer, name)]
    if isinstance(command, ListScenes):
        for name in names:
            print(name if name in missing else f"{name}  kept")
        return
    _build(source, missing, command)
    left = [name for name in names if not is_kept(source, command.renderer, name)]
    print(f"{len(names) - len(left)} of {len(names)} scenes are kept, {len(missing)} of them built now")
    if left:
        raise UsageError(f"more scenes than the cache may hold: give it more GB by {SCENES_VARIABLE}")


def _worlds(env_id: str) -> "str | WorldSource":
    """The kind of worlds of an environment."""
    import gymnasium as gym

    from labeling.core.errors import UsageError
    from sbm_gym.scenes.env_names import registered_id

    worlds = gym.spec(registered_id(env_id)).kwargs.get("worlds")
    if worlds is None:
        raise UsageError(f"env {env_id!r} has no scenes, as those of this project have")
    return worlds


def _build(source: "WorldSource", names: list[str], command: Build) -> None:
    from tqdm import tqdm

    from labeling.cluster.jobs import map_jobs
    from sbm_gym.assets.catalog.same_libraries import same_libraries
    from sbm_gym.scenes.scene_cache import keep_scene, keep_scene_files, scene_files

    here, same = command.where.is_local, same_libraries(source)
    # Nodes of a cluster keep the scene for themselves, too.
    work = functools.partial(keep_scene if here else scene_files, source, command.renderer)
    with tqdm(total=len(names), desc="compiling", unit="scene", file=sys.stderr, disable=not names) as bar:
        for made in map_jobs(work, names, command.workers, where=command.where, same=same):
            name = made if isinstance(made, str) else keep_scene_files(source, command.renderer, *made)
            bar.set_postfix_str(name, refresh=bool(bar.update()))


if __name__ == "__main__":
    sys.exit(main())
