"""Ray casting against the triangles and planes of a scene: nearest opaque hits, glass on the way, and shadows."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, Int64

from sbm_gym.rendering.rays.embree import AS_THEY_ARE, TriangleTree
from sbm_gym.rendering.rays.ray_kernels import intersect_planes, occlude_planes, reach_boxes
from sbm_gym.rendering.rays.workers import MIN_RAYS_OF_A_MOMENT, Workers
from sbm_gym.rendering.tables.occupancy import bounds_of
from sbm_gym.rendering.tables.scene_tables import GLASS, SceneTables
from sbm_gym.rendering.tables.texture_sampling import TextureTable, hole_test

MAX_LAYERS = 16
"""A ray passes through at most this many holes and panes."""
LAYER_GAP_M = 1e-4
"""A ray goes on this far behind a hole or pane."""
MAX_BOXES = 64
"""Beyond this many geoms with holes or of glass, rays are not tried against each one's box first."""


class TriangleScene:
    """Some triangles of the tables, with a search tree."""

    def __init__(
        self,
        corners: Float32[np.ndarray, "n 3 3"],
        rows: Int64[np.ndarray, "n"],
        geoms: Int32[np.ndarray, "n"],
        workers: Workers,
        holes: Bool[np.ndarray, "n"] | None = None,
    ) -> None:
        """Builds the search tree.

        Args:
            corners: triangles, world frame.
            rows: for each its row in the tables.
            geoms: and its geom, in runs.
            workers: threads for casting.
            holes: which triangles have holes, which stop light elsewhere; None if none is special.
        """
        self._workers = workers
        self.rows = rows
        self.has_holes = holes is not None and bool(holes.any())
        self.bounds = bounds_of(corners).astype(float)
        self.boxes = self.hole_boxes = self.bounds[:0].reshape(0, 2, 3)
        if holes is not None:
            self.boxes = _boxes(corners, geoms)
            self.hole_boxes = _boxes(corners[holes], geoms[holes]) if self.has_holes else self.hole_boxes
        self._tree = TriangleTree(corners, _run_starts(geoms))

    def cast(
        self, rays: Float32[np.ndarray, "n 6"], order: Int64[np.ndarray, "n"] = AS_THEY_ARE
    ) -> tuple[Float32[np.ndarray, "n"], Int64[np.ndarray, "n"], Float32[np.ndarray, "n 2"]]:
        """Nearest hits: parameter (inf: none), row in the tables (-1: none), barycentric coordinates."""
        return self._tree.cast(rays, self.rows, self._workers, order)

    def occluded(self, rays: Float32[np.ndarray, "n 6"], far: float) -> Bool[np.ndarray, "n"]:
        """Whether anything lies on each ray before parameter ``far``."""
        return self._tree.occluded(rays, far, self._workers)


def _run_starts(geoms: Int32[np.ndarray, "n"]) -> Int64[np.ndarray, "runs"]:
    """Where the triangles of each geom begin."""
    return np.append(0, np.flatnonzero(np.diff(geoms)) + 1)


def _boxes(corners: Float32[np.ndarray, "n 3 3"], geoms: Int32[np.ndarray, "n"]) -> Float[np.ndarray, "b 2 3"]:
    """Bounding boxes (low and high corner) of geoms; of everything together if they are many."""
    starts = _run_starts(geoms)
    runs = np.split(corners, starts[1:]) if len(starts) <= MAX_BOXES else [corners]
    boxes = np.array([bounds_of(run) for run in runs], float)
    # Rays are single precision: what only grazes a box is let in.
    return boxes + 1e-3 * np.array([[[-1.0], [1.0]]])


@dataclass
class Hits:
    """What rays hit first."""

    t: Float32[np.ndarray, "n"]
    triangle: Int64[np.ndarray, "n"]
    uv: Float32[np.ndarray, "n 2"]


@dataclass
class GlassHits:
    """Glass between the eye and what it sees: one entry per ray and pane, near ones first on each ray."""

    ray: Int64[np.ndarray, "k"]
    hits: Hits


