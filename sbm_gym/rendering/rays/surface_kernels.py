"""Compiled kernels that tell what rays hit: geom, normal, colour; and the sky where they hit nothing."""

import math

import numpy as np
from numba import njit

from sbm_gym.rendering.tables.light_tables import AmbientTable
from sbm_gym.rendering.tables.scene_tables import GeomTable, TriangleTable
from sbm_gym.rendering.tables.texture_sampling import TextureTable, sample, texture_level


@njit(cache=True, nogil=True, error_model="numpy")
def describe(
    start,
    stop,
    rays,
    t,
    triangle,
    uv,
    triangles: TriangleTable,
    geoms: GeomTable,
    textures: TextureTable,
    ambient: AmbientTable,
    footprint,
    geom,
    normal,
    albedo,
):
    """What each ray hit: its geom, normal and colour.

    Args:
        start: first ray.
        stop: behind the last one.
        rays: (n, 6) float32, as in ``SurfaceTable``.
        t: (n,) float32, likewise.
        triangle: (n,) int64, likewise.
        uv: (n, 2) float32, barycentric coordinates of the hits; on planes metres along the plane's axes.
        triangles: of the scene.
        geoms: of the scene.
        textures: of the scene.
        ambient: for the sky.
        footprint: metres per metre of depth that a ray stands for; 0 takes textures in full detail.
        geom: (n,) int32, -1 for nothing; written.
        normal: (n, 3) float32, unit, on the side that is seen; written where something was hit.
        albedo: (n, 3) float32, linear colour, the sky's light for nothing; written.
    """
    texels, level_start, level_size, level_count, is_cube = textures
    n, face_normals, c = triangles.normals, triangles.face_normals, triangles.texture_coordinates
    geom_of, log2_density, colours, texture_of = (
        triangles.geom,
        triangles.log2_texels_per_m,
        geoms.colour,
        geoms.texture,
    )
    # Unsigned, or every index is asked whether it is negative.
    for i in range(np.uint64(start), np.uint64(stop)):
        dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
        if triangle[i] < 0:
            geom[i] = -1
            albedo[i, 0], albedo[i, 1], albedo[i, 2] = _background(dx, dy, dz, ambient, textures, footprint)
            continue
        at = np.uint64(triangle[i])
        u, v = uv[i, 0], uv[i, 1]
        w = 1.0 - u - v
        fx, fy, fz = face_normals[at, 0], face_normals[at, 1], face_normals[at, 2]
        facing = fx * dx + fy * dy + fz * dz
        if facing > 0.0:
            fx, fy, fz = -fx, -fy, -fz
        nx = w * n[at, 0, 0] + u * n[at, 1, 0] + v * n[at, 2, 0]
        ny = w * n[at, 0, 1] + u * n[at, 1, 1] + v * n[at, 2, 1]
        nz = w * n[at, 0, 2] + u * n[at, 1, 2] + v * n[at, 2, 2]
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length < 1e-6:
            nx, ny, nz = fx, fy, fz
        else:
            # Two-sided: the smooth normal takes the side of the face that is seen.
            scale = 1.0 / length if nx * fx + ny * fy + nz * fz >= 0.0 else -1.0 / length
            nx, ny, nz = nx * scale, ny * scale, nz * scale
        normal[i, 0], normal[i, 1], normal[i, 2] = nx, ny, nz
        geom[i] = geom_of[at]
        number = np.uint64(geom_of[at])
        red, green, blue = colours[number, 0], colours[number, 1], colours[number, 2]
        texture = texture_of[number]
        if texture >= 0:
            cosine = abs(facing) / math.sqrt(dx * dx + dy * dy + dz * dz)
            level = texture_level(log2_density[at], t[i], footprint, cosine)
            s = w * c[at, 0, 0] + u * c[at, 1, 0] + v * c[at, 2, 0]
            r = w * c[at, 0, 1] + u * c[at, 1, 1] + v * c[at, 2, 1]
            q = w * c[at, 0, 2] + u * c[at, 1, 2] + v * c[at, 2, 2]
            texel = sample(texels, level_start, level_size, level_count, is_cube, texture, s, r, q, level)
            red, green, blue = red * texel[0], green * texel[1], blue * texel[2]
        albedo[i, 0], albedo[i, 1], albedo[i, 2] = red, green, blue


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _background(dx, dy, dz, ambient: AmbientTable, textures: TextureTable, footprint):
    """Linear red, green and blue light of the sky in direction (dx, dy, dz), of any length."""
    if ambient.sky_texture >= 0:
        texture = ambient.sky_texture
        # The skybox stands upright: its own up is the world's +Z. Source: MuJoCo, render_gl3.c, settexture.
        texels_per_rad = 0.5 * textures.level_size[texture, 0, 0]
        level = math.log2(max(texels_per_rad * footprint, 1e-6))
        texels, level_start, level_size, level_count, is_cube = textures
        texel = sample(texels, level_start, level_size, level_count, is_cube, texture, dx, dz, -dy, level)
        return texel[0], texel[1], texel[2]
    up = dz / math.sqrt(dx * dx + dy * dy + dz * dz)
    # Most of the change of a clear sky is near the horizon.
    weight = math.sqrt(up) if up > 0.0 else min(-4.0 * up, 1.0)
    other = 0 if up > 0.0 else 2
    return (
        ambient.sky[1, 0] + weight * (ambient.sky[other, 0] - ambient.sky[1, 0]),
        ambient.sky[1, 1] + weight * (ambient.sky[other, 1] - ambient.sky[1, 1]),
        ambient.sky[1, 2] + weight * (ambient.sky[other, 2] - ambient.sky[1, 2]),
    )
