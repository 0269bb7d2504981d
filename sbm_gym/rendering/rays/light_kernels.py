"""Compiled kernels that add up the light that arrives at surfaces: from everywhere, and from each lamp in turn.

Points are worked on in blocks of a fixed size. Every block writes its shadow rays to its own part of the lists, so that
any split of blocks over threads gives the same bytes.
"""

import math

import numpy as np
from numba import njit

from sbm_gym.rendering.rays.surface_table import SurfaceTable
from sbm_gym.rendering.tables.light_tables import (
    DIRECTIONAL,
    NOWHERE,
    SPOT,
    WHOLLY,
    AmbientTable,
    LampReach,
    LightTable,
)
from sbm_gym.rendering.tables.scene_tables import GeomTable, TriangleTable

BLOCK = 512
"""Points that are worked on together: what is known of them then stays in the processor's cache."""
SHADOW_OFFSET_M = 2e-3
"""Shadow rays start this far off the surface, so that it does not shade itself."""
FAINT = 0.004
"""Lamps that add less than this share to the light from everywhere are left out: less than half of one of 255 levels,
however bright the picture."""


@njit(cache=True, nogil=True, error_model="numpy")
def lamp_rays(
    start,
    stop,
    chosen,
    seen: SurfaceTable,
    triangles: TriangleTable,
    geoms: GeomTable,
    lights: LightTable,
    reach: LampReach,
    ambient: AmbientTable,
    far_m,
    light,
    lit,
    shadow_rays,
    point_of,
    lamp_of,
    gain,
    count,
):
    """Light that needs no shadow ray, and for all other light the ray that finds out whether it arrives.

    Args:
        start: first block of points.
        stop: behind the last block.
        chosen: (k,) int64, the points: rows of ``seen``.
        seen: what rays hit.
        triangles: of the scene.
        geoms: of the scene.
        lights: of the scene.
        reach: how much of each lamp's light is drawn where.
        ambient: the light from everywhere.
        far_m: shadow rays to the sun are this long.
        light: (n, 6) float32, linear red, green and blue irradiance, then the same as gloss; written for the chosen.
        lit: (n,) uint64, one bit for each lamp that shines there; set to 0 for the chosen.
        shadow_rays: (blocks, m, 6) float32, from a point to a lamp at parameter 1; written.
        point_of: (blocks, m) int32, the row of ``seen`` to which each shadow ray belongs; written.
        lamp_of: (blocks, m) int32, its lamp; written.
        gain: (blocks, m, 2) float32, what the lamp's colours are multiplied by on the surface and as gloss; written.
        count: (blocks,) int64, how many shadow rays each block has; written.
    """
    rays, t, triangle, geom, normal = seen
    # Arrays are taken out of their tables once: in a loop that costs reference counting.
    face_normals, speculars = triangles.face_normals, geoms.specular
    gloss_cosines, gloss_exponents = geoms.gloss_cosine, geoms.gloss_exponent
    diffuse, light_specular = lights.diffuse, lights.specular
    share, code, grid_x, grid_y, grid_z = reach.share, reach.around, reach.origin[0], reach.origin[1], reach.origin[2]
    density, filled_x, filled_y, filled_z = (
        ambient.density,
        ambient.grid_origin[0],
        ambient.grid_origin[1],
        ambient.grid_origin[2],
    )
    reach_per_m, filled_per_m = 1.0 / reach.cell_m, 1.0 / ambient.cell_m
    ambient_red, ambient_green, ambient_blue = ambient.colour[0], ambient.colour[1], ambient.colour[2]
    faint = FAINT * min(ambient_red, ambient_green, ambient_blue)
    places = np.empty((BLOCK, 9), np.float32)
    for block in range(start, stop):
        first = block * BLOCK
        points = min(BLOCK, len(chosen) - first)
        for k in range(points):
            i = chosen[first + k]
            lit[i] = 0
            at = triangle[i]
            if at < 0:
                continue
            dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
            fx, fy, fz = face_normals[at, 0], face_normals[at, 1], face_normals[at, 2]
            if fx * dx + fy * dy + fz * dz > 0.0:
                fx, fy, fz = -fx, -fy, -fz
            px, py, pz = rays[i, 0] + t[i] * dx, rays[i, 1] + t[i] * dy, rays[i, 2] + t[i] * dz
            nearer = -1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
            places[k, 0], places[k, 1], places[k, 2] = px, py, pz
            places[k, 3], places[k, 4], places[k, 5] = fx, fy, fz
            places[k, 6], places[k, 7], places[k, 8] = nearer * dx, nearer * dy, nearer * dz
            # Light from above is stronger than light from below, and no two walls of a room are equally bright.
            around = 0.92 + 0.08 * normal[i, 2] + 0.05 * normal[i, 0] + 0.03 * normal[i, 1]
            gx, gy, gz = (px - filled_x) * filled_per_m, (py - filled_y) * filled_per_m, (pz - filled_z) * filled_per_m
            around *= _openness(density, gx - 0.5, gy - 0.5, gz - 0.5, fx, fy, fz)
            light[i, 0], light[i, 1], light[i, 2] = ambient_red * around, ambient_green * around, ambient_blue * around
            light[i, 3] = light[i, 4] = light[i, 5] = 0.0
        cast = 0
        for lamp in range(lights.kind.shape[0]):
            kind, slot = lights.kind[lamp], lights.shadow_slot[lamp]
            lamp_x, lamp_y, lamp_z = lights.position[lamp, 0], lights.position[lamp, 1], lights.position[lamp, 2]
            axis_x, axis_y, axis_z = lights.direction[lamp, 0], lights.direction[lamp, 1], lights.direction[lamp, 2]
            near, linear, square = lights.attenuation[lamp, 0], lights.attenuation[lamp, 1], lights.attenuation[lamp, 2]
            most = max(lights.diffuse[lamp, 0], lights.diffuse[lamp, 1], lights.diffuse[lamp, 2])
            most_gloss = max(lights.specular[lamp, 0], lights.specular[lamp, 1], lights.specular[lamp, 2])
            for k in range(points):
                i = chosen[first + k]
                if triangle[i] < 0:
                    continue
                px, py, pz = places[k, 0], places[k, 1], places[k, 2]
                nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
                if kind == DIRECTIONAL:
                    lx, ly, lz = -axis_x, -axis_y, -axis_z
                else:
                    lx, ly, lz = lamp_x - px, lamp_y - py, lamp_z - pz
                facing = nx * lx + ny * ly + nz * lz
                face_facing = places[k, 3] * lx + places[k, 4] * ly + places[k, 5] * lz
                if facing <= 0.0 or face_facing <= 0.0:
                    continue
                strength = 1.0
                if slot >= 0:
                    gx, gy, gz = (px - grid_x) * reach_per_m, (py - grid_y) * reach_per_m, (pz - grid_z) * reach_per_m
                    strength = _share(share, code, slot, gx, gy, gz)
                    if strength <= 0.0:
                        continue
                if kind != DIRECTIONAL:
                    distance = max(math.sqrt(lx * lx + ly * ly + lz * lz), 1e-6)
                    inverse = 1.0 / distance
                    lx, ly, lz = lx * inverse, ly * inverse, lz * inverse
                    facing, face_facing = facing * inverse, face_facing * inverse
                    strength /= max(near + distance * (linear + distance * square), 1e-6)
                    if kind == SPOT:
                        cosine = -(lx * axis_x + ly * axis_y + lz * axis_z)
                        if cosine < lights.spot[lamp, 0]:
                            continue
                        strength *= max(cosine, 0.0) ** lights.spot[lamp, 1]
                # Facets of smooth surfaces turn away all at once: fade them where light only grazes them.
                strength *= min(face_facing * 8.0, 1.0)
                lambert = strength * facing
                gloss = 0.0
                specular = speculars[geom[i]]
                if specular > 0.0:
                    hx, hy, hz = lx + places[k, 6], ly + places[k, 7], lz + places[k, 8]
                    cosine = (nx * hx + ny * hy + nz * hz) / max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-6)
                    if cosine > gloss_cosines[geom[i]]:
                        gloss = strength * specular * cosine ** gloss_exponents[geom[i]]
                if lambert * most < faint and gloss * most_gloss < 0.1 * faint:
                    continue
                if slot < 0:
                    for channel in range(3):
                        light[i, channel] += lambert * diffuse[lamp, channel]
                        light[i, 3 + channel] += gloss * light_specular[lamp, channel]
                    continue
                fx, fy, fz = (
                    SHADOW_OFFSET_M * places[k, 3],
                    SHADOW_OFFSET_M * places[k, 4],
                    SHADOW_OFFSET_M * places[k, 5],
                )
                if kind == DIRECTIONAL:
                    lx, ly, lz = far_m * lx, far_m * ly, far_m * lz
                else:
                    lx, ly, lz = lamp_x - px - fx, lamp_y - py - fy, lamp_z - pz - fz
                shadow_rays[block, cast, 0], shadow_rays[block, cast, 3] = px + fx, lx
                shadow_rays[block, cast, 1], shadow_rays[block, cast, 4] = py + fy, ly
                shadow_rays[block, cast, 2], shadow_rays[block, cast, 5] = pz + fz, lz
                point_of[block, cast], lamp_of[block, cast] = i, lamp
                gain[block, cast, 0], gain[block, cast, 1] = lambert, gloss
                cast += 1
        count[block] = cast


