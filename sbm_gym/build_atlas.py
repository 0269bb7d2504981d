"""View atlases for learning on real detectors: ``python -m sbm_gym.build_atlas --detector compact --out DIR``."""

import sys
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from labeling.cluster.cluster_config import ClusterConfig
from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp
from labeling.runtime.ranges import Count, NonNegative, check_ranges
from sbm_gym.worlds.splits import Split

if TYPE_CHECKING:
    from collections.abc import Callable

    import gymnasium

    from sbm_gym.atlas.scene_atlas import AtlasBuilder

Place = tuple[str, int]
"""A scene, and the number of a place there."""


@dataclass(frozen=True)
class AtlasConfig:
    """Renders every place and heading of scenes once and stores depth, geom ids and a detector's detections, so that
    an environment made with ``atlas=DIR`` looks views up. A command that was stopped goes on where it was.
    """

    out: Path
    """Folder for the atlases; made if it does not exist."""
    env: str = "sbm_gym/Indoor-v0"
    """Gymnasium id of the world; rooms, since streets are arranged anew for every episode."""
    split: Split = "train"
    """Split whose scenes are taken."""
    skip: NonNegative[int] = 0
    """Scenes left out at the beginning of the split: those for validation come after those for training."""
    scenes: Count | None = None
    """Number of scenes after those; all if not given."""
    detector: str = "compact"
    """Detector whose detections are stored: any name that agents.collect takes."""
    grid_m: float = 0.5
    """Distance of neighbouring places, metres; at most 0.5."""
    headings: Count = 12
    """Directions at each place; at least 12."""
    workers: Count = 1
    """Processes side by side."""
    where: tyro.conf.OmitArgPrefixes[ClusterConfig] = field(default_factory=ClusterConfig)


def build(config: AtlasConfig) -> list[Path]:
    """Builds the atlases that are missing.

    Returns:
        The folders of all scenes' atlases.

    Raises:
        SbmError: if something about the settings is wrong, or a folder holds other views.
    """
    from labeling.cluster.cluster_config import JobFiles
    from labeling.cluster.jobs import map_jobs
    from labeling.runtime.cli import progress_bar
    from labeling.runtime.process_pool import PerProcess
    from sbm_gym.assets.catalog.same_libraries import same_libraries
    from sbm_gym.atlas.scene_atlas import KEY_FILE, scene_folder

    check_ranges(config)
    env = _make_env(config)
    names = env.get_wrapper_attr("scene_names")[config.skip :][: config.scenes]
    if not names:
        raise UsageError(f"--skip {config.skip} leaves no scene of split {config.split}")
    make_views = PerProcess(partial(_view_maker, config))
    files = JobFiles(
        config.out,
        lambda job: [scene_folder(config.out, job[0]) / KEY_FILE],
        config.where.files_named(config.detector),
    )
    same = same_libraries(env.spec.kwargs.get("worlds") if env.spec else None)
    for number, name in enumerate(names):
        builder = _builder(config, env, name)
        missing = builder.missing_places()
        jobs = [(name, place) for place in missing]
        title = f"{name} ({number + 1} of {len(names)})"
        made = map_jobs(make_views, jobs, config.workers, where=config.where, files=files, same=same)
        for _ in progress_bar(made, unit="place", total=len(jobs), desc=title):
            pass
        if not builder.is_finished:
            builder.finish()
    env.close()
    return [scene_folder(config.out, name) for name in names]


def _make_env(config: AtlasConfig) -> "gymnasium.Env":
    """The environment that views are rendered in, itself without an atlas."""
    from sbm_gym.named_env import make_env

    return make_env(config.env, config.split, config.detector, colours=False, scene_cache=1)


def _builder(config: AtlasConfig, env: "gymnasium.Env", name: str) -> "AtlasBuilder":
    """The builder of a scene's atlas; resets the environment into that scene."""
    from sbm_gym.atlas.pose_grid import PoseGrid
    from sbm_gym.atlas.scene_atlas import AtlasBuilder

    env.reset(seed=0, options={"scene": name})
    poses = PoseGrid.cover(env.get_wrapper_attr("scene").world.navigable, config.grid_m, config.headings)
    return AtlasBuilder(config.out, env.get_wrapper_attr("atlas_key")(), poses)


def _view_maker(config: AtlasConfig) -> "Callable[[Place], None]":
    """A function that renders the views of one place and writes them, with an environment of its own."""
    env = _make_env(config)

    @lru_cache(maxsize=1)
    def begun(name: str):
        return _builder(config, env, name)

    def look_around(job: Place) -> None:
        name, place = job
        builder = begun(name)
        poses = builder.poses
        headings = map(poses.heading_rad, range(poses.num_headings))
        builder.write_place(
            place,
            [env.get_wrapper_attr("simulation").view_from(poses.places_m[place], yaw_rad) for yaw_rad in headings],
        )

    return look_around


def _build_and_list(config: AtlasConfig) -> None:
    for folder in build(config):
        print(folder)


HELP = CommandHelp(
    examples=(("--split train --detector compact --out ATLAS", "the training scenes, as compact sees them"),),
)
main = make_main("sbm_gym.build_atlas", AtlasConfig, _build_and_list, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
