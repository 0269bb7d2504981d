"""The plain sky behind worlds that bring none."""

import numpy as np
from jaxtyping import Float, Float32, UInt8

from sbm_gym.rendering.tables.lights import SKY
from sbm_gym.rendering.tables.textures import BYTE_TO_LINEAR, LINEAR_STEPS, LINEAR_TO_BYTE, srgb_encode


def sky_colour(directions: Float[np.ndarray, "n 3"], sky: Float[np.ndarray, "3 3"] = SKY) -> UInt8[np.ndarray, "n 3"]:
    """Colour of the sky in these directions, as ``rays`` draws it at full exposure.

    Args:
        directions: in the world; any length.
        sky: linear colours of zenith, horizon and ground.
    """
    up = directions[:, 2:] / np.linalg.norm(directions, axis=1, keepdims=True)
    weight = np.where(up > 0.0, np.sqrt(np.maximum(up, 0.0)), np.minimum(-4.0 * up, 1.0))
    other = np.where(up > 0.0, sky[0], sky[2])
    return np.rint(255.0 * srgb_encode(sky[1] + weight * (other - sky[1]))).astype(np.uint8)


def add_haze(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth_m: Float32[np.ndarray, "h w"],
    intrinsics: Float[np.ndarray, "3 3"],
    sky: Float[np.ndarray, "3 3"],
    haze_per_m: float,
) -> UInt8[np.ndarray, "h w 3"]:
    """Lets haze, which has the horizon's colour, replace some of what is far away, as ``rays`` does it.

    Args:
        rgb: the picture.
        depth_m: z-depth, 0 where there is only sky.
        intrinsics: K.
        sky: linear colours of zenith, horizon and ground.
        haze_per_m: share of what is seen that haze replaces in each metre.
    """
    rows, columns = np.indices(depth_m.shape)
    right = (columns - intrinsics[0, 2]) / intrinsics[0, 0]
    down = (rows - intrinsics[1, 2]) / intrinsics[1, 1]
    away = depth_m * np.sqrt(1.0 + right**2 + down**2)
    through = np.exp(-haze_per_m * away)[..., None].astype(np.float32)
    linear = BYTE_TO_LINEAR[rgb] * through + (1.0 - through) * sky[1].astype(np.float32)
    return LINEAR_TO_BYTE[np.rint(np.clip(linear, 0.0, 1.0) * LINEAR_STEPS).astype(np.int32)]
