"""The reward of looking: terms by name, pure functions of what the agent's own senses have learned in a step."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from sbm_gym.robot.object_beliefs import BeliefUpdate
    from sbm_gym.robot.object_memory import MemoryUpdate

Reward = Literal["views", "evidence"]
"""What is paid for: confirmed objects and new views of them, as in the thesis, or labels that may be expected to be
right."""
REWARDS: tuple[Reward, ...] = get_args(Reward)


@dataclass(frozen=True)
class RewardWeights:
    """What each event is worth; 0 switches a term off."""

    new_object: float = 1.0
    """For an object confirmed for the first time."""
    better_view: float = 0.5
    """For raising a known object's best confidence from ``confident`` all the way to 1; parts in proportion."""
    new_azimuth: float = 0.25
    """For seeing a confirmed object from a new 20 degree sector; a full circle is worth 4.5 objects."""
    new_range_or_elevation: float = 0.05
    """For a new range or elevation bin within a sector already seen."""
    collision: float = 0.1
    """Taken away for every move that an obstacle cuts short."""
    step: float = 0.0
    """Taken away for every step. Off by default: episodes have a fixed number of views, so it changes no choice."""
    label: float = 0.1
    """With the reward ``evidence``: for each label more that may be expected to be right."""
    found_early: float = 0.5
    """With the reward ``evidence``: for a thing whose chance to be what it is called reaches one half for the first
    time, times the share of the views that are left."""


def reward_terms(update: "MemoryUpdate", collided: bool, weights: RewardWeights) -> dict[str, float]:
    """All terms of one step by name; the reward is their sum, in this order."""
    new_views = weights.new_azimuth * update.num_new_azimuths
    return {
        "discovery": weights.new_object * len(update.new_objects) + weights.better_view * update.confidence_gain,
        "diversity": new_views + weights.new_range_or_elevation * update.num_new_cells,
        "collision": -weights.collision if collided else 0.0,
        "step": -weights.step,
    }


def evidence_terms(
    update: "BeliefUpdate", collided: bool, views_left: float, weights: RewardWeights
) -> dict[str, float]:
    """All terms of one step by name with the reward ``evidence``; the reward is their sum, in this order.

    Args:
        update: what the latest view has added to what the robot knows of things.
        collided: whether an obstacle has cut the move short.
        views_left: share of the episode's views that are to come.
        weights: what each event is worth.
    """
    return {
        "labels": weights.label * update.labels,
        "discovery": weights.found_early * views_left * update.found,
        "collision": -weights.collision if collided else 0.0,
        "step": -weights.step,
    }
