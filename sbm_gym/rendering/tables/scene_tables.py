"""Flat per-triangle and per-geom tables of everything in a model that is drawn."""

import math
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
    twice_areas,
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

    Rows are those of things that stand still, of things that move, and one for each plane.
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
        """Tessellates a model's visible geoms; they stand nowhere until they are placed.

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
        moving = _moves(model)
        surfaces: dict[int, Surface] = {}
        for geom in np.flatnonzero(visible).tolist():
            if geom not in plane_geoms:
                surface = _surface(model, looks, geom, _mapping(model, looks, geom))
                if surface is not None and len(surface.corners):
                    surfaces[geom] = surface
        runs: list[GeomSpan] = []
        rows = np.zeros((model.ngeom, 2), np.int64)
        row = 0
        for is_moving in (False, True):
            for is_special in (False, True):
                members = [g for g in surfaces if moving[g] == is_moving and (geoms.kind[g] != SOLID) == is_special]
                start = row
                for geom in members:
                    rows[geom] = row, row + len(surfaces[geom].corners)
                    row += len(surfaces[geom].corners)
                runs.append(GeomSpan(members, start, row))
        ordered = [surfaces[geom] for run in runs for geom in run.geoms]
        ordered += [_plane_triangle(model, geom, _mapping(model, looks, geom)) for geom in plane_geoms]
        for index, geom in enumerate(plane_geoms):
            rows[geom] = row + index, row + index + 1
        if not ordered:
            ordered = [_surface_of(*(np.zeros((0, 3, 3)) for _ in range(3)))]
        local_corners = np.concatenate([s.corners for s in ordered])
        coordinates = np.concatenate([s.texture_coordinates for s in ordered])
        count = len(coordinates)
        geom_column = np.zeros(count, np.int32)
        for geom, (start, stop) in enumerate(rows.tolist()):
            geom_column[start:stop] = geom
        half_size = np.asarray(model.geom_size[plane_geoms, :2], float).reshape(-1, 2)
        planes = len(plane_geoms)
        return cls(
            geoms,
            plane_geoms,
            runs,
            rows,
            TriangleTable(
                normals=np.zeros((count, 3, 3), np.float32),
                face_normals=np.zeros((count, 3), np.float32),
                texture_coordinates=coordinates,
                log2_texels_per_m=_log2_density(local_corners, coordinates, geoms.texture[geom_column], textures),
                geom=geom_column,
            ),
            np.zeros((count, 3, 3), np.float32),
            PlaneTable(np.zeros((planes, 3)), np.zeros((planes, 3, 3)), np.where(half_size > 0, half_size, np.inf)),
            local_corners,
            np.concatenate([s.normals for s in ordered]),
        )

    def place(self, data: mujoco.MjData, geoms: list[int]) -> None:
        """Moves the triangles of these geoms to where ``data`` has them."""
        kept = len(self.corners) - len(self.local_corners)
        for geom in geoms:
            start, stop = self.geom_span[geom]
            rotation = np.asarray(data.geom_xmat[geom], float).reshape(3, 3)
            position = np.asarray(data.geom_xpos[geom], float)
            corners = _turned(self.local_corners[start - kept : stop - kept], rotation) + position
            self.corners[start:stop] = corners
            self.triangles.normals[start:stop] = _turned(self.local_normals[start - kept : stop - kept], rotation)
            _face_normals(corners, self.triangles.face_normals[start:stop])
            if start >= self.first_plane:
                self.planes.origin[start - self.first_plane] = position
                self.planes.axes[start - self.first_plane] = rotation.T

    def at_rest(self) -> "SceneTables":
        """The same without what is needed only to place again what stands still; shares its arrays."""
        first = self.spans[True, False].start - len(self.corners)
        moving = slice(first, None) if first else slice(len(self.local_corners), None)
        return replace(self, local_corners=self.local_corners[moving], local_normals=self.local_normals[moving])

    def take_down(self, poses: Float[np.ndarray, "k 12"], geoms: list[int]) -> None:
        """Finds out, to within rounding, what ``at_rest`` has left out.

        Args:
            poses: where the geoms stand: position, and rotation row by row.
            geoms: all that stand still.
        """
        if len(self.local_corners) == len(self.corners):
            return
        kept = [np.zeros((len(self.corners) - len(self.local_corners), 3, 3), np.float32) for _ in range(2)]
        for geom, pose in zip(geoms, poses, strict=True):
            rows, back = slice(*self.geom_span[geom]), pose[3:].reshape(3, 3).T
            kept[0][rows] = _turned(self.corners[rows] - pose[:3], back)
            kept[1][rows] = _turned(self.triangles.normals[rows], back)
        self.local_corners = np.concatenate([kept[0], self.local_corners])
        self.local_normals = np.concatenate([kept[1], self.local_normals])


CHUNK = 2048
"""Triangles that are turned at a time: products of larger matrices start threads, which cost more than they gain."""


def _turned(triangles: Float32[np.ndarray, "n 3 3"], rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The vectors of triangles, turned."""
    turned = np.empty(triangles.shape)
    flat = triangles.reshape(-1, 3)
    for start in range(0, len(flat), 3 * CHUNK):
        rows = slice(start, start + 3 * CHUNK)
        turned.reshape(-1, 3)[rows] = flat[rows].astype(float) @ rotation.T
    return turned


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


def _surface(model: mujoco.MjModel, looks: Looks, geom: int, mapping: TextureMapping) -> Surface | None:
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE:
        return tessellate_geom(model, looks, geom, mapping)
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


def _log2_density(
    corners: Float32[np.ndarray, "n 3 3"],
    coordinates: Float32[np.ndarray, "n 3 3"],
    texture: Int[np.ndarray, "n"],
    textures: TextureStore,
) -> Float32[np.ndarray, "n"]:
    """log2 of texels per metre: the square root of the ratio of a triangle's areas on the texture and in space."""
    log2_density = np.zeros(len(texture), np.float32)
    textured = np.flatnonzero(texture >= 0)
    texture = texture[textured]
    scaled = coordinates[textured].astype(float)
    size = textures.level_size[texture, 0].astype(float)
    cube = textures.is_cube[texture] > 0
    if cube.any():
        # A direction's place on a cube of half size one: a face of w texels is two units wide.
        on_cube = scaled[cube] / np.maximum(np.abs(scaled[cube]).max(axis=-1, keepdims=True), 1e-12)
        scaled[cube] = 0.5 * on_cube * size[cube, :1, None]
    scaled[~cube, :, 0] *= size[~cube, :1]
    scaled[~cube, :, 1] *= size[~cube, 1:]
    density = np.sqrt(twice_areas(scaled) / np.maximum(twice_areas(corners[textured]), 1e-18))
    log2_density[textured] = np.log2(np.maximum(density, 1e-6))
    return log2_density
