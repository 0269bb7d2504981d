"""An environment with observations and ``info`` like the real one's, and a trivial task: say what the state says."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

ENV_ID = "toy/Echo-v0"
STATE = 5


class Echo(gym.Env):
    """Pays most for an action whose first number is that of the state."""

    def __init__(self, split: str | None = "train", size: int = 16, **settings: Any) -> None:
        self.split, self.settings = split, settings
        self.observation_space = spaces.Dict(
            {
                "rgb": spaces.Box(0, 255, (size, size, 3), np.uint8),
                "depth": spaces.Box(0, 255, (size, size, 1), np.uint8),
                "state": spaces.Box(-1.0, 1.0, (STATE,), np.float32),
            }
        )
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        return self._observe(), self._info(0.0)

    def step(self, action):
        reward = 1.0 - abs(float(action[0]) - float(self._observation["state"][0]))
        return self._observe(), reward, False, False, self._info(reward)

    def _observe(self):
        self._observation = {
            name: self.np_random.integers(0, 256, part.shape, np.uint8)
            if part.dtype == np.uint8
            else self.np_random.uniform(-1, 1, part.shape).astype(np.float32)
            for name, part in self.observation_space.spaces.items()
        }
        return self._observation

    def _info(self, reward: float) -> dict[str, Any]:
        return {
            "reward_terms": {"discovery": reward, "diversity": 0.0},
            "collided": reward < 0.5,
            "is_success": reward > 0.9,
            "coverage": 0.5,
            "confirmed_objects": [{}] * int(reward > 0.9),
            "path_length_m": 1.0,
            "detections": [object()],
        }


if ENV_ID not in gym.registry:
    gym.register(ENV_ID, entry_point=Echo, max_episode_steps=10)  # type: ignore[arg-type]
    gym.register("toy/Large-v0", entry_point=Echo, max_episode_steps=10, kwargs={"size": 24})  # type: ignore[arg-type]
