"""The ``rays`` renderer: Embree ray casting and compiled shading, no OpenGL.

Colour, depth and geom ids come from the same rays. Cost follows pixels, hardly triangles, and shadows are exact.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, Int64

from sbm_gym.rendering.base import Frame, check_camera
from sbm_gym.rendering.lamp_reach import lamp_reach
from sbm_gym.rendering.lights import LightLevel, ambient_light, light_level, light_table
from sbm_gym.rendering.occupancy import fill_space
from sbm_gym.rendering.raycast import Caster, Hits, Panes, TriangleScene, Workers
from sbm_gym.rendering.scene_tables import HOLES, SceneTables
from sbm_gym.rendering.shading import (
    AmbientTable,
    LampReach,
    LightTable,
    TextureTable,
    borrow_shadows,
    camera_rays,
    encode,
    find_edges,
    shade,
    surfaces,
)
from sbm_gym.rendering.textures import build_texture_store

CENTRE = np.zeros((1, 2))
EDGE_OFFSETS_PX = np.array([[0.12, -0.34], [0.235, 0.274], [-0.355, 0.066]])
"""Sub-rays of an edge pixel beside the one in its centre. No two of the four share a row or column, so that edges of
any direction are smoothed."""
MAX_CACHED_GEOM_SETS = 256
"""Objects whose own ray-casting scenes are kept for amodal masks."""


@dataclass
class _Shaded:
    """Surfaces and light at the hits of some rays."""

    colour: Float32[np.ndarray, "n 3"]
    position: Float32[np.ndarray, "n 3"]
    normal: Float32[np.ndarray, "n 3"]
    geom: Int32[np.ndarray, "n"]
    """-1 for none."""
    occluded: Bool[np.ndarray, "slots n"]


class _Scratch:
    """Memory for intermediate results that is used again for the next picture: fresh memory costs a page fault each."""

    def __init__(self) -> None:
        self._arrays: dict[str, Float32[np.ndarray, "n"]] = {}

    def take(self, name: str, *shape: int) -> Float32[np.ndarray, "..."]:
        """An array with any content; the one taken before under this name is no longer valid."""
        size = int(np.prod(shape))
        if name not in self._arrays or len(self._arrays[name]) < size:
            self._arrays[name] = np.empty(size, np.float32)
        return self._arrays[name][:size].reshape(shape)


class RaysRenderer:
    """Draws a compiled model by ray casting. Implements ``sbm_gym.rendering.base.Renderer``.

    The same model and camera give the same bytes in any process and with any number of threads. Static geometry is
    prepared at the first picture; bodies that move are followed from picture to picture. Not for use from several
    threads at a time.
    """

    def __init__(self, model: mujoco.MjModel, *, shadows: bool = True) -> None:
        """Reads geometry, materials and textures of a model.

        Args:
            model: the compiled model; colours, lights and textures are read now, poses at every picture.
            shadows: whether lights that cast shadows do so.
        """
        import numba

        self._model = model
        self._shadows = shadows
        store = build_texture_store(model)
        self._textures = TextureTable(
            store.texels, store.level_start, store.level_size, store.level_count, store.is_cube
        )
        self._tables = SceneTables(model, store)
        self._threads = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
        self._workers = Workers(self._threads)
        self._caster = Caster(self._tables, self._textures, self._workers)
        self._caster.plane_rows = self._tables.first_plane + np.arange(len(self._tables.plane_geoms))
        self._still = Caster(self._tables, self._textures, self._workers)
        self._scenes: dict[tuple[bool, bool], TriangleScene] = {}
        self._placed: dict[bool, Float[np.ndarray, "g 12"]] = {}
        self._filled = fill_space(np.zeros((0, 3, 3), np.float32))
        self._far_m = 1.0
        self._level: LightLevel | None = None
        self._bounds = np.zeros((2, 3))
        self._scratch = {use: _Scratch() for use in ("picture", "edges", "panes")}
        self._reach: tuple[bytes, LampReach] | None = None
        self._geom_sets: OrderedDict[tuple[int, ...], tuple[Float[np.ndarray, "g 12"], Caster]] = OrderedDict()

    def render(
        self,
        data: mujoco.MjData,
        intrinsics: Float[np.ndarray, "3 3"],
        camera_to_world: Float[np.ndarray, "4 4"],
        height_px: int,
        width_px: int,
        *,
        antialias: bool = True,
    ) -> Frame:
        """Draws the scene as it stands in ``data``; see ``Renderer.render``.

        Raises:
            ValueError: if the picture has no pixels, or camera numbers are not finite.
        """
        pixel_to_world = _pixel_to_world(intrinsics, camera_to_world, height_px, width_px)
        self._follow(data)
        if self._level is None:
            self._level = light_level(self._model, data)
        camera = (np.asarray(camera_to_world[:3, 3], float), pixel_to_world)
        lights = light_table(self._model, data, camera_to_world, self._shadows)
        ambient = ambient_light(self._model, self._filled, self._level)
        footprint = 1.0 / float(np.sqrt(abs(intrinsics[0, 0] * intrinsics[1, 1])))
        pixels = np.arange(height_px * width_px, dtype=np.int64)
        rays = self._rays(pixels, width_px, CENTRE, camera)
        hits, panes = self._caster.first_hits(rays, footprint)
        shaded = self._shade(rays, hits, lights, ambient, footprint, (pixels, 1, width_px, height_px))
        colour = self._add_panes(shaded.colour, rays, panes, lights, ambient, footprint)
        rgb = np.empty((len(pixels), 3), np.uint8)
        self._workers.split(encode, len(pixels), pixels, colour, 1, ambient.exposure, rgb)
        if antialias:
            is_edge = self._edges(hits, shaded, height_px, width_px)
            if panes is not None:
                _mark_pane_edges(panes, is_edge)
            edges = np.flatnonzero(is_edge)
            self._smooth(edges, width_px, height_px, camera, lights, ambient, footprint, shaded, rgb)
        depth_m = np.where(hits.triangle >= 0, hits.t, np.float32(0.0)).astype(np.float32)
        shape = (height_px, width_px)
        return Frame(rgb.reshape(*shape, 3), depth_m.reshape(shape), shaded.geom.reshape(shape))

    def amodal_mask(
        self,
        data: mujoco.MjData,
        geom_ids: Sequence[int],
        intrinsics: Float[np.ndarray, "3 3"],
        camera_to_world: Float[np.ndarray, "4 4"],
        height_px: int,
        width_px: int,
    ) -> Bool[np.ndarray, "h w"]:
        """Pixels whose centre would show one of these geoms if nothing else were there; see ``Renderer``.

        Only rays inside the geoms' projected bounding rectangle are cast. Glass does not count, as in ``geom_id``.

        Raises:
            ValueError: as in ``render``; also for geoms that the model does not have.
        """
        pixel_to_world = _pixel_to_world(intrinsics, camera_to_world, height_px, width_px)
        mask = np.zeros((height_px, width_px), bool)
        geoms = [int(geom) for geom in geom_ids]
        if any(not 0 <= geom < self._model.ngeom for geom in geoms):
            raise ValueError(f"geom ids must lie in 0..{self._model.ngeom - 1}, but are {geoms}")
        drawn = tuple(sorted({geom for geom in geoms if geom in self._tables.geom_span}))
        if not drawn:
            return mask
        self._follow(data)
        caster, bounds = self._geom_set(data, drawn)
        window = _window(bounds, intrinsics, camera_to_world, height_px, width_px)
        if window is None:
            return mask
        left, top, right, bottom = window
        rows, columns = np.arange(top, bottom, dtype=np.int64), np.arange(left, right, dtype=np.int64)
        pixels = (rows[:, None] * width_px + columns).ravel()
        rays = self._rays(pixels, width_px, CENTRE, (np.asarray(camera_to_world[:3, 3], float), pixel_to_world))
        if caster.special or len(caster.plane_rows):
            footprint = 1.0 / float(np.sqrt(abs(intrinsics[0, 0] * intrinsics[1, 1])))
            covered = caster.first_hits(rays, footprint)[0].triangle >= 0
        else:
            covered = caster.opaque[0].occluded(rays, float("inf"))
        mask[top:bottom, left:right] = covered.reshape(bottom - top, right - left)
        return mask

    def close(self) -> None:
        """Nothing to give back: memory goes with the object."""

    def _rays(self, pixels: Int64[np.ndarray, "k"], width_px: int, offsets, camera) -> Float32[np.ndarray, "n 6"]:
        origin, pixel_to_world = camera
        rays = np.empty((len(pixels) * len(offsets), 6), np.float32)
        self._workers.split(camera_rays, len(rays), pixels, width_px, offsets, origin, pixel_to_world, rays)
        return rays

    def _shade(
        self,
        rays,
        hits: Hits,
        lights,
        ambient: AmbientTable,
        footprint: float,
        picture: tuple[Int64[np.ndarray, "k"], int, int, int] | None = None,
        around: _Shaded | None = None,
    ) -> _Shaded:
        """Surfaces and light at hits.

        Args:
            rays: the rays.
            hits: what they hit.
            lights: the lights.
            ambient: the light from everywhere.
            footprint: metres per metre of depth that a ray stands for.
            picture: pixels of the rays, rays for each, and size of the picture; None for rays of no order.
            around: the picture's pixels, if these are sub-rays of some of them.
        """
        count = len(rays)
        memory = self._scratch["panes" if picture is None else "picture" if around is None else "edges"]
        position, normal, face_normal, albedo, colour = memory.take("surface", 5, count, 3)
        slots = int(lights.shadow_slot.max(initial=-1)) + 1
        shadow_rays, needs_ray = memory.take("shadow", slots, count, 6), np.empty((slots, count), bool)
        tables = (self._tables.triangles, self._tables.geoms, self._textures, footprint, lights)
        outputs = (position, normal, face_normal, albedo)
        hit_columns = (hits.t, hits.triangle, hits.uv)
        occluded = np.zeros((slots, count), bool)
        reach = self._lamp_reach(lights)
        places = (self._far_m, reach, *outputs, shadow_rays, needs_ray, occluded)
        self._workers.split(surfaces, count, rays, *hit_columns, *tables, *places)
        geom = self._geoms_of(hits.triangle)
        if slots:
            if picture is None:
                self._cast_shadows(shadow_rays, needs_ray, occluded)
            else:
                self._find_shadows(geom, normal, shadow_rays, needs_ray, occluded, picture, around)
        self._workers.split(shade, count, rays, hits.triangle, *tables, ambient, *outputs, occluded, colour)
        return _Shaded(colour, position, normal, geom, occluded)

    def _lamp_reach(self, lights: LightTable) -> LampReach:
        """Where light can arrive, worked out anew when lamps or walls have moved."""
        key = lights.position[lights.is_fixed].tobytes() + lights.shadow_slot.tobytes()
        if self._reach is None or self._reach[0] != key:
            self._reach = (key, lamp_reach(lights, self._still, self._bounds))
        return self._reach[1]

    def _find_shadows(self, geom, normal, shadow_rays, needs_ray, occluded, picture, around: "_Shaded | None") -> None:
        """Casts shadow rays, except where the surroundings leave no doubt.

        In a picture every other pixel is cast like the black squares of a chessboard; the white ones between four that
        see one surface in the same light have that light too. A shadow one pixel wide differs from two of the four.
        Sub-rays of an edge pixel take the light of what they hit from the pixels around them. Casting is most of the
        work, and this saves half of it.
        """
        pixels, samples, width_px, height_px = picture
        is_open = np.empty(len(geom), bool)
        if around is None:
            black = (pixels // width_px + pixels % width_px) % 2 == 0
            self._cast_shadows(shadow_rays, needs_ray & black, occluded)
            of_geom, of_normal, of_occluded = geom, normal, occluded
        else:
            black = np.zeros(len(geom), bool)
            of_geom, of_normal, of_occluded = around.geom, around.normal, around.occluded
        columns = (geom, normal, of_geom, of_normal, of_occluded)
        borrowed = np.zeros_like(occluded)
        frame = (pixels, samples, width_px, height_px, around is not None)
        self._workers.split(borrow_shadows, len(geom), *frame, *columns, borrowed, is_open)
        np.copyto(occluded, borrowed, where=~black & ~is_open)
        self._cast_shadows(shadow_rays, needs_ray & (is_open & ~black), occluded)

    def _cast_shadows(self, shadow_rays, chosen: Bool[np.ndarray, "slots n"], occluded) -> None:
        cast = np.flatnonzero(chosen)
        occluded.reshape(-1)[cast] = self._caster.shadows(shadow_rays.reshape(-1, 6)[cast])

    def _geoms_of(self, triangle: Int64[np.ndarray, "n"]) -> Int32[np.ndarray, "n"]:
        """Geoms of hits, -1 for none."""
        if len(self._tables.triangles.geom) == 0:
            return np.full(len(triangle), -1, np.int32)
        return np.where(triangle >= 0, self._tables.triangles.geom[triangle], np.int32(-1))

    def _add_panes(self, colour, rays, panes: Panes | None, lights, ambient, footprint: float):
        """Puts glass before what is seen through it, from the farthest pane to the nearest."""
        if panes is None:
            return colour
        glass = self._shade(rays[panes.ray], panes.hits, lights, ambient, footprint).colour
        alpha = self._tables.geoms.alpha[self._tables.triangles.geom[panes.hits.triangle]][:, None]
        far_to_near = np.lexsort((-panes.hits.t, panes.ray))
        ray = panes.ray[far_to_near]
        # Layer by layer: the k-th entry of each ray at once, so that no ray is written twice in one assignment.
        starts = np.concatenate([[True], ray[1:] != ray[:-1]])
        layer = np.arange(len(ray)) - np.maximum.accumulate(np.where(starts, np.arange(len(ray)), 0))
        for depth in range(int(layer.max(initial=-1)) + 1):
            chosen = far_to_near[layer == depth]
            at = panes.ray[chosen]
            colour[at] = alpha[chosen] * glass[chosen] + (1.0 - alpha[chosen]) * colour[at]
        return colour

    def _edges(self, hits: Hits, shaded: _Shaded, height_px: int, width_px: int) -> Bool[np.ndarray, "h w"]:
        """Pixels that differ from one of their four neighbours."""
        across, below = np.empty(len(hits.t), bool), np.empty(len(hits.t), bool)
        surfaces_hit = (hits.t, hits.triangle, self._tables.triangles.geom, shaded.normal, shaded.position)
        columns = (*surfaces_hit, shaded.occluded, shaded.colour)
        self._workers.split(find_edges, len(hits.t), width_px, height_px, *columns, across, below)
        across, below = across.reshape(height_px, width_px), below.reshape(height_px, width_px)
        is_edge = across | below
        is_edge[:, 1:] |= across[:, :-1]
        is_edge[1:] |= below[:-1]
        return is_edge

    def _smooth(
        self, pixels, width_px: int, height_px: int, camera, lights, ambient, footprint: float, around: _Shaded, rgb
    ) -> None:
        """Draws edge pixels again, from their centres and three sub-rays each."""
        if len(pixels) == 0:
            return
        samples = len(EDGE_OFFSETS_PX)
        finer = footprint / np.sqrt(samples + 1)
        rays = self._rays(pixels, width_px, EDGE_OFFSETS_PX, camera)
        hits, panes = self._caster.first_hits(rays, finer)
        picture = (pixels, samples, width_px, height_px)
        colour = self._shade(rays, hits, lights, ambient, finer, picture, around).colour
        colour = self._add_panes(colour, rays, panes, lights, ambient, finer)
        together = np.concatenate([around.colour[pixels, None], colour.reshape(-1, samples, 3)], axis=1).reshape(-1, 3)
        self._workers.split(encode, len(pixels), pixels, together, samples + 1, ambient.exposure, rgb)

    def _follow(self, data: mujoco.MjData) -> None:
        """Brings the world-frame tables up to date with ``data``.

        Static geometry moves only when somebody edits the model in place; it is compared too, which costs little.
        """
        plane_rows = list(self._tables.plane_geoms)
        for moving in (False, True):
            geoms = self._tables.spans[moving, False].geoms + self._tables.spans[moving, True].geoms
            # Planes have no tree to rebuild: they are followed with the moving geometry.
            geoms = geoms + plane_rows if moving else geoms
            pose = _poses(data, geoms)
            if moving in self._placed and np.array_equal(self._placed[moving], pose):
                continue
            self._tables.place(data, geoms)
            self._placed[moving] = pose
            self._rebuild(moving)
            if not moving:
                self._measure_world()

    def _rebuild(self, moving: bool) -> None:
        for special in (False, True):
            span = self._tables.spans[moving, special]
            if span.stop > span.start:
                rows = np.arange(span.start, span.stop)
                self._scenes[moving, special] = self._triangle_scene(rows)
        order = [(False, False), (True, False)]
        # What moves may clear the way for a lamp, so it does not count there.
        self._still.opaque = [scene for key, scene in self._scenes.items() if key == (False, False)]
        self._caster.opaque = [self._scenes[key] for key in order if key in self._scenes]
        self._caster.special = [self._scenes[m, True] for m, _ in order if (m, True) in self._scenes]

    def _triangle_scene(self, rows: Int64[np.ndarray, "n"]) -> TriangleScene:
        geoms = self._tables.triangles.geom[rows]
        kinds = self._tables.geoms.kind[geoms]
        corners = self._tables.corners[rows]
        if not kinds.any():
            return TriangleScene(corners, rows, self._threads)
        return TriangleScene(corners, rows, self._threads, geoms, kinds == HOLES)

    def _measure_world(self) -> None:
        still = self._tables.spans[False, False]
        corners = self._tables.corners[still.start : still.stop]
        self._filled = fill_space(corners)
        self._reach, self._level = None, None
        if len(corners):
            reach = np.abs(corners).max()
            # Far enough for a shadow ray to leave the world from anywhere in it.
            self._far_m = float(4.0 * reach + 10.0)
            self._bounds = np.array([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))], float)
        else:
            self._far_m = 1000.0

    def _geom_set(self, data: mujoco.MjData, geoms: tuple[int, ...]) -> tuple[Caster, Float[np.ndarray, "2 3"] | None]:
        """Ray-casting scene of a few geoms alone, and their bounding box (None: infinite)."""
        pose = _poses(data, list(geoms))
        cached = self._geom_sets.get(geoms)
        if cached is None or not np.array_equal(cached[0], pose):
            caster = Caster(self._tables, self._textures, self._workers)
            rows = {False: [], True: []}
            planes = []
            for geom in geoms:
                span = np.arange(*self._tables.geom_span[geom])
                if span[0] >= self._tables.first_plane:
                    planes.append(span)
                else:
                    rows[bool(self._tables.geoms.kind[geom])].append(span)
            for special, scenes in ((False, caster.opaque), (True, caster.special)):
                if rows[special]:
                    chosen = np.concatenate(rows[special])
                    scenes.append(self._triangle_scene(chosen))
            caster.plane_rows = np.concatenate(planes) if planes else caster.plane_rows
            self._geom_sets[geoms] = cached = (pose, caster)
            while len(self._geom_sets) > MAX_CACHED_GEOM_SETS:
                self._geom_sets.popitem(last=False)
        self._geom_sets.move_to_end(geoms)
        caster = cached[1]
        return caster, caster.bounds()


def _poses(data: mujoco.MjData, geoms: list[int]) -> Float[np.ndarray, "g 12"]:
    return np.concatenate([data.geom_xpos[geoms], data.geom_xmat[geoms]], axis=1)


def _pixel_to_world(intrinsics, camera_to_world, height_px: int, width_px: int) -> Float[np.ndarray, "3 3"]:
    """Matrix that turns (x, y, 1) of a pixel into a world direction of z-depth one."""
    check_camera(intrinsics, camera_to_world, height_px, width_px)
    return np.asarray(camera_to_world, float)[:3, :3] @ np.linalg.inv(intrinsics)


def _window(bounds, intrinsics, camera_to_world, height_px: int, width_px: int) -> tuple[int, int, int, int] | None:
    """Pixel rectangle (left, top, right, bottom; ends excluded) that a box can cover; None if it is out of sight."""
    whole = (0, 0, width_px, height_px)
    if bounds is None:
        return whole
    corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    rotation, position = np.asarray(camera_to_world[:3, :3], float), np.asarray(camera_to_world[:3, 3], float)
    in_camera = (corners - position) @ rotation
    if (in_camera[:, 2] <= 0).all():
        return None
    if in_camera[:, 2].min() < 1e-3:
        return whole
    projected = in_camera @ np.asarray(intrinsics, float).T
    pixels = projected[:, :2] / projected[:, 2:]
    left, top = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
    right, bottom = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 1, [width_px, height_px])
    return (int(left), int(top), int(right), int(bottom)) if left < right and top < bottom else None


def _mark_pane_edges(panes: Panes, is_edge: Bool[np.ndarray, "h w"]) -> None:
    """Marks the outlines of glass, which the opaque hits behind it do not show."""
    covered = np.zeros(is_edge.size, np.int64)
    np.add.at(covered, panes.ray, 1)
    covered = covered.reshape(is_edge.shape)
    across, down = covered[:, 1:] != covered[:, :-1], covered[1:] != covered[:-1]
    is_edge[:, 1:] |= across
    is_edge[:, :-1] |= across
    is_edge[1:] |= down
    is_edge[:-1] |= down
