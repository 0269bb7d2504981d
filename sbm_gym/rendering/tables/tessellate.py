"""Turns every drawable MuJoCo geom into triangles with normals and texture coordinates, in the geom's own frame.

Texture coordinates follow MuJoCo's classic OpenGL renderer, so that both renderers put the same texel in the same
place. Source: MuJoCo, ``src/render/classic/render_context.c`` (shapes) and ``render_gl3.c``, ``settexture`` (scaling).
"""

import functools
import math
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Float32
from numba import njit

from sbm_gym.rendering.tables.looks import DrawnMesh

MAX_SAGITTA_M = 1e-4
"""How far a flat facet may lie inside the circle it stands for: a tenth of the depth agreement asked for."""
MIN_SEGMENTS, MAX_SEGMENTS = 24, 256
"""Facets around a full circle: enough for a round outline, bounded for very large shapes."""


@dataclass(frozen=True)
class TextureMapping:
    """How a material lays its texture on a geom."""

    is_cube: bool = False
    """A cube texture is looked up by direction; a 2-D one by (u, v)."""
    repeat: tuple[float, float] = (1.0, 1.0)
    """``texrepeat`` of the material."""
    uniform: bool = False
    """``texuniform``: ``repeat`` counts per metre instead of per object."""


@dataclass(frozen=True)
class Surface:
    """Triangles in the frames of their geoms, metres."""

    corners: Float32[np.ndarray, "n 3 3"]
    normals: Float32[np.ndarray, "n 3 3"]
    """Unit normals at the corners."""
    texture_coordinates: Float32[np.ndarray, "n 3 3"]
    """(u, v, 0) with row 0 of the picture at v = 0, or a direction for cube textures."""

    def rows(self, start: int, stop: int) -> "Surface":
        """Some of the triangles; shares their arrays."""
        return Surface(self.corners[start:stop], self.normals[start:stop], self.texture_coordinates[start:stop])

    def put(self, start: int, other: "Surface | None") -> int:
        """Copies triangles over those from ``start`` on, and returns how many."""
        if other is None:
            return 0
        rows = self.rows(start, start + len(other.corners))
        rows.corners[:], rows.normals[:], rows.texture_coordinates[:] = vars(other).values()
        return len(other.corners)


def tessellate_geom(model: mujoco.MjModel, geom_id: int, mapping: TextureMapping) -> Surface | None:
    """Triangles of a geom of any type but a mesh that has a finite surface.

    Args:
        model: the compiled model.
        geom_id: which geom.
        mapping: the texture mapping of its material.

    Returns:
        The surface, or None for types that have no triangles here (planes, which are intersected exactly instead).
    """
    kind = int(model.geom_type[geom_id])
    size = np.asarray(model.geom_size[geom_id], float)
    types = mujoco.mjtGeom
    if kind == types.mjGEOM_BOX:
        return _box(size, mapping)
    if kind == types.mjGEOM_SPHERE:
        return _ellipsoid(np.repeat(size[0], 3), mapping)
    if kind == types.mjGEOM_ELLIPSOID:
        return _ellipsoid(size, mapping)
    if kind == types.mjGEOM_CYLINDER:
        return _cylinder(size[0], size[1], mapping)
    if kind == types.mjGEOM_CAPSULE:
        return _capsule(size[0], size[1], mapping)
    if kind == types.mjGEOM_HFIELD and model.geom_dataid[geom_id] >= 0:
        return _height_field(model, int(model.geom_dataid[geom_id]), size, mapping)
    return None


def write_mesh(mesh: DrawnMesh, size: Float[np.ndarray, "3"], mapping: TextureMapping, rows: Surface) -> int:
    """Writes the triangles of a mesh that have an area, in its order.

    Args:
        mesh: the mesh.
        size: of the geom that shows it.
        mapping: the texture mapping of its material.
        rows: as many as the mesh has faces; gets the triangles in its first rows.

    Returns:
        How many there are.
    """
    # Texture coordinates are a multiple of what they come from, less a shift: -0.0 stays what it is.
    source, indices, axes, shift = mesh.vertices_m, mesh.faces, 2, 0.0
    if mapping.is_cube:
        factor, axes = size if mapping.uniform else np.ones(3), 3
    elif mesh.texcoords is None:
        factor, shift = 0.5 * _generated_scale(size, mapping), 0.5
    else:
        source, indices, factor = mesh.texcoords, mesh.texcoords_of_faces, np.array(_explicit_scale(size, mapping))
    _gather_corners(mesh.vertices_m, mesh.faces, rows.corners)
    _gather_normals(mesh.normals, mesh.normals_of_faces, rows.normals)
    _gather_coordinates(source, indices, factor, axes, shift, rows.texture_coordinates)
    solid = twice_areas(rows.corners) > 0
    if solid.all():
        return len(solid)
    count = int(np.count_nonzero(solid))
    for column in (rows.corners, rows.normals, rows.texture_coordinates):
        column[:count] = column[solid]
    return count


