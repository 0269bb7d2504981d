"""The reward of looking: terms by name, pure functions of what the agent's own senses have learned in a step."""

from dataclasses import dataclass

from sbm_gym.robot.object_memory import MemoryUpdate


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


def reward_terms(update: MemoryUpdate, collided: bool, weights: RewardWeights) -> dict[str, float]:
    """All terms of one step by name; the reward is their sum, in this order."""
    new_views = weights.new_azimuth * update.num_new_azimuths
    return {
        "discovery": weights.new_object * len(update.new_objects) + weights.better_view * update.confidence_gain,
        "diversity": new_views + weights.new_range_or_elevation * update.num_new_cells,
        "collision": -weights.collision if collided else 0.0,
        "step": -weights.step,
    }
