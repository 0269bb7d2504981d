"""What the policy's network makes of an observation: a small picture encoder beside a state encoder, then both as one.

Most of what decides the next step is in the state vector, and every epoch of PPO passes over every picture again, so
the picture encoder is made to cost less than the step that drew the picture: pictures are averaged over blocks before
the first convolution.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from jaxtyping import Float
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

CHANNELS = {"rgb": 3, "depth": 1}
PICTURES = tuple(CHANNELS)


class LookFeatures(BaseFeaturesExtractor):
    """Features of the observations of ``FixationEnv``."""

    def __init__(
        self,
        observation_space: spaces.Dict,
        features: int = 128,
        pictures: Sequence[str] = PICTURES,
        picture_features: int = 64,
        channels: Sequence[int] = (16, 32),
        block_px: int = 4,
    ) -> None:
        """Makes an extractor with random weights.

        Args:
            observation_space: ``state`` (n) and, where they are looked at, ``rgb`` (3 h w) and ``depth`` (1 h w), both
                uint8 and channels first as Stable-Baselines3 hands them on.
            features: how many features come out; the state encoder is as wide.
            pictures: which of ``rgb`` and ``depth`` are looked at; none of them leaves the state vector alone.
            picture_features: how many of what goes into the last layer are of the pictures.
            channels: of the convolutions, each 3x3 with a stride of 2.
            block_px: edge length of the blocks that pictures are averaged over.

        Raises:
            ValueError: if the observation space is of another kind, or there is no such picture.
        """
        unknown = [name for name in pictures if name not in PICTURES]
        if unknown:
            raise ValueError(f"pictures may be {' and '.join(PICTURES)}, not {unknown[0]!r}")
        _check(observation_space, pictures)
        super().__init__(observation_space, features)
        self.block_px = block_px
        self.looks_at = tuple(pictures)
        """The pictures that it looks at."""
        if pictures:
            height_px, width_px = observation_space[pictures[0]].shape[1:]  # type: ignore[index]
            depths = sum(observation_space[name].shape[0] for name in pictures)  # type: ignore[index]
            size = (height_px // block_px, width_px // block_px)
            self.pictures = _picture_encoder(depths, *size, channels, picture_features)
        self.state = nn.Sequential(nn.Linear(observation_space["state"].shape[0], features), nn.Tanh())  # type: ignore[index]
        self.fusion = nn.Sequential(nn.Linear(features + picture_features * bool(pictures), features), nn.Tanh())

    def forward(self, observations: dict[str, torch.Tensor]) -> Float[torch.Tensor, "b features"]:
        """Features of a batch.

        Args:
            observations: ``rgb`` and ``depth`` from 0 to 1 (Stable-Baselines3 divides by 255), and ``state``.
        """
        encoded = self.state(observations["state"])
        if self.looks_at:
            seen = [nearness(observations[name]) if name == "depth" else observations[name] for name in self.looks_at]
            blocks = nn.functional.avg_pool2d(torch.cat(seen, dim=1), self.block_px)
            encoded = torch.cat([encoded, self.pictures(blocks)], dim=1)
        return self.fusion(encoded)


def nearness(depth: Float[torch.Tensor, "b 1 h w"]) -> Float[torch.Tensor, "b 1 h w"]:
    """1 at the camera, 0 where depth ends and where there is no return, so that averages over blocks make sense.

    Args:
        depth: encoded depth divided by 255; 0 = no return.
    """
    return torch.where(depth > 0.0, 1.0 - depth, torch.zeros_like(depth))


def _picture_encoder(before: int, height: int, width: int, channels: Sequence[int], features: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for after in channels:
        layers += [nn.Conv2d(before, after, 3, stride=2), nn.ReLU()]
        before, height, width = after, (height - 1) // 2, (width - 1) // 2
    if min(height, width) < 1:
        raise ValueError(f"pictures are too small for {len(channels)} convolutions; take smaller blocks or fewer")
    return nn.Sequential(*layers, nn.Flatten(), nn.Linear(before * height * width, features), nn.ReLU())


def _check(space: spaces.Space, pictures: Sequence[str]) -> None:
    parts: dict[str, Any] = space.spaces if isinstance(space, spaces.Dict) else {}
    fits = {*pictures, "state"} <= set(parts) <= {*PICTURES, "state"}
    fits = fits and all(isinstance(part, spaces.Box) for part in parts.values())
    fits = fits and len(parts["state"].shape) == 1
    for name in pictures if fits else ():
        shape = parts[name].shape
        fits = fits and parts[name].dtype == np.uint8 and len(shape) == 3 and shape[0] == CHANNELS[name]
        fits = fits and shape[1:] == parts[pictures[0]].shape[1:]
    if not fits:
        wanted = f"a Dict of {', '.join((*pictures, 'state'))}: pictures 3 x h x w and 1 x h x w of uint8, and a vector"
        raise ValueError(f"observations must be {wanted}; not {space}")
