"""Running an evaluation: missing episodes, summary, files, plot and tables."""

import contextlib
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from agents.evaluation.evaluate_config import EvaluateConfig
from agents.evaluation.label_quality import label_record
from agents.evaluation.results import (
    DECISIVE_SETTINGS,
    EARLIER_DEFAULTS,
    SETTINGS_FILE,
    copy_results,
    policy_key,
    read_result,
    result_path,
)
from agents.evaluation.summary import summary
from agents.evaluation.table import print_tables
from agents.policies.base import Policy
from agents.policies.registry import make_policy
from agents.rollouts.environments import capture_size, inner_env, same_furniture
from agents.rollouts.run_episode import EpisodeSpec, another_draw, episode_spec, run_episode
from agents.rollouts.scene_shares import scenes_to_compare_in
from labeling.cluster.cluster_config import JobFiles
from labeling.cluster.jobs import map_jobs
from labeling.core.errors import UsageError
from labeling.formats.atomic import write_json
from labeling.runtime.process_pool import PerProcess
from labeling.runtime.ranges import check_ranges
from labeling.runtime.run_folder import as_options, claim_run_folder
from labeling.runtime.threads import one_network_thread
from sbm_gym.env.view_detectors import digest_of_detector
from sbm_gym.named_env import make_env

RESULT_FILE, PLOT_FILE, PICTURES_FOLDER = "evaluation.json", "evaluation.png", "pictures"


def evaluate_policies(
    config: EvaluateConfig, reuse: Path | None = None, show: Callable[[dict[str, Any]], None] = print_tables
) -> dict[str, Any]:
    """Evaluates policies; see ``EvaluateConfig``.

    Args:
        config: the settings.
        reuse: for an evaluation without labels: the folder of one with, whose episodes need not be run again.
        show: takes what was found and tells it.

    Returns:
        The content of ``evaluation.json``.

    Raises:
        SbmError: if env, policies, detector or folder are at fault.

    Example:
        >>> import tempfile
        >>> from agents import EvaluateConfig, evaluate_policies
        >>> settings = {"env": "sbm_gym/IndoorBuiltin-v0", "episodes": 1, "seeds": 1, "labels": False}
        >>> config = EvaluateConfig(("spin", "random"), out=Path(tempfile.mkdtemp()) / "results", **settings)
        >>> content = evaluate_policies(config)  # doctest: +SKIP
        >>> list(content["policies"])  # doctest: +SKIP
        ['spin', 'random']
    """
    _check(config)
    evaluator = Evaluator(config)
    with contextlib.closing(evaluator.env), one_network_thread():
        settings = {name: getattr(config, name) for name in DECISIVE_SETTINGS}
        if config.labels:
            settings["views"] = list(config.label_views)
        weights = {"detector_digest": digest_of_detector(config.detector)}  # one name may come to stand for others
        claim_run_folder(
            config.out,
            SETTINGS_FILE,
            {"settings": settings, "weights": weights},
            lambda content: {
                **as_options({**EARLIER_DEFAULTS, **content["settings"]}),
                **{**weights, **content.get("weights", {})},
            },
        )
        if reuse is not None and not config.labels:
            copy_results(reuse, config.out)
        specs = [
            episode_spec(evaluator.scenes, seed, episode)
            for seed in range(config.seeds)
            for episode in range(config.episodes)
        ]
        _run_missing(evaluator, specs)
        records = {policy: [evaluator.results(spec, policy) for spec in specs] for policy in config.policies}
        content = summary(config, records)
        write_json(config.out / RESULT_FILE, content)
        show(content)
        _draw(evaluator, content, records, specs)
    return content


