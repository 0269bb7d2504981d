"""The ``rays`` renderer: Embree ray casting and compiled shading, no OpenGL.

Colour, depth and geom ids come from the same rays. Cost follows pixels, hardly triangles, and shadows are exact.
"""

import functools
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt8

from labeling.core.views import Camera
from sbm_gym.rendering.base import Frame, check_camera, check_geoms, pixel_to_world
from sbm_gym.rendering.rays.lighting import Illumination, Shader, Surfaces
from sbm_gym.rendering.rays.picture_kernels import encode, encode_samples
from sbm_gym.rendering.rays.ray_kernels import camera_rays, name_geoms
from sbm_gym.rendering.rays.ray_scene import RayScene, StillScene
from sbm_gym.rendering.rays.raycast import GlassHits
from sbm_gym.rendering.rays.reused_arrays import ReusedArrays
from sbm_gym.rendering.rays.workers import MIN_RAYS_OF_A_MOMENT, Workers
from sbm_gym.rendering.tables.looks import Looks

CENTRE = np.zeros((1, 2))
EDGE_OFFSETS_PX = np.array([[0.12, -0.34], [0.235, 0.274], [-0.355, 0.066]])
"""Sub-rays of an edge pixel beside the one in its centre. No two of the four share a row or column, so that edges of
any direction are smoothed."""
TILE_PX = 4
"""Rays through a square of pixels find their way together: sixteen of them, as many as are traced at a time."""