@njit(cache=True, nogil=True)
def _gather_corners(vertices_m, faces, corners):
    for n in range(len(faces)):
        for corner in range(3):
            for axis in range(3):
                corners[n, corner, axis] = vertices_m[faces[n, corner], axis]


@njit(cache=True, nogil=True)
def _gather_normals(of_mesh, indices, normals):
    for n in range(len(indices)):
        for corner in range(3):
            x, y, z = of_mesh[indices[n, corner]]
            # A zero normal (from a degenerate face) would shade black.
            if x * x + y * y + z * z < 0.25:
                x, y, z = np.float32(0.0), np.float32(0.0), np.float32(1.0)
            normals[n, corner, 0], normals[n, corner, 1], normals[n, corner, 2] = x, y, z


@njit(cache=True, nogil=True)
def _gather_coordinates(source, indices, factor, axes, shift, coordinates):
    for n in range(len(indices)):
        for corner in range(3):
            coordinates[n, corner, 2] = 0.0
            for axis in range(axes):
                coordinates[n, corner, axis] = source[indices[n, corner], axis] * factor[axis] - shift


def plane_texture_coordinates(
    size: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"], mapping: TextureMapping
) -> Float[np.ndarray, "n 3"]:
    """Texture coordinates of points of a plane geom; they are linear in the point, also on infinite planes."""
    if mapping.is_cube:
        return points.copy()
    scale = _explicit_scale(size, mapping)
    coordinates = np.zeros_like(points)
    infinite = size[0] <= 0 or size[1] <= 0
    for axis, sign in ((0, 1.0), (1, -1.0)):
        extent = size[axis] if size[axis] > 0 else 1.0
        unscaled = sign * 0.5 * points[:, axis] / extent + (0.5 if size[axis] > 0 else 0.0)
        coordinates[:, axis] = scale[axis] * unscaled - (0.5 if infinite else 0.0)
    return coordinates


def _explicit_scale(size, mapping: TextureMapping) -> tuple[float, float]:
    scale = [repeat if repeat > 0 else 1.0 for repeat in mapping.repeat]
    if mapping.uniform:
        scale = [s * size[axis] if size[axis] > 0 else s for axis, s in enumerate(scale)]
    return scale[0], scale[1]


def _finish(corners, normals, uv, unit_coordinates, size, mapping: TextureMapping) -> Surface:
    """Applies the material's mapping and drops triangles without area (at the poles of spheres)."""
    coordinates = np.zeros(corners.shape, np.float32)
    if mapping.is_cube:
        coordinates[:] = unit_coordinates * (np.asarray(size) if mapping.uniform else 1.0)
    else:
        coordinates[..., :2] = uv * np.asarray(_explicit_scale(size, mapping))
    arrays = [np.asarray(column, np.float32) for column in (corners, normals, coordinates)]
    solid = twice_areas(corners) > 0
    return Surface(*(arrays if solid.all() else (column[solid] for column in arrays)))


@njit(cache=True, nogil=True)
def twice_areas(triangles):
    """Twice the area of each triangle of (n, 3, 3) corners."""
    areas = np.empty(len(triangles))
    for n in range(len(triangles)):
        areas[n] = twice_area(triangles[n])
    return areas


@njit(cache=True, nogil=True)
def twice_areas_of_faces(vertices, faces):
    """Twice the area of each of (n, 3) faces of a mesh."""
    areas = np.empty(len(faces))
    triangle = np.empty((3, 3), vertices.dtype)
    for n in range(len(faces)):
        for corner in range(3):
            triangle[corner] = vertices[faces[n, corner]]
        areas[n] = twice_area(triangle)
    return areas


