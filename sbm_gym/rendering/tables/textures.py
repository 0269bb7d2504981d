"""The textures of a model as mip pyramids in one flat array that kernels can index."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8
from numba import njit

from sbm_gym.rendering.tables.looks import Picture

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


def lay_out_textures(pictures: Sequence[Picture]) -> TextureStore:
    """Places of textures and their mip levels in one array of texels, which ``fill_textures`` fills.

    Textures with a channel count that is not a picture's (1 to 4) are a single white texel.
    """
    layouts = [_layout(picture) for picture in pictures] or [(1, [(1, 1)])]
    count, most_levels = len(layouts), max(len(sizes) for _, sizes in layouts)
    level_start = np.zeros((count, most_levels), np.int64)
    level_size = np.ones((count, most_levels, 2), np.int64)
    filled = 0
    for texture, (faces, sizes) in enumerate(layouts):
        for level, (width, height) in enumerate(sizes):
            level_start[texture, level] = filled
            level_size[texture, level] = width, height
            filled += faces * width * height
    has_holes = np.zeros(count, np.int64)
    has_holes[: len(pictures)] = [has_holes_in(picture) for picture in pictures]
    return TextureStore(
        texels=np.empty((filled, 4), np.uint8),
        level_start=level_start,
        level_size=level_size,
        level_count=np.array([len(sizes) for _, sizes in layouts], np.int64),
        is_cube=np.array([faces == CUBE_FACES for faces, _ in layouts], np.int64),
        has_holes=has_holes,
    )


def fill_textures(pictures: Sequence[Picture], store: TextureStore) -> None:
    """Fills the texels of what ``lay_out_textures`` made of the same pictures."""
    if len(pictures) == 0:
        store.texels[:] = 255
    for texture, picture in enumerate(pictures):
        faces = CUBE_FACES if store.is_cube[texture] else 1
        levels = []
        for level in range(int(store.level_count[texture])):
            start, (width, height) = int(store.level_start[texture, level]), store.level_size[texture, level].tolist()
            texels = store.texels[start : start + faces * width * height]
            levels.append(texels.reshape(faces, height, width, 4))
        _read_picture(picture, levels[0])
        _fill_pyramid(levels)


def has_holes_in(picture: Picture) -> bool:
    """Whether some texels of a texture are more transparent than opaque."""
    return picture.texels.shape[2] in (2, 4) and bool(picture.texels[..., -1].min(initial=255) < 128)


def _layout(picture: Picture) -> tuple[int, list[tuple[int, int]]]:
    """How many faces a texture has, and width and height of each level, halved until one texel is left."""
    height, width, channels = picture.texels.shape
    if not 1 <= channels <= 4:
        return 1, [(1, 1)]
    sizes = [(width, width if picture.is_cube else height)]
    while max(sizes[-1]) > 1:
        sizes.append((max(sizes[-1][0] // 2, 1), max(sizes[-1][1] // 2, 1)))
    return CUBE_FACES if picture.is_cube else 1, sizes


def _read_picture(picture: Picture, faces: UInt8[np.ndarray, "faces h w 4"]) -> None:
    """Copies a texture into ``faces``; a cube with one picture for all its faces gets six of it."""
    import cv2

    height, width, channels = picture.texels.shape
    if not 1 <= channels <= 4:
        faces[:] = 255
        return
    data = picture.texels.reshape(-1, channels)
    texels = faces.reshape(-1, 4)[: len(data)]
    if channels == 3:
        # In one pass, where numpy would need one for each channel.
        cv2.cvtColor(data[None], cv2.COLOR_RGB2RGBA, dst=texels[None])
    elif channels == 4:
        texels[:] = data
    else:
        texels[:, :3], texels[:, 3] = data[:, :1], data[:, 1] if channels == 2 else 255
    if picture.is_linear:
        texels[:, :3] = np.rint(255.0 * srgb_encode(texels[:, :3] / 255.0))
    if len(faces) == CUBE_FACES and height == width:
        faces[1:] = faces[0]


def _fill_pyramid(levels: list[UInt8[np.ndarray, "faces h w 4"]]) -> None:
    """Fills all levels from the first: box filter in linear light, colours weighted by their alpha."""
    import cv2

    weighted = np.empty(levels[0].shape, np.float32)
    _weigh(levels[0].reshape(-1, 4), weighted.reshape(-1, 4))
    for level in levels[1:]:
        height, width = level.shape[1:3]
        weighted = np.stack(
            [
                cv2.resize(face, (width, height), interpolation=cv2.INTER_AREA).reshape(height, width, 4)
                for face in weighted
            ]
        )
        _unweigh(weighted.reshape(-1, 4), level.reshape(-1, 4))


@njit(cache=True, nogil=True)
def _weigh(texels, weighted):
    """Linear light times alpha: transparent texels often hold any colour, which must not bleed into edges of leaves."""
    for n in range(len(texels)):
        alpha = np.float32(texels[n, 3]) / np.float32(255.0)
        for channel in range(3):
            weighted[n, channel] = BYTE_TO_LINEAR[texels[n, channel]] * alpha
        weighted[n, 3] = alpha


@njit(cache=True, nogil=True)
def _unweigh(weighted, texels):
    """Texels of what ``_weigh`` made, after filtering."""
    zero, one, steps = np.float32(0.0), np.float32(1.0), np.float32(LINEAR_STEPS)
    for n in range(len(texels)):
        alpha = weighted[n, 3]
        for channel in range(3):
            linear = weighted[n, channel] / max(alpha, np.float32(1e-6))
            texels[n, channel] = LINEAR_TO_BYTE[int(np.rint(min(max(linear, zero), one) * steps))]
        texels[n, 3] = np.uint8(np.rint(min(max(alpha, zero), one) * np.float32(255.0)))
