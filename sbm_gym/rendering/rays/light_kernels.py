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
    SOMEWHAT,
    SPOT,
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


# Single precision all through, or the compiler makes doubles of it.
_ZERO, _ONE, _HALF, _TENTH, _TINY, _GRAZING = (np.float32(value) for value in (0.0, 1.0, 0.5, 0.1, 1e-6, 8.0))
_OFFSET = np.float32(SHADOW_OFFSET_M)
_NEXT = np.uint64(1)
# Where columns of points begin: place, normals of face and surface, direction of the eye, gloss, and what ``_shine``
# writes. Unsigned, or every index is asked whether it is negative.
_COLUMNS = 18
_PX, _PY, _PZ, _FX, _FY, _FZ, _NX, _NY, _NZ, _EX, _EY, _EZ = (np.uint64(column * BLOCK) for column in range(12))
_SPECULAR, _LEAST_COSINE, _EXPONENT, _GLOSS_COSINE, _STRENGTH, _LAMBERT = (
    np.uint64(column * BLOCK) for column in range(12, _COLUMNS)
)


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
    # Arrays are taken out of their tables once: in a loop that costs reference counting.
    diffuse, light_specular = lights.diffuse, lights.specular
    share, around = reach.share, reach.around.reshape(len(reach.around), -1)
    grid_x, grid_y, grid_z = np.float32(reach.origin[0]), np.float32(reach.origin[1]), np.float32(reach.origin[2])
    per_m, far = np.float32(1.0 / reach.cell_m), np.float32(far_m)
    faint = np.float32(FAINT * min(ambient.colour[0], ambient.colour[1], ambient.colour[2]))
    point = np.empty(BLOCK, np.int64)
    cell = np.empty(BLOCK, np.int64)
    p = np.empty(_COLUMNS * BLOCK, np.float32)
    for block in range(start, stop):
        first = block * BLOCK
        end = min(first + BLOCK, len(chosen))
        points = _gather(first, end, chosen, seen, triangles, geoms, ambient, light, lit, point, p)
        for k in range(np.uint64(points)):
            cell[k] = _cell(
                share, (p[_PX + k] - grid_x) * per_m, (p[_PY + k] - grid_y) * per_m, (p[_PZ + k] - grid_z) * per_m
            )
        cast = 0
        for lamp in range(lights.kind.shape[0]):
            slot, is_sun = lights.shadow_slot[lamp], lights.kind[lamp] == DIRECTIONAL
            _shine(lamp, lights, points, p)
            most = np.float32(max(diffuse[lamp, 0], diffuse[lamp, 1], diffuse[lamp, 2]))
            most_gloss = np.float32(max(light_specular[lamp, 0], light_specular[lamp, 1], light_specular[lamp, 2]))
            lamp_x, lamp_y, lamp_z = _place(lamp, lights)
            for k in range(np.uint64(points)):
                strength, lambert, specular = p[_STRENGTH + k], p[_LAMBERT + k], p[_SPECULAR + k]
                if lambert * most < faint and strength * specular * most_gloss < _TENTH * faint:
                    continue
                px, py, pz = p[_PX + k], p[_PY + k], p[_PZ + k]
                drawn = _ONE
                if slot >= 0 and cell[k] >= 0:
                    if around[slot, cell[k]] == NOWHERE:
                        continue
                    if around[slot, cell[k]] == SOMEWHAT:
                        drawn = _share(share, slot, (px - grid_x) * per_m, (py - grid_y) * per_m, (pz - grid_z) * per_m)
                if lights.kind[lamp] == SPOT:
                    drawn *= _spot(lamp, lights, px, py, pz)
                lambert *= drawn
                gloss = _ZERO
                if specular > _ZERO and p[_GLOSS_COSINE + k] > p[_LEAST_COSINE + k]:
                    gloss = drawn * strength * specular * p[_GLOSS_COSINE + k] ** p[_EXPONENT + k]
                if lambert * most < faint and gloss * most_gloss < _TENTH * faint:
                    continue
                i = point[k]
                if slot < 0:
                    for channel in range(3):
                        light[i, channel] += lambert * diffuse[lamp, channel]
                        light[i, 3 + channel] += gloss * light_specular[lamp, channel]
                    continue
                px, py, pz = px + _OFFSET * p[_FX + k], py + _OFFSET * p[_FY + k], pz + _OFFSET * p[_FZ + k]
                if is_sun:
                    lx, ly, lz = far * lamp_x, far * lamp_y, far * lamp_z
                else:
                    lx, ly, lz = lamp_x - px, lamp_y - py, lamp_z - pz
                shadow_rays[block, cast, 0], shadow_rays[block, cast, 3] = px, lx
                shadow_rays[block, cast, 1], shadow_rays[block, cast, 4] = py, ly
                shadow_rays[block, cast, 2], shadow_rays[block, cast, 5] = pz, lz
                point_of[block, cast], lamp_of[block, cast] = i, lamp
                gain[block, cast, 0], gain[block, cast, 1] = lambert, gloss
                cast += 1
        count[block] = cast


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(first, end, chosen, seen: SurfaceTable, triangles, geoms, ambient: AmbientTable, light, lit, point, p):
    """Puts chosen points into columns, and gives them the light from everywhere.

    Args:
        first: first of the chosen.
        end: behind the last one.
        chosen: as in ``lamp_rays``; likewise the tables, ``light`` and ``lit``.
        seen: see ``chosen``.
        triangles: see ``chosen``.
        geoms: see ``chosen``.
        ambient: see ``chosen``.
        light: see ``chosen``.
        lit: see ``chosen``.
        point: (BLOCK,) int64, the points where there is a surface; written.
        p: (_COLUMNS * BLOCK,) float32, columns of what is known of these; written.

    Returns:
        How many these are.
    """
    rays, t, triangle, geom, normal = seen
    face_normals, speculars = triangles.face_normals, geoms.specular
    gloss_cosines, gloss_exponents, filled = geoms.gloss_cosine, geoms.gloss_exponent, ambient.density.reshape(-1)
    depth, height, width = ambient.density.shape
    low = ambient.grid_origin
    low_x, low_y, low_z = np.float32(low[0]), np.float32(low[1]), np.float32(low[2])
    per_m, half = np.float32(1.0 / ambient.cell_m), np.float32(0.5)
    red, green, blue = np.float32(ambient.colour[0]), np.float32(ambient.colour[1]), np.float32(ambient.colour[2])
    k = np.uint64(0)
    for row in range(first, end):
        i = chosen[row]
        lit[i] = 0
        at = triangle[i]
        if at < 0:
            continue
        dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
        fx, fy, fz = face_normals[at, 0], face_normals[at, 1], face_normals[at, 2]
        if fx * dx + fy * dy + fz * dz > _ZERO:
            fx, fy, fz = -fx, -fy, -fz
        px, py, pz = rays[i, 0] + t[i] * dx, rays[i, 1] + t[i] * dy, rays[i, 2] + t[i] * dz
        nearer = -_ONE / math.sqrt(dx * dx + dy * dy + dz * dz)
        p[_PX + k], p[_PY + k], p[_PZ + k] = px, py, pz
        p[_FX + k], p[_FY + k], p[_FZ + k] = fx, fy, fz
        p[_NX + k], p[_NY + k], p[_NZ + k] = normal[i, 0], normal[i, 1], normal[i, 2]
        p[_EX + k], p[_EY + k], p[_EZ + k] = nearer * dx, nearer * dy, nearer * dz
        number = geom[i]
        p[_SPECULAR + k] = speculars[number]
        p[_LEAST_COSINE + k], p[_EXPONENT + k] = gloss_cosines[number], gloss_exponents[number]
        # Light from above is stronger than light from below, and no two walls of a room are equally bright.
        around = np.float32(0.92 + 0.08 * normal[i, 2] + 0.05 * normal[i, 0] + 0.03 * normal[i, 1])
        gx, gy, gz = (px - low_x) * per_m - half, (py - low_y) * per_m - half, (pz - low_z) * per_m - half
        around *= _openness(filled, depth, height, width, gx, gy, gz, fx, fy, fz)
        light[i, 0], light[i, 1], light[i, 2] = red * around, green * around, blue * around
        light[i, 3] = light[i, 4] = light[i, 5] = _ZERO
        point[k] = i
        k += _NEXT
    return k