class RaysRenderer:
    """Draws a compiled model by ray casting. Implements ``sbm_gym.rendering.base.Renderer``.

    The same model and camera give the same bytes in any process and with any number of threads. Static geometry is
    prepared at the first picture; bodies that move are followed from picture to picture. Not for use from several
    threads at a time.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        shadows: bool = True,
        still: StillScene | None = None,
        looks: Looks | None = None,
    ) -> None:
        """Reads geometry, materials and textures of a model.

        Args:
            model: the compiled model; colours, lights and textures are read now, poses at every picture.
            shadows: whether lights that cast shadows do so.
            still: what is known of the model already; it may then lack its meshes and textures.
            looks: meshes and pictures, if the model was compiled without them.
        """
        import numba

        self._model = model
        self._shadows = shadows
        self._workers = Workers(int(numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
        self._scene = RayScene(model, self._workers, still, looks)
        self._shader = Shader(self._scene.tables, self._scene.textures, self._scene.caster, self._workers)
        self._memory = {use: ReusedArrays() for use in ("picture", "samples", "panes")}

    def render(self, data: mujoco.MjData, camera: Camera, *, antialias: bool = True, colours: bool = True) -> Frame:
        """Draws the scene as it stands in ``data``; see ``Renderer.render``."""
        check_camera(camera)
        self._scene.update(data)
        footprint = _footprint(camera)
        shape = height_px, width_px = camera.size
        pixels, tiled, black = _pixels(height_px, width_px)
        memory = self._memory["picture"]
        rays = self._rays(pixels, CENTRE, camera, memory)
        hits, panes = self._scene.caster.first_hits(rays, footprint, with_panes=colours, order=tiled)
        depth_m = np.where(hits.triangle >= 0, hits.t, np.float32(0.0))
        if not colours:
            geom = np.empty(len(pixels), np.int32)
            columns = (hits.triangle, self._scene.tables.triangles.geom, geom)
            self._workers.split(name_geoms, len(pixels), *columns, least=MIN_RAYS_OF_A_MOMENT)
            return Frame(np.zeros((*shape, 3), np.uint8), depth_m.reshape(shape), geom.reshape(shape))
        scene = self._scene.illumination(data, camera.camera_to_world, self._shadows)
        surfaces = self._shader.surfaces(rays, hits, scene.ambient, footprint, memory)
        related = self._shader.same_surface(surfaces, height_px, width_px)
        self._shader.light_picture(surfaces, scene, black, related, height_px, width_px)
        if antialias:
            self._shader.soften_shadows(surfaces, related, height_px, width_px, memory)
        colour = self._shader.colours(surfaces, scene.ambient, memory)
        self._add_panes(colour, rays, panes, scene, footprint)
        rgb = np.empty((len(pixels), 3), np.uint8)
        self._workers.split(encode, len(pixels), colour, scene.ambient.exposure, rgb, least=MIN_RAYS_OF_A_MOMENT)
        if antialias:
            is_edge = _edges(*related, height_px, width_px)
            if panes is not None:
                _mark_pane_edges(panes, is_edge)
            self._smooth(np.flatnonzero(is_edge), camera, scene, footprint, surfaces, colour, rgb)
        return Frame(rgb.reshape(*shape, 3), depth_m.reshape(shape), surfaces.geom.reshape(shape))

    def amodal_mask(self, data: mujoco.MjData, geom_ids: Sequence[int], camera: Camera) -> Bool[np.ndarray, "h w"]:
        """Pixels whose centre would show one of these geoms if nothing else were there; see ``Renderer``.

        Only rays inside the geoms' projected bounding rectangle are cast.
        """
        check_camera(camera)
        mask = np.zeros(camera.size, bool)
        drawn = tuple(sorted(check_geoms(self._model, geom_ids) & self._scene.tables.geom_span.keys()))
        if not drawn:
            return mask
        self._scene.update(data)
        caster, bounds = self._scene.geom_set(data, drawn)
        window = _window(bounds, camera)
        if window is None:
            return mask
        left, top, right, bottom = window
        rows, columns = np.arange(top, bottom, dtype=np.int64), np.arange(left, right, dtype=np.int64)
        pixels = (rows[:, None] * camera.size[1] + columns).ravel()
        rays = self._rays(pixels, CENTRE, camera, self._memory["samples"])
        if caster.special or len(caster.plane_rows):
            covered = caster.first_hits(rays, _footprint(camera))[0].triangle >= 0
        else:
            covered = caster.opaque[0].occluded(rays, float("inf"))
        mask[top:bottom, left:right] = covered.reshape(bottom - top, right - left)
        return mask

    def still(self, data: mujoco.MjData) -> StillScene:
        """What renderers of the same model need not work out again."""
        self._scene.update(data)
        return self._scene.still(data)

    def close(self) -> None:
        """Nothing to give back: memory goes with the object."""

    def _rays(
        self, pixels: Int64[np.ndarray, "k"], offsets, camera: Camera, memory: ReusedArrays
    ) -> Float32[np.ndarray, "n 6"]:
        rays = memory.take("rays", (len(pixels) * len(offsets), 6))
        origin = np.asarray(camera.camera_to_world[:3, 3], float)
        columns = (pixels, camera.size[1], offsets, origin, pixel_to_world(camera), rays)
        self._workers.split(camera_rays, len(rays), *columns, least=MIN_RAYS_OF_A_MOMENT)
        return rays

    def _add_panes(self, colour, rays, panes: GlassHits | None, scene: Illumination, footprint: float) -> None:
        """Puts glass before what is seen through it, from the farthest pane to the nearest."""
        if panes is None:
            return
        memory = self._memory["panes"]
        surfaces = self._shader.surfaces(rays[panes.ray], panes.hits, scene.ambient, footprint, memory)
        self._shader.light_all(surfaces, scene)
        glass = self._shader.colours(surfaces, scene.ambient, memory)
        alpha = self._scene.tables.geoms.alpha[surfaces.geom][:, None]
        far_to_near = np.lexsort((-panes.hits.t, panes.ray))
        ray = panes.ray[far_to_near]
        # Layer by layer: the k-th entry of each ray at once, so that no ray is written twice in one assignment.
        starts = np.concatenate([[True], ray[1:] != ray[:-1]])
        layer = np.arange(len(ray)) - np.maximum.accumulate(np.where(starts, np.arange(len(ray)), 0))
        for depth in range(int(layer.max(initial=-1)) + 1):
            chosen = far_to_near[layer == depth]
            at = panes.ray[chosen]
            colour[at] = alpha[chosen] * glass[chosen] + (1.0 - alpha[chosen]) * colour[at]

    def _smooth(
        self,
        pixels: Int64[np.ndarray, "k"],
        camera: Camera,
        scene: Illumination,
        footprint: float,
        around: Surfaces,
        of_colour: Float32[np.ndarray, "n 3"],
        rgb: UInt8[np.ndarray, "n 3"],
    ) -> None:
        """Draws edge pixels again, from their centres and three sub-rays each."""
        if len(pixels) == 0:
            return
        samples = len(EDGE_OFFSETS_PX)
        finer = footprint / np.sqrt(samples + 1)
        memory = self._memory["samples"]
        rays = self._rays(pixels, EDGE_OFFSETS_PX, camera, memory)
        hits, panes = self._scene.caster.first_hits(rays, finer)
        surfaces = self._shader.surfaces(rays, hits, scene.ambient, finer, memory)
        self._shader.light_samples(surfaces, scene, pixels, around, *camera.size)
        colour = self._shader.colours(surfaces, scene.ambient, memory)
        self._add_panes(colour, rays, panes, scene, finer)
        columns = (pixels, samples, colour, of_colour, scene.ambient.exposure, rgb)
        self._workers.split(encode_samples, len(pixels), *columns)


@functools.lru_cache(maxsize=4)
def _pixels(
    height_px: int, width_px: int
) -> tuple[Int64[np.ndarray, "n"], Int64[np.ndarray, "n"], Int64[np.ndarray, "k"]]:
    """The pixels of a picture; the same tile by tile; and those that are black if it is a chessboard."""
    pixels = np.arange(height_px * width_px, dtype=np.int64)
    y, x = np.divmod(pixels, width_px)
    tiled = np.lexsort((x, y, x // TILE_PX, y // TILE_PX))
    return pixels, tiled, pixels[(y + x) % 2 == 0]


def _footprint(camera: Camera) -> float:
    """Metres per metre of depth that the ray of a pixel stands for."""
    return 1.0 / float(np.sqrt(abs(camera.intrinsics[0, 0] * camera.intrinsics[1, 1])))


def _edges(
    across: Bool[np.ndarray, "n"], below: Bool[np.ndarray, "n"], height_px: int, width_px: int
) -> Bool[np.ndarray, "h w"]:
    """Pixels that see another surface than one of their four neighbours. See ``Shader.same_surface``."""
    apart = ~across.reshape(height_px, width_px)[:, :-1]
    above = ~below.reshape(height_px, width_px)[:-1]
    is_edge = np.zeros((height_px, width_px), bool)
    is_edge[:, :-1] |= apart
    is_edge[:, 1:] |= apart
    is_edge[:-1] |= above
    is_edge[1:] |= above
    return is_edge


def _window(bounds, camera: Camera) -> tuple[int, int, int, int] | None:
    """Pixel rectangle (left, top, right, bottom; ends excluded) that a box can cover; None if it is out of sight."""
    height_px, width_px = camera.size
    whole = (0, 0, width_px, height_px)
    if bounds is None:
        return whole
    corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    rotation, position = (
        np.asarray(camera.camera_to_world[:3, :3], float),
        np.asarray(camera.camera_to_world[:3, 3], float),
    )
    in_camera = (corners - position) @ rotation
    if (in_camera[:, 2] <= 0).all():
        return None
    if in_camera[:, 2].min() < 1e-3:
        return whole
    projected = in_camera @ np.asarray(camera.intrinsics, float).T
    pixels = projected[:, :2] / projected[:, 2:]
    left, top = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
    right, bottom = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 1, [width_px, height_px])
    return (int(left), int(top), int(right), int(bottom)) if left < right and top < bottom else None


def _mark_pane_edges(panes: GlassHits, is_edge: Bool[np.ndarray, "h w"]) -> None:
    """Marks the outlines of glass, which the opaque hits behind it do not show."""
    covered = np.zeros(is_edge.size, np.int64)
    np.add.at(covered, panes.ray, 1)
    covered = covered.reshape(is_edge.shape)
    across, down = covered[:, 1:] != covered[:, :-1], covered[1:] != covered[:-1]
    is_edge[:, 1:] |= across
    is_edge[:, :-1] |= across
    is_edge[1:] |= down
    is_edge[:-1] |= down
