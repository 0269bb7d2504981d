"""MuJoCo worlds and the Gymnasium environment in which an agent moves to see better.

Importing this package registers the environments with Gymnasium; nothing heavy is loaded until one is made.
"""

from sbm_gym.registration import ENV_IDS, register_envs

__all__ = ["ENV_IDS", "register_envs"]

register_envs()