@njit(cache=True, nogil=True, error_model="numpy")
def _shine(lamp, lights: LightTable, points, p):
    """Works out how a lamp would light points if nothing stood in the way. Compiled to vector instructions.

    Args:
        lamp: its row.
        lights: of the scene.
        points: how many there are.
        p: columns of the points; some are written.
    """
    lamp_x, lamp_y, lamp_z = _place(lamp, lights)
    # Rays of the sun are parallel and do not spread.
    is_sun = lights.kind[lamp] == DIRECTIONAL
    moves = _ZERO if is_sun else _ONE
    near = _ONE if is_sun else np.float32(lights.attenuation[lamp, 0])
    linear = _ZERO if is_sun else np.float32(lights.attenuation[lamp, 1])
    square = _ZERO if is_sun else np.float32(lights.attenuation[lamp, 2])
    for k in range(np.uint64(points)):
        lx, ly, lz = lamp_x - moves * p[_PX + k], lamp_y - moves * p[_PY + k], lamp_z - moves * p[_PZ + k]
        distance = max(math.sqrt(lx * lx + ly * ly + lz * lz), _TINY)
        inverse = _ONE / distance
        lx, ly, lz = lx * inverse, ly * inverse, lz * inverse
        facing = p[_NX + k] * lx + p[_NY + k] * ly + p[_NZ + k] * lz
        face_facing = p[_FX + k] * lx + p[_FY + k] * ly + p[_FZ + k] * lz
        # Facets of smooth surfaces turn away all at once: fade them where light only grazes them.
        strength = min(face_facing * _GRAZING, _ONE) / max(near + distance * (linear + distance * square), _TINY)
        strength = strength if (facing > _ZERO) & (face_facing > _ZERO) else _ZERO
        hx, hy, hz = lx + p[_EX + k], ly + p[_EY + k], lz + p[_EZ + k]
        along = p[_NX + k] * hx + p[_NY + k] * hy + p[_NZ + k] * hz
        p[_GLOSS_COSINE + k] = along / max(math.sqrt(hx * hx + hy * hy + hz * hz), _TINY)
        p[_STRENGTH + k], p[_LAMBERT + k] = strength, strength * facing


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _place(lamp, lights: LightTable):
    """Where a lamp is; of the sun, in which direction."""
    at, axis = lights.position, lights.direction
    if lights.kind[lamp] == DIRECTIONAL:
        return np.float32(-axis[lamp, 0]), np.float32(-axis[lamp, 1]), np.float32(-axis[lamp, 2])
    return np.float32(at[lamp, 0]), np.float32(at[lamp, 1]), np.float32(at[lamp, 2])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _spot(lamp, lights: LightTable, px, py, pz):
    """Share of a spotlight's light that goes towards a point."""
    lamp_x, lamp_y, lamp_z = _place(lamp, lights)
    lx, ly, lz = lamp_x - px, lamp_y - py, lamp_z - pz
    cosine = -(lx * lights.direction[lamp, 0] + ly * lights.direction[lamp, 1] + lz * lights.direction[lamp, 2])
    cosine /= max(math.sqrt(lx * lx + ly * ly + lz * lz), _TINY)
    return np.float32(0.0 if cosine < lights.spot[lamp, 0] else max(cosine, 0.0) ** lights.spot[lamp, 1])


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
def _cell(share, gx, gy, gz):
    """Number of the cell of ``LampReach`` that a point lies in, -1 outside the grid; arguments as in ``_share``."""
    depth, height, width = share.shape[1:]
    x, y, z = math.floor(gx), math.floor(gy), math.floor(gz)
    return (z * height + y) * width + x if 0 <= x < width and 0 <= y < height and 0 <= z < depth else -1


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _share(share, slot, gx, gy, gz):
    """Share of a lamp's light that is drawn at a point, trilinear between the centres of cells.

    Args:
        share: as in ``LampReach``.
        slot: the lamp's shadow slot.
        gx: x of the point, in cells from the grid's corner; likewise gy and gz.
        gy: see gx.
        gz: see gx.
    """
    depth, height, width = share.shape[1:]
    gx, gy, gz = max(gx - _HALF, _ZERO), max(gy - _HALF, _ZERO), max(gz - _HALF, _ZERO)
    x0, y0, z0 = int(gx), int(gy), int(gz)
    x1, y1, z1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1), min(z0 + 1, depth - 1)
    wx, wy, wz = gx - np.float32(x0), gy - np.float32(y0), gz - np.float32(z0)
    vx, vy, vz = _ONE - wx, _ONE - wy, _ONE - wz
    low = vy * (vx * share[slot, z0, y0, x0] + wx * share[slot, z0, y0, x1])
    low += wy * (vx * share[slot, z0, y1, x0] + wx * share[slot, z0, y1, x1])
    high = vy * (vx * share[slot, z1, y0, x0] + wx * share[slot, z1, y0, x1])
    high += wy * (vx * share[slot, z1, y1, x0] + wx * share[slot, z1, y1, x1])
    return vz * low + wz * high


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _density(filled, depth, height, width, gx, gy, gz):
    """Trilinear look-up in the grid of filled space; 0 outside it.

    Args:
        filled: (z * y * x,) float32, ``density`` of ``AmbientTable``.
        depth: its cells along z.
        height: along y.
        width: along x.
        gx: x of the point, in cells from the centre of the first one; likewise gy and gz.
        gy: see gx.
        gz: see gx.
    """
    ix, iy, iz = math.floor(gx), math.floor(gy), math.floor(gz)
    if not (0 <= ix < width - 1 and 0 <= iy < height - 1 and 0 <= iz < depth - 1):
        return _ZERO
    wx, wy, wz = gx - np.float32(ix), gy - np.float32(iy), gz - np.float32(iz)
    # Unsigned, see above.
    low, line, layer = np.uint64((iz * height + iy) * width + ix), np.uint64(width), np.uint64(height * width)
    high = low + layer
    a = filled[low] + wx * (filled[low + _NEXT] - filled[low])
    b = filled[low + line] + wx * (filled[low + line + _NEXT] - filled[low + line])
    c = filled[high] + wx * (filled[high + _NEXT] - filled[high])
    d = filled[high + line] + wx * (filled[high + line + _NEXT] - filled[high + line])
    a += wy * (b - a)
    c += wy * (d - c)
    return a + wz * (c - a)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _openness(filled, depth, height, width, gx, gy, gz, nx, ny, nz):
    """How much ambient light reaches a point: one cone of three steps through the grid of filled space.

    Source: after Crassin et al., Interactive Indirect Illumination Using Voxel Cone Tracing, 2011.

    Args:
        filled: as in ``_density``.
        depth: see filled.
        height: see filled.
        width: see filled.
        gx: the point, as in ``_density``; likewise gy and gz.
        gy: see gx.
        gz: see gx.
        nx: x of the unit normal of the surface there; likewise ny and nz.
        ny: see nx.
        nz: see nx.

    Returns:
        From 0.3 (enclosed) to 1 (open).
    """
    through, step = _ONE, np.float32(1.6)
    for _ in range(3):
        here = _density(filled, depth, height, width, gx + step * nx, gy + step * ny, gz + step * nz)
        through *= _ONE - min(here, np.float32(0.85))
        step += step
    return np.float32(0.3) + np.float32(0.7) * through
