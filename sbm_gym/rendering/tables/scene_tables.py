"""Flat per-triangle and per-geom tables of everything in a model that is drawn."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32
from numba import njit

from sbm_gym.rendering.tables.looks import Looks
from sbm_gym.rendering.tables.tessellate import (
    Surface,
    TextureMapping,
    plane_texture_coordinates,
    tessellate_geom,
    twice_area,
    write_mesh,
)
from sbm_gym.rendering.tables.textures import TextureStore, has_holes_in, srgb_decode

FIRST_HIDDEN_GROUP = 3
"""MuJoCo's viewers hide geom groups from here on."""
OPAQUE_ALPHA = 0.995
"""Geoms below this opacity are drawn as glass. Source: MuJoCo, ``render_gl3.c``, the list of transparent geoms."""
SOLID, HOLES, GLASS = 0, 1, 2
_DEFAULT_GEOM_RGBA = np.array([0.5, 0.5, 0.5, 1.0])
_DEFAULT_GLOSS = (0.5, 0.5)
"""Specular and shininess of geoms without a material, as MuJoCo's visualiser sets them."""


class TriangleTable(NamedTuple):
    """What kernels need to know about triangles, world frame. The last rows stand for planes."""

    normals: Float32[np.ndarray, "n 3 3"]
    face_normals: Float32[np.ndarray, "n 3"]
    texture_coordinates: Float32[np.ndarray, "n 3 3"]
    log2_texels_per_m: Float32[np.ndarray, "n"]
    geom: Int32[np.ndarray, "n"]


class GeomTable(NamedTuple):
    """How each geom looks."""

    colour: Float32[np.ndarray, "g 3"]
    """Linear light."""
    alpha: Float32[np.ndarray, "g"]
    emission: Float32[np.ndarray, "g"]
    specular: Float32[np.ndarray, "g"]
    gloss_exponent: Float32[np.ndarray, "g"]
    gloss_cosine: Float32[np.ndarray, "g"]
    """Where the half-way direction leaves the normal by more, gloss is below a thousandth."""
    texture: Int32[np.ndarray, "g"]
    """-1 for none."""
    kind: Int32[np.ndarray, "g"]
    """0 solid, 1 with holes where its texture is transparent, 2 glass."""


class PlaneTable(NamedTuple):
    """Plane geoms, which are intersected exactly. One-sided, as in ``mj_ray``."""

    origin: Float[np.ndarray, "p 3"]
    axes: Float[np.ndarray, "p 3 3"]
    """Rows: the plane's x and y axes and its normal, in the world."""
    half_size: Float[np.ndarray, "p 2"]
    """Infinite where the plane is."""


@dataclass
class GeomSpan:
    """Where the triangles of a run of geoms stand in the tables."""

    geoms: list[int]
    start: int
    stop: int


