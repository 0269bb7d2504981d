"""The whole of an evaluation: play what is missing, sum up, write, draw, print."""

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from agents.evaluation.evaluate_config import EvaluateConfig
from agents.evaluation.label_quality import VIEW_COUNTS, label_record
from agents.evaluation.store import BEFORE, DECISIVE, SETTINGS_FILE, adopt, policy_key, read_result, result_path
from agents.evaluation.summary import summary
from agents.evaluation.table import print_tables
from agents.policies.base import Policy
from agents.policies.registry import make_policy
from agents.rollouts.environments import capture_size, inner_env, make_env
from agents.rollouts.run_episode import EpisodeSpec, episode_spec, run_episode
from labeling.core.errors import UsageError
from labeling.io.formats.atomic import write_json
from labeling.runtime.process_pool import PerProcess, map_jobs
from labeling.runtime.run_folder import as_options, claim_run_folder

_Job = tuple[EpisodeSpec, list[str]]
"""A start, and the policies to play it with."""
RESULT_FILE, PLOT_FILE, PICTURES_FOLDER = "evaluation.json", "evaluation.png", "pictures"


def evaluate(config: EvaluateConfig, played: Path | None = None) -> dict[str, Any]:
    """Evaluates policies; see ``EvaluateConfig``.

    Args:
        config: the settings.
        played: for an evaluation without labels: the folder of one with, whose episodes need not be played again.

    Returns:
        The content of ``evaluation.json``.

    Raises:
        SbmError: if env, policies, detector or folder are at fault.
    """
    _check(config)
    player = Player(config)
    try:
        settings = {name: getattr(config, name) for name in DECISIVE}
        if config.labels:
            settings["views"] = list(VIEW_COUNTS)
        claim_run_folder(
            config.out,
            SETTINGS_FILE,
            {"settings": settings},
            lambda content: as_options({**BEFORE, **content["settings"]}),
        )
        if played is not None and not config.labels:
            adopt(played, config.out)
        specs = [
            episode_spec(player.scenes, seed, episode)
            for seed in range(config.seeds)
            for episode in range(config.episodes)
        ]
        _play_missing(player, specs)
        records = {
            policy: [
                read_result(result_path(config.out, player.keys[policy], spec.seed, spec.episode)) for spec in specs
            ]
            for policy in config.policies
        }
        content = summary(config, records)
        write_json(config.out / RESULT_FILE, content)
        print_tables(content)
        _draw(player, content, records, specs)
    finally:
        player.close()
    return content


class Player:
    """Plays episodes with all policies and keeps their results."""

    def __init__(self, config: EvaluateConfig) -> None:
        """Makes env and policies.

        Args:
            config: the settings.

        Raises:
            UsageError: if env, detector or a policy are unknown.
        """
        self.config = config
        self.keys = {policy: policy_key(policy, config.env) for policy in config.policies}
        """Under which name each policy's results are kept."""
        self._policies: dict[str, Policy] = {policy: make_policy(policy, config.env) for policy in config.policies}
        self.env = make_env(config.env, config.split, config.detector)
        self.scenes = inner_env(self.env).scene_names
        """Names of the scenes of the split."""

    def close(self) -> None:
        """Frees the env."""
        self.env.close()

    def missing(self, spec: EpisodeSpec) -> list[str]:
        """The policies that have no result for this start."""
        return [
            policy
            for policy, key in self.keys.items()
            if not result_path(self.config.out, key, spec.seed, spec.episode).is_file()
        ]

    def play(self, spec: EpisodeSpec, policy: str) -> None:
        """Plays an episode and keeps its result."""
        size_px = capture_size(self.env, self.config.size) if self.config.labels else None
        record, captures = run_episode(self.env, self._policies[policy], spec, size_px)
        record["policy"] = policy
        if self.config.labels:
            record["label_quality"] = label_record(captures, inner_env(self.env).categories)
        write_json(result_path(self.config.out, self.keys[policy], spec.seed, spec.episode), record)


def _check(config: EvaluateConfig) -> None:
    if not config.policies:
        raise UsageError("--policies names nobody; give at least one, such as ring")
    twice = sorted({policy for policy in config.policies if config.policies.count(policy) > 1})
    if twice:
        raise UsageError(f"--policies names {twice[0]!r} twice; give each once")
    for name in ("episodes", "seeds", "workers"):
        if getattr(config, name) < 1:
            raise UsageError(f"--{name} must be at least 1, not {getattr(config, name)}")
    if config.pictures < 0:
        raise UsageError(f"--pictures counts episodes; give 0 or more, not {config.pictures}")
    if config.size is not None and config.size < 32:
        raise UsageError(f"--size must be at least 32 pixels, not {config.size}")


# Playing -------------------------------------------------------------------------------------------------------------


def _play_missing(player: Player, specs: Sequence[EpisodeSpec]) -> None:
    """Plays what has no result yet. All policies play one start after the other, while its scene is at hand."""
    from tqdm import tqdm

    waiting = [(spec, policies) for spec in specs for policies in [player.missing(spec)] if policies]
    total, missing = len(specs) * len(player.keys), sum(len(policies) for _, policies in waiting)
    if missing < total:
        print(f"{total - missing} of {total} results are there already", file=sys.stderr)
    with tqdm(total=missing, desc="evaluating", unit="episode", smoothing=0.05, file=sys.stderr) as bar:
        if player.config.workers == 1:
            waiting = [(spec, [policy]) for spec, policies in waiting for policy in policies]
            work = partial(_play, player)
        else:
            work = PerProcess(partial(_playing, player.config))
        for count in map_jobs(work, waiting, player.config.workers):
            bar.update(count)


def _playing(config: EvaluateConfig) -> Callable[[_Job], int]:
    return partial(_play, Player(config))


def _play(player: Player, job: _Job) -> int:
    """Plays one start with some policies; returns how many."""
    spec, policies = job
    for policy in policies:
        player.play(spec, policy)
    return len(policies)


# Drawing -------------------------------------------------------------------------------------------------------------


def _draw(player: Player, content: dict[str, Any], records: dict[str, Any], specs: Sequence[EpisodeSpec]) -> None:
    from agents.evaluation.plot import draw_summary
    from agents.evaluation.top_down import draw_ways, seen_from_above

    out = player.config.out
    draw_summary(content, out / PLOT_FILE)
    print(f"figures: {out / RESULT_FILE}\nplot:    {out / PLOT_FILE}")
    for number, spec in enumerate(specs[: player.config.pictures]):
        path = out / PICTURES_FOLDER / f"seed{spec.seed}-{spec.episode:04d}.png"
        player.env.reset(seed=spec.env_seed, options={"scene": spec.scene})
        plan = seen_from_above(inner_env(player.env))
        draw_ways(plan, {policy: episodes[number] for policy, episodes in records.items()}, path)
    if player.config.pictures:
        print(f"ways:    {out / PICTURES_FOLDER}")
