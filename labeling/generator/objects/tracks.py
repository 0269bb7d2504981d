"""Tracks: candidates in several places that are one object, which has moved from one to the other.

Views are taken one after the other, so that what moves is in neighbouring places in neighbouring views; and nothing is
in two places in one view.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Int

from labeling.generator.cloud.free_space import count_hits
from labeling.generator.cloud.moved import settled_voxels
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import Candidate
from labeling.generator.objects.object_posterior import PlaceObservations

MOVED_SHARE = 0.3
"""A candidate has moved if this share of its voxels has."""
MIN_VOXELS = 30
"""Fewer voxels that others look through are noise: in a real capture, stray detections of one to three of them."""
REACH = 1.5
"""From one view to the next a thing moves by no more than so many of its own sizes."""
MAX_GAP = 5
"""Views after which a thing that no view has shown since is not taken to be the same one."""


@dataclass(frozen=True)
class _Place:
    """A candidate as tracks see it."""

    name: str
    size_m: float
    centres_m: dict[int, Float32[np.ndarray, "3"]]
    """Mean of what each view's detection shows."""


def with_tracks(cloud: Cloud, candidates: Sequence[Candidate], moved: Bool[np.ndarray, "n"]) -> list[Candidate]:
    """Candidates with the number of their track; those that have not moved have none.

    Places are joined from the nearest pair on, as a single linkage that never joins two that one view shows.

    Args:
        cloud: the points of all views.
        candidates: the objects, each in one place.
        moved: voxels that have moved.
    """
    places = {k: _place(cloud, one) for k, one in enumerate(candidates) if has_moved(one.foreground_voxels, moved)}
    numbers, pairs = list(places), []
    for k, first in enumerate(numbers):
        for second in numbers[k + 1 :]:
            apart = _apart(places[first], places[second])
            if apart <= 1.0:
                pairs.append((apart, first, second))
    track = {k: k for k in numbers}
    views = {k: set(place.centres_m) for k, place in places.items()}
    for _, first, second in sorted(pairs):
        one, other = sorted((track[first], track[second]))
        if one == other or views[one] & views[other]:
            continue
        views[one] |= views.pop(other)
        track = {k: one if number == other else number for k, number in track.items()}
    return [replace(one, track=track.get(k)) for k, one in enumerate(candidates)]


def has_moved(voxels: Int[np.ndarray, "f"], moved: Bool[np.ndarray, "n"]) -> bool:
    """Whether what detections show has moved.

    Args:
        voxels: indices of those that they show.
        moved: voxels that have moved.
    """
    return len(voxels) >= MIN_VOXELS and bool(np.count_nonzero(moved[voxels]) >= MOVED_SHARE * len(voxels))


def track_observations(observed: Sequence[PlaceObservations], tracks: Sequence[int | None]) -> list[PlaceObservations]:
    """What views observe of each candidate, of those of a track in all of its places.

    Args:
        observed: of each candidate in its own place.
        tracks: the track of each, if it has one.
    """
    members: dict[int, list[int]] = {}
    for k, track in enumerate(tracks):
        if track is not None:
            members.setdefault(track, []).append(k)
    joined = {track: _joined([observed[k] for k in own]) for track, own in members.items()}
    return [one if track is None else joined[track] for one, track in zip(observed, tracks, strict=True)]


def with_shared_posteriors(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Candidates of which those of a track have one posterior: that of the place of which detections show most."""
    best: dict[int, Candidate] = {}
    for one in candidates:
        if one.track is not None and one.posterior is not None:
            known = best.setdefault(one.track, one)
            if len(one.foreground_voxels) > len(known.foreground_voxels):
                best[one.track] = one
    return [replace(one, posterior=best[one.track].posterior) if one.track in best else one for one in candidates]


def without_settled(
    cloud: Cloud,
    candidates: Sequence[Candidate],
    probability: Float32[np.ndarray, "n k"],
    moved: Bool[np.ndarray, "n"],
) -> Float32[np.ndarray, "n k"]:
    """The probabilities of points, 0 of what passes where the point stands still.

    Args:
        cloud: the points of all views.
        candidates: objects.
        probability: of each of them at each point.
        moved: voxels that have moved.
    """
    tracked = [k for k, one in enumerate(candidates) if one.track is not None]
    if not tracked:
        return probability
    probability, hits = probability.copy(), count_hits(cloud.voxel_of_pixel, cloud.num_points)
    for k in tracked:
        views = [detection.view_index for detection in candidates[k].detections]
        probability[settled_voxels(cloud, moved, hits, min(views), max(views)), k] = 0
    return probability


def _place(cloud: Cloud, one: Candidate) -> _Place:
    votes = one.category_votes()
    centres = {
        seeds.detection.view_index: cloud.points[seeds.foreground].mean(axis=0)
        for seeds in (*one.weak, *one.sources)
        if len(seeds.foreground)
    }
    return _Place(min(votes, key=lambda name: (-votes[name], name)), one.size_m(cloud.voxel_m), centres)


def _apart(one: _Place, other: _Place) -> float:
    """How far two places are apart, as a share of how far a thing may move meanwhile; infinite if they are of two."""
    if one.name != other.name or one.centres_m.keys() & other.centres_m.keys():
        return np.inf
    reach_m = REACH * max(one.size_m, other.size_m, 1e-6)
    least = np.inf
    for view, centre_m in one.centres_m.items():
        for after, there_m in other.centres_m.items():
            gap = abs(view - after)
            if gap <= MAX_GAP:
                least = min(least, float(np.linalg.norm(centre_m - there_m)) / (gap * reach_m))
    return least


def _joined(observed: Sequence[PlaceObservations]) -> PlaceObservations:
    """Observations of one object in several places: in each view where the view shows most of it."""
    if len(observed) == 1:
        return observed[0]
    names = sorted({name for one in observed for name in one.confidence})
    sides = np.stack([one.side for one in observed])
    found = np.stack([np.max([*one.confidence.values()], axis=0) for one in observed])
    # A detection tells where it is, too, where no voxel of its own shows.
    place = np.argmax(sides + found, axis=0)
    views = np.arange(sides.shape[1])
    none = np.zeros(sides.shape[1])
    return PlaceObservations(
        {name: np.max([one.confidence.get(name, none) for one in observed], axis=0) for name in names},
        sides.max(axis=0),
        np.stack([one.from_object_m for one in observed])[place, views],
    )
