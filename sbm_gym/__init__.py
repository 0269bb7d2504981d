"""MuJoCo worlds and the Gymnasium environment in which an agent moves to see better.

Importing this package registers the environments with Gymnasium; nothing heavy is loaded until one is made.

>>> import gymnasium, sbm_gym
>>> env = gymnasium.make("sbm_gym/IndoorBuiltin-v0", reward_weights=sbm_gym.RewardWeights(collision=0.5))
>>> env.action_space
Box(-1.0, 1.0, (4,), float32)

What users import comes from here; paths inside the package may change.
"""

from typing import TYPE_CHECKING, Any

from sbm_gym.registration import ENV_IDS, register_envs, register_world

if TYPE_CHECKING:
    from sbm_gym.detection.simulated import SimulatedDetectorConfig
    from sbm_gym.env.fixation_env import FixationEnv
    from sbm_gym.env.rewards import RewardWeights
    from sbm_gym.robot.body import BodyConfig
    from sbm_gym.robot.knowledge import RobotKnowledge
    from sbm_gym.robot.object_memory import MemoryConfig
    from sbm_gym.scenes.compiled import WorldSource
    from sbm_gym.scenes.profiles import INDOOR, OUTDOOR, WorldProfile
    from sbm_gym.worlds.rooms.indoor import build_room
    from sbm_gym.worlds.world import World

_MODULES = {
    "BodyConfig": "robot.body",
    "FixationEnv": "env.fixation_env",
    "INDOOR": "scenes.profiles",
    "MemoryConfig": "robot.object_memory",
    "OUTDOOR": "scenes.profiles",
    "RewardWeights": "env.rewards",
    "RobotKnowledge": "robot.knowledge",
    "SimulatedDetectorConfig": "detection.simulated",
    "World": "worlds.world",
    "WorldProfile": "scenes.profiles",
    "WorldSource": "scenes.compiled",
    "build_room": "worlds.rooms.indoor",
}
"""Where names that are loaded when first asked for come from."""

__all__ = [
    "ENV_IDS",
    "INDOOR",
    "OUTDOOR",
    "BodyConfig",
    "FixationEnv",
    "MemoryConfig",
    "RewardWeights",
    "RobotKnowledge",
    "SimulatedDetectorConfig",
    "World",
    "WorldProfile",
    "WorldSource",
    "build_room",
    "register_envs",
    "register_world",
]

register_envs()


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
