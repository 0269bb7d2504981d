"""Small rooms as an environment, and hyperparameters for the smallest training on it."""

from pathlib import Path

import gymnasium as gym

from ..sbm_gym.box_rooms import BoxRooms

ENV_ID, SHORT_ENV_ID = "policies_test/Boxes-v0", "policies_test/BoxesShort-v0"
SHORT_STEPS = 5
HYPERPARAMS = f"""{SHORT_ENV_ID}:
  n_timesteps: 10
  n_envs: 1
  n_steps: 10
  batch_size: 5
  n_epochs: 1
  policy_kwargs:
    net_arch: [8]
    features_extractor_kwargs: {{features: 8, picture_features: 4, channels: [4]}}
"""

for env_id, steps in ((ENV_ID, 25), (SHORT_ENV_ID, SHORT_STEPS)):
    if env_id not in gym.registry:
        gym.register(
            env_id,
            entry_point="sbm_gym.env.fixation_env:FixationEnv",
            kwargs={"worlds": BoxRooms()},
            max_episode_steps=steps,
        )


def write_hyperparams(folder: Path) -> Path:
    path = folder / "boxes.yaml"
    path.write_text(HYPERPARAMS)
    return path
