"""What each half of the reward teaches: policies trained on parts of it, all measured with the whole."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from experiments.stages import Scale, Workplace, code_digest, digest

DESCRIPTION = "PPO trained on parts of the reward, measured with the whole of it on validation scenes"
ENV = "sbm_gym/IndoorBuiltin-v0"
DETECTOR = "simulated"
SPLIT = "val"
HYPERPARAMS = Path(__file__).with_name("reward_ablation.yaml")
Reward = Literal["both", "discovery", "diversity", "neither"]
REWARDS: tuple[Reward, ...] = ("both", "discovery", "diversity", "neither")
"""Which terms are paid in training; see ``agents.train``. Differences are to the first."""
REFERENCES = ("random", "ring", "next_best_view")
FIGURES = ("return", "discovery", "diversity", "objects", "coverage", "collisions")
START = {
    "return": "return",
    "discovery": "reward/discovery",
    "diversity": "reward/diversity",
    "objects": "objects_confirmed",
    "coverage": "coverage",
    "collisions": "collisions",
}
"""What validations during training call the figures."""
TRAINING_CODE = ("agents.ppo.training", "agents.features", "sbm_gym.fixation_env", "sbm_gym.registration")
SMOKE_ROLLOUTS = 2

PROTOCOL = {
    "training": (
        "actions are priorities of the view planner. One run for each reward and training seed; runs of one seed begin "
        "with the same network, whose priorities are wrong for both halves of the reward: candidates and near views "
        "count less, unseen floor more, and it does not look ahead. Measured is the last policy of a run: the best one "
        "would be chosen by validations, which pay the full reward to all"
    ),
    "figures": (
        "means over the same validation episodes for all, with the full reward; then mean and sample standard "
        "deviation over training seeds. difference: to the policy trained on the full reward with the same seed, "
        "likewise"
    ),
    "start": "these networks before their first update, on the episodes of validations",
}


@dataclass(frozen=True)
class Size:
    """How much of everything a scale has."""

    steps: int | None
    """Of training; None is what the hyperparameters say, 0 two rollouts."""
    episodes: int
    """To measure by."""
    validation_episodes: int = 20
    """Of each validation during training."""


SIZES: dict[Scale, Size] = {"smoke": Size(0, 1, 1), "quick": Size(20_000, 40), "full": Size(None, 100)}


def run(workplace: Workplace) -> dict[str, Any]:
    """Trains what has not been trained, plays what has not been played, and sums up.

    Returns:
        Figures by reward over training seeds, those of hand-written policies and of the networks that runs begin
        with, and how every run was trained.

    Raises:
        SbmError: if a run cannot go on.
    """
    from agents.evaluation.paired import over_seeds

    runs: dict[Reward, list[Path]] = {
        reward: [_trained(reward, seed, workplace) for seed in workplace.seeds] for reward in REWARDS
    }
    content = _measured(runs, workplace)
    figures = {policy: found["figures"] for policy, found in content["policies"].items()}

    def values(policies: list[str], name: str) -> list[float]:
        return [figures[policy][name]["mean"] for policy in policies]

    rewards = {}
    for reward, folders in runs.items():
        ours, base = [_policy(folder) for folder in folders], [_policy(folder) for folder in runs[REWARDS[0]]]
        rewards[reward] = {
            name: {
                **over_seeds(values(ours, name)),
                "difference": None
                if reward == REWARDS[0]
                else over_seeds([a - b for a, b in zip(values(ours, name), values(base, name), strict=True)]),
            }
            for name in FIGURES
        }
    return {
        "env": ENV,
        "detector": DETECTOR,
        "settings": content["settings"],
        "rewards": rewards,
        "references": {policy: {name: figures[policy][name]["mean"] for name in FIGURES} for policy in REFERENCES},
        "start": _start(runs[REWARDS[0]]),
        "runs": [{"reward": reward, **_origin(folder)} for reward, folders in runs.items() for folder in folders],
        "protocol": PROTOCOL,
    }


def _trained(reward: Reward, seed: int, workplace: Workplace) -> Path:
    """The folder of a finished run."""
    import functools
    import sys
    from dataclasses import asdict

    from tqdm import tqdm

    from agents.ppo.hyperparameters import read_hyperparameters
    from agents.ppo.training import train
    from agents.train import TrainConfig
    from experiments.provenance import versions

    size, hyperparameters = SIZES[workplace.scale], read_hyperparameters(ENV, HYPERPARAMS)
    steps = hyperparameters.n_timesteps if size.steps is None else size.steps
    steps = steps or SMOKE_ROLLOUTS * hyperparameters.n_steps * hyperparameters.n_envs
    # Rates fall over the whole of a run, so a longer one is another one.
    decisive = [ENV, DETECTOR, asdict(hyperparameters), steps, size.validation_episodes]
    decisive.append(versions())
    folder = workplace.cache / "reward_ablation" / digest(decisive, code_digest(*TRAINING_CODE)) / f"{reward}-{seed}"
    if _steps_done(folder) >= steps:
        return folder
    config = TrainConfig(
        out=folder,
        env=ENV,
        steps=steps,
        seed=seed,
        reward=reward,
        detector=DETECTOR,
        hyperparams=HYPERPARAMS,
        eval_episodes=size.validation_episodes,
    )
    train(config, tqdm.write, functools.partial(tqdm, unit="step", file=sys.stderr, dynamic_ncols=True))
    return folder


def _steps_done(folder: Path) -> int:
    """How far a run has come."""
    from agents.ppo.checkpoint import read_description
    from agents.ppo.files import LAST

    last = folder / LAST
    return read_description(last)["steps"] if last.is_dir() else 0


def _measured(runs: dict[Reward, list[Path]], workplace: Workplace) -> dict[str, Any]:
    """Plays the last policies of all runs, and hand-written ones, from the same starts."""
    from agents.evaluate import EvaluateConfig
    from agents.evaluation.run import evaluate
    from experiments.policy_evaluation import played_folder

    config = EvaluateConfig(
        policies=(*(_policy(folder) for folders in runs.values() for folder in folders), *REFERENCES),
        env=ENV,
        split=SPLIT,
        episodes=SIZES[workplace.scale].episodes,
        seeds=1,
        detector=DETECTOR,
        labels=False,
        workers=workplace.workers,
        out=played_folder("reward_ablation_episodes", ENV, SPLIT, DETECTOR, None, workplace),
    )
    return evaluate(config)


def _policy(folder: Path) -> str:
    from agents.ppo.files import LAST

    return f"ppo:{folder / LAST}"


def _start(folders: list[Path]) -> dict[str, Any]:
    """Figures of the networks that runs begin with, over training seeds."""
    from agents.evaluation.paired import over_seeds
    from agents.ppo.files import HISTORY_FILE
    from labeling.episode_json import read_json

    first = [read_json(folder / HISTORY_FILE).mapping()["validations"][0] for folder in folders]
    assert all(one["at"] == 0 for one in first)
    return {name: over_seeds([one[theirs] for one in first]) for name, theirs in START.items()}


def _origin(folder: Path) -> dict[str, Any]:
    from agents.ppo.files import LAST
    from experiments.trained_policies import origin_of

    origin = origin_of(folder / LAST)
    return {name: origin[name] for name in ("seed", "steps", "command", "hyperparameters", "git_commit")}


def report(results: Path, docs: Path) -> list[Path]:
    """Writes the page about policies, and the pictures in it.

    Returns:
        The files written.
    """
    from experiments.policies_page import write_page

    return write_page(results, docs)
