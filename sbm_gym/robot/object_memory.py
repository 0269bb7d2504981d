"""What the agent knows about objects, from its own senses: a detector, a depth camera and odometry.

Nothing here looks at the simulator's ground truth: rewards are computed from this memory, and a robot could keep the
same.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from labeling.core.types import CONFIDENT, Detection
from labeling.core.views import Camera
from sbm_gym.robot import view_kernels

Cell = tuple[int, int, int]
"""A view bin: azimuth, range and elevation index."""


@dataclass(frozen=True)
class ViewBins:
    """How directions from which an object is seen are told apart."""

    num_azimuths: int = 18
    """Azimuth sectors around the object: 18 of 20 degrees, as the thesis' ring of views."""
    range_edges_m: tuple[float, ...] = (0.4, 1.5, 3.0)
    """Edges between horizontal ranges, metres; nearer or farther views are not counted (cut off, or too small)."""
    elevation_edges_rad: tuple[float, ...] = (0.35, 0.70)
    """Edges between elevations of the camera above the centroid: level, from above, from steeply above."""

    def cell(self, camera_m: Float[np.ndarray, "3"], centroid_m: Float[np.ndarray, "3"]) -> Cell | None:
        """The bin of a camera that looks at a centroid, None beyond the outermost ranges."""
        inside, bins = self.cells(camera_m[None], centroid_m[None])
        azimuth, ring, layer = (int(index[0]) for index in bins)
        return (azimuth, ring, layer) if inside[0] else None

    def cells(
        self, cameras_m: Float[np.ndarray, "*#n 3"], centroids_m: Float[np.ndarray, "*#n 3"]
    ) -> tuple[Bool[np.ndarray, "*n"], tuple[Int[np.ndarray, "*n"], Int[np.ndarray, "*n"], Int[np.ndarray, "*n"]]]:
        """``cell`` of many cameras and centroids.

        Args:
            cameras_m: where they are.
            centroids_m: what they look at; shapes are broadcast.

        Returns:
            Which of them are within the outermost ranges, and sector, range and elevation of all; what lies beyond the
            outermost ranges is counted to the nearest.
        """
        offsets = np.ascontiguousarray(cameras_m - centroids_m, float)
        edges = self.range_edges_m, self.elevation_edges_rad
        inside, *bins = view_kernels.view_bins(offsets.reshape(-1, 3), *edges, self.num_azimuths)
        azimuths, rings, layers = (index.reshape(offsets.shape[:-1]) for index in bins)
        return inside.reshape(offsets.shape[:-1]) > 0, (azimuths, rings, layers)

    @property
    def shape(self) -> tuple[int, int, int]:
        """How many sectors, ranges and elevations are told apart."""
        return self.num_azimuths, len(self.range_edges_m) - 1, len(self.elevation_edges_rad) + 1

    def azimuth_bin(self, azimuth_rad):
        """The sector of azimuths, a number or an array (of the camera as seen from the object, counter-clockwise from
        +X).
        """
        turns = (azimuth_rad / (2.0 * np.pi)) % 1.0
        return np.minimum(np.floor(turns * self.num_azimuths).astype(np.int64), self.num_azimuths - 1)


@dataclass(frozen=True)
class MemoryConfig:
    """When a detection becomes a known object, and when two of them are one."""

    confident: float = CONFIDENT
    """Confidence from which a detection is believed (thesis A.2.2: 0.9)."""
    merge_radius_m: float = 0.2
    """Centroids at most this far apart are one object (the thesis' heuristic, from its published code)."""
    merge_extent_share: float = 0.5
    """Large objects show different parts to different views, so the radius is at least this share of the known part's
    horizontal extent; of the category's own kind also if the centroid falls into the box around the known part, grown
    by ``merge_radius_m``. Where the category differs, less: furniture of different kinds stands close together."""
    other_category_factor: float = 0.7
    """Shrinks the share of the extent where the category differs."""
    max_depth_m: float = 8.0
    """Detections farther away are left for later: their centroids are too uncertain."""
    min_mask_share: float = 32 / 256**2
    """Smaller masks are dropped, as a share of the picture (the thesis drops less than 32 of 256x256 pixels)."""
    min_visible_share: float = 0.34
    """A known object counts as seen if this share of its remembered points is in the picture and not hidden."""
    max_own_size_m: float = 1.0
    """An object's near side may hide its own far side by up to its size, at most this."""
    num_points: int = 96
    """Surface points remembered of each object."""
    bins: ViewBins = field(default_factory=ViewBins)
    """View directions told apart."""


