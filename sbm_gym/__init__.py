"""MuJoCo worlds and the Gymnasium environment in which an agent moves to see better.

Importing this package registers the environments with Gymnasium; nothing heavy is loaded until one is made.

>>> import gymnasium, sbm_gym
>>> env = gymnasium.make("sbm_gym/IndoorBuiltin-v0", reward_weights=sbm_gym.RewardWeights(collision=0.5))
>>> env.action_space
Box(-1.0, 1.0, (4,), float32)

What users import comes from here; paths inside the package may change.
"""

import lazy_loader

from labeling.runtime.start_up import expect_interrupts
from sbm_gym.registration import register_envs

expect_interrupts()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # what __init__.pyi lists

register_envs()
