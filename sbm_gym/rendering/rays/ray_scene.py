"""The geometry of a model as the ray renderer keeps it, brought up to date from picture to picture."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from sbm_gym.rendering.rays.lamp_reach import lamp_reach
from sbm_gym.rendering.rays.lighting import Illumination
from sbm_gym.rendering.rays.raycast import RayCaster, TriangleScene
from sbm_gym.rendering.rays.workers import Workers
from sbm_gym.rendering.tables.light_tables import LampReach, LightTable
from sbm_gym.rendering.tables.lights import LightMeter, ambient_light, light_key, light_table, skybox_of
from sbm_gym.rendering.tables.looks import Looks
from sbm_gym.rendering.tables.occupancy import FilledSpace, bounds_of, fill_space
from sbm_gym.rendering.tables.scene_tables import HOLES, SceneTables
from sbm_gym.rendering.tables.texture_sampling import TextureTable
from sbm_gym.rendering.tables.textures import fill_textures, lay_out_textures

_One = TypeVar("_One")
_Other = TypeVar("_Other")

MAX_CACHED_GEOM_SETS = 256
"""Objects whose own ray-casting scenes are kept for amodal masks."""
STORE_BELOW_M = -20.0
"""Moving things wholly below this height wait their turn out of the world, and no ray looks for them there."""


@dataclass(frozen=True)
class StillScene:
    """All that ``RayScene`` works out about what stands still, as arrays and numbers that can be kept."""

    tables: SceneTables
    textures: TextureTable
    skybox: int
    """Texture of the sky, -1 for none."""
    poses: Float[np.ndarray, "g 12"]
    """Where the geoms that stand still do so."""
    filled: FilledSpace
    bounds: Float[np.ndarray, "2 3"]
    far_m: float
    together: Bool[np.ndarray, "l l"] | None
    """Which lights shine on one place."""
    lamps: bytes
    """Where the lamps are that ``reach`` is of."""
    reach: LampReach | None


class RayScene:
    """Tables and search trees of a model. What stands still is prepared once, what moves is placed anew."""

    def __init__(
        self,
        model: mujoco.MjModel,
        workers: Workers,
        still: StillScene | None = None,
        looks: Looks | None = None,
    ) -> None:
        """Reads geometry, materials and textures of a model.

        Args:
            model: the compiled model.
            workers: threads.
            still: what is known of the model already; it may then lack its meshes and textures.
            looks: meshes and pictures, if the model was compiled without them.
        """
        self._model = model
        self._workers = workers
        if still is None:
            shown = looks or Looks.of_model(model)
            store = lay_out_textures(shown.pictures)
            _, self.tables = self._in_parallel(
                lambda: fill_textures(shown.pictures, store), lambda: SceneTables.of_model(model, shown, store)
            )
            self.textures = TextureTable(
                store.texels, store.level_start, store.level_size, store.level_count, store.is_cube
            )
        else:
            self.tables, self.textures = still.tables, still.textures
        self.caster = RayCaster(self.tables, self.textures, workers)
        self.caster.plane_rows = self.tables.first_plane + np.arange(len(self.tables.plane_geoms))
        self._still = RayCaster(self.tables, self.textures, workers)
        self._scenes: dict[tuple[bool, bool], TriangleScene] = {}
        self._geoms = {
            moving: np.array(self.tables.spans[moving, False].geoms + self.tables.spans[moving, True].geoms, np.int64)
            for moving in (False, True)
        }
        # Planes have no tree to rebuild: they are kept with the moving geometry.
        self._geoms[True] = np.append(self._geoms[True], np.array(self.tables.plane_geoms, np.int64))
        self._placed: dict[bool, Float[np.ndarray, "g 12"]] = {}
        self._skybox = skybox_of(model) if still is None else still.skybox
        self._filled = fill_space(np.zeros((0, 3, 3), np.float32)) if still is None else still.filled
        self._far_m = 1.0 if still is None else still.far_m
        self._bounds = np.zeros((2, 3)) if still is None else still.bounds
        self._meter = LightMeter(None if still is None else still.together)
        self._reach: tuple[bytes, LampReach] | None = None
        self._light: tuple[bytes, Illumination] | None = None
        if still is not None:
            self._placed[False] = still.poses
            self._reach = None if still.reach is None else (still.lamps, still.reach)
        self._has_trees = False
        self._geom_sets: OrderedDict[tuple[int, ...], tuple[Float[np.ndarray, "g 12"], RayCaster]] = OrderedDict()

    def update(self, data: mujoco.MjData) -> None:
        """Brings the world-frame tables up to date with ``data``.

        Static geometry moves only when somebody edits the model in place; it is compared too, which costs little.
        """
        for moving, geoms in self._geoms.items():
            pose = _poses(data, geoms)
            moved = np.ones(len(geoms), bool)
            if moving in self._placed:
                moved = (self._placed[moving] != pose).any(axis=1)
                if not moved.any():
                    if not moving and not self._has_trees:
                        self._rebuild(moving)
                    continue
                if not moving:
                    self.tables.take_down(self._placed[moving], geoms.tolist())
            self.tables.place(data, geoms[moved].tolist())
            self._placed[moving] = pose
            if moving:
                self._rebuild(moving)
            else:
                self._in_parallel(self._measure_world, lambda: self._rebuild(False))

    def still(self, data: mujoco.MjData) -> StillScene:
        """What stands still, for another process; shares its arrays.

        Args:
            data: the same as at the last update.
        """
        lamps = light_table(self._model, data, np.eye(4), shadows=True)
        self._meter.level(self._model, data, self._is_in_sight)
        reach = self._lamp_reach(lamps)
        return StillScene(
            self.tables.at_rest(),
            self.textures,
            self._skybox,
            self._placed[False],
            self._filled,
            self._bounds,
            self._far_m,
            self._meter.together,
            _lamps_key(lamps),
            reach,
        )

    def illumination(
        self, data: mujoco.MjData, camera_to_world: Float[np.ndarray, "4 4"], shadows: bool
    ) -> Illumination:
        """The light of the scene as it was last updated.

        Args:
            data: where lamps are.
            camera_to_world: the headlight shines from here.
            shadows: whether any light casts shadows.
        """
        key = light_key(self._model, data, camera_to_world) + bytes([shadows])
        if self._light is None or self._light[0] != key:
            lights = light_table(self._model, data, camera_to_world, shadows)
            ambient = ambient_light(
                self._model, self._filled, self._meter.level(self._model, data, self._is_in_sight), self._skybox
            )
            self._light = (key, Illumination(lights, self._lamp_reach(lights), ambient, self._far_m))
        return self._light[1]

    def _is_in_sight(self, start_m: Float[np.ndarray, "3"], end_m: Float[np.ndarray, "3"]) -> bool:
        """Whether nothing that stands still lies between two points; glass counts."""
        rays = np.concatenate([start_m, end_m - start_m])[None].astype(np.float32)
        occluded = np.zeros(1, bool)
        for (moving, _), scene in self._scenes.items():
            if not moving:
                occluded |= scene.occluded(rays, 1.0)
        return not (occluded | self.caster.behind_planes(rays))[0]

    def _lamp_reach(self, lights: LightTable) -> LampReach:
        """Where light can arrive, worked out anew when lamps or walls have moved."""
        key = _lamps_key(lights)
        if self._reach is None or self._reach[0] != key:
            self._reach = (key, lamp_reach(lights, self._still, self._bounds))
        return self._reach[1]

    def _in_parallel(self, one: Callable[[], _One], other: Callable[[], _Other]) -> tuple[_One, _Other]:
        """What two functions that have nothing to do with each other return; run at a time if there are threads."""
        tasks: tuple[Callable[[], Any], ...] = (one, other)
        results: list[Any] = [None, None]

        def work(start: int, stop: int) -> None:
            for index in range(start, stop):
                results[index] = tasks[index]()

        self._workers.split(work, 2, least=1)
        return results[0], results[1]

    def _rebuild(self, moving: bool) -> None:
        self._has_trees |= not moving
        for special in (False, True):
            span = self.tables.spans[moving, special]
            rows = np.arange(span.start, span.stop)
            # What stands still is not copied: processes that have mapped it share it.
            corners = self.tables.corners[span.start : span.stop]
            if moving:
                shown = corners[:, :, 2].max(axis=1, initial=-np.inf) > STORE_BELOW_M
                rows, corners = rows[shown], corners[shown]
            self._scenes.pop((moving, special), None)
            if len(rows):
                self._scenes[moving, special] = self._triangle_scene(rows, corners)
        order = [(False, False), (True, False)]
        # What moves may clear the way for a lamp, so it does not count there.
        self._still.opaque = [scene for key, scene in self._scenes.items() if key == (False, False)]
        self.caster.opaque = [self._scenes[key] for key in order if key in self._scenes]
        self.caster.special = [self._scenes[m, True] for m, _ in order if (m, True) in self._scenes]

    def _triangle_scene(self, rows: Int64[np.ndarray, "n"], corners: Float32[np.ndarray, "n 3 3"]) -> TriangleScene:
        geoms = self.tables.triangles.geom[rows]
        kinds = self.tables.geoms.kind[geoms]
        return TriangleScene(corners, rows, geoms, self._workers, kinds == HOLES if kinds.any() else None)

    def _measure_world(self) -> None:
        still = self.tables.spans[False, False]
        corners = self.tables.corners[still.start : still.stop]
        self._filled = fill_space(corners)
        self._reach, self._light, self._meter = None, None, LightMeter()
        if len(corners):
            bounds = bounds_of(corners)
            self._bounds = bounds.astype(float)
            # Far enough for a shadow ray to leave the world from anywhere in it.
            self._far_m = float(4.0 * np.abs(bounds).max() + 10.0)
        else:
            self._far_m = 1000.0

    def geom_set(
        self, data: mujoco.MjData, geoms: tuple[int, ...]
    ) -> tuple[RayCaster, Float[np.ndarray, "2 3"] | None]:
        """Casts rays against a few geoms alone; and their bounding box (None: infinite).

        Args:
            data: the same as at the last update.
            geoms: drawn geoms, sorted.
        """
        pose = _poses(data, np.array(geoms, np.int64))
        cached = self._geom_sets.get(geoms)
        if cached is None or not np.array_equal(cached[0], pose):
            caster = RayCaster(self.tables, self.textures, self._workers)
            rows = {False: [], True: []}
            planes = []
            for geom in geoms:
                span = np.arange(*self.tables.geom_span[geom])
                if span[0] >= self.tables.first_plane:
                    planes.append(span)
                else:
                    rows[bool(self.tables.geoms.kind[geom])].append(span)
            for special, scenes in ((False, caster.opaque), (True, caster.special)):
                if rows[special]:
                    chosen = np.concatenate(rows[special])
                    scenes.append(self._triangle_scene(chosen, self.tables.corners[chosen]))
            caster.plane_rows = np.concatenate(planes) if planes else caster.plane_rows
            self._geom_sets[geoms] = cached = (pose, caster)
            while len(self._geom_sets) > MAX_CACHED_GEOM_SETS:
                self._geom_sets.popitem(last=False)
        self._geom_sets.move_to_end(geoms)
        caster = cached[1]
        return caster, caster.bounds()


def _poses(data: mujoco.MjData, geoms: Int64[np.ndarray, "g"]) -> Float[np.ndarray, "g 12"]:
    return np.concatenate([data.geom_xpos[geoms], data.geom_xmat[geoms]], axis=1)


def _lamps_key(lights: LightTable) -> bytes:
    return lights.position[lights.is_fixed].tobytes() + lights.shadow_slot.tobytes()