class RayCaster:
    """Casts rays against a set of Embree scenes (opaque, and special: with holes or of glass) and planes."""

    def __init__(self, tables: SceneTables, textures: TextureTable, workers: Workers) -> None:
        """Starts empty: fill ``opaque``, ``special`` and ``plane_rows``.

        Args:
            tables: the scene's triangles.
            textures: for the holes in some of them.
            workers: threads for the compiled parts.
        """
        self.opaque: list[TriangleScene] = []
        self.special: list[TriangleScene] = []
        self.plane_rows = np.zeros(0, np.int64)
        self._tables = tables
        self._textures = textures
        self._workers = workers

    def bounds(self) -> Float[np.ndarray, "2 3"] | None:
        """Lowest and highest corner of everything here; None if planes make it infinite or it is empty."""
        boxes = [scene.bounds for scene in (*self.opaque, *self.special)]
        if len(self.plane_rows) or not boxes:
            return None
        return np.stack([np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)])

    def _planes(self):
        chosen = self.plane_rows - self._tables.first_plane
        return type(self._tables.planes)(*(column[chosen] for column in self._tables.planes))

    def first_hits(
        self,
        rays: Float32[np.ndarray, "n 6"],
        footprint: float,
        with_panes: bool = True,
        order: Int64[np.ndarray, "n"] = AS_THEY_ARE,
    ) -> tuple[Hits, GlassHits | None]:
        """Nearest opaque hits, and the panes of glass before them.

        Args:
            rays: origins and un-normalised directions.
            footprint: metres per metre of depth that a ray stands for; decides how textures with holes are filtered.
            with_panes: whether panes are looked for; without, hits are the same.
            order: which rays to trace together, see ``TriangleTree.cast``.
        """
        hits = self._nearest(self.opaque, rays, order)
        if len(self.plane_rows):
            # Rows of planes stand together; a subset is cast as its own table.
            local = np.full(len(rays), -1, np.int64)
            self._workers.split(intersect_planes, len(rays), rays, self._planes(), 0, hits.t, local, hits.uv)
            on_plane = local >= 0
            hits.triangle[on_plane] = self.plane_rows[local[on_plane]]
        if with_panes and self.special:
            return hits, self._walk_special(rays, hits, footprint)
        if any(scene.has_holes for scene in self.special):
            # Glass stops no ray: only those that may meet something with holes can end elsewhere than found so far.
            active = self._near_special(rays, hits.t, [scene for scene in self.special if scene.has_holes], True)
            self._walk_special(rays, hits, footprint, active)
        return hits, None

    def _near_special(
        self, rays, far: Float32[np.ndarray, "n"], scenes: list[TriangleScene], holes_only: bool = False
    ) -> Int64[np.ndarray, "k"]:
        """Rays that may hit something with holes or of glass."""
        boxes = np.concatenate([scene.hole_boxes if holes_only else scene.boxes for scene in scenes])
        reached = np.empty(len(rays), bool)
        self._workers.split(reach_boxes, len(rays), rays, far, boxes, reached, least=MIN_RAYS_OF_A_MOMENT)
        return np.flatnonzero(reached)

    def _nearest(self, scenes: list[TriangleScene], rays, order: Int64[np.ndarray, "n"] = AS_THEY_ARE) -> Hits:
        if not scenes:
            count = len(rays)
            t, triangle = np.full(count, np.inf, np.float32), np.full(count, -1, np.int64)
            return Hits(t, triangle, np.zeros((count, 2), np.float32))
        t, triangle, uv = scenes[0].cast(rays, order)
        for scene in scenes[1:]:
            other_t, other_triangle, other_uv = scene.cast(rays, order)
            nearer = np.flatnonzero(other_t < t)
            t[nearer], triangle[nearer], uv[nearer] = other_t[nearer], other_triangle[nearer], other_uv[nearer]
        return Hits(t, triangle, uv)

    def _walk_special(
        self, rays, hits: Hits, footprint: float, active: Int64[np.ndarray, "k"] | None = None
    ) -> GlassHits | None:
        """Follows rays through holes and glass until something opaque stops them; updates ``hits``.

        Args:
            rays: the rays.
            hits: their hits with what is opaque.
            footprint: see ``first_hits``.
            active: the rays that may meet holes or glass at all, if that is known.
        """
        active = self._near_special(rays, hits.t, self.special) if active is None else active
        passed = np.zeros(len(rays), np.float32)
        found: list[tuple[np.ndarray, ...]] = []
        for _ in range(MAX_LAYERS):
            moved = rays[active].copy()
            moved[:, :3] += passed[active, None] * moved[:, 3:]
            found_next = self._nearest(self.special, moved)
            t, triangle, uv = found_next.t + passed[active], found_next.triangle, found_next.uv
            reached = t < hits.t[active]
            active, t, triangle, uv = active[reached], t[reached], triangle[reached], uv[reached]
            if len(active) == 0:
                break
            is_glass = self._tables.geoms.kind[self._tables.triangles.geom[triangle]] == GLASS
            falls_through = self._holes(rays, active, t, triangle, uv, is_glass, footprint)
            found.append((active[is_glass], t[is_glass], triangle[is_glass], uv[is_glass]))
            stops = ~falls_through
            stopped = active[stops]
            hits.t[stopped], hits.triangle[stopped], hits.uv[stopped] = t[stops], triangle[stops], uv[stops]
            active, t = active[falls_through], t[falls_through]
            passed[active] = t + np.maximum(LAYER_GAP_M, np.float32(1e-5) * t)
            if len(active) == 0:
                break
        if not any(len(part[0]) for part in found):
            return None
        ray, t, triangle, uv = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return GlassHits(ray, Hits(t, triangle, uv))

    def _holes(self, rays, active, t, triangle, uv, is_glass, footprint: float) -> Bool[np.ndarray, "n"]:
        falls_through = np.ones(len(active), bool)
        solid = np.flatnonzero(~is_glass)
        if len(solid):
            is_hole = np.zeros(len(solid), bool)
            self._workers.split(
                hole_test,
                len(solid),
                rays[active[solid]],
                t[solid],
                triangle[solid],
                uv[solid],
                self._tables.triangles,
                self._tables.geoms,
                self._textures,
                footprint,
                is_hole,
            )
            falls_through[solid] = is_hole
        return falls_through

    def shadows(self, rays: Float32[np.ndarray, "n 6"]) -> Bool[np.ndarray, "n"]:
        """Whether the light at parameter 1 of each ray is hidden. Glass lets light through, holes too."""
        occluded = np.zeros(len(rays), bool)
        for index, scene in enumerate(self.opaque):
            occluded = scene.occluded(rays, 1.0) if index == 0 else occluded | scene.occluded(rays, 1.0)
        if len(self.plane_rows):
            self._workers.split(occlude_planes, len(rays), rays, self._planes(), occluded)
        if any(scene.has_holes for scene in self.special):
            self._special_shadows(rays, occluded)
        return occluded

    def behind_planes(self, rays: Float32[np.ndarray, "n 6"]) -> Bool[np.ndarray, "n"]:
        """Whether planes hide parameter 1 of each ray from its origin."""
        hidden = np.zeros(len(rays), bool)
        if len(self.plane_rows):
            self._workers.split(occlude_planes, len(rays), rays, self._planes(), hidden)
        return hidden

    def _special_shadows(self, rays, occluded) -> None:
        holed = [scene for scene in self.special if scene.has_holes]
        far = np.where(occluded, np.float32(-1.0), np.float32(1.0))
        active = self._near_special(rays, far, holed, True)
        reached = np.zeros(len(active), bool)
        for scene in holed:
            reached |= scene.occluded(rays[active], 1.0)
        active = active[reached]
        if len(active) == 0:
            return
        hits = Hits(
            np.ones(len(active), np.float32), np.full(len(active), -1, np.int64), np.zeros((len(active), 2), np.float32)
        )
        self._walk_special(rays[active], hits, 0.0, np.arange(len(active)))
        occluded[active[hits.triangle >= 0]] = True
