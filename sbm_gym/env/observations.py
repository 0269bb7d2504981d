"""What a policy gets to see: a small picture, a small depth image, and a vector of what the agent knows."""

import numpy as np
from gymnasium import spaces
from jaxtyping import Float, UInt8

from sbm_gym.env.state_vector import ROOM_SCALES, state_names
from sbm_gym.robot.object_memory import ViewBins


def observation_space(height_px: int, width_px: int, bins: ViewBins) -> spaces.Dict:
    """The observation space of an env with these picture sizes."""
    return spaces.Dict(
        {
            "rgb": spaces.Box(0, 255, (height_px, width_px, 3), np.uint8),
            "depth": spaces.Box(0, 255, (height_px, width_px, 1), np.uint8),
            "state": spaces.Box(-1.0, 1.0, (len(state_names(bins)),), np.float32),
        }
    )


def encode_depth(
    depth_m: Float[np.ndarray, "h w"], level_m: float = ROOM_SCALES.depth_level_m
) -> UInt8[np.ndarray, "h w 1"]:
    """Depth in levels of ``level_m``; a return is never encoded as 0, which stands for none."""
    levels = np.clip(np.rint(depth_m / level_m), 1, 255)
    return np.where(depth_m > 0.0, levels, 0).astype(np.uint8)[..., None]
