"""The textures of a model as mip pyramids in one flat array that kernels can index."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

CUBE_FACES = 6


def srgb_decode(encoded: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Linear light of sRGB values in [0, 1]. Source: IEC 61966-2-1."""
    encoded = np.asarray(encoded, float)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4)


def srgb_encode(linear: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Encoded (sRGB) values of linear light in [0, 1]. Source: IEC 61966-2-1."""
    linear = np.clip(np.asarray(linear, float), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


BYTE_TO_LINEAR: Float32[np.ndarray, "256"] = srgb_decode(np.arange(256) / 255.0).astype(np.float32)
"""Linear light of each sRGB byte."""
LINEAR_STEPS = 1 << 14
LINEAR_TO_BYTE: UInt8[np.ndarray, "16385"] = np.rint(
    255.0 * srgb_encode(np.arange(LINEAR_STEPS + 1) / LINEAR_STEPS)
).astype(np.uint8)
"""sRGB byte of linear light in steps of 1/16384: fine enough that neighbouring dark bytes all occur."""


@dataclass(frozen=True)
class TextureStore:
    """All textures of a model, sRGB bytes with alpha, every mip level of every face."""

    texels: UInt8[np.ndarray, "n 4"]
    level_start: Int[np.ndarray, "textures levels"]
    """Index of the first texel of each level (of its first face)."""
    level_size: Int[np.ndarray, "textures levels 2"]
    """Width and height of each level."""
    level_count: Int[np.ndarray, "textures"]
    is_cube: Int[np.ndarray, "textures"]
    has_holes: Int[np.ndarray, "textures"]
    """Whether some texels are transparent."""


def build_texture_store(model: mujoco.MjModel) -> TextureStore:
    """Reads the textures of a model and filters them down, in linear light, to one texel.

    Textures with a channel count that is not a picture's (1 to 4) become a single white texel.
    """
    pyramids = [_pyramid(_faces(model, texture)) for texture in range(model.ntex)]
    most_levels = max((len(levels) for levels in pyramids), default=1)
    count = max(model.ntex, 1)
    level_start = np.zeros((count, most_levels), np.int64)
    level_size = np.ones((count, most_levels, 2), np.int64)
    level_count = np.ones(count, np.int64)
    is_cube, has_holes = np.zeros(count, np.int64), np.zeros(count, np.int64)
    has_holes[: model.ntex] = textures_with_holes(model)
    chunks, filled = [], 0
    for texture, levels in enumerate(pyramids):
        is_cube[texture] = len(levels[0]) == CUBE_FACES
        level_count[texture] = len(levels)
        for level, faces in enumerate(levels):
            level_start[texture, level] = filled
            level_size[texture, level] = faces.shape[2], faces.shape[1]
            chunks.append(faces.reshape(-1, 4))
            filled += len(chunks[-1])
    texels = np.concatenate(chunks) if chunks else np.full((1, 4), 255, np.uint8)
    return TextureStore(texels, level_start, level_size, level_count, is_cube, has_holes)


def textures_with_holes(model: mujoco.MjModel) -> list[bool]:
    """Whether some texels of each texture are more transparent than opaque."""
    found = []
    for texture in range(model.ntex):
        channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        texels = int(model.tex_width[texture]) * int(model.tex_height[texture])
        alpha = model.tex_data[start : start + texels * channels][channels - 1 :: channels]
        found.append(channels in (2, 4) and bool(np.asarray(alpha).min(initial=255) < 128))
    return found


def _faces(model: mujoco.MjModel, texture: int) -> UInt8[np.ndarray, "faces h w 4"]:
    width, height = int(model.tex_width[texture]), int(model.tex_height[texture])
    channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
    if not 1 <= channels <= 4:
        return np.full((1, 1, 1, 4), 255, np.uint8)
    data = np.asarray(model.tex_data[start : start + width * height * channels], np.uint8)
    data = data.reshape(height, width, channels)
    picture = np.full((height, width, 4), 255, np.uint8)
    picture[..., :3] = data[..., :3] if channels >= 3 else data[..., :1]
    if channels in (2, 4):
        picture[..., 3] = data[..., -1]
    if model.tex_colorspace[texture] == mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR:
        picture[..., :3] = np.rint(255.0 * srgb_encode(picture[..., :3] / 255.0))
    if model.tex_type[texture] == mujoco.mjtTexture.mjTEXTURE_2D:
        return picture[None]
    if height == width:
        return np.broadcast_to(picture, (CUBE_FACES, *picture.shape)).copy()
    return picture.reshape(CUBE_FACES, width, width, 4)


def _pyramid(faces: UInt8[np.ndarray, "faces h w 4"]) -> list[UInt8[np.ndarray, "faces h w 4"]]:
    """Halves a picture until one texel is left: box filter in linear light, colours weighted by their alpha."""
    import cv2

    levels = [faces]
    alpha = faces[..., 3:].astype(np.float32) / 255.0
    # Transparent texels often hold arbitrary colours, which must not bleed into the edges of leaves.
    weighted = np.concatenate([BYTE_TO_LINEAR[faces[..., :3]] * alpha, alpha], axis=-1)
    while max(weighted.shape[1:3]) > 1:
        size = (max(weighted.shape[2] // 2, 1), max(weighted.shape[1] // 2, 1))
        weighted = np.stack(
            [cv2.resize(face, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], 4) for face in weighted]
        )
        alpha = weighted[..., 3:]
        linear = weighted[..., :3] / np.maximum(alpha, 1e-6)
        steps = np.rint(np.clip(linear, 0.0, 1.0) * LINEAR_STEPS).astype(np.int64)
        opacity = np.rint(np.clip(alpha, 0.0, 1.0) * 255.0).astype(np.uint8)
        levels.append(np.concatenate([LINEAR_TO_BYTE[steps], opacity], axis=-1))
    return levels
