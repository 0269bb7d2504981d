"""Recording episodes into a folder, so that it can be killed and started again at any time."""

import contextlib
import dataclasses
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from agents.policies.registry import make_policy, policy_digest
from agents.rollouts.collect_config import CollectConfig
from agents.rollouts.environments import capture_size, inner_env, same_furniture
from agents.rollouts.rollout import rollout
from labeling.cluster.cluster_config import JobFiles
from labeling.cluster.jobs import map_jobs
from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError, SbmError, UsageError
from labeling.core.types import CONFIDENT
from labeling.io.coco import SLIVER_AREA_SHARE
from labeling.io.episodes import read_episode, write_episode
from labeling.runtime.process_pool import PerProcess
from labeling.runtime.provenance import simulation_provenance
from labeling.runtime.ranges import check_ranges
from labeling.runtime.run_folder import as_options, claim_run_folder
from sbm_gym.env.recording import Capture, episode_of_captures
from sbm_gym.env.view_detectors import digest_of_detector
from sbm_gym.named_env import make_env
from sbm_gym.sensors.sensor_noise import add_noise

SETTINGS_FILE = "collection.json"
MAX_ATTEMPTS = 20
"""An episode without a single confident detection gives no labels, so it is started again elsewhere: this many
times."""
ATTEMPTS_PER_SCENE = 5
"""After so many starts in one scene that found nothing, the next scene is tried."""


def collect_episodes(config: CollectConfig) -> list[Path]:
    """Records the episodes that the folder lacks.

    Args:
        config: what to record, and where.

    Returns:
        Folders of all episodes asked for, in order.

    Raises:
        SbmError: if env or policy are unknown, the folder holds something else, or no object can be found.

    Example:
        >>> import tempfile
        >>> from agents import CollectConfig, collect_episodes
        >>> out = Path(tempfile.mkdtemp()) / "episodes"
        >>> config = CollectConfig(out, env="sbm_gym/IndoorBuiltin-v0", policy="spin", episodes=1, size=64)
        >>> [folder.name for folder in collect_episodes(config)]  # doctest: +ELLIPSIS
        1 episodes in ...
        ['0000']
    """
    from tqdm import tqdm

    check_ranges(config)
    make_policy(config.policy, config.env)
    with contextlib.closing(make_env(config.env, config.split, config.detector, **config.world)) as env:
        settings = dataclasses.asdict(config)
        for name in ("out", "episodes", "workers", "where"):  # none changes what an episode holds
            del settings[name]
        defaults = {setting.name: setting.default for setting in dataclasses.fields(config)}  # of before it was there
        weights = _weights(config)
        claim_run_folder(
            config.out,
            SETTINGS_FILE,
            {"settings": settings, "weights": weights},
            lambda content: {
                **as_options({**defaults, **content["settings"]}),
                **{**weights, **content.get("weights", {})},
            },
            "episodes",
        )
        folders = [_folder(config, number) for number in range(config.episodes)]
        missing = [number for number, folder in enumerate(folders) if not _is_complete(folder)]
        if len(missing) < len(folders):
            print(f"{len(folders) - len(missing)} of {len(folders)} episodes are there already", file=sys.stderr)
        alone = config.workers == 1 and config.where.is_local
        work = partial(_record, config, env) if alone else PerProcess(partial(_recorder, config))
        files = JobFiles(config.out, common=config.where.files_named(config.policy, config.detector), whole=True)
        same = same_furniture(env)
        with tqdm(total=len(missing), desc="recording", unit="episode", file=sys.stderr) as bar:
            for _ in map_jobs(work, missing, config.workers, where=config.where, files=files, same=same):
                bar.update()
    print(f"{len(folders)} episodes in {config.out}")
    return folders


def _weights(config: CollectConfig) -> dict[str, str]:
    """What stands behind the names of policy and detector: a folder of the same name may come to hold others."""
    digests = {
        "policy_digest": policy_digest(config.policy, config.env),
        "detector_digest": digest_of_detector(config.detector),
    }
    return {name: found for name, found in digests.items() if found}


def _folder(config: CollectConfig, number: int) -> Path:
    return config.out / f"{number:04d}"


