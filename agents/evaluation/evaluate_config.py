"""Settings of an evaluation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from labeling.runtime.ranges import Count, NonNegative, PictureHeight


@dataclass(frozen=True)
class EvaluateConfig:
    """Lets policies look around from the same starts and compares what they earn and the labels they bring home.

    Prints tables and writes OUT/evaluation.json and OUT/evaluation.png. Every episode's result is kept in OUT: killed
    and started again, it goes on where it was, and more episodes, seeds or policies can be added later. Delete OUT
    after a change of the program.
    """

    policies: tuple[str, ...] = ("ring", "spin", "random", "frontier", "next_best_view")
    """Who is compared: "ring", "spin", "random", "frontier", "next_best_view", "ppo" (the trained policy that comes
    with the project), "ppo:CHECKPOINT". Differences are to the first one."""
    env: str = "sbm_gym/Indoor-v0"
    """Gymnasium id of the world."""
    split: Literal["train", "val", "test", "wide"] = "val"
    """Scenes. Test scenes are for final figures only."""
    episodes: Count = 50
    """Episodes of each policy and seed."""
    seeds: Count = 3
    """Seeds 0, 1, ...: each draws starts of its own. Spread is over seeds."""
    detector: str = "simulated"
    """The detector in the loop."""
    labels: bool = True
    """Make labels of the first 5, 10, 12, 15, 20 and 25 views and score them. Without, it is many times faster."""
    size: PictureHeight | None = None
    """Height of the pictures that labels are made on, pixels; their shape is the world's. By default 256, as in the
    thesis."""
    pictures: NonNegative[int] = 0
    """Draw the ways of all policies from above in so many episodes, into OUT/pictures."""
    workers: Count = 1
    """Processes side by side, one thread each if there are several."""
    out: Path = Path("out/evaluation")
    """Folder for the results; made if it does not exist."""
