"""What all looks of an episode say of every thing that the detector has pointed at, sure or not.

It is the label generator's judgement (``labeling.generator.objects.object_posterior``), made as the robot goes, from
what the robot has: a thing is a place in the world with a surface as far as it has been seen, every view that shows it
is a look, and the chances of its names follow from all looks. From these follows how many labels may be expected to be
right: what a robot that labels for itself is after.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from numba import njit

from labeling.core.types import MIN_POSTERIOR
from labeling.core.views import Camera
from labeling.generator.objects.object_posterior import MIN_SIDE, ObjectModel, PlaceObservations, alikeness
from sbm_gym.robot.object_memory import Finding, MemoryConfig, SeenSurface, thin, visible_share

LIKELY = 0.5
"""A thing is found when the chance of one of its names reaches this for the first time."""
RESEMBLANCE = 0.2
"""How much less a label is worth for looks that resemble each other: n looks from one place count n ** (1 - this)."""


@dataclass(kw_only=True, eq=False)
class Thing(SeenSurface):
    """A place that detections speak of, and all looks at it."""

    side: Float[np.ndarray, "v"]
    """Square root of the share of each picture that shows it; 0 where it is hidden or out of the picture."""
    confidence: dict[str, Float[np.ndarray, "v"]] = field(default_factory=dict)
    """Of the surest detection in each view, by category; 0 where there is none."""
    category: str = ""
    """The likeliest of its names."""
    chance: float = 0.0
    """That it is what it is called."""
    labels: float = 0.0
    """Labels that may be expected to be right, fewer for looks that resemble others."""
    is_found: bool = False
    """Whether ``chance`` has ever reached ``LIKELY``."""

    @property
    def area_m2(self) -> float:
        """Of its upright box as seen from any side, on average: a quarter of its surface (Cauchy)."""
        x, y, z = self.extent_m.tolist()
        return 0.5 * (x * y + y * z + z * x)

    @property
    def worth(self) -> float:
        """The chance that a label of it is right; 0 where none would be made."""
        return self.chance if self.chance >= MIN_POSTERIOR else 0.0

    def is_detected(self, view: int) -> bool:
        """Whether a view's detections speak of it."""
        return any(row[view] > 0.0 for row in self.confidence.values())


@dataclass(frozen=True)
class BeliefUpdate:
    """What one view has added."""

    labels: float
    """By how much the number of labels that may be expected to be right has grown; it may shrink, too."""
    found: int
    """Things found by this view."""


