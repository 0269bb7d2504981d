"""Surfaces that rays hit, and the light that they receive."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64, UInt64

from sbm_gym.rendering.rays.irradiance_interpolation import (
    interpolate_light,
    interpolate_samples,
    same_surface,
    soften_shadows,
)
from sbm_gym.rendering.rays.light_kernels import BLOCK, add_lamps, lamp_rays, line_up
from sbm_gym.rendering.rays.picture_kernels import combine
from sbm_gym.rendering.rays.raycast import Hits, RayCaster
from sbm_gym.rendering.rays.reused_arrays import ReusedArrays
from sbm_gym.rendering.rays.surface_kernels import describe
from sbm_gym.rendering.rays.surface_table import SurfaceTable
from sbm_gym.rendering.rays.workers import MIN_RAYS, MIN_RAYS_OF_A_MOMENT, Workers
from sbm_gym.rendering.tables.light_tables import AmbientTable, LampReach, LightTable
from sbm_gym.rendering.tables.scene_tables import SceneTables
from sbm_gym.rendering.tables.texture_sampling import TextureTable


@dataclass(frozen=True)
class Illumination:
    """All light of a scene."""

    lights: LightTable
    reach: LampReach
    ambient: AmbientTable
    far_m: float
    """Longer than any way out of the world."""


@dataclass
class Surfaces:
    """What rays hit and the light there."""

    rays: Float32[np.ndarray, "n 6"]
    hits: Hits
    geom: Int32[np.ndarray, "n"]
    """-1 for nothing."""
    normal: Float32[np.ndarray, "n 3"]
    """Smooth, on the side that is seen."""
    albedo: Float32[np.ndarray, "n 3"]
    """Linear; the sky's light where nothing was hit."""
    light: Float32[np.ndarray, "n 6"]
    """Red, green and blue on the surface, then off it as gloss."""
    lit: UInt64[np.ndarray, "n"]
    """One bit for each lamp that casts shadows and shines there."""

    @property
    def table(self) -> SurfaceTable:
        """The points that were hit, for kernels."""
        return SurfaceTable(self.rays, self.hits.t, self.hits.triangle, self.geom, self.normal)