class Evaluator:
    """Runs episodes with all policies and keeps their results."""

    def __init__(self, config: EvaluateConfig) -> None:
        """Makes env and policies.

        Args:
            config: the settings.

        Raises:
            UsageError: if env, detector or a policy are unknown.
        """
        self.config = config
        self._keys = {policy: policy_key(policy, config.env) for policy in config.policies}
        self._policies: dict[str, Policy] = {policy: make_policy(policy, config.env) for policy in config.policies}
        paid = {} if config.reward == "views" else {"reward": config.reward}
        self.env = make_env(config.env, config.split, config.detector, **paid)
        self.scenes = scenes_to_compare_in(config.split, inner_env(self.env).scene_names)[: config.scenes]
        """Names of the scenes that episodes begin in."""

    def path(self, spec: EpisodeSpec, policy: str) -> Path:
        """Where the result of an episode lies."""
        return result_path(self.config.out, self._keys[policy], spec)

    def next_missing(self, spec: EpisodeSpec, policy: str) -> EpisodeSpec | None:
        """The first play of a start that has no result yet."""
        return next((play for play in self._plays(spec, policy) if not self.path(play, policy).is_file()), None)

    def results(self, spec: EpisodeSpec, policy: str) -> list[dict[str, Any]]:
        """What came of all plays of a start."""
        return [read_result(self.path(play, policy)) for play in self._plays(spec, policy)]

    def _plays(self, spec: EpisodeSpec, policy: str) -> list[EpisodeSpec]:
        """All draws of a policy that draws at random, which its first play tells; else that one alone."""
        first = self.path(spec, policy)
        if self.config.draws == 1 or not first.is_file() or not read_result(first).get("is_random", True):
            return [spec]
        return [another_draw(spec, draw) for draw in range(self.config.draws)]

    def files_of(self, jobs: Sequence[tuple[EpisodeSpec, str]]) -> list[Path]:
        """Results that there may be of several starts, each with a policy."""
        return [
            self.path(another_draw(spec, draw) if draw else spec, policy)
            for spec, policy in jobs
            for draw in range(self.config.draws)
        ]

    def run(self, spec: EpisodeSpec, policy: str) -> None:
        """Runs an episode and keeps its result."""
        size_px = capture_size(self.env, self.config.size) if self.config.labels else None
        record, captures = run_episode(self.env, self._policies[policy], spec, size_px)
        record["policy"] = policy
        if self.config.labels:
            known, views = inner_env(self.env).categories, self.config.label_views
            record["label_quality"] = label_record(captures, known, views, self.config.detector)
        write_json(self.path(spec, policy), record)

    def run_all(self, jobs: Sequence[tuple[EpisodeSpec, str]]) -> int:
        """Runs what is missing of several starts, each with a policy; returns how many there were."""
        for spec, policy in jobs:
            while play := self.next_missing(spec, policy):
                self.run(play, policy)
        return len(jobs)


def _check(config: EvaluateConfig) -> None:
    if not config.policies:
        raise UsageError("--policies names nobody; give at least one, such as ring")
    twice = sorted({policy for policy in config.policies if config.policies.count(policy) > 1})
    if twice:
        raise UsageError(f"--policies names {twice[0]!r} twice; give each once")
    check_ranges(config)
    if not config.label_views or min(config.label_views) < 1:
        raise UsageError(f"--label-views must be numbers of views from 1, such as 12 25, not {config.label_views}")


def _run_missing(evaluator: Evaluator, specs: Sequence[EpisodeSpec]) -> None:
    """Runs what has no result yet: all policies from one start after the other, scene by scene while it is at hand."""
    from tqdm import tqdm

    config = evaluator.config
    waiting = [
        [(spec, policy) for policy in config.policies if evaluator.next_missing(spec, policy)]
        for spec in sorted(specs, key=lambda spec: evaluator.scenes.index(spec.scene))
    ]
    total, missing = len(specs) * len(config.policies), sum(map(len, waiting))
    if missing < total:
        print(f"{total - missing} of {total} results are there already", file=sys.stderr)
    if config.workers == 1 and config.where.is_local:
        work, jobs = evaluator.run_all, [[job] for jobs in waiting for job in jobs]
    else:
        work, jobs = PerProcess(partial(_runner, config)), [jobs for jobs in waiting if jobs]
    with tqdm(total=missing, desc="evaluating", unit="episode", smoothing=0.05, file=sys.stderr) as bar:
        common = config.where.files_named(config.detector, *config.policies)
        files = JobFiles(config.out, evaluator.files_of, common)
        same = same_furniture(evaluator.env)
        for count in map_jobs(work, jobs, config.workers, where=config.where, files=files, same=same):
            bar.update(count)


def _runner(config: EvaluateConfig) -> Callable[[Sequence[tuple[EpisodeSpec, str]]], int]:
    return Evaluator(config).run_all


def _draw(evaluator: Evaluator, content: dict[str, Any], records: dict[str, Any], specs: Sequence[EpisodeSpec]) -> None:
    from agents.evaluation.plot import draw_summary
    from agents.evaluation.trajectories import draw_trajectories

    out, pictures = evaluator.config.out, evaluator.config.pictures
    draw_summary(content, out / PLOT_FILE)
    print(f"figures: {out / RESULT_FILE}\nplot:    {out / PLOT_FILE}")
    for number, spec in enumerate(specs[:pictures]):
        path = out / PICTURES_FOLDER / f"seed{spec.seed}-{spec.episode:04d}.png"
        evaluator.env.reset(seed=spec.env_seed, options={"scene": spec.scene})
        episodes = {policy: plays[number][0] for policy, plays in records.items()}
        draw_trajectories(inner_env(evaluator.env), episodes, path)
    if pictures:
        print(f"ways:    {out / PICTURES_FOLDER}")
