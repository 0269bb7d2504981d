"""Moves a robot by the keyboard: ``python -m agents.play --env ENV --seed S``."""

import sys
from dataclasses import dataclass
from typing import Any, Literal

from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp
from labeling.runtime.ranges import Positive, Seed, Settings


@dataclass(frozen=True)
class PlayConfig(Settings):
    """Opens a window on a robot that you move: see what an episode, its reward and its detector are like.

    Keys: w and s one stride forward and back, a and d to the left and right, q and e look left and right, r and f up
    and down; several at once. The robot waits for keys. Escape or closing the window ends it. Needs a screen and the
    extra ``play``.
    """

    env: str = "sbm_gym/IndoorBuiltin-v0"
    """The environment."""
    split: str = "train"
    """Its scenes: train, val, test, wide or endless."""
    detector: str = "simulated"
    """The robot's detector, as ``agents.collect`` takes it."""
    view: Literal["eyes", "above"] = "eyes"
    """What the window shows: what the robot sees, or the robot from above with what it has found."""
    moving: int = 0
    """So many things move at the same time, at most."""
    zoom: Positive[float] = 2.0
    """A factor of the size of the pictures."""
    seed: Seed = 0
    """Of scene, start and detector."""


def run(config: PlayConfig) -> None:
    """Plays until the window is closed.

    Raises:
        SbmError: if there is no such environment, no pygame or no screen.
    """
    from agents.rollouts.keyboard import KEYS, play
    from sbm_gym.named_env import make_env

    config.check()
    mode = "rgb_array" if config.view == "eyes" else "third_person"
    env = make_env(config.env, config.split, config.detector, render_mode=mode, moving=config.moving)
    print(f"keys: {KEYS}")
    try:
        play(env, config.seed, config.zoom, _report)
    finally:
        env.close()


def _report(step: int, reward: float, info: dict[str, Any]) -> None:
    terms = ", ".join(f"{name} {value:+.2f}" for name, value in info["reward_terms"].items() if value)
    print(f"step {step}: reward {reward:+.2f}" + (f" ({terms})" if terms else ""), flush=True)


HELP = CommandHelp(
    groups={"common options": ("env", "view", "seed")},
    examples=(
        ("", "a room furnished at random"),
        ("--env sbm_gym/OutdoorBuiltin-v0 --view above --moving 6", "streets with traffic, from above"),
    ),
)
main = make_main("agents.play", PlayConfig, run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