class ObjectBeliefs:
    """Keeps the things of one episode."""

    def __init__(self, model: ObjectModel, config: MemoryConfig, num_views: int) -> None:
        """Starts empty.

        Args:
            model: what looks say of things.
            config: how the robot's memory tells things apart.
            num_views: of the episode, that before the first step included.
        """
        self.things: list[Thing] = []
        self._model, self._config = model, config
        self._eyes_m, self._count = np.zeros((num_views, 3)), 0
        self._pixel_share = 1.0
        """Of the picture, that a square metre fills at one metre."""
        self.update = BeliefUpdate(0.0, 0)
        """What the latest view has added."""

    @property
    def expected_labels(self) -> float:
        """Labels that may be expected to be right, see ``Thing.labels``."""
        return sum(thing.labels for thing in self.things)

    def add(self, findings: Sequence[Finding], depth_m: Float[np.ndarray, "h w"], camera: Camera) -> None:
        """Takes in one view.

        Args:
            findings: all its detections, as ``MemoryUpdate.findings``.
            depth_m: z-depth, metres, 0 = no return.
            camera: of the view; its pose is from odometry.
        """
        before = self.expected_labels
        view, eye_m = self._count, camera.camera_to_world[:3, 3]
        if view == len(self._eyes_m):  # An episode that goes on beyond its end.
            self._grow()
        self._eyes_m[view] = eye_m
        self._pixel_share = camera.intrinsics[0, 0] * camera.intrinsics[1, 1] / (camera.size[0] * camera.size[1])
        self._count += 1
        touched = [self._note(finding, view) for finding in findings]
        for thing in self.things:
            share = visible_share(thing, depth_m, camera, self._config.max_own_size_m)
            if thing.is_detected(view):
                share = max(share, self._config.min_visible_share)
            if share >= self._config.min_visible_share:
                thing.side[view] = self._side(thing, share, eye_m)
        self._join(touched)
        found = 0
        for thing in self.things:
            if thing.side[view] > 0.0:
                self._judge(thing)
                found += thing.chance >= LIKELY and not thing.is_found
                thing.is_found |= thing.chance >= LIKELY
        self.update = BeliefUpdate(self.expected_labels - before, found)

    def chance_at(self, place_m: Float[np.ndarray, "3"]) -> float:
        """The chance that the thing nearest to a place is what it is called; 0 where there is none within its size."""
        place = place_m.tolist()
        nearest = min(self.things, key=lambda one: math.dist(one.centroid_m.tolist(), place), default=None)
        if nearest is None:
            return 0.0
        reach_m = max(self._config.merge_radius_m, 0.5 * float(np.max(nearest.extent_m)))
        return nearest.chance if math.dist(nearest.centroid_m.tolist(), place) <= reach_m else 0.0

    def worth_from(self, eyes_m: Float[np.ndarray, "p 3"], things: Sequence[Thing]) -> Float[np.ndarray, "t p"]:
        """By how much ``expected_labels`` would grow if each thing were seen from each place, its chance unchanged.

        Args:
            eyes_m: camera positions, world.
            things: of these.
        """
        worth = np.zeros((len(things), len(eyes_m)))
        for row, thing in zip(worth, things, strict=True):
            looks = np.flatnonzero(thing.side[: self._count] > MIN_SIDE)
            reach_m = np.sqrt(self._pixel_share * thing.area_m2) / MIN_SIDE
            seen_m = self._eyes_m[looks] - thing.centroid_m
            row[:] = thing.worth * _novelty(eyes_m - thing.centroid_m, seen_m, reach_m)
        return worth

    # Parts of the above -----------------------------------------------------------------------------------------------

    def _note(self, finding: Finding, view: int) -> Thing:
        """Adds a detection to the thing at its place, or as a new one."""
        thing = self._at(finding.category, finding.centroid_m)
        if thing is None:
            side = np.zeros(len(self._eyes_m))
            points_m = thin(finding.points_m, self._config.num_points)
            thing = Thing(centroid_m=finding.centroid_m, points_m=points_m, side=side)
            self.things.append(thing)
        elif not thing.is_detected(view):
            # Others of this view show the same pixels under another name.
            thing.merge(finding.points_m, finding.centroid_m, self._config.num_points)
        row = thing.confidence.setdefault(finding.category, np.zeros(len(self._eyes_m)))
        row[view] = max(row[view], finding.confidence)
        thing.category = thing.category or finding.category
        return thing

    def _at(self, category: str, centroid_m: Float[np.ndarray, "3"], but: Thing | None = None) -> Thing | None:
        """The nearest thing whose reach holds a place, as ``ObjectMemory`` tells objects apart."""
        config, best, best_m, place_m = self._config, None, np.inf, centroid_m.tolist()
        for thing in self.things:
            distance_m = math.dist(thing.centroid_m.tolist(), place_m)
            if distance_m >= best_m or thing is but:
                continue
            same = thing.category == category
            share = config.merge_extent_share * (1.0 if same else config.other_category_factor)
            reach_m = max(config.merge_radius_m, share * thing.width_m)
            if distance_m <= reach_m or (same and thing.surrounds(centroid_m[None], config.merge_radius_m)[0]):
                best, best_m = thing, distance_m
        return best

    def _join(self, touched: Sequence[Thing]) -> None:
        """Makes one thing of two, where what has been seen of one has grown to hold the other."""
        for thing in touched:
            if thing not in self.things:
                continue
            other = self._at(thing.category, thing.centroid_m, but=thing)
            if other is None:
                continue
            for name, row in thing.confidence.items():
                own = other.confidence.setdefault(name, np.zeros(len(self._eyes_m)))
                np.maximum(own, row, out=own)
            np.maximum(other.side, thing.side, out=other.side)
            other.merge(thing.points_m, thing.centroid_m, self._config.num_points)
            other.is_found |= thing.is_found
            self.things.remove(thing)
            self._judge(other)

    def _judge(self, thing: Thing) -> None:
        """What all looks say of a thing."""
        count = self._count
        confidence = {name: row[:count] for name, row in thing.confidence.items()}
        from_object_m = self._eyes_m[:count] - thing.centroid_m
        chances = self._model.posterior(PlaceObservations(confidence, thing.side[:count], from_object_m))
        thing.category = max(chances, key=chances.__getitem__)
        thing.chance = chances[thing.category]
        seen = from_object_m[thing.side[:count] > MIN_SIDE]
        thing.labels = thing.worth * float(np.sum(_company(seen) ** -RESEMBLANCE))

    def _side(self, thing: Thing, share: float, eye_m: Float[np.ndarray, "3"]) -> float:
        """Square root of the share of the picture that shows a thing, from its size and distance."""
        distance_m = max(float(np.linalg.norm(thing.centroid_m - eye_m)), 0.1)
        return float(np.sqrt(min(1.0, share * self._pixel_share * thing.area_m2 / distance_m**2)))

    def _grow(self) -> None:
        more = len(self._eyes_m) + 1
        self._eyes_m = np.concatenate([self._eyes_m, np.zeros((more, 3))])
        for thing in self.things:
            thing.side = np.concatenate([thing.side, np.zeros(more)])
            thing.confidence = {name: np.concatenate([row, np.zeros(more)]) for name, row in thing.confidence.items()}


@njit(cache=True)
def _company(from_object_m):
    """How many looks each look resembles, itself included: (n,) float64, for (n, 3) float64, from the thing."""
    count = len(from_object_m)
    company = np.ones(count)
    for one in range(count):
        for other in range(one):
            alike = alikeness(from_object_m[one], from_object_m[other])
            company[one] += alike
            company[other] += alike
    return company


@njit(cache=True)
def _novelty(from_object_m, seen_m, reach_m):
    """What one more look from each place would count beside the looks there are.

    Args:
        from_object_m: (p, 3) float64, places, from the thing.
        seen_m: (n, 3) float64, where it has been seen from, likewise.
        reach_m: farther looks count nothing.

    Returns:
        (p,) float64.
    """
    company = _company(seen_m)
    worth = np.zeros(len(from_object_m))
    for place in range(len(from_object_m)):
        x, y, z = from_object_m[place]
        if x * x + y * y + z * z > reach_m * reach_m:
            continue
        own, added = 1.0, 0.0
        for look in range(len(seen_m)):
            alike = alikeness(from_object_m[place], seen_m[look])
            own += alike
            added += (company[look] + alike) ** -RESEMBLANCE - company[look] ** -RESEMBLANCE
        worth[place] = added + own**-RESEMBLANCE
    return worth
