"""Policies that move a robot to see better: recorded, trained with PPO, and compared.

>>> import gymnasium, numpy as np, sbm_gym
>>> from agents import make_policy, rollout
>>> env = gymnasium.make("sbm_gym/IndoorBuiltin-v0", colours=False)
>>> observation, info = env.reset(seed=1)
>>> steps = list(rollout(env, make_policy("ring"), observation, info, np.random.default_rng(0)))
>>> len(steps), bool(sum(step.reward for step in steps) > 0.0)
(25, True)

What users import comes from here; paths inside the package may change.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.evaluation.evaluate_config import EvaluateConfig
    from agents.evaluation.run import evaluate_policies
    from agents.policies.base import Policy, RobotPolicy
    from agents.policies.registry import make_policy
    from agents.ppo.config import PpoConfig
    from agents.ppo.training import train_ppo
    from agents.rollouts.collect_config import CollectConfig
    from agents.rollouts.recorder import collect_episodes, record_episode
    from agents.rollouts.rollout import Transition, rollout

_MODULES = {
    "CollectConfig": "rollouts.collect_config",
    "EvaluateConfig": "evaluation.evaluate_config",
    "Policy": "policies.base",
    "PpoConfig": "ppo.config",
    "RobotPolicy": "policies.base",
    "Transition": "rollouts.rollout",
    "collect_episodes": "rollouts.recorder",
    "evaluate_policies": "evaluation.run",
    "make_policy": "policies.registry",
    "record_episode": "rollouts.recorder",
    "rollout": "rollouts.rollout",
    "train_ppo": "ppo.training",
}
"""Where the names come from that are loaded when they are first asked for."""

__all__ = [
    "CollectConfig",
    "EvaluateConfig",
    "Policy",
    "PpoConfig",
    "RobotPolicy",
    "Transition",
    "collect_episodes",
    "evaluate_policies",
    "make_policy",
    "record_episode",
    "rollout",
    "train_ppo",
]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