@njit(cache=True, nogil=True, error_model="numpy")
def line_up(start, stop, count, first, shadow_rays, together):
    """Copies the shadow rays of blocks to one list without gaps.

    Args:
        start: first block.
        stop: behind the last one.
        count: (blocks,) int64, shadow rays of each block.
        first: (blocks,) int64, where each block's begin in the list.
        shadow_rays: (blocks, m, 6) float32.
        together: (sum of count, 6) float32; written.
    """
    # Assigning slices would do, but numba compiles that for seconds.
    for block in range(start, stop):
        for ray in range(count[block]):
            for part in range(6):
                together[first[block] + ray, part] = shadow_rays[block, ray, part]


@njit(cache=True, nogil=True, error_model="numpy")
def add_lamps(start, stop, count, first, occluded, point_of, lamp_of, gain, lights: LightTable, light, lit):
    """Adds the light whose shadow rays arrived.

    Args:
        start: first block.
        stop: behind the last one.
        count: as in ``line_up``.
        first: as in ``line_up``.
        occluded: (sum of count,) bool, by place in the list of ``line_up``.
        point_of: as in ``lamp_rays``.
        lamp_of: as in ``lamp_rays``.
        gain: as in ``lamp_rays``.
        lights: of the scene.
        light: (n, 6) float32; added to.
        lit: (n,) uint64; bits are set.
    """
    diffuse, specular = lights.diffuse, lights.specular
    for block in range(start, stop):
        for k in range(count[block]):
            if occluded[first[block] + k]:
                continue
            i, lamp = point_of[block, k], lamp_of[block, k]
            # With more than 64 lamps some share a bit: differences are then found less often.
            lit[i] |= np.uint64(1) << np.uint64(lamp & 63)
            for channel in range(3):
                light[i, channel] += gain[block, k, 0] * diffuse[lamp, channel]
                light[i, 3 + channel] += gain[block, k, 1] * specular[lamp, channel]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _share(share, code, slot, gx, gy, gz):
    """Share of a lamp's light that is drawn at a point, trilinear between the centres of cells; 1 outside the grid.

    Args:
        share: as in ``LampReach``.
        code: ``around`` of ``LampReach``.
        slot: the lamp's shadow slot.
        gx: x of the point, in cells from the grid's corner; likewise gy and gz.
        gy: see gx.
        gz: see gx.
    """
    depth, height, width = share.shape[1:]
    if not (0.0 <= gx < width and 0.0 <= gy < height and 0.0 <= gz < depth):
        return 1.0
    around = code[slot, int(gz), int(gy), int(gx)]
    if around == WHOLLY:
        return 1.0
    if around == NOWHERE:
        return 0.0
    gx, gy, gz = max(gx - 0.5, 0.0), max(gy - 0.5, 0.0), max(gz - 0.5, 0.0)
    x0, y0, z0 = int(gx), int(gy), int(gz)
    x1, y1, z1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1), min(z0 + 1, depth - 1)
    wx, wy, wz = gx - x0, gy - y0, gz - z0
    low = (1.0 - wy) * ((1.0 - wx) * share[slot, z0, y0, x0] + wx * share[slot, z0, y0, x1])
    low += wy * ((1.0 - wx) * share[slot, z0, y1, x0] + wx * share[slot, z0, y1, x1])
    high = (1.0 - wy) * ((1.0 - wx) * share[slot, z1, y0, x0] + wx * share[slot, z1, y0, x1])
    high += wy * ((1.0 - wx) * share[slot, z1, y1, x0] + wx * share[slot, z1, y1, x1])
    return (1.0 - wz) * low + wz * high


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _density(density, gx, gy, gz):
    """Trilinear look-up in the grid of filled space; 0 outside it.

    Args:
        density: (z, y, x) float32, as in ``AmbientTable``.
        gx: x of the point, in cells from the centre of the first one; likewise gy and gz.
        gy: see gx.
        gz: see gx.
    """
    depth, height, width = density.shape
    if not (0.0 <= gx < width - 1 and 0.0 <= gy < height - 1 and 0.0 <= gz < depth - 1):
        return 0.0
    ix, iy, iz = int(gx), int(gy), int(gz)
    wx, wy, wz = gx - ix, gy - iy, gz - iz
    jx, jy, jz = ix + 1, iy + 1, iz + 1
    a = density[iz, iy, ix] + wx * (density[iz, iy, jx] - density[iz, iy, ix])
    b = density[iz, jy, ix] + wx * (density[iz, jy, jx] - density[iz, jy, ix])
    c = density[jz, iy, ix] + wx * (density[jz, iy, jx] - density[jz, iy, ix])
    d = density[jz, jy, ix] + wx * (density[jz, jy, jx] - density[jz, jy, ix])
    a += wy * (b - a)
    c += wy * (d - c)
    return a + wz * (c - a)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _openness(density, gx, gy, gz, nx, ny, nz):
    """How much ambient light reaches a point: one cone of three steps through the grid of filled space.

    Source: after Crassin et al., Interactive Indirect Illumination Using Voxel Cone Tracing, 2011.

    Args:
        density: as in ``_density``.
        gx: the point, as in ``_density``; likewise gy and gz.
        gy: see gx.
        gz: see gx.
        nx: x of the unit normal of the surface there; likewise ny and nz.
        ny: see nx.
        nz: see nx.

    Returns:
        From 0.3 (enclosed) to 1 (open).
    """
    through = 1.0
    step = 1.6
    for _ in range(3):
        filled = _density(density, gx + step * nx, gy + step * ny, gz + step * nz)
        through *= 1.0 - min(filled, 0.85)
        step *= 2.0
    return 0.3 + 0.7 * through
