"""What an agent could learn in some episodes, as a digest."""

import hashlib
import sys
from dataclasses import fields, is_dataclass

import gymnasium as gym
import numpy as np

from .box_rooms import BoxRooms


def digest(value, found=None) -> str:
    """Of all numbers in nested observations, infos, captures."""
    found = found or hashlib.sha256()
    if isinstance(value, dict):
        for name in sorted(value, key=str):
            found.update(str(name).encode())
            digest(value[name], found)
    elif isinstance(value, list | tuple):
        for part in value:
            digest(part, found)
    elif isinstance(value, np.ndarray):
        found.update(str(value.dtype).encode() + value.tobytes())
    elif is_dataclass(value):
        for field in fields(value):
            digest(getattr(value, field.name), found)
    else:
        found.update(repr(value).encode())
    return found.hexdigest()


def rollout(env_id: str, scene: str, episodes: int = 2, steps: int = 5) -> str:
    """A digest of observations, rewards, infos and captures."""
    everything = []
    with gym.make(f"sbm_gym:{env_id}") as env:
        env.action_space.seed(0)
        for seed in range(episodes):
            everything.append(env.reset(seed=seed, options={"scene": scene}))
            everything += [env.step(env.action_space.sample()) for _ in range(steps)]
            everything.append(env.get_wrapper_attr("capture")(64, 64))
    return digest(everything)


def rollout_digest(seed: int, **kwargs) -> str:
    """Everything that an episode in box rooms, or in the worlds of ``kwargs``, returns, as one hash."""
    digest = hashlib.sha256()
    env = gym.make("sbm_gym:sbm_gym/Indoor-v0", **{"worlds": BoxRooms(), **kwargs})
    observation, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    truncated, reward = False, 0.0
    while not truncated:
        for name in sorted(observation):
            digest.update(observation[name].tobytes())
        digest.update(repr((reward, info["reward_terms"], info["collided"], info["scene"])).encode())
        for detection in info["detections"]:
            digest.update(repr((detection.category, detection.confidence)).encode() + detection.mask.tobytes())
        observation, reward, _, truncated, info = env.step(env.action_space.sample())
    return digest.hexdigest()


if __name__ == "__main__":
    print(rollout(sys.argv[1], sys.argv[2]))