@dataclass
class SceneTables:
    """Every drawn triangle of a model; world-frame columns follow the bodies through ``place``.

    Rows are those of things that stand still, of things that move, and one for each plane. Rows of things that stand
    still are in the geoms' own frames until they are placed for the first time.
    """

    geoms: GeomTable
    plane_geoms: list[int]
    runs: list[GeomSpan]
    """Solid and special (with holes, or of glass) geoms that stand still, then those that move."""
    rows: Int[np.ndarray, "g 2"]
    """First row of each geom's triangles, and the first that is not its own; both 0 for geoms that have none."""
    triangles: TriangleTable
    corners: Float32[np.ndarray, "n 3 3"]
    planes: PlaneTable
    local_corners: Float32[np.ndarray, "m 3 3"]
    """In the geoms' own frames: of the last rows, as many as may have to be placed again."""
    local_normals: Float32[np.ndarray, "m 3 3"]

    def __post_init__(self) -> None:
        keys = ((False, False), (False, True), (True, False), (True, True))
        self.spans: dict[tuple[bool, bool], GeomSpan] = dict(zip(keys, self.runs, strict=True))
        """By whether they move and whether they are special."""
        self.first_plane = self.runs[-1].stop
        self.geom_span: dict[int, tuple[int, int]] = {
            geom: (start, stop) for geom, (start, stop) in enumerate(self.rows.tolist()) if stop > start
        }

    @classmethod
    def of_model(cls, model: mujoco.MjModel, looks: Looks, textures: TextureStore) -> "SceneTables":
        """Tessellates a model's visible geoms; they stand nowhere until all of them are placed.

        Args:
            model: the compiled model.
            looks: its meshes and pictures.
            textures: the pictures as textures.
        """
        geoms = _geom_table(model, looks, textures)
        visible = visible_geoms(model)
        plane_geoms = [
            geom
            for geom in np.flatnonzero(visible).tolist()
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE and geoms.kind[geom] == SOLID
        ]
        local, runs, rows = _tessellate(model, looks, geoms.kind != SOLID, visible, plane_geoms)
        count = len(local.corners)
        geom_column = np.zeros(count, np.int32)
        for geom, (start, stop) in enumerate(rows.tolist()):
            geom_column[start:stop] = geom
        half_size = np.asarray(model.geom_size[plane_geoms, :2], float).reshape(-1, 2)
        planes, first_moving = len(plane_geoms), runs[2].start
        return cls(
            geoms,
            plane_geoms,
            runs,
            rows,
            TriangleTable(
                normals=local.normals,
                face_normals=np.zeros((count, 3), np.float32),
                texture_coordinates=local.texture_coordinates,
                log2_texels_per_m=_log2_density(local, geoms.texture[geom_column], textures),
                geom=geom_column,
            ),
            local.corners,
            PlaneTable(np.zeros((planes, 3)), np.zeros((planes, 3, 3)), np.where(half_size > 0, half_size, np.inf)),
            local.corners[first_moving:].copy(),
            local.normals[first_moving:].copy(),
        )

    def place(self, data: mujoco.MjData, geoms: list[int]) -> None:
        """Moves the triangles of these geoms to where ``data`` has them."""
        kept = len(self.corners) - len(self.local_corners)
        for geom in geoms:
            start, stop = self.geom_span[geom]
            rotation = np.asarray(data.geom_xmat[geom], float).reshape(3, 3)
            position = np.asarray(data.geom_xpos[geom], float)
            for rows in _chunks(start, stop):
                local_corners, local_normals = self.corners[rows], self.triangles.normals[rows]
                if start >= kept:
                    local = slice(rows.start - kept, rows.stop - kept)
                    local_corners, local_normals = self.local_corners[local], self.local_normals[local]
                corners = _turned(local_corners, rotation) + position
                self.corners[rows] = corners
                self.triangles.normals[rows] = _turned(local_normals, rotation)
                _face_normals(corners, self.triangles.face_normals[rows])
            if start >= self.first_plane:
                self.planes.origin[start - self.first_plane] = position
                self.planes.axes[start - self.first_plane] = rotation.T

    def at_rest(self) -> "SceneTables":
        """The same without what is needed only to place again what stands still; shares its arrays."""
        first = self.spans[True, False].start - len(self.corners)
        moving = slice(first, None) if first else slice(len(self.local_corners), None)
        return replace(self, local_corners=self.local_corners[moving], local_normals=self.local_normals[moving])

    def take_down(self, poses: Float[np.ndarray, "k 12"], geoms: list[int]) -> None:
        """Finds out, to within rounding, what is not kept of things that stand still.

        Args:
            poses: where the geoms stand: position, and rotation row by row.
            geoms: all that stand still.
        """
        if len(self.local_corners) == len(self.corners):
            return
        kept = [np.zeros((len(self.corners) - len(self.local_corners), 3, 3), np.float32) for _ in range(2)]
        for geom, pose in zip(geoms, poses, strict=True):
            back = pose[3:].reshape(3, 3).T
            for rows in _chunks(*self.geom_span[geom]):
                kept[0][rows] = _turned(self.corners[rows] - pose[:3], back)
                kept[1][rows] = _turned(self.triangles.normals[rows], back)
        self.local_corners = np.concatenate([kept[0], self.local_corners])
        self.local_normals = np.concatenate([kept[1], self.local_normals])


CHUNK = 2048
"""Triangles that are turned at a time: products of larger matrices start threads, which cost more than they gain."""


def _chunks(start: int, stop: int) -> Iterator[slice]:
    """Rows of a geom, a chunk at a time."""
    for first in range(start, stop, CHUNK):
        yield slice(first, min(first + CHUNK, stop))


