"""Recorded episodes that experiments share."""

import os
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from experiments.cache.stages import RunContext, Scale, digest
from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import experiment_versions
from sbm_gym.worlds.splits import Split

BEGUN_AGAIN = "begun_again"
"""What results call the number of episodes that began elsewhere first, where the detector was sure of nothing."""


@dataclass(frozen=True)
class EpisodePool:
    """Episodes of one kind of world and one split."""

    name: str
    env: str
    split: Split
    """Settings are chosen on "train" and reported on "val"; "endless" is to learn from, too; "test", "wide" and
    "final" are for final tables only."""
    episodes: int
    seed: int = 0
    detector: str = "simulated"
    """Whose detections guide the agent and are recorded: "simulated", or a name that labeling.detectors knows."""
    policy: str = "ring"
    """Who moves."""
    episodes_per_scene: int = 1
    """Begun in different places."""
    moving: int = 0
    """Things that move, at most."""
    moving_speed: float = 1.0
    """Factor of their speed; with 0 the same things stand."""
    unseen_models: bool = False
    """In training scenes models that final ones do not show, and the other way round."""


def ablation_pools(scale: Scale) -> tuple[EpisodePool, ...]:
    """Of the ablation of the label generator: rooms and streets to choose settings on, and to report them on."""
    counts = {"smoke": (2, 1, 1, 1), "quick": (10, 6, 4, 3), "standard": (20, 9, 8, 5), "full": (30, 12, 12, 8)}[scale]
    rooms, streets = "sbm_gym/Indoor-v0", "sbm_gym/Outdoor-v0"
    return (
        EpisodePool("rooms_train", rooms, "train", counts[0]),
        EpisodePool("rooms_val", rooms, "val", counts[1]),
        EpisodePool("streets_train", streets, "train", counts[2]),
        EpisodePool("streets_val", streets, "val", counts[3]),
    )


def record(pool: EpisodePool, context: RunContext) -> list[Path]:
    """Records what the pool lacks.

    Episode i depends on the settings and on i alone, so that pools of different sizes share their first episodes.

    Returns:
        The folders of its episodes, in a dataset of these alone.

    Raises:
        SbmError: if the world cannot be built.
    """
    from agents.evaluation.results import policy_key
    from agents.rollouts.collect_config import CollectConfig
    from agents.rollouts.recorder import collect_episodes
    from labeling.io.episodes import find_episodes
    from sbm_gym.assets.catalog.same_libraries import library_digests
    from sbm_gym.env.view_detectors import digest_of_detector

    settings = asdict(pool)
    name, episodes = settings.pop("name"), settings.pop("episodes")
    if not pool.moving:
        del settings["moving"], settings["moving_speed"]
    if not pool.unseen_models:
        del settings["unseen_models"]
    depends_on = [
        {**settings, "policy": policy_key(pool.policy, pool.env)},
        experiment_versions(),
        code_digest(collect_episodes),
        digest_of_detector(pool.detector),
        library_digests(),
    ]
    out = context.cache / "episodes" / f"{name}-{digest(*depends_on)}"
    more = {"workers": context.workers, "where": context.where}
    found = collect_episodes(CollectConfig(out=out, episodes=episodes, **more, **settings))
    if len(find_episodes(out)) == len(found):
        return found
    # A larger pool has been here: whoever reads this one as a dataset must not get that one's episodes.
    return link_dataset(f"{out.name}-first-{episodes}", {folder.name: folder for folder in found}, context)


def link_dataset(name: str, episodes: Mapping[str, Path], context: RunContext) -> list[Path]:
    """One dataset of the episodes of several pools.

    Args:
        name: of the dataset. Episodes that it holds from before and that are not asked for any more are removed.
        episodes: folders, by the names that they are to have; another episode needs another name.
        context: where datasets are kept. Files are hard links where the file system has them.

    Returns:
        The folders, by name.
    """
    out = context.cache / "episodes" / name
    out.mkdir(parents=True, exist_ok=True)
    for folder in out.iterdir():
        if folder.name not in episodes:
            shutil.rmtree(folder)
    for wanted in sorted(episodes):
        if not (out / wanted).is_dir():
            half = out / f".{wanted}"  # episodes whose names start with a dot are passed over
            shutil.copytree(episodes[wanted], half, copy_function=_link)
            half.rename(out / wanted)
    return [out / wanted for wanted in sorted(episodes)]


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def pool_record(pool: EpisodePool, folders: list[Path]) -> dict[str, Any]:
    """What the record of results says about a pool."""
    import json

    told = [json.loads((folder / "episode.json").read_text()) for folder in folders]
    scenes, again = [one["scene"] for one in told], sum(one.get("spawn", 0) > 0 for one in told)
    return {**asdict(pool), "views_per_episode": 25, "scenes": scenes, BEGUN_AGAIN: again}
