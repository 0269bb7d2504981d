"""The policies that come with the project do what they have learnt: read with the wrong rows, they would do no better
than ``random``.
"""

import gymnasium as gym
import numpy as np
import pytest

from agents.policies.registry import make_policy
from agents.rollouts.rollout import rollout

ENV_ID = "sbm_gym:sbm_gym/IndoorBuiltin-v0"


@pytest.mark.slow
def test_shipped_policies_earn_more_than_twice_as_much_as_random_from_one_start():
    earned = {}
    with gym.make(ENV_ID, colours=False, detector="simulated") as env:
        for name in ("ppo", "ppo_unmapped", "random"):
            observation, info = env.reset(seed=4, options={"scene": "seed/3"})
            policy = make_policy(name, "sbm_gym/IndoorBuiltin-v0")
            steps = rollout(env, policy, observation, info, np.random.default_rng(1))
            earned[name] = sum(step.reward for step in steps)
    assert min(earned["ppo"], earned["ppo_unmapped"]) > 2.0 * earned["random"] > 0.0, earned
