"""What a policy has looked at: from which sides each object and each unconfirmed candidate has been seen or tried."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from sbm_gym.robot.angles import wrap
from sbm_gym.robot.object_memory import Cell, Finding, KnownObject, MemoryConfig

IN_VIEW_RAD = np.deg2rad(38.0)
"""What is at most this far to the side of where the camera points is well inside its 90 degrees."""


@dataclass
class Candidate:
    """Something that may be an object."""

    centroid_m: Float[np.ndarray, "3"]
    size_m: float
    """Largest extent of what has been seen of it."""
    confidence: float
    """The best that a view has given it."""
    looks: set[Cell] = field(default_factory=set)
    """View bins from which it has been looked at in vain."""


class ViewHistory:
    """Remembers where looking was tried, so that no look is expected to give twice what it gave once."""

    def __init__(self, config: MemoryConfig) -> None:
        """Starts with nothing.

        Args:
            config: how the env's own memory tells objects and views apart.
        """
        self._config = config
        self.candidates: list[Candidate] = []
        self._tried: dict[int, set[Cell]] = {}

    def tried(self, object_id: int) -> set[Cell]:
        """View bins from which the camera has been pointed at a confirmed object, seen or not."""
        return self._tried.setdefault(object_id, set())

    def add(
        self,
        unconfirmed: Sequence[Finding],
        objects: Sequence[KnownObject],
        camera_to_world: Float[np.ndarray, "4 4"],
    ) -> None:
        """Takes in one view.

        Args:
            unconfirmed: its detections that are not to be believed, as ``MemoryUpdate.unconfirmed``.
            objects: the confirmed ones.
            camera_to_world: its pose.
        """
        places_m = [tuple(one.centroid_m.tolist()) for one in self.candidates]
        for finding in unconfirmed:
            self._note(finding, places_m)
        self._forget_parts_of(objects)
        camera_m, forward = camera_to_world[:3, 3], camera_to_world[:3, 2]
        yaw_rad = float(np.arctan2(forward[1], forward[0]))
        watched = [(known.centroid_m, self.tried(known.object_id)) for known in objects]
        watched += [(one.centroid_m, one.looks) for one in self.candidates]
        centroids_m = np.array([centroid_m for centroid_m, _ in watched]).reshape(-1, 3)
        offsets = centroids_m - camera_m
        side_rad = wrap(np.arctan2(offsets[:, 1], offsets[:, 0]) - yaw_rad)
        inside, (azimuths, rings, layers) = self._config.bins.cells(camera_m[None], centroids_m)
        for index in np.flatnonzero(inside & (np.abs(side_rad) < IN_VIEW_RAD)):
            watched[index][1].add((int(azimuths[index]), int(rings[index]), int(layers[index])))

    def _note(self, finding: Finding, places_m: list[tuple[float, ...]]) -> None:
        """Adds a detection to a candidate near it, or as a new one; ``places_m`` follows the candidates' centroids."""
        centroid_m, size_m, confidence = finding.centroid_m, finding.size_m, finding.confidence
        place_m = tuple(centroid_m.tolist())
        reach_m, share = self._reach_m(size_m), self._config.merge_extent_share
        for index, one in enumerate(self.candidates):
            distance_m = math.dist(places_m[index], place_m)
            if distance_m <= reach_m or distance_m <= share * one.size_m:
                # The newest view is mostly the nearest one; its centroid is as good as any.
                one.centroid_m, one.size_m = centroid_m, max(size_m, one.size_m)
                one.confidence, places_m[index] = max(one.confidence, confidence), place_m
                return
        self.candidates.append(Candidate(centroid_m, size_m, confidence))
        places_m.append(place_m)

    def _forget_parts_of(self, objects: Sequence[KnownObject]) -> None:
        """Drops the candidates that have turned out to be confirmed objects."""
        if not objects or not self.candidates:
            return
        centroids_m = np.array([one.centroid_m for one in self.candidates])
        is_part = np.zeros(len(centroids_m), bool)
        for known in objects:
            reach_m = self._reach_m(max(known.extent_m.tolist()))
            is_part |= known.holds(centroids_m, reach_m, self._config.merge_radius_m)
        self.candidates = [one for one, part in zip(self.candidates, is_part, strict=True) if not part]

    def _reach_m(self, size_m: float) -> float:
        return max(self._config.merge_radius_m, self._config.merge_extent_share * size_m)
