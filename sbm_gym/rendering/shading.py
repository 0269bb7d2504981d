"""Compiled kernels of the ray renderer: camera rays, planes, surfaces, light, and the finished picture.

Every kernel works on a range [start, stop) of rays and writes only there, so that any split over threads gives the
same bytes. No kernel uses fast-math or numba's own threads: both would let the result depend on the split.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32
from numba import njit

from sbm_gym.rendering.scene_tables import GeomTable, PlaneTable, TriangleTable
from sbm_gym.rendering.textures import BYTE_TO_LINEAR, LINEAR_STEPS, LINEAR_TO_BYTE

DIRECTIONAL, POINT, SPOT = 0, 1, 2
SHADOW_OFFSET_M = 2e-3
"""Shadow rays start this far off the surface, so that it does not shade itself."""
SAME_SURFACE_COSINE = 0.9
"""Neighbouring hits on one geom whose normals differ by less belong to one surface."""
SHOULDER = 0.6
"""Linear light above this is compressed softly towards white instead of being cut off."""
VISIBLE_STEP = 0.02
"""Five of 255 levels: fainter edges of shadows are not smoothed."""
HOLE_ALPHA = 0.5
"""Texels more transparent than this are holes."""


class LightTable(NamedTuple):
    """Lights in the world."""

    kind: np.ndarray
    position: Float[np.ndarray, "l 3"]
    direction: Float[np.ndarray, "l 3"]
    diffuse: Float[np.ndarray, "l 3"]
    specular: Float[np.ndarray, "l 3"]
    attenuation: Float[np.ndarray, "l 3"]
    spot: Float[np.ndarray, "l 2"]
    """Cosine of the cut-off angle, exponent."""
    shadow_slot: np.ndarray
    """Which row of the occlusion table belongs to the light; -1: casts no shadow."""
    is_fixed: np.ndarray
    """Whether the light stands where it stands for as long as nobody edits the model."""


class LampReach(NamedTuple):
    """Where the light of lamps can arrive at all: lamps of other rooms need no shadow rays."""

    reached: np.ndarray
    """By shadow slot and cell, (s, z, y, x)."""
    origin: Float[np.ndarray, "3"]
    cell_m: float


class AmbientTable(NamedTuple):
    """Light from everywhere, and how much of it reaches a place."""

    colour: Float[np.ndarray, "3"]
    sky: Float[np.ndarray, "3 3"]
    """Zenith, horizon and ground colours of the background, linear."""
    haze_per_m: float
    """Share of what is seen that haze, which has the horizon's colour, replaces in each metre."""
    exposure: float
    """What all light is multiplied by before it becomes a picture."""
    sky_texture: int
    """Skybox texture, -1 for the plain sky."""
    density: Float32[np.ndarray, "z y x"]
    """Blurred share of each cell of a coarse grid that is filled with surfaces."""
    grid_origin: Float[np.ndarray, "3"]
    cell_m: float