@njit(cache=True, nogil=True)
def twice_area(triangle):
    """Twice the area of a triangle of (3, 3) corners."""
    # Numba's float() would leave single precision as it is.
    ax, ay, az = np.float64(triangle[0, 0]), np.float64(triangle[0, 1]), np.float64(triangle[0, 2])
    ux, uy, uz = triangle[1, 0] - ax, triangle[1, 1] - ay, triangle[1, 2] - az
    vx, vy, vz = triangle[2, 0] - ax, triangle[2, 1] - ay, triangle[2, 2] - az
    cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return math.sqrt(cx * cx + cy * cy + cz * cz)


def _grid_triangles(*grids) -> list[np.ndarray]:
    """Splits each cell of (rows, columns, k) grids of vertices into two triangles: arrays of (n, 3, k)."""
    triangles = []
    for grid in grids:
        a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
        halves = [np.stack(corner, axis=2).reshape(-1, 3, grid.shape[-1]) for corner in ((a, b, c), (a, c, d))]
        triangles.append(np.concatenate(halves))
    return triangles


def _segments(radius_m: float) -> int:
    """Facets around a circle such that none lies deeper than the allowed sagitta; a multiple of four."""
    if radius_m <= MAX_SAGITTA_M:
        return MIN_SEGMENTS
    wanted = np.pi / np.arccos(1.0 - MAX_SAGITTA_M / radius_m)
    return 4 * int(np.ceil(np.clip(wanted, MIN_SEGMENTS, MAX_SEGMENTS) / 4))


def _box(size, mapping: TextureMapping) -> Surface:
    unit, normals, uv = _unit_box()
    return _finish(unit * size, normals, uv, unit, size, mapping)


