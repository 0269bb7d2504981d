"""Options of ``agents.train``."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal

import tyro

from labeling.cluster.cluster_config import ClusterConfig
from labeling.runtime.ranges import Count, NonNegative, Seed

PaidReward = Literal["both", "discovery", "diversity", "neither", "evidence"]
"""Which terms of the reward are paid beside those for collisions and steps; or another reward, for labels that may be
expected to be right."""


@dataclass(frozen=True)
class KeptOptions:
    """Options that a run is begun with, which its folder keeps; here as they are by default.

    ``PpoConfig`` has them by the same names, where None stands for one that is not given.
    """

    env: str = "sbm_gym/IndoorBuiltin-v0"
    detector: str = "simulated:compact"
    atlas: Path | None = None
    reward: PaidReward = "both"
    seed: int = 0
    scenes: int = 120
    validation_scenes: int = 20
    eval_every: int = 40_000
    eval_episodes: int = 200


KEPT = tuple(one.name for one in fields(KeptOptions))


@dataclass(frozen=True)
class PpoConfig:
    """Trains a policy that decides where to go and where to look, with PPO.

    Says beforehand what it will take and then how fast it goes, tells the return on validation scenes beside those of
    hand-written policies from the same starts, and ends with a table on unseen scenes and the commands that use the
    policy. RUN/best holds the policy with the highest return on the validation scenes, RUN/last the latest one; either
    is a policy by the name of ppo:FOLDER. A run that was stopped goes on where it was when the same command is given
    again.
    """

    out: Path | None = None
    """Folder of the run; by default out/ppo/ENV."""
    env: str | None = None
    """Gymnasium id of the world; by default sbm_gym/IndoorBuiltin-v0."""
    steps: Count | None = None
    """Steps of the environment in all; by default as the hyperparameters say. A finished run goes on with more."""
    seed: Seed | None = None
    """Decides the first weights, scenes, starting places and all noise; by default 0."""
    envs: Count | None = None
    """Environments that are stepped together; by default as the hyperparameters say."""
    processes: Count | None = None
    """Processes that the environments are spread over; by default one for each core, with --cluster of all nodes.
    Changes nothing but the time."""
    where: tyro.conf.OmitArgPrefixes[ClusterConfig] = field(default_factory=ClusterConfig)
    reward: PaidReward | None = None
    """Which terms of the reward are paid in training, by default "both"; collisions cost always. Validation has the
    full reward. With "evidence" both have another reward, for labels that may be expected to be right (see the
    environment)."""
    detector: str | None = None
    """The detector in the loop; by default simulated:compact."""
    atlas: Path | None = None
    """Folder of python -m sbm_gym.build_atlas with views of the scenes: they are looked up instead of drawn."""
    scenes: Count | None = None
    """So many scenes to train in, by default 120: the first of the endless split."""
    validation_scenes: Count | None = None
    """So many scenes to validate in, by default 20: those that come next in the endless split."""
    hyperparams: Path | None = None
    """YAML file in the shape of rl-zoo's, with the env as a key; by default the one that comes with the project."""
    eval_every: Count | None = None
    """Steps between validations; by default 40000."""
    eval_episodes: Count | None = None
    """Episodes of a validation, by default 200; the same starts every time."""
    compare_episodes: NonNegative[int] = 100
    """Starts of the table at the end, which says how the policy does beside hand-written ones and its untrained self
    in scenes that it was neither trained in nor chosen by; 0 makes none."""
    device: str = "auto"
    """Where the network computes: cpu, cuda, ...; auto takes a GPU if there is one."""
    resume: Path | None = None
    """Go on with this run, with its settings; only --steps, --envs, --eval-every, --processes, --cluster,
    --shared, --compare-episodes, --allow-code and --device may be given with it."""
    allow_code: bool = False
    """With --resume: Python code that RUN's settings name, as env or detector, may be run. Only for runs that you
    trust; naming it again with --env or --detector allows it, too."""