@dataclass(kw_only=True, eq=False)
class SeenSurface:
    """A thing as far as it has been seen: points of its surface."""

    centroid_m: Float[np.ndarray, "3"]
    """Mean of the centroids of its masks."""
    points_m: Float[np.ndarray, "n 3"]
    """A sample of its surface."""
    num_detections: int = 1
    """Masks merged into it."""
    _bounds_m: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]] | None = None
    _width_m: float | None = None

    @property
    def width_m(self) -> float:
        """The larger of the horizontal extents."""
        if self._width_m is None:
            low, high = self._bounds()
            self._width_m = max(float(high[0] - low[0]), float(high[1] - low[1]))
        return self._width_m

    @property
    def extent_m(self) -> Float[np.ndarray, "3"]:
        """Full size of the seen part along the world's axes, without the outermost 2 % of points."""
        low, high = self._bounds()
        return high - low

    def surrounds(self, points_m: Float[np.ndarray, "n 3"], margin_m: float) -> Bool[np.ndarray, "n"]:
        """Which points lie in the upright box around the seen part, grown by a margin on all sides."""
        low, high = self._bounds()
        return np.all((points_m >= low - margin_m) & (points_m <= high + margin_m), axis=1)

    def holds(self, points_m: Float[np.ndarray, "n 3"], reach_m: float, margin_m: float) -> Bool[np.ndarray, "n"]:
        """Which points lie at most ``reach_m`` from its centroid, or are such that it ``surrounds``."""
        return view_kernels.are_near(points_m, self.centroid_m, reach_m, *self._bounds(), margin_m)

    def merge(self, points_m: Float[np.ndarray, "n 3"], centroid_m: Float[np.ndarray, "3"], limit: int) -> None:
        """Adds what another mask shows of it; if there are more than ``limit`` points, evenly picked ones are kept."""
        self.centroid_m = (self.centroid_m * self.num_detections + centroid_m) / (self.num_detections + 1)
        self.num_detections += 1
        self.points_m = thin(np.concatenate([self.points_m, points_m]), limit)
        self._bounds_m = self._width_m = None

    def _bounds(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        if self._bounds_m is None:
            ordered = np.sort(self.points_m, axis=0)
            margin = int(0.02 * len(ordered))
            self._bounds_m = (ordered[margin], ordered[-1 - margin])
        return self._bounds_m


@dataclass(kw_only=True, eq=False)
class KnownObject(SeenSurface):
    """An object the agent believes in; its surface is that of its confident masks."""

    object_id: int
    """Position in the order of discovery, from 0."""
    category: str
    """Of its most confident detection."""
    best_confidence: float
    """Of all confident detections merged into it."""
    cells: set[Cell] = field(default_factory=set)
    """View bins from which it has been seen."""

    @property
    def azimuths(self) -> set[int]:
        """Azimuth sectors from which it has been seen."""
        return {cell[0] for cell in self.cells}


@dataclass(frozen=True)
class Finding:
    """A detection in the world."""

    category: str
    confidence: float
    points_m: Float[np.ndarray, "_ 3"]
    """What its mask shows."""
    centroid_m: Float[np.ndarray, "3"]
    """Their mean."""
    size_m: float
    """The largest of their extents along the world's axes."""


@dataclass(frozen=True)
class MemoryUpdate:
    """What one view has taught."""

    new_objects: tuple[int, ...]
    """Ids of objects confirmed for the first time."""
    confidence_gain: float
    """Sum over known objects of the increase of their best confidence, as a share of what was left above
    ``confident``."""
    num_new_azimuths: int
    """Azimuth sectors of known objects seen for the first time."""
    num_new_cells: int
    """Range and elevation bins seen for the first time within known azimuth sectors."""
    visible: tuple[int, ...]
    """Ids of known objects that this view shows."""
    confidence_now: dict[int, float]
    """By id of known object: the best confidence with which this view detects it, where it does."""
    unconfirmed: tuple[Finding, ...]
    """The detections that are not to be believed, the most confident first."""
    findings: tuple[Finding, ...] = ()
    """All detections that are large and near enough, the most confident first."""


class ObjectMemory:
    """Keeps the objects of one episode."""

    def __init__(self, config: MemoryConfig | None = None) -> None:
        """Starts empty.

        Args:
            config: None takes the defaults.
        """
        self.config = config or MemoryConfig()
        self.objects: list[KnownObject] = []

    def observe(
        self,
        detections: Sequence[Detection],
        depth_m: Float[np.ndarray, "h w"],
        camera: Camera,
    ) -> MemoryUpdate:
        """Takes in one view.

        Args:
            detections: what the detector says about it; masks have the size of ``depth_m``.
            depth_m: z-depth, metres, 0 = no return.
            camera: of the view; its pose is from odometry.

        Returns:
            What is new.
        """
        new_objects, gain = [], 0.0
        confidence_now: dict[int, float] = {}
        unconfirmed, findings = [], []
        for detection in sorted(detections, key=lambda d: -d.confidence):
            finding = find(detection, depth_m, camera, self.config)
            if finding is None:
                continue
            findings.append(finding)
            points, centroid_m = finding.points_m, finding.centroid_m
            known = self._match(detection.category, centroid_m)
            if detection.confidence >= self.config.confident:
                if known is None:
                    known = self._add(detection, points, centroid_m)
                    new_objects.append(known.object_id)
                else:
                    gain += self._merge(known, detection, points, centroid_m)
            else:
                unconfirmed.append(finding)
            if known is not None:
                confidence_now.setdefault(known.object_id, detection.confidence)
        visible, new_azimuths, new_cells = self._look(depth_m, camera)
        return MemoryUpdate(
            new_objects=tuple(new_objects),
            confidence_gain=gain,
            num_new_azimuths=new_azimuths,
            num_new_cells=new_cells,
            visible=visible,
            confidence_now=confidence_now,
            unconfirmed=tuple(unconfirmed),
            findings=tuple(findings),
        )

    def _match(self, category: str, centroid_m: Float[np.ndarray, "3"]) -> KnownObject | None:
        """The nearest known object whose merge radius reaches the centroid (thesis 4.2: centroid NMS)."""
        best, best_distance_m, centre_m = None, np.inf, centroid_m.tolist()
        for known in self.objects:
            same = known.category == category
            share = self.config.merge_extent_share * (1.0 if same else self.config.other_category_factor)
            reach_m = max(self.config.merge_radius_m, share * known.width_m)
            distance_m = math.dist(known.centroid_m.tolist(), centre_m)
            close = distance_m <= reach_m or (same and known.surrounds(centroid_m[None], self.config.merge_radius_m)[0])
            if close and distance_m < best_distance_m:
                best, best_distance_m = known, distance_m
        return best

    def _add(self, detection: Detection, points, centroid_m: Float[np.ndarray, "3"]) -> KnownObject:
        known = KnownObject(
            object_id=len(self.objects),
            category=detection.category,
            best_confidence=detection.confidence,
            centroid_m=centroid_m,
            points_m=thin(points, self.config.num_points),
        )
        self.objects.append(known)
        return known

    def _merge(self, known: KnownObject, detection: Detection, points, centroid_m: Float[np.ndarray, "3"]) -> float:
        """Adds a confident detection to a known object; returns the normalised gain of confidence."""
        known.merge(points, centroid_m, self.config.num_points)
        gain = max(0.0, detection.confidence - known.best_confidence)
        if gain > 0.0:
            known.best_confidence, known.category = detection.confidence, detection.category
        return gain / max(1.0 - self.config.confident, 1e-6)

    def _look(self, depth_m: Float[np.ndarray, "h w"], camera: Camera) -> tuple[tuple[int, ...], int, int]:
        """Notes from where the known objects are seen; returns those visible, new azimuths and other new cells."""
        visible, new_azimuths, new_cells = [], 0, 0
        for known in self.objects:
            if visible_share(known, depth_m, camera, self.config.max_own_size_m) < self.config.min_visible_share:
                continue
            visible.append(known.object_id)
            cell = self.config.bins.cell(camera.camera_to_world[:3, 3], known.centroid_m)
            if cell is None or cell in known.cells:
                continue
            if cell[0] in known.azimuths:
                new_cells += 1
            else:
                new_azimuths += 1
            known.cells.add(cell)
        return tuple(visible), new_azimuths, new_cells


def find(
    detection: Detection, depth_m: Float[np.ndarray, "h w"], camera: Camera, config: MemoryConfig
) -> Finding | None:
    """What a detection shows in the world, None if its mask is too small, too far or without depth.

    The mask's rim is left out where enough remains inside (its pixels often belong to the background), and so are
    points more than three standard deviations from the mean, as in the thesis' published code.
    """
    points_m, centroid_m, size_m = view_kernels.mask_points(
        detection.mask,
        depth_m,
        camera.intrinsics,
        camera.camera_to_world,
        config.min_mask_share * detection.mask.size,
        config.max_depth_m,
    )
    if len(points_m) == 0:
        return None
    return Finding(detection.category, detection.confidence, points_m, centroid_m, size_m)


def visible_share(
    known: SeenSurface,
    depth_m: Float[np.ndarray, "h w"],
    camera: Camera,
    max_own_size_m: float = MemoryConfig.max_own_size_m,
) -> float:
    """Share of an object's remembered points that a view shows: in the picture, and nothing foreign before them.

    What stands before a point is foreign if it is nearer to the camera than the object reaches: from behind, an object
    hides its own front, so depth may fall short of a remembered point by the object's own size. What lies clearly
    behind a point means that the object is not there.
    """
    own_size_m = min(max_own_size_m, known.width_m)
    agreeing = view_kernels.count_agreeing(
        known.points_m,
        depth_m,
        camera.intrinsics,
        camera.camera_to_world,
        behind_m=0.15 + own_size_m,
        before_m=0.3 + 0.5 * min(own_size_m, 1.0),
    )
    return agreeing / len(known.points_m)


def thin(points: Float[np.ndarray, "n 3"], count: int) -> Float[np.ndarray, "m 3"]:
    """At most ``count`` points, evenly picked from the list."""
    if len(points) <= count:
        return points.copy()
    return points[np.linspace(0, len(points) - 1, count).round().astype(int)]
