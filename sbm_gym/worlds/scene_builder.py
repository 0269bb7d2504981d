"""Putting models, quads and boxes into an ``MjSpec``: geometry that is only drawn, and boxes that are only touched."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int, UInt8

from labeling.core.types import Box3d
from sbm_gym.assets.models.model import FurnitureModel
from sbm_gym.assets.models.surfaces import Material
from sbm_gym.rendering.tables.looks import DrawnMesh
from sbm_gym.worlds.geometry.placing import Placement, rotation, yaw_quaternion
from sbm_gym.worlds.left_out import LeftOut
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION, GEOM_GROUP_VISUAL, ObjectInstance

DRAWN: dict[str, Any] = {"group": GEOM_GROUP_VISUAL, "contype": 0, "conaffinity": 0, "mass": 0}
"""Settings of geoms that are drawn and never touched."""


def instance_of(piece: Placement, instance_id: int, body_name: str) -> ObjectInstance:
    """The object that a piece of a class with a name is.

    Args:
        piece: what stands where.
        instance_id: positive, unique within the world.
        body_name: the body that holds its geoms.
    """
    turn = np.eye(3)
    turn[:2, :2] = rotation(piece.yaw_rad)
    extent = np.array(piece.card.size_m, float)
    centre = np.array([piece.x_m, piece.y_m, piece.z_m + extent[2] / 2])
    assert piece.card.category is not None
    return ObjectInstance(instance_id, piece.card.category, body_name, Box3d(centre, extent, turn), piece.card.model_id)


def look_of(material: Material) -> dict[str, Any]:
    """Arguments of ``SceneBuilder.material`` for a building material."""
    return {"picture": material.texture, "specular": material.specular, "shininess": material.shininess}


def tiled_texcoords(corners_m: Float[np.ndarray, "q 4 3"], material: Material) -> Float[np.ndarray, "n 2"]:
    """Texture coordinates of the corners of quads, in step across quads of one plane."""
    normal = np.abs(_across(corners_m))
    # Roofs lie flatter than walls stand: they are covered from above unless they are nearly upright.
    steep = normal[:, 2] < 0.5 * normal[:, :2].max(axis=1)
    axis = np.where(steep, np.argmax(normal[:, :2], axis=1), 2)
    picks = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    plan = np.take_along_axis(corners_m, picks[:, None, :], axis=2)
    return (plan / np.array(material.size_m) * [1.0, -1.0]).reshape(-1, 2)


def _across(corners_m: Float[np.ndarray, "n c 3"]) -> Float[np.ndarray, "n 3"]:
    """The normals of flat polygons, as long as twice the area of their first three corners."""
    (ax, ay, az), (bx, by, bz) = (corners_m[:, corner].T - corners_m[:, 0].T for corner in (1, 2))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


class SceneBuilder:
    """Adds things to one ``MjSpec``. Meshes of a model and pictures are added once, however often they are used."""

    def __init__(self, spec: mujoco.MjSpec):
        """Builds into ``spec``.

        MuJoCo is told to keep no meshes of whole models: the few that come again in another scene of a process are
        prepared in 0.03 s, and all of them would take half a gigabyte.
        """
        mujoco.mj_setCacheCapacity(mujoco.mj_getCache(), 0)
        self.spec = spec
        self.left_out = LeftOut()
        """Meshes and pictures, which the spec does without until it is made whole."""
        self._meshes: dict[str, list[tuple[int, str]]] = {}
        self._textures: dict[int, int] = {}
        self._materials = 0

    def place(self, name: str, piece: Placement, *, moves: bool = False) -> mujoco.MjsBody:
        """Adds an empty body where a piece stands.

        Args:
            name: of the body.
            piece: what will stand there.
            moves: whether episodes put it elsewhere (a mocap body).
        """
        position_m, turn = [piece.x_m, piece.y_m, piece.z_m], yaw_quaternion(piece.yaw_rad)
        return self.spec.worldbody.add_body(name=name, pos=position_m, quat=turn, mocap=moves)

    def whole_spec(self) -> mujoco.MjSpec:
        """The spec with all meshes and pictures in it."""
        self.left_out.put_into(self.spec)
        return self.spec

    def texture(self, picture: UInt8[np.ndarray, "h w c"]) -> int:
        """Adds a picture (RGB or RGBA) and returns its number; the same array is added once."""
        if id(picture) not in self._textures:
            self._textures[id(picture)] = len(self.left_out.pictures)
            self.left_out.pictures.append(picture)  # the array is kept, so its id stays its own
        return self._textures[id(picture)]

    def material(
        self,
        *,
        rgba: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0),
        picture: UInt8[np.ndarray, "h w c"] | None = None,
        specular: float = 0.0,
        shininess: float = 0.3,
        emission: float = 0.0,
    ) -> str:
        """Adds a material and returns its name."""
        self._materials += 1
        material = self.spec.add_material(
            name=f"material_{self._materials}", rgba=rgba, specular=specular, shininess=shininess, emission=emission
        )
        if picture is not None:
            self.left_out.materials.append((material, self.texture(picture)))
        return material.name

    def mesh(
        self,
        vertices_m: Float[np.ndarray, "v 3"],
        normals: Float[np.ndarray, "v 3"],
        faces: Int[np.ndarray, "t 3"],
        texcoords: Float[np.ndarray, "v 2"] | None,
    ) -> int:
        """Adds a mesh with one normal (and texture coordinate) for each vertex, and returns its number."""
        points, directions = np.ascontiguousarray(vertices_m, np.float32), np.ascontiguousarray(normals, np.float32)
        corners = np.ascontiguousarray(faces, np.int32)
        mapped = None if texcoords is None else np.ascontiguousarray(texcoords, np.float32)
        mesh = DrawnMesh(points, corners, directions, corners, mapped, None if mapped is None else corners)
        self.left_out.meshes.append(mesh)
        return len(self.left_out.meshes) - 1

    def drawn(self, body: mujoco.MjsBody, mesh: int, material: str, **where) -> None:
        """Adds a mesh to a body as a geom that is drawn and never touched."""
        around = np.maximum(np.abs(self.left_out.meshes[mesh].vertices_m).max(axis=0), 1e-4)
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=around, material=material, **DRAWN, **where)
        self.left_out.geoms.append((geom, mesh))

    def drawn_box(
        self, body: mujoco.MjsBody, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], material: str
    ) -> None:
        """Adds an axis-aligned box that is drawn and never touched."""
        low, high = np.minimum(low, high), np.maximum(low, high)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=0.5 * (low + high),
            size=np.maximum(0.5 * (high - low), 1e-4),
            material=material,
            **DRAWN,
        )

    def touched_box(
        self, body: mujoco.MjsBody, rectangle: Float[np.ndarray, "4"], height_m: tuple[float, float]
    ) -> None:
        """Adds an upright box (min x, min y, max x, max y) that is touched and never drawn."""
        low, high = np.asarray(rectangle[:2]), np.asarray(rectangle[2:])
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[*(0.5 * (low + high)), 0.5 * (height_m[0] + height_m[1])],
            size=[*(0.5 * (high - low)), 0.5 * (height_m[1] - height_m[0])],
            group=GEOM_GROUP_COLLISION,
            contype=1,
            conaffinity=1,
            mass=0,
            rgba=[0.8, 0.3, 0.3, 0.3],
        )

    def flat_mesh(self, corners_m: Float[np.ndarray, "q 4 3"], texcoords: Float[np.ndarray, "n 2"] | None) -> int:
        """Adds a mesh of flat quads and returns its number.

        Args:
            corners_m: counter-clockwise as seen from the front; a triangle's last two are the same point.
            texcoords: of all corners.
        """
        faces = (np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(len(corners_m))[:, None, None]).reshape(-1, 3)
        points = corners_m.reshape(-1, 3)
        faces = faces[np.linalg.norm(_across(points[faces]), axis=1) > 1e-9]
        across = _across(corners_m)
        normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        return self.mesh(points, np.repeat(normals, 4, axis=0), faces, texcoords)

    def quads(
        self,
        body: mujoco.MjsBody,
        corners_m: Float[np.ndarray, "q 4 3"],
        texcoords: Float[np.ndarray, "q 4 2"],
        material: str,
    ) -> None:
        """Adds flat quads, corners counter-clockwise as seen from their front."""
        self.drawn(body, self.flat_mesh(corners_m, texcoords.reshape(-1, 2)), material)

    def tiled_quads(
        self,
        body: mujoco.MjsBody,
        corners_m: Float[np.ndarray, "q 4 3"],
        material: Material,
        name: str,
        emission: float = 0.0,
    ) -> None:
        """Adds flat quads covered with a building material, in step across quads of the same plane."""
        look = self.material(**look_of(material), emission=emission)
        self.drawn(body, self.flat_mesh(corners_m, tiled_texcoords(corners_m, material)), look, name=name)

    def furniture(
        self,
        body: mujoco.MjsBody,
        model: FurnitureModel,
        repaint: Mapping[tuple[float, float, float], tuple[float, float, float, float]] | None = None,
    ) -> None:
        """Adds what is seen of a model to a body.

        Args:
            body: where it goes.
            model: the model; its meshes are shared by all bodies that have them.
            repaint: other colours (RGBA) for surfaces of these display colours (RGB) that have no picture.
        """
        if model.model_id not in self._meshes:
            self._meshes[model.model_id] = [
                (
                    self.mesh(surface.vertices_m, surface.normals, surface.faces, surface.texcoords),
                    self.material(
                        rgba=surface.rgba,
                        picture=surface.texture,
                        specular=surface.specular,
                        shininess=surface.shininess,
                    ),
                )
                for surface in model.surfaces
            ]
        for surface, (mesh, material) in zip(model.surfaces, self._meshes[model.model_id], strict=True):
            rgba = (repaint or {}).get(surface.rgba[:3]) if surface.texture is None else None
            if rgba is not None:
                material = self.material(rgba=rgba, specular=surface.specular, shininess=surface.shininess)
            self.drawn(body, mesh, material)
