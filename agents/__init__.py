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

import lazy_loader

from labeling.runtime.start_up import expect_interrupts

expect_interrupts()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # what __init__.pyi lists