class Shader:
    """Works out surfaces and light at hits."""

    def __init__(self, tables: SceneTables, textures: TextureTable, caster: RayCaster, workers: Workers) -> None:
        """Reads nothing yet.

        Args:
            tables: the scene's triangles and geoms.
            textures: their textures.
            caster: finds shadows.
            workers: threads.
        """
        self._tables = tables
        self._textures = textures
        self._caster = caster
        self._workers = workers
        self._shadow_memory = ReusedArrays()

    def surfaces(
        self,
        rays: Float32[np.ndarray, "n 6"],
        hits: Hits,
        ambient: AmbientTable,
        footprint: float,
        memory: ReusedArrays,
    ) -> Surfaces:
        """What rays hit; the light there is yet to come.

        Args:
            rays: the rays.
            hits: what they hit.
            ambient: for the sky.
            footprint: metres per metre of depth that a ray stands for.
            memory: holds the result until it is used again.
        """
        count = len(rays)
        surfaces = Surfaces(
            rays,
            hits,
            np.empty(count, np.int32),
            memory.take("normal", (count, 3)),
            memory.take("albedo", (count, 3)),
            memory.take("light", (count, 6)),
            memory.take("lit", (count,), np.uint64),
        )
        self._workers.split(
            describe,
            count,
            rays,
            hits.t,
            hits.triangle,
            hits.uv,
            self._tables.triangles,
            self._tables.geoms,
            self._textures,
            ambient,
            footprint,
            surfaces.geom,
            surfaces.normal,
            surfaces.albedo,
        )
        return surfaces

    def light_all(self, surfaces: Surfaces, scene: Illumination) -> None:
        """Works out the light everywhere."""
        self._light(np.arange(len(surfaces.rays)), surfaces, scene)

    def same_surface(
        self, surfaces: Surfaces, height_px: int, width_px: int
    ) -> tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
        """Whether pixels of a picture see the same surface as their right and as their lower neighbour."""
        count = height_px * width_px
        across, below = np.empty(count, bool), np.empty(count, bool)
        self._workers.split(
            same_surface, count, width_px, height_px, surfaces.table, across, below, least=MIN_RAYS_OF_A_MOMENT
        )
        return across, below

    def light_picture(
        self,
        surfaces: Surfaces,
        scene: Illumination,
        black: Int64[np.ndarray, "k"],
        related: tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n"]],
        height_px: int,
        width_px: int,
    ) -> None:
        """Works out the light at black pixels, and at white ones where those around them do not tell.

        Args:
            surfaces: of the pixels of a picture, row by row.
            scene: its light.
            black: pixels whose row and column are an even number together.
            related: what ``same_surface`` found.
            height_px: of the picture.
            width_px: of the picture.
        """
        self._light(black, surfaces, scene)
        is_open = np.empty(len(surfaces.rays), bool)
        columns = (surfaces.geom, *related, surfaces.light, surfaces.lit, is_open)
        self._workers.split(interpolate_light, len(is_open), width_px, height_px, *columns, least=MIN_RAYS_OF_A_MOMENT)
        self._light(np.flatnonzero(is_open), surfaces, scene)

    def soften_shadows(
        self,
        surfaces: Surfaces,
        related: tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n"]],
        height_px: int,
        width_px: int,
        memory: ReusedArrays,
    ) -> None:
        """Smooths the edges of shadows in a picture.

        Args:
            surfaces: of its pixels, row by row, with the light there.
            related: what ``same_surface`` found.
            height_px: of the picture.
            width_px: of the picture.
            memory: holds the new light until it is used again.
        """
        softened = memory.take("softened", surfaces.light.shape)
        columns = (surfaces.geom, *related, surfaces.light, surfaces.lit, softened)
        self._workers.split(soften_shadows, len(softened), width_px, height_px, *columns, least=MIN_RAYS_OF_A_MOMENT)
        surfaces.light = softened

    def light_samples(
        self,
        surfaces: Surfaces,
        scene: Illumination,
        pixels: Int64[np.ndarray, "k"],
        around: Surfaces,
        height_px: int,
        width_px: int,
    ) -> None:
        """Takes light of sub-rays from the pixels around them, and works it out where none sees the same surface.

        Args:
            surfaces: of the sub-rays, those of each pixel together.
            scene: its light.
            pixels: to which they belong.
            around: the picture.
            height_px: of the picture.
            width_px: of the picture.
        """
        count = len(surfaces.rays)
        is_open = np.empty(count, bool)
        self._workers.split(
            interpolate_samples,
            count,
            pixels,
            count // len(pixels),
            width_px,
            height_px,
            surfaces.table,
            around.table,
            around.light,
            surfaces.light,
            is_open,
        )
        self._light(np.flatnonzero(is_open), surfaces, scene)

    def colours(self, surfaces: Surfaces, ambient: AmbientTable, memory: ReusedArrays) -> Float32[np.ndarray, "n 3"]:
        """Linear light that comes back along each ray."""
        colour = memory.take("colour", surfaces.albedo.shape)
        columns = (surfaces.table, self._tables.geoms, ambient, surfaces.albedo, surfaces.light, colour)
        self._workers.split(combine, len(colour), *columns, least=MIN_RAYS_OF_A_MOMENT)
        return colour

    def _light(self, chosen: Int64[np.ndarray, "k"], surfaces: Surfaces, scene: Illumination) -> None:
        """Works out the light at some hits."""
        if len(chosen) == 0:
            return
        blocks = -(-len(chosen) // BLOCK)
        slots = int(scene.lights.shadow_slot.max(initial=-1)) + 1
        take, room = self._shadow_memory.take, (blocks, min(BLOCK, len(chosen)) * slots)
        shadow_rays = take("rays", (*room, 6))
        point_of, lamp_of = take("point", room, np.int32), take("lamp", room, np.int32)
        gain, count = take("gain", (*room, 2)), np.empty(blocks, np.int64)
        self._split(
            lamp_rays,
            blocks,
            MIN_RAYS,
            chosen,
            surfaces.table,
            *(self._tables.triangles, self._tables.geoms, scene.lights, scene.reach, scene.ambient, scene.far_m),
            *(surfaces.light, surfaces.lit, shadow_rays, point_of, lamp_of, gain, count),
        )
        ends = np.cumsum(count)
        if ends[-1] == 0:
            return
        first, together = ends - count, take("together", (int(ends[-1]), 6))
        self._split(line_up, blocks, MIN_RAYS_OF_A_MOMENT, count, first, shadow_rays, together)
        occluded = self._caster.shadows(together)
        arrived = (count, first, occluded, point_of, lamp_of, gain, scene.lights, surfaces.light, surfaces.lit)
        self._split(add_lamps, blocks, MIN_RAYS_OF_A_MOMENT, *arrived)

    def _split(self, kernel: Callable[..., None], blocks: int, least: int, *arguments: object) -> None:
        self._workers.split(kernel, blocks, *arguments, least=least // BLOCK)
