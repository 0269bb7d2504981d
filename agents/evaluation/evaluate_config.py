"""Settings of an evaluation."""

from dataclasses import dataclass, field
from pathlib import Path

import tyro

from labeling.cluster.cluster_config import ClusterConfig
from labeling.runtime.ranges import Count, NonNegative, PictureHeight
from sbm_gym.env.rewards import Reward
from sbm_gym.worlds.splits import Split

VIEW_COUNTS = (5, 10, 12, 15, 20, 25)


@dataclass(frozen=True)
class EvaluateConfig:
    """Lets policies look around from the same starts and compares what they earn and the labels they bring home.

    Prints tables and writes OUT/evaluation.json and OUT/evaluation.png. Intervals are over starts and scenes. Every
    episode's result is kept in OUT: killed and started again, it goes on where it was, and more episodes, seeds, draws
    or policies can be added later. Delete OUT after a change of the program.
    """

    policies: tuple[str, ...] = ("ring", "spin", "random", "frontier", "next_best_view")
    """Who is compared: "ring", "spin", "random", "frontier", "next_best_view", "ppo", "ppo_evidence" and
    "ppo_unmapped" (trained policies that come with the project), "ppo:CHECKPOINT". Differences are to the first."""
    env: str = "sbm_gym/Indoor-v0"
    """Gymnasium id of the world."""
    split: Split = "endless"
    """Scenes: of "endless" such as agents.train neither learns from nor chooses by. "test" and "wide" are for final
    figures only."""
    scenes: Count | None = 20
    """How many of them, the first ones; episodes begin in each of them in turn. All there are, if there are fewer."""
    episodes: Count = 200
    """Starts of each seed, the same for all policies. The table says which differences so many resolve; below 100 in
    4 scenes none counts as shown."""
    seeds: Count = 1
    """Seeds 0, 1, ...: each draws starts of its own."""
    draws: Count = 1
    """Every start is played so often by policies that draw at random, and their figures averaged."""
    detector: str = "simulated"
    """The detector in the loop."""
    reward: Reward = "views"
    """What is paid: "views", the thesis' discoveries and new sides, or "evidence", labels that may be expected to be
    right (see the environment)."""
    labels: bool = False
    """Make labels of the first views, too, and score them; takes many times as long."""
    label_views: tuple[int, ...] = VIEW_COUNTS
    """With --labels: how many of the first views labels are made of."""
    size: PictureHeight | None = None
    """Height of the pictures that labels are made on, pixels; their shape is the world's. By default 256, as in the
    thesis."""
    pictures: NonNegative[int] = 0
    """Draw the ways of all policies from above in so many episodes, into OUT/pictures."""
    workers: Count = 1
    """Processes side by side; each computes in one thread, so that their number changes no result."""
    where: tyro.conf.OmitArgPrefixes[ClusterConfig] = field(default_factory=ClusterConfig)
    out: Path = Path("out/evaluation")
    """Folder for the results; made if it does not exist."""