class TextureTable(NamedTuple):
    """The arrays of a ``TextureStore``."""

    texels: np.ndarray
    level_start: np.ndarray
    level_size: np.ndarray
    level_count: np.ndarray
    is_cube: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def camera_rays(start, stop, pixels, width, offsets, origin, pixel_to_world, rays):
    """Rays (origin, un-normalised direction) of ``len(offsets)`` samples per pixel; the hit parameter is z-depth."""
    samples = offsets.shape[0]
    for i in range(start, stop):
        pixel = pixels[i // samples]
        x = pixel % width + offsets[i % samples, 0]
        y = pixel // width + offsets[i % samples, 1]
        for axis in range(3):
            rays[i, axis] = origin[axis]
            rays[i, 3 + axis] = pixel_to_world[axis, 0] * x + pixel_to_world[axis, 1] * y + pixel_to_world[axis, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def name_triangles(start, stop, t, primitive, rows, triangle):
    """Rows of the tables of what Embree hit, -1 for nothing."""
    for i in range(start, stop):
        triangle[i] = rows[primitive[i]] if t[i] < math.inf else -1


@njit(cache=True, nogil=True, error_model="numpy")
def reach_boxes(start, stop, rays, far, boxes, reached):
    """Whether rays enter any of some boxes (low corner, high corner) before their parameter ``far``."""
    for i in range(start, stop):
        reached[i] = False
        for b in range(boxes.shape[0]):
            enter, leave = 0.0, far[i]
            for axis in range(3):
                # Zero directions divide to infinities, which compare as they should.
                inverse = 1.0 / rays[i, 3 + axis]
                near = (boxes[b, 0, axis] - rays[i, axis]) * inverse
                away = (boxes[b, 1, axis] - rays[i, axis]) * inverse
                if near > away:
                    near, away = away, near
                if near > enter:
                    enter = near
                if away < leave:
                    leave = away
            if enter <= leave:
                reached[i] = True
                break


@njit(cache=True, nogil=True, error_model="numpy")
def borrow_shadows(
    start, stop, pixels, samples, width, height, own, geom, normal, of_geom, of_normal, of_occluded, occluded, is_open
):
    """Takes shadows of rays from pixels around them where those agree; marks the rays that must be cast.

    Args:
        start: first ray.
        stop: behind the last ray.
        pixels: the pixel of every ``samples`` rays.
        samples: rays of a pixel.
        width: of the picture.
        height: of the picture.
        own: whether a ray's own pixel counts, and one that agrees is enough. Else all four neighbours must agree.
        geom: what the rays hit.
        normal: there.
        of_geom: what the pixels show.
        of_normal: there.
        of_occluded: shadows of the pixels, (lights, pixels).
        occluded: shadows of the rays, (lights, rays).
        is_open: rays that must be cast.
    """
    for i in range(start, stop):
        if geom[i] < 0:
            is_open[i] = False
            continue
        pixel = pixels[i // samples]
        x, y = pixel % width, pixel // width
        found, agree = -1, True
        for step in range(5):
            if step == 0:
                if not own:
                    continue
                other = pixel
            elif step == 1:
                other = pixel - 1 if x > 0 else -1
            elif step == 2:
                other = pixel + 1 if x < width - 1 else -1
            elif step == 3:
                other = pixel - width if y > 0 else -1
            else:
                other = pixel + width if y < height - 1 else -1
            same = other >= 0 and of_geom[other] == geom[i]
            if same:
                cosine = 0.0
                for axis in range(3):
                    cosine += normal[i, axis] * of_normal[other, axis]
                same = cosine >= SAME_SURFACE_COSINE
            if not same:
                if not own:
                    agree = False
                    break
                continue
            if found >= 0:
                for light in range(of_occluded.shape[0]):
                    agree &= of_occluded[light, other] == of_occluded[light, found]
            found = other
        is_open[i] = found < 0 or not agree
        if not is_open[i]:
            for light in range(of_occluded.shape[0]):
                occluded[light, i] = of_occluded[light, found]


@njit(cache=True, nogil=True, error_model="numpy")
def intersect_planes(start, stop, rays, planes: PlaneTable, first_plane, t, triangle, uv):
    """Replaces hits by nearer ones with planes, seen from their front."""
    for p in range(planes.origin.shape[0]):
        nx, ny, nz = planes.axes[p, 2, 0], planes.axes[p, 2, 1], planes.axes[p, 2, 2]
        for i in range(start, stop):
            slope = rays[i, 3] * nx + rays[i, 4] * ny + rays[i, 5] * nz
            if slope >= -1e-12:
                continue
            dx = planes.origin[p, 0] - rays[i, 0]
            dy = planes.origin[p, 1] - rays[i, 1]
            dz = planes.origin[p, 2] - rays[i, 2]
            hit = (dx * nx + dy * ny + dz * nz) / slope
            if hit <= 0.0 or hit >= t[i]:
                continue
            hx, hy, hz = hit * rays[i, 3] - dx, hit * rays[i, 4] - dy, hit * rays[i, 5] - dz
            u = hx * planes.axes[p, 0, 0] + hy * planes.axes[p, 0, 1] + hz * planes.axes[p, 0, 2]
            v = hx * planes.axes[p, 1, 0] + hy * planes.axes[p, 1, 1] + hz * planes.axes[p, 1, 2]
            if abs(u) <= planes.half_size[p, 0] and abs(v) <= planes.half_size[p, 1]:
                t[i] = hit
                triangle[i] = first_plane + p
                uv[i, 0] = u
                uv[i, 1] = v


@njit(cache=True, nogil=True, error_model="numpy")
def occlude_planes(start, stop, rays, planes: PlaneTable, occluded):
    """Marks shadow rays (to the light at parameter 1) that a plane blocks, from either side."""
    for p in range(planes.origin.shape[0]):
        nx, ny, nz = planes.axes[p, 2, 0], planes.axes[p, 2, 1], planes.axes[p, 2, 2]
        for i in range(start, stop):
            slope = rays[i, 3] * nx + rays[i, 4] * ny + rays[i, 5] * nz
            if abs(slope) < 1e-12:
                continue
            dx = planes.origin[p, 0] - rays[i, 0]
            dy = planes.origin[p, 1] - rays[i, 1]
            dz = planes.origin[p, 2] - rays[i, 2]
            hit = (dx * nx + dy * ny + dz * nz) / slope
            if hit <= 0.0 or hit >= 1.0:
                continue
            hx, hy, hz = hit * rays[i, 3] - dx, hit * rays[i, 4] - dy, hit * rays[i, 5] - dz
            u = hx * planes.axes[p, 0, 0] + hy * planes.axes[p, 0, 1] + hz * planes.axes[p, 0, 2]
            v = hx * planes.axes[p, 1, 0] + hy * planes.axes[p, 1, 1] + hz * planes.axes[p, 1, 2]
            if abs(u) <= planes.half_size[p, 0] and abs(v) <= planes.half_size[p, 1]:
                occluded[i] = True


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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
    red = green = blue = alpha = 0.0
    for corner in range(4):
        column = x1 if corner & 1 else x0
        row = y1 if corner & 2 else y0
        weight = (wx if corner & 1 else 1.0 - wx) * (wy if corner & 2 else 1.0 - wy)
        at = first + row * width + column
        red += weight * BYTE_TO_LINEAR[texels[at, 0]]
        green += weight * BYTE_TO_LINEAR[texels[at, 1]]
        blue += weight * BYTE_TO_LINEAR[texels[at, 2]]
        alpha += weight * texels[at, 3]
    return red, green, blue, alpha / 255.0


@njit(cache=True, nogil=True, error_model="numpy")
def _sample(textures: TextureTable, texture, u, v, w, level):
    """Trilinear texture look-up, linear light and alpha."""
    face = 0
    if textures.is_cube[texture]:
        face, u, v = _cube_face(u, v, w)
    last = textures.level_count[texture] - 1
    level = min(max(level, 0.0), float(last))
    low = min(int(level), last)
    fraction = level - low
    width, height = textures.level_size[texture, low, 0], textures.level_size[texture, low, 1]
    first = textures.level_start[texture, low] + face * width * height
    wraps = not textures.is_cube[texture]
    red, green, blue, alpha = _bilinear(textures.texels, first, width, height, u, v, wraps)
    if fraction > 0.0:
        width, height = textures.level_size[texture, low + 1, 0], textures.level_size[texture, low + 1, 1]
        first = textures.level_start[texture, low + 1] + face * width * height
        r, g, b, a = _bilinear(textures.texels, first, width, height, u, v, wraps)
        red += fraction * (r - red)
        green += fraction * (g - green)
        blue += fraction * (b - blue)
        alpha += fraction * (a - alpha)
    return red, green, blue, alpha


@njit(cache=True, nogil=True, error_model="numpy")
def _surface_texel(rays, i, t, at, u, v, triangles, texture, textures, footprint):
    """Texel under a hit. ``footprint``: metres per metre of depth that a sample covers; 0 asks for full detail."""
    w = 1.0 - u - v
    c = triangles.texture_coordinates
    s = w * c[at, 0, 0] + u * c[at, 1, 0] + v * c[at, 2, 0]
    r = w * c[at, 0, 1] + u * c[at, 1, 1] + v * c[at, 2, 1]
    q = w * c[at, 0, 2] + u * c[at, 1, 2] + v * c[at, 2, 2]
    level = 0.0
    if footprint > 0.0:
        dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
        n = triangles.face_normals
        cosine = abs(dx * n[at, 0] + dy * n[at, 1] + dz * n[at, 2]) / math.sqrt(dx * dx + dy * dy + dz * dz)
        # A slanted surface stretches the footprint by 1/cos along one axis only: the geometric mean of both.
        level = triangles.log2_texels_per_m[at] + math.log2(t * footprint / math.sqrt(max(cosine, 0.02)))
    return _sample(textures, texture, s, r, q, level)


@njit(cache=True, nogil=True, error_model="numpy")
def hole_test(start, stop, rays, t, triangle, uv, triangles, geoms, textures, footprint, is_hole):
    """Whether hits on textures with transparent parts fall through."""
    for i in range(start, stop):
        texture = geoms.texture[triangles.geom[triangle[i]]]
        texel = _surface_texel(rays, i, t[i], triangle[i], uv[i, 0], uv[i, 1], triangles, texture, textures, footprint)
        is_hole[i] = texel[3] < HOLE_ALPHA


@njit(cache=True, nogil=True, error_model="numpy")
def surfaces(
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
    lights: LightTable,
    far_m,
    reach: LampReach,
    position,
    normal,
    face_normal,
    albedo,
    shadow_rays,
    needs_ray,
    occluded,
):
    """What each ray hit, the rays from there to the lights that cast shadows, and which lights are out of reach."""
    depth, height, width = reach.reached.shape[1:]
    cells_per_m = 1.0 / reach.cell_m
    slots = shadow_rays.shape[0]
    for i in range(start, stop):
        at = triangle[i]
        if at < 0:
            for slot in range(slots):
                needs_ray[slot, i] = False
            continue
        dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
        u, v = uv[i, 0], uv[i, 1]
        w = 1.0 - u - v
        fx, fy, fz = triangles.face_normals[at, 0], triangles.face_normals[at, 1], triangles.face_normals[at, 2]
        if fx * dx + fy * dy + fz * dz > 0.0:
            fx, fy, fz = -fx, -fy, -fz
        n = triangles.normals
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
        px, py, pz = rays[i, 0] + t[i] * dx, rays[i, 1] + t[i] * dy, rays[i, 2] + t[i] * dz
        position[i, 0], position[i, 1], position[i, 2] = px, py, pz
        normal[i, 0], normal[i, 1], normal[i, 2] = nx, ny, nz
        face_normal[i, 0], face_normal[i, 1], face_normal[i, 2] = fx, fy, fz
        geom = triangles.geom[at]
        red, green, blue = geoms.colour[geom, 0], geoms.colour[geom, 1], geoms.colour[geom, 2]
        texture = geoms.texture[geom]
        if texture >= 0:
            texel = _surface_texel(rays, i, t[i], at, u, v, triangles, texture, textures, footprint)
            red, green, blue = red * texel[0], green * texel[1], blue * texel[2]
        albedo[i, 0], albedo[i, 1], albedo[i, 2] = red, green, blue
        cx = math.floor((px - reach.origin[0]) * cells_per_m)
        cy = math.floor((py - reach.origin[1]) * cells_per_m)
        cz = math.floor((pz - reach.origin[2]) * cells_per_m)
        inside = 0 <= cx < width and 0 <= cy < height and 0 <= cz < depth
        for light in range(lights.kind.shape[0]):
            slot = lights.shadow_slot[light]
            if slot < 0:
                continue
            if inside and not reach.reached[slot, cz, cy, cx]:
                occluded[slot, i] = True
                needs_ray[slot, i] = False
                continue
            ox, oy, oz = px + SHADOW_OFFSET_M * fx, py + SHADOW_OFFSET_M * fy, pz + SHADOW_OFFSET_M * fz
            if lights.kind[light] == DIRECTIONAL:
                lx, ly, lz = (
                    -far_m * lights.direction[light, 0],
                    -far_m * lights.direction[light, 1],
                    -far_m * lights.direction[light, 2],
                )
            else:
                lx, ly, lz = (
                    lights.position[light, 0] - ox,
                    lights.position[light, 1] - oy,
                    lights.position[light, 2] - oz,
                )
            if lx * fx + ly * fy + lz * fz <= 0.0 or lx * nx + ly * ny + lz * nz <= 0.0:
                needs_ray[slot, i] = False
                continue
            needs_ray[slot, i] = True
            shadow_rays[slot, i, 0], shadow_rays[slot, i, 1], shadow_rays[slot, i, 2] = ox, oy, oz
            shadow_rays[slot, i, 3], shadow_rays[slot, i, 4], shadow_rays[slot, i, 5] = lx, ly, lz


@njit(cache=True, nogil=True, error_model="numpy")
def _density(ambient: AmbientTable, x, y, z):
    """Trilinear look-up in the grid of filled space; 0 outside it."""
    depth, height, width = ambient.density.shape
    gx = (x - ambient.grid_origin[0]) / ambient.cell_m - 0.5
    gy = (y - ambient.grid_origin[1]) / ambient.cell_m - 0.5
    gz = (z - ambient.grid_origin[2]) / ambient.cell_m - 0.5
    if not (0.0 <= gx < width - 1 and 0.0 <= gy < height - 1 and 0.0 <= gz < depth - 1):
        return 0.0
    ix, iy, iz = int(gx), int(gy), int(gz)
    wx, wy, wz = gx - ix, gy - iy, gz - iz
    d = ambient.density
    low = (1.0 - wy) * ((1.0 - wx) * d[iz, iy, ix] + wx * d[iz, iy, ix + 1])
    low += wy * ((1.0 - wx) * d[iz, iy + 1, ix] + wx * d[iz, iy + 1, ix + 1])
    high = (1.0 - wy) * ((1.0 - wx) * d[iz + 1, iy, ix] + wx * d[iz + 1, iy, ix + 1])
    high += wy * ((1.0 - wx) * d[iz + 1, iy + 1, ix] + wx * d[iz + 1, iy + 1, ix + 1])
    return (1.0 - wz) * low + wz * high


@njit(cache=True, nogil=True, error_model="numpy")
def _openness(ambient: AmbientTable, px, py, pz, nx, ny, nz):
    """How much ambient light reaches a point: one cone of three steps through the grid of filled space.

    Source: after Crassin et al., Interactive Indirect Illumination Using Voxel Cone Tracing, 2011.
    """
    through = 1.0
    step = 1.6 * ambient.cell_m
    for _ in range(3):
        filled = _density(ambient, px + step * nx, py + step * ny, pz + step * nz)
        through *= 1.0 - min(filled, 0.85)
        step *= 2.0
    return 0.3 + 0.7 * through


@njit(cache=True, nogil=True, error_model="numpy")
def _background(dx, dy, dz, ambient: AmbientTable, textures: TextureTable, footprint):
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if ambient.sky_texture >= 0:
        texture = ambient.sky_texture
        # The skybox stands upright: its own up is the world's +Z. Source: MuJoCo, render_gl3.c, settexture.
        texels_per_rad = 0.5 * textures.level_size[texture, 0, 0]
        level = math.log2(max(texels_per_rad * footprint, 1e-6))
        texel = _sample(textures, texture, dx, dz, -dy, level)
        return texel[0], texel[1], texel[2]
    up = dz / length
    # Most of the change of a clear sky is near the horizon.
    weight = math.sqrt(up) if up > 0.0 else min(-4.0 * up, 1.0)
    other = 0 if up > 0.0 else 2
    return (
        ambient.sky[1, 0] + weight * (ambient.sky[other, 0] - ambient.sky[1, 0]),
        ambient.sky[1, 1] + weight * (ambient.sky[other, 1] - ambient.sky[1, 1]),
        ambient.sky[1, 2] + weight * (ambient.sky[other, 2] - ambient.sky[1, 2]),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def shade(
    start,
    stop,
    rays,
    triangle,
    triangles: TriangleTable,
    geoms: GeomTable,
    textures: TextureTable,
    footprint,
    lights: LightTable,
    ambient: AmbientTable,
    position,
    normal,
    face_normal,
    albedo,
    occluded,
    colour,
):
    """Linear light that comes back along each ray: ambient, Lambert and Blinn-Phong terms of all lights, emission."""
    for i in range(start, stop):
        dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
        if triangle[i] < 0:
            colour[i, 0], colour[i, 1], colour[i, 2] = _background(dx, dy, dz, ambient, textures, footprint)
            continue
        geom = triangles.geom[triangle[i]]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        vx, vy, vz = -dx / length, -dy / length, -dz / length
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        fx, fy, fz = face_normal[i, 0], face_normal[i, 1], face_normal[i, 2]
        px, py, pz = position[i, 0], position[i, 1], position[i, 2]
        # Light from above is stronger than light from below, and no two walls of a room are equally bright.
        around = 0.92 + 0.08 * nz + 0.05 * nx + 0.03 * ny
        around *= _openness(ambient, px, py, pz, fx, fy, fz)
        red, green, blue = ambient.colour[0] * around, ambient.colour[1] * around, ambient.colour[2] * around
        gloss_red = gloss_green = gloss_blue = 0.0
        for light in range(lights.kind.shape[0]):
            slot = lights.shadow_slot[light]
            if slot >= 0 and occluded[slot, i]:
                continue
            strength = 1.0
            if lights.kind[light] == DIRECTIONAL:
                lx, ly, lz = -lights.direction[light, 0], -lights.direction[light, 1], -lights.direction[light, 2]
            else:
                lx, ly, lz = (
                    lights.position[light, 0] - px,
                    lights.position[light, 1] - py,
                    lights.position[light, 2] - pz,
                )
                if nx * lx + ny * ly + nz * lz <= 0.0:
                    continue
                distance = max(math.sqrt(lx * lx + ly * ly + lz * lz), 1e-6)
                lx, ly, lz = lx / distance, ly / distance, lz / distance
                a = lights.attenuation
                strength /= max(a[light, 0] + distance * (a[light, 1] + distance * a[light, 2]), 1e-6)
                if lights.kind[light] == SPOT:
                    cosine = -(
                        lx * lights.direction[light, 0]
                        + ly * lights.direction[light, 1]
                        + lz * lights.direction[light, 2]
                    )
                    if cosine < lights.spot[light, 0]:
                        continue
                    strength *= max(cosine, 0.0) ** lights.spot[light, 1]
            facing = nx * lx + ny * ly + nz * lz
            face_facing = fx * lx + fy * ly + fz * lz
            if facing <= 0.0 or face_facing <= 0.0:
                continue
            # Facets of smooth surfaces turn away all at once: fade them where light only grazes them.
            strength *= min(face_facing * 8.0, 1.0)
            lambert = strength * facing
            red += lambert * lights.diffuse[light, 0]
            green += lambert * lights.diffuse[light, 1]
            blue += lambert * lights.diffuse[light, 2]
            if geoms.specular[geom] > 0.0:
                hx, hy, hz = lx + vx, ly + vy, lz + vz
                cosine = (nx * hx + ny * hy + nz * hz) / max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-6)
                if cosine > 0.0:
                    gloss = strength * geoms.specular[geom] * cosine ** geoms.gloss_exponent[geom]
                    gloss_red += gloss * lights.specular[light, 0]
                    gloss_green += gloss * lights.specular[light, 1]
                    gloss_blue += gloss * lights.specular[light, 2]
        glow = geoms.emission[geom]
        colour[i, 0] = albedo[i, 0] * (red + glow) + gloss_red
        colour[i, 1] = albedo[i, 1] * (green + glow) + gloss_green
        colour[i, 2] = albedo[i, 2] * (blue + glow) + gloss_blue
        if ambient.haze_per_m > 0.0:
            away = math.sqrt((px - rays[i, 0]) ** 2 + (py - rays[i, 1]) ** 2 + (pz - rays[i, 2]) ** 2)
            through = math.exp(-ambient.haze_per_m * away)
            for channel in range(3):
                colour[i, channel] = ambient.sky[1, channel] + through * (colour[i, channel] - ambient.sky[1, channel])


@njit(cache=True, nogil=True, error_model="numpy")
def _differs(i, j, t, triangle, geom_of, normal, position, occluded, colour):
    """Whether an edge runs between two neighbouring pixels: of a geom, of a shape, of a shadow."""
    a, b = triangle[i], triangle[j]
    if a < 0 or b < 0:
        return (a < 0) != (b < 0)
    if geom_of[a] != geom_of[b]:
        return True
    for slot in range(occluded.shape[0]):
        if occluded[slot, i] != occluded[slot, j]:
            # Most shadows of homes with many lamps are too faint to be seen. The square root is close to sRGB.
            for channel in range(3):
                step = math.sqrt(colour[i, channel]) - math.sqrt(colour[j, channel])
                if abs(step) > VISIBLE_STEP:
                    return True
            break
    facing = normal[i, 0] * normal[j, 0] + normal[i, 1] * normal[j, 1] + normal[i, 2] * normal[j, 2]
    if facing < SAME_SURFACE_COSINE:
        return True
    off = 0.0
    for axis in range(3):
        off += normal[i, axis] * (position[j, axis] - position[i, axis])
    return abs(off) > 0.01 + 0.01 * t[i]


@njit(cache=True, nogil=True, error_model="numpy")
def find_edges(start, stop, width, height, t, triangle, geom_of, normal, position, occluded, colour, across, below):
    """Marks pixels that differ from their right and from their lower neighbour."""
    for i in range(start, stop):
        x, y = i % width, i // width
        across[i] = x < width - 1 and _differs(i, i + 1, t, triangle, geom_of, normal, position, occluded, colour)
        below[i] = y < height - 1 and _differs(i, i + width, t, triangle, geom_of, normal, position, occluded, colour)


@njit(cache=True, nogil=True, error_model="numpy")
def _tone(linear):
    """Identity up to the shoulder, then a curve with the same slope that reaches white only at infinity."""
    if linear <= SHOULDER:
        return max(linear, 0.0)
    return SHOULDER + (1.0 - SHOULDER) * (1.0 - math.exp((SHOULDER - linear) / (1.0 - SHOULDER)))


@njit(cache=True, nogil=True, error_model="numpy")
def encode(start, stop, pixels, colour, samples, exposure, rgb):
    """Writes pixels: the mean of their tone-mapped samples, as sRGB bytes."""
    for k in range(start, stop):
        for channel in range(3):
            total = 0.0
            for sample in range(samples):
                total += _tone(exposure * colour[k * samples + sample, channel])
            rgb[pixels[k], channel] = LINEAR_TO_BYTE[int(total / samples * LINEAR_STEPS + 0.5)]