def _recorder(config: CollectConfig) -> Callable[[int], None]:
    return partial(_record, config, make_env(config.env, config.split, config.detector, **config.world))


def _record(config: CollectConfig, env: gym.Env, number: int) -> None:
    """Records an episode and writes it, whole or not at all."""
    write_episode(_folder(config, number), record_episode(env, config, number))


def record_episode(env: gym.Env, config: CollectConfig, number: int) -> Episode:
    """Records one episode with at least one confident view; the same for the same settings and number.

    Args:
        env: the environment.
        config: the settings.
        number: number of the episode.

    Raises:
        SbmError: if no start led to a confident detection.

    Example:
        >>> import sbm_gym
        >>> env = gym.make("sbm_gym/IndoorBuiltin-v0")
        >>> config = CollectConfig(Path("out"), env="sbm_gym/IndoorBuiltin-v0", policy="spin", size=64)
        >>> record_episode(env, config, number=0).rgb.shape
        (25, 64, 64, 3)
    """
    scenes = inner_env(env).scene_names
    order = np.random.default_rng([config.seed, 0]).permutation(len(scenes))
    for attempt in range(MAX_ATTEMPTS):
        index = number // config.episodes_per_scene + attempt // ATTEMPTS_PER_SCENE
        scene = scenes[int(order[index % len(scenes)])]
        seeds = np.random.SeedSequence([config.seed, 1, number, attempt]).generate_state(2)
        captures, log = _roll_out(env, config, scene, int(seeds[0]), int(seeds[1]))
        if any(_is_source(capture) for capture in captures):
            metadata = {
                "world": config.env,
                "scene": scene,
                "split": config.split,
                "policy": config.policy,
                "seed": config.seed,
                "episode": number,
                "spawn": attempt,
                "env_seed": int(seeds[0]),
                "detector": config.detector,
                "detector_categories": list(inner_env(env).categories),
                "confident": CONFIDENT,
                **_weights(config),
                "noise": dataclasses.asdict(config.noise),
                **({"motion": config.motion} if config.motion else {}),
                **({"unseen_models": True} if config.unseen_models else {}),
                **simulation_provenance(),
                "steps": log,
            }
            episode = episode_of_captures(captures, inner_env(env).categories, metadata, name=f"{number:04d}")
            return add_noise(episode, config.noise, noise_seed(config.seed, number))
    raise SbmError(
        f"episode {number}: {MAX_ATTEMPTS} starts without one confident detection ({config.policy!r} in "
        f"{config.env!r}); try another seed or split"
    )


def noise_seed(seed: int, number: int) -> tuple[int, int, int]:
    """What decides the noise of an episode's depth and poses: the recording's seed and the episode's number."""
    return seed, 4, number


def _roll_out(
    env: gym.Env, config: CollectConfig, scene: str, env_seed: int, policy_seed: int
) -> tuple[list[Capture], list[dict[str, Any]]]:
    """One episode: the full frame after every step, and what was done."""
    policy = make_policy(config.policy, config.env)
    observation, info = env.reset(seed=env_seed, options={"scene": scene})
    captures, log = [], []
    for step in rollout(env, policy, observation, info, np.random.default_rng(policy_seed)):
        captures.append(inner_env(env).capture(*capture_size(env, config.size)))
        log.append(
            {
                "action": [float(value) for value in step.action],
                "reward": step.reward,
                "reward_terms": step.info["reward_terms"],
                "collided": step.info["collided"],
                "fixated_object": step.info["fixation_target"].get("object_id"),
                "coverage": step.info["coverage"],
            }
        )
    return captures, log


def _is_source(capture: Capture) -> bool:
    """Whether labels can start from this view: a confident detection of a size that the label generator accepts."""
    return any(
        detection.confidence >= CONFIDENT
        and np.count_nonzero(detection.mask) >= SLIVER_AREA_SHARE * detection.mask.size
        for detection in capture.detections
    )


def _is_complete(folder: Path) -> bool:
    """Whether an episode is there. Episodes appear whole; one that was damaged since is an error, not overwritten."""
    if not folder.exists():
        return False
    try:
        read_episode(folder)
    except EpisodeFormatError as error:
        raise UsageError(f"{error}; delete {folder} to have it recorded again") from error
    return True
