"""Compiled look-ups in textures: mip-mapped, wrapped or on the faces of a cube."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from sbm_gym.rendering.tables.scene_tables import GeomTable, TriangleTable
from sbm_gym.rendering.tables.textures import BYTE_TO_LINEAR

BYTE_TO_SHARE = (np.arange(256) / 255.0).astype(np.float32)
HOLE_ALPHA = 0.5
"""Texels more transparent than this are holes."""


class TextureTable(NamedTuple):
    """The arrays of a ``TextureStore``."""

    texels: np.ndarray
    level_start: np.ndarray
    level_size: np.ndarray
    level_count: np.ndarray
    is_cube: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _cube_face(x, y, z):
    """Face and place on it of a direction. Source: OpenGL 4.6 specification, table 8.19."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face = 0 if x >= 0 else 1
        s, t, major = (-z if x >= 0 else z), -y, ax
    elif ay >= az:
        face = 2 if y >= 0 else 3
        s, t, major = x, (z if y >= 0 else -z), ay
    else:
        face = 4 if z >= 0 else 5
        s, t, major = (x if z >= 0 else -x), -y, az
    major = max(major, 1e-12)
    return face, 0.5 * (s / major + 1.0), 0.5 * (t / major + 1.0)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _bilinear(texels, first, width, height, u, v, wraps):
    if wraps:
        # Into the first tile, so that at most one texel beyond its edges has to be wrapped: division is slow.
        u, v = u - math.floor(u), v - math.floor(v)
    x, y = u * width - 0.5, v * height - 0.5
    fx, fy = math.floor(x), math.floor(y)
    wx, wy = x - fx, y - fy
    x0, y0 = int(fx), int(fy)
    x1, y1 = x0 + 1, y0 + 1
    if wraps:
        x0 = width - 1 if x0 < 0 else (0 if x0 >= width else x0)
        y0 = height - 1 if y0 < 0 else (0 if y0 >= height else y0)
        x1 = 0 if x1 >= width else x1
        y1 = 0 if y1 >= height else y1
    else:
        x0, x1 = min(max(x0, 0), width - 1), min(max(x1, 0), width - 1)
        y0, y1 = min(max(y0, 0), height - 1), min(max(y1, 0), height - 1)
    upper, lower = first + y0 * width, first + y1 * width
    # Unsigned, or every index is asked whether it is negative.
    a, b = np.uint64(upper + x0), np.uint64(upper + x1)
    c, d = np.uint64(lower + x0), np.uint64(lower + x1)
    return (
        _between(BYTE_TO_LINEAR, texels, 0, a, b, c, d, wx, wy),
        _between(BYTE_TO_LINEAR, texels, 1, a, b, c, d, wx, wy),
        _between(BYTE_TO_LINEAR, texels, 2, a, b, c, d, wx, wy),
        _between(BYTE_TO_SHARE, texels, 3, a, b, c, d, wx, wy),
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _between(decode, texels, channel, a, b, c, d, x, y):
    """Bilinear mean of a channel of four texels."""
    low, high = decode[texels[a, channel]], decode[texels[c, channel]]
    low += x * (decode[texels[b, channel]] - low)
    high += x * (decode[texels[d, channel]] - high)
    return low + y * (high - low)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def sample(texels, level_start, level_size, level_count, is_cube, texture, u, v, w, level):
    """Trilinear texture look-up, linear light and alpha. The arrays are those of a ``TextureTable``: handed over one by
    one they cost no reference counting.
    """
    face = 0
    if is_cube[texture] != 0:
        face, u, v = _cube_face(u, v, w)
    last = level_count[texture] - 1
    level = min(max(level, 0.0), float(last))
    low = min(int(level), last)
    fraction = level - low
    width, height = level_size[texture, low, 0], level_size[texture, low, 1]
    first = level_start[texture, low] + face * width * height
    wraps = is_cube[texture] == 0
    red, green, blue, alpha = _bilinear(texels, first, width, height, u, v, wraps)
    if fraction > 0.0:
        width, height = level_size[texture, low + 1, 0], level_size[texture, low + 1, 1]
        first = level_start[texture, low + 1] + face * width * height
        r, g, b, a = _bilinear(texels, first, width, height, u, v, wraps)
        red += fraction * (r - red)
        green += fraction * (g - green)
        blue += fraction * (b - blue)
        alpha += fraction * (a - alpha)
    return red, green, blue, alpha


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def texture_level(log2_texels_per_m, t, footprint, cosine):
    """Mip level for a sample that covers ``footprint`` metres per metre of depth ``t``; 0 asks for full detail."""
    if footprint <= 0.0:
        return 0.0
    # A slanted surface stretches the footprint by 1/cos along one axis only: the geometric mean of both.
    return log2_texels_per_m + math.log2(t * footprint / math.sqrt(max(cosine, 0.02)))


@njit(cache=True, nogil=True, error_model="numpy")
def hole_test(
    start,
    stop,
    rays,
    t,
    triangle,
    uv,
    triangles: TriangleTable,
    geoms: GeomTable,
    textures: TextureTable,
    footprint,
    is_hole,
):
    """Whether hits on textures with transparent parts fall through."""
    texels, level_start, level_size, level_count, is_cube = textures
    normals, c, log2_density = triangles.face_normals, triangles.texture_coordinates, triangles.log2_texels_per_m
    for i in range(start, stop):
        at, u, v = triangle[i], uv[i, 0], uv[i, 1]
        w = 1.0 - u - v
        dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
        facing = dx * normals[at, 0] + dy * normals[at, 1] + dz * normals[at, 2]
        cosine = abs(facing) / math.sqrt(dx * dx + dy * dy + dz * dz)
        level = texture_level(log2_density[at], t[i], footprint, cosine)
        s = w * c[at, 0, 0] + u * c[at, 1, 0] + v * c[at, 2, 0]
        r = w * c[at, 0, 1] + u * c[at, 1, 1] + v * c[at, 2, 1]
        q = w * c[at, 0, 2] + u * c[at, 1, 2] + v * c[at, 2, 2]
        texture = geoms.texture[triangles.geom[at]]
        texel = sample(texels, level_start, level_size, level_count, is_cube, texture, s, r, q, level)
        is_hole[i] = texel[3] < HOLE_ALPHA