@functools.cache
def _unit_box() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners, normals and texture coordinates of a box of half size one."""
    # Per face: outward axis and sign, then the axes along which u and -v grow. Source: makeBuiltin, mjrBOX.
    faces = ((2, 1, (0, 1), 1), (2, -1, (0, 1), -1), (0, 1, (1, 2), 1), (0, -1, (1, 2), -1))
    faces += ((1, -1, (0, 2), 1), (1, 1, (0, 2), -1))
    corners, normals, uv = [], [], []
    for axis, sign, (u_axis, v_axis), v_sign in faces:
        quad, quad_uv = np.zeros((4, 3)), np.zeros((4, 2))
        for index, (s, t) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
            quad[index, axis], quad[index, u_axis], quad[index, v_axis] = sign, s, t
            quad_uv[index] = 0.5 + 0.5 * s, 0.5 - 0.5 * v_sign * t
        normal = np.zeros((3, 3))
        normal[:, axis] = sign
        for corner in ((0, 1, 2), (0, 2, 3)):
            corners.append(quad[list(corner)])
            uv.append(quad_uv[list(corner)])
            normals.append(normal)
    return np.array(corners), np.array(normals), np.array(uv)


def _ellipsoid(size, mapping: TextureMapping) -> Surface:
    around = _segments(float(np.max(size)))
    azimuth = np.linspace(0.0, 2.0 * np.pi, around + 1)
    polar = np.linspace(0.0, np.pi, around // 2 + 1)[:, None]
    unit = _sphere_points(polar, azimuth)
    uv = np.stack(np.broadcast_arrays(azimuth / (2 * np.pi), polar / np.pi), axis=-1)
    normals = unit / size
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return _joined([_grid_triangles(unit * size, normals, uv, unit)], size, mapping)


def _sphere_points(polar, azimuth) -> np.ndarray:
    x, y, z = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar) + 0.0 * azimuth
    return np.stack([x, y, z], axis=-1)


def _tube(radius_m: float, half_length_m: float) -> list[np.ndarray]:
    azimuth = np.linspace(0.0, 2.0 * np.pi, _segments(radius_m) + 1)
    height = np.array([[1.0], [-1.0]])
    unit = np.stack(np.broadcast_arrays(np.cos(azimuth), np.sin(azimuth), height), axis=-1)
    uv = np.stack(np.broadcast_arrays(azimuth / (2 * np.pi), 0.5 - 0.5 * height), axis=-1)
    normals = unit * [1.0, 1.0, 0.0]
    return _grid_triangles(unit * [radius_m, radius_m, half_length_m], normals, uv, unit)


def _joined(parts: list[list[np.ndarray]], size, mapping: TextureMapping) -> Surface:
    corners, normals, uv, unit = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return _finish(corners, normals, uv, unit, size, mapping)


def _cylinder(radius_m: float, half_length_m: float, mapping: TextureMapping) -> Surface:
    size = np.array([radius_m, radius_m, half_length_m])
    azimuth = np.linspace(0.0, 2.0 * np.pi, _segments(radius_m) + 1)
    ring = np.array([[0.0], [1.0]])
    parts = [_tube(radius_m, half_length_m)]
    for sign in (1.0, -1.0):
        unit = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), sign + 0.0 * ring * azimuth], axis=-1)
        normals = np.broadcast_to([0.0, 0.0, sign], unit.shape)
        parts.append(_grid_triangles(unit * size, normals, 0.5 + 0.5 * unit[..., :2], unit))
    return _joined(parts, size, mapping)


def _capsule(radius_m: float, half_length_m: float, mapping: TextureMapping) -> Surface:
    size = np.array([radius_m, radius_m, half_length_m])
    around = _segments(radius_m)
    azimuth = np.linspace(0.0, 2.0 * np.pi, around + 1)
    parts = [_tube(radius_m, half_length_m)]
    for sign in (1.0, -1.0):
        elevation = np.linspace(0.0, 0.5 * np.pi, around // 4 + 1)[:, None]
        unit = _sphere_points(0.5 * np.pi - sign * elevation, azimuth)
        along = elevation / (0.5 * np.pi)
        uv = np.stack(np.broadcast_arrays(azimuth / (2 * np.pi), 1.0 - along if sign > 0 else along), axis=-1)
        offset = np.array([0.0, 0.0, sign])
        parts.append(_grid_triangles(unit * radius_m + offset * half_length_m, unit, uv, unit + offset))
    return _joined(parts, size, mapping)


def _generated_scale(size, mapping: TextureMapping) -> Float[np.ndarray, "2"]:
    """Texture coordinates of shapes that bring none of their own: this times half the local position, less a half."""
    scale = np.asarray(mapping.repeat, float)
    if not mapping.uniform:
        scale = np.where(size[:2] > 0, scale / np.maximum(size[:2], mujoco.mjMINVAL), scale)
    return scale * [1.0, -1.0]


def _finish_generated(corners, normals, size, mapping: TextureMapping) -> Surface:
    """Finishes a shape that brings no texture coordinates of its own."""
    if mapping.is_cube:
        return _finish(corners, normals, None, corners, size, mapping)
    uv = 0.5 * corners[..., :2] * _generated_scale(size, mapping) - 0.5
    return _finish(corners, normals, uv, corners, size, TextureMapping())


def _height_field(model: mujoco.MjModel, field_id: int, size, mapping: TextureMapping) -> Surface:
    rows, columns = int(model.hfield_nrow[field_id]), int(model.hfield_ncol[field_id])
    start = int(model.hfield_adr[field_id])
    half_x, half_y, top, bottom = (float(s) for s in model.hfield_size[field_id])
    height = top * np.asarray(model.hfield_data[start : start + rows * columns], float).reshape(rows, columns)
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    points = np.stack([x, y, height], axis=-1)
    slope_y, slope_x = np.gradient(height, 2 * half_y / (rows - 1), 2 * half_x / (columns - 1))
    normals = np.stack([-slope_x, -slope_y, np.ones_like(height)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    parts = [_grid_triangles(points, normals)]
    for edge, outward in (
        (points[:, 0], (-1, 0, 0)),
        (points[:, -1], (1, 0, 0)),
        (points[0], (0, -1, 0)),
        (points[-1], (0, 1, 0)),
    ):
        skirt = np.stack([edge, edge * [1, 1, 0] - [0, 0, bottom]])
        parts.append(_grid_triangles(skirt, np.broadcast_to(np.array(outward, float), skirt.shape)))
    floor = np.array([[[sx * half_x, sy * half_y, -bottom] for sx in (-1, 1)] for sy in (-1, 1)])
    parts.append(_grid_triangles(floor, np.broadcast_to([0.0, 0.0, -1.0], floor.shape)))
    corners, normals = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return _finish_generated(corners, normals, size, mapping)