def _turned(triangles: Float32[np.ndarray, "n 3 3"], rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The vectors of a chunk of triangles, turned."""
    return (triangles.reshape(-1, 3).astype(float) @ rotation.T).reshape(-1, 3, 3)


@njit(cache=True, nogil=True)
def _face_normals(corners, normals):
    """Unit normals of triangles, 0 where a triangle has no area."""
    for n in range(len(corners)):
        ax, ay, az = corners[n, 0, 0], corners[n, 0, 1], corners[n, 0, 2]
        ux, uy, uz = corners[n, 1, 0] - ax, corners[n, 1, 1] - ay, corners[n, 1, 2] - az
        vx, vy, vz = corners[n, 2, 0] - ax, corners[n, 2, 1] - ay, corners[n, 2, 2] - az
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = max(math.sqrt(x * x + y * y + z * z), 1e-30)
        normals[n, 0], normals[n, 1], normals[n, 2] = x / length, y / length, z / length


def visible_geoms(model: mujoco.MjModel) -> Bool[np.ndarray, "ngeom"]:
    """Which geoms are drawn: groups 0 to 2 that are not wholly transparent."""
    groups = np.clip(model.geom_group, 0, mujoco.mjNGROUP - 1)
    return (groups < FIRST_HIDDEN_GROUP) & (_geom_rgba(model)[:, 3] > 0)


def geom_kinds(model: mujoco.MjModel) -> Int32[np.ndarray, "ngeom"]:
    """Whether each geom is solid, has holes where its texture is transparent, or is glass."""
    looks = Looks.of_model(model)
    has_holes = np.array([has_holes_in(picture) for picture in looks.pictures], bool)
    return _geom_kinds(_geom_rgba(model), _geom_textures(model, looks), has_holes)


def _geom_kinds(rgba, texture, has_holes) -> Int32[np.ndarray, "ngeom"]:
    kind = np.full(len(rgba), SOLID, np.int32)
    if len(has_holes):
        kind[(texture >= 0) & has_holes[np.maximum(texture, 0)]] = HOLES
    kind[rgba[:, 3] < OPAQUE_ALPHA] = GLASS
    return kind


def _geom_textures(model: mujoco.MjModel, looks: Looks) -> Int32[np.ndarray, "ngeom"]:
    """The texture of each geom, -1 for none."""
    texture = np.full(model.ngeom, -1, np.int32)
    has_material = model.geom_matid >= 0
    texture[has_material] = looks.texture_of_material[model.geom_matid[has_material]]
    return texture


def _geom_rgba(model: mujoco.MjModel) -> Float[np.ndarray, "ngeom 4"]:
    """The geom's own colour where it is set, else its material's. Source: MuJoCo, ``setMaterial``."""
    rgba = np.asarray(model.geom_rgba, float).copy()
    inherits = (model.geom_matid >= 0) & np.all(rgba == _DEFAULT_GEOM_RGBA, axis=1)
    rgba[inherits] = model.mat_rgba[model.geom_matid[inherits]]
    return rgba


def _geom_table(model: mujoco.MjModel, looks: Looks, textures: TextureStore) -> GeomTable:
    rgba = _geom_rgba(model)
    material = model.geom_matid
    has_material = material >= 0
    specular, shininess = (np.full(model.ngeom, value) for value in _DEFAULT_GLOSS)
    emission, texture = np.zeros(model.ngeom), _geom_textures(model, looks)
    if has_material.any():
        chosen = material[has_material]
        specular[has_material] = model.mat_specular[chosen]
        shininess[has_material] = model.mat_shininess[chosen]
        emission[has_material] = model.mat_emission[chosen]
    return GeomTable(
        colour=srgb_decode(np.clip(rgba[:, :3], 0.0, 1.0)).astype(np.float32),
        alpha=rgba[:, 3].astype(np.float32),
        emission=emission.astype(np.float32),
        specular=specular.astype(np.float32),
        # OpenGL's exponent is 128 times MuJoCo's shininess. Source: MuJoCo, render_gl3.c.
        gloss_exponent=(128.0 * shininess).astype(np.float32),
        gloss_cosine=np.where(shininess > 0, 1e-3 ** (1.0 / np.maximum(128.0 * shininess, 1e-6)), 0).astype(np.float32),
        texture=texture,
        kind=_geom_kinds(rgba, texture, textures.has_holes > 0),
    )


def _mapping(model: mujoco.MjModel, looks: Looks, geom: int) -> TextureMapping:
    material = int(model.geom_matid[geom])
    if material < 0:
        return TextureMapping()
    texture = int(looks.texture_of_material[material])
    return TextureMapping(
        is_cube=texture >= 0 and looks.pictures[texture].is_cube,
        repeat=(float(model.mat_texrepeat[material, 0]), float(model.mat_texrepeat[material, 1])),
        uniform=bool(model.mat_texuniform[material]),
    )


def _moves(model: mujoco.MjModel) -> Bool[np.ndarray, "ngeom"]:
    """Geoms on bodies with a joint up the tree, or below a mocap body."""
    on_joint = model.body_weldid != 0
    on_mocap = model.body_mocapid[model.body_rootid] >= 0
    return (on_joint | on_mocap)[model.geom_bodyid]


INFINITE_GLASS_HALF_SIZE_M = 1000.0


def _tessellate(
    model: mujoco.MjModel,
    looks: Looks,
    special: Bool[np.ndarray, "ngeom"],
    visible: Bool[np.ndarray, "ngeom"],
    plane_geoms: list[int],
) -> tuple[Surface, list[GeomSpan], Int[np.ndarray, "ngeom 2"]]:
    """The triangles of all visible geoms in the order of ``SceneTables``; its ``runs`` and ``rows``."""
    moving = _moves(model)
    drawn = [geom for geom in np.flatnonzero(visible).tolist() if geom not in plane_geoms]
    meshes = {geom: looks.meshes[looks.mesh_of_geom[geom]] for geom in drawn if looks.mesh_of_geom[geom] >= 0}
    others = {geom: _surface(model, geom, _mapping(model, looks, geom)) for geom in drawn if geom not in meshes}
    most = sum(len(mesh.faces) for mesh in meshes.values()) + sum(len(one.corners) for one in others.values() if one)
    # Room for all at once: to gather them afterwards would take as much memory, and time, again.
    table = Surface(*(np.empty((most + len(plane_geoms), 3, 3), np.float32) for _ in range(3)))
    runs: list[GeomSpan] = []
    rows = np.zeros((model.ngeom, 2), np.int64)
    row = 0
    for is_moving in (False, True):
        for is_special in (False, True):
            run = GeomSpan([], row, row)
            for geom in drawn:
                if moving[geom] != is_moving or special[geom] != is_special:
                    continue
                if geom in meshes:
                    mesh, size = meshes[geom], np.asarray(model.geom_size[geom], float)
                    room = table.rows(row, row + len(mesh.faces))
                    count = write_mesh(mesh, size, _mapping(model, looks, geom), room)
                else:
                    count = table.put(row, others[geom])
                if count:
                    rows[geom] = row, row + count
                    run.geoms.append(geom)
                    row += count
            run.stop = row
            runs.append(run)
    for geom in plane_geoms:
        rows[geom] = row, row + table.put(row, _plane_triangle(model, geom, _mapping(model, looks, geom)))
        row += 1
    return table.rows(0, row), runs, rows


def _surface(model: mujoco.MjModel, geom: int, mapping: TextureMapping) -> Surface | None:
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE:
        return tessellate_geom(model, geom, mapping)
    # Planes that rays may pass through become two triangles, since only triangles take part in that loop.
    size = np.asarray(model.geom_size[geom], float)
    half = np.where(size[:2] > 0, size[:2], INFINITE_GLASS_HALF_SIZE_M)
    corners = np.array([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]]) * [*half, 1.0]
    coordinates = plane_texture_coordinates(size, corners.reshape(-1, 3), mapping).reshape(-1, 3, 3)
    return _surface_of(corners, np.broadcast_to([0.0, 0.0, 1.0], corners.shape), coordinates)


def _surface_of(corners, normals, coordinates) -> Surface:
    return Surface(*(np.asarray(column, np.float32) for column in (corners, normals, coordinates)))


def _plane_triangle(model: mujoco.MjModel, geom: int, mapping: TextureMapping) -> Surface:
    """One triangle with legs of one metre; a plane's hits have barycentric coordinates far outside it."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    coordinates = plane_texture_coordinates(np.asarray(model.geom_size[geom], float), corners, mapping)
    return _surface_of(corners[None], np.broadcast_to([0.0, 0.0, 1.0], (1, 3, 3)), coordinates[None])


def _log2_density(surface: Surface, texture: Int[np.ndarray, "n"], textures: TextureStore) -> Float32[np.ndarray, "n"]:
    """log2 of texels per metre: the square root of the ratio of a triangle's areas on the texture and in space."""
    log2_density = np.zeros(len(texture), np.float32)
    textured = np.flatnonzero(texture >= 0)
    size = textures.level_size[:, 0].astype(float)
    columns = (surface.corners, surface.texture_coordinates, textured, texture, size, textures.is_cube)
    log2_density[textured] = np.log2(np.maximum(_density(*columns), 1e-6))
    return log2_density


@njit(cache=True, nogil=True)
def _density(corners, coordinates, chosen, texture, size, is_cube):
    """Texels per metre of some triangles."""
    density = np.empty(len(chosen))
    on_texture = np.empty((3, 3))
    for k in range(len(chosen)):
        row = chosen[k]
        width, height = size[texture[row]]
        for corner in range(3):
            x, y, z = coordinates[row, corner]
            u, v, w = np.float64(x), np.float64(y), np.float64(z)
            if is_cube[texture[row]]:
                # A direction's place on a cube of half size one: a face of w texels is two units wide.
                longest = max(abs(u), abs(v), abs(w), 1e-12)
                u, v, w = 0.5 * (u / longest) * width, 0.5 * (v / longest) * width, 0.5 * (w / longest) * width
            else:
                u, v = u * width, v * height
            on_texture[corner, 0], on_texture[corner, 1], on_texture[corner, 2] = u, v, w
        density[k] = math.sqrt(twice_area(on_texture) / max(twice_area(corners[row]), 1e-18))
    return density
