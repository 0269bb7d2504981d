"""How much of each object a view shows, from points on the objects' surfaces and the view's instance map.

Counting pixels of a mask drawn without occluders would be exact but costs a render per object; a hundred surface points
per object tell visible from hidden and cut-off shares within a few per cent at almost no cost.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Int

from labeling.core.views import Camera
from sbm_gym.rendering.tables.looks import Looks
from sbm_gym.rendering.tables.tessellate import twice_areas_of_faces
from sbm_gym.robot.view_kernels import count_shown
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION, ObjectInstance

POINTS_PER_OBJECT = 96


@dataclass(frozen=True)
class ObservedObject:
    """One object as one view shows it."""

    instance_id: int
    category: str
    model_key: str
    """Names the furniture model: objects of one model look alike."""
    object_key: str
    """Names the object within all worlds."""
    visible_share: float
    """Share of its part in the picture that nothing hides."""
    truncated_share: float
    """Share of it that lies outside the picture."""
    azimuth_rad: float
    """From where it is seen, 0 = from its front, positive = from its right-hand side; in (-pi, pi]."""
    elevation_rad: float
    """How far above its centre the camera is."""
    range_m: float
    """From the camera to its centre."""


class ObjectSurfaces:
    """Points on the surfaces of the objects of one compiled world."""

    def __init__(
        self, objects: Sequence[ObjectInstance], points_m: Float[np.ndarray, "n k 3"], world_name: str
    ) -> None:
        """Takes points that are known.

        Args:
            objects: the objects; they do not move during an episode.
            points_m: ``POINTS_PER_OBJECT`` points of each.
            world_name: distinguishes objects of different worlds.
        """
        self.objects, self.points_m, self._world_name = tuple(objects), points_m, world_name
        self._ids = np.array([instance.instance_id for instance in self.objects], np.int32)

    @classmethod
    def sampled(
        cls,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        objects: Sequence[ObjectInstance],
        world_name: str,
        known: Mapping[str, Float[np.ndarray, "k 3"]] | None = None,
        looks: Looks | None = None,
    ) -> "ObjectSurfaces":
        """Samples the objects' drawn geoms.

        Args:
            model: the compiled world.
            data: its state, with forward kinematics done.
            objects: the objects.
            world_name: distinguishes objects of different worlds.
            known: points of some objects, by names of their bodies.
            looks: meshes, if the model was compiled without them.
        """
        known = known or {}
        if looks is None and any(instance.body_name not in known for instance in objects):
            looks = Looks.of_model(model)
        points_m = [
            known[instance.body_name]
            if instance.body_name in known
            else surface_points(model, data, _visual_geoms(model, instance.body_name), POINTS_PER_OBJECT, looks)
            for instance in objects
        ]
        return cls(objects, np.array(points_m).reshape(-1, POINTS_PER_OBJECT, 3), world_name)

    def rearranged(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        objects: Sequence[ObjectInstance],
        moved: Mapping[str, Float[np.ndarray, "k 3"]],
    ) -> "ObjectSurfaces":
        """Surfaces of other objects of the same world, some of which are here already.

        Args:
            model: the compiled world.
            data: its state, with forward kinematics done.
            objects: the objects.
            moved: see ``points_of_moved``.
        """
        known = {one.body_name: points for one, points in zip(self.objects, self.points_m, strict=True)}
        for name, points_m in moved.items():
            body = model.body(name).id
            known[name] = points_m @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
        return ObjectSurfaces.sampled(model, data, objects, self._world_name, known)

    def observe(self, instance_map: Int[np.ndarray, "h w"], camera: Camera) -> list[ObservedObject]:
        """The objects of which at least one point is in the picture and not hidden.

        Args:
            instance_map: instance id of every pixel, 0 for none.
            camera: of the view.
        """
        in_picture, visible = count_shown(
            self.points_m, self._ids, instance_map, camera.intrinsics, camera.camera_to_world, min_depth_m=1e-3
        )
        return [
            self._observed(
                self.objects[index],
                camera.camera_to_world[:3, 3],
                visible[index] / in_picture[index],
                in_picture[index] / POINTS_PER_OBJECT,
            )
            for index in np.flatnonzero(visible)
        ]

    def _observed(
        self, instance: ObjectInstance, camera_m, visible_share: float, inside_share: float
    ) -> ObservedObject:
        box = instance.box_3d
        offset = camera_m - box.centre_m
        # The box's axes are the model's: +X its right, +Y its back, so it is seen from its front from -Y.
        right, front = float(offset @ box.rotation[:, 0]), float(-offset @ box.rotation[:, 1])
        horizontal_m = float(np.hypot(right, front))
        return ObservedObject(
            instance_id=instance.instance_id,
            category=instance.category,
            model_key=instance.model_name,
            object_key=f"{self._world_name}/{instance.instance_id}",
            visible_share=float(visible_share),
            truncated_share=float(1.0 - inside_share),
            azimuth_rad=float(np.arctan2(right, front)),
            elevation_rad=float(np.arctan2(offset[2], horizontal_m)),
            range_m=float(np.linalg.norm(offset)),
        )


def points_of_moved(
    model: mujoco.MjModel, data: mujoco.MjData, looks: Looks | None = None
) -> dict[str, Float[np.ndarray, "k 3"]]:
    """Points on the surfaces of all bodies that are moved from episode to episode, by name and in their own frames.

    Args:
        model: the compiled world; bodies that are moved are mocap bodies.
        data: its state, with forward kinematics done.
        looks: meshes, if the model was compiled without them.
    """
    looks, found = looks or Looks.of_model(model), {}
    for body in np.flatnonzero(model.body_mocapid >= 0).tolist():
        name = model.body(body).name
        geoms = _visual_geoms(model, name)
        if geoms:
            away = surface_points(model, data, geoms, POINTS_PER_OBJECT, looks) - data.xpos[body]
            found[name] = away @ data.xmat[body].reshape(3, 3)
    return found


def _visual_geoms(model: mujoco.MjModel, body_name: str) -> list[int]:
    """Geoms of a body that are drawn."""
    body = model.body(body_name)
    first, count = int(body.geomadr[0]), int(body.geomnum[0])
    return [geom for geom in range(first, first + count) if model.geom_group[geom] < GEOM_GROUP_COLLISION]


def surface_points(
    model: mujoco.MjModel, data: mujoco.MjData, geom_ids: Sequence[int], count: int, looks: Looks | None = None
) -> Float[np.ndarray, "count 3"]:
    """Points spread over the surfaces of some geoms, in proportion to area; the same for the same arguments.

    Meshes and boxes are sampled exactly; round primitives through a box inscribed in them.

    Raises:
        ValueError: if there is no geom.
    """
    if len(geom_ids) == 0:
        raise ValueError("surface_points needs at least one geom; the object's body has no visual geoms")
    looks = looks or Looks.of_model(model)
    meshes = [_mesh(model, geom, looks) for geom in geom_ids]
    rng = np.random.default_rng(0)
    # Systematic sampling: evenly spaced quantiles of area, so that even few points cover everything.
    cumulative = np.cumsum(np.concatenate([twice_areas_of_faces(*mesh) for mesh in meshes]))
    quantiles = (np.arange(count) + rng.random(count)) / count * cumulative[-1]
    chosen = np.minimum(np.searchsorted(cumulative, quantiles), len(cumulative) - 1)
    u, v = rng.random(count), rng.random(count)
    flip = u + v > 1.0
    u[flip], v[flip] = 1.0 - u[flip], 1.0 - v[flip]
    shares = np.stack([1.0 - u - v, u, v], axis=1)
    firsts = np.cumsum([0] + [len(faces) for _, faces in meshes])
    of_geom = np.searchsorted(firsts, chosen, side="right") - 1
    points = np.empty((count, 3))
    for number in np.unique(of_geom).tolist():
        here, geom = of_geom == number, geom_ids[number]
        vertices, faces = meshes[number]
        corners = vertices[faces[chosen[here] - firsts[number]]].astype(float)
        local = np.einsum("nk,nkj->nj", shares[here], corners)
        points[here] = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    return points


_BOX_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_BOX_SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
_BOX_TRIANGLES = np.array([triangle for a, b, c, d in _BOX_SIDES for triangle in ((a, b, c), (a, c, d))])


def _mesh(
    model: mujoco.MjModel, geom: int, looks: Looks
) -> tuple[Float[np.ndarray, "v 3"] | Float32[np.ndarray, "v 3"], Int[np.ndarray, "n 3"]]:
    """Vertices and faces of one geom, in its own frame."""
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    if looks.mesh_of_geom[geom] >= 0:
        mesh = looks.meshes[looks.mesh_of_geom[geom]]
        return mesh.vertices_m, mesh.faces
    size = model.geom_size[geom].astype(float)
    shapes = mujoco.mjtGeom
    # Corners of a box around something round would stick out of it; those of an inscribed box do not.
    if kind == shapes.mjGEOM_SPHERE:
        half = np.full(3, size[0] / np.sqrt(3.0))
    elif kind == shapes.mjGEOM_ELLIPSOID:
        half = size / np.sqrt(3.0)
    elif kind in (shapes.mjGEOM_CYLINDER, shapes.mjGEOM_CAPSULE):
        half = np.array([size[0] / np.sqrt(2.0), size[0] / np.sqrt(2.0), size[1]])
    else:
        half = size
    return _BOX_CORNERS * half, _BOX_TRIANGLES
