"""Association of detections of different views: which are of one object, by the voxels they share and by category."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float32, Int
from numba import njit

from labeling.core.types import Detection
from labeling.generator.objects.seeds import DetectionSeeds

OTHER_VIEWS = 3
"""How many views besides the source must be confident of a consistent object. Source: thesis A.5, criterion 1."""

CUT_SHARE = 0.6
"""A mask counts as cut off by a side of the picture if more than this share of the square root of its area, in pixels,
touches that side."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate object: the detections associated with it, and their votes on each of the n voxels of the cloud."""

    sources: tuple[DetectionSeeds, ...]
    """Confident detections of it."""
    votes_for: Float32[np.ndarray, "n"]
    """Sum of the confidences of the sources that saw the voxel inside their mask."""
    votes_against: Float32[np.ndarray, "n"]
    """Sum of the confidences of the sources that saw it outside."""
    weak: tuple[DetectionSeeds, ...] = ()
    """Detections below the confidence threshold that overlap it."""
    posterior: Mapping[str, float] | None = None
    """Probability of each category, once computed; until then confidences of detections decide the category."""
    track: int | None = None
    """Number of the moving object that was in this place for a while; None for what stands still."""

    @classmethod
    def of(cls, seeds: DetectionSeeds, num_voxels: int) -> "Candidate":
        """A candidate with one source; ``num_voxels`` is the size of the cloud."""
        return cls((), np.zeros(num_voxels, np.float32), np.zeros(num_voxels, np.float32)).with_sources([seeds])

    def with_sources(self, sources: Sequence[DetectionSeeds], weak: Sequence[DetectionSeeds] = ()) -> "Candidate":
        """The object with the votes of more detections."""
        votes_for, votes_against = self.votes_for.copy(), self.votes_against.copy()
        for seeds in sources:
            votes_for[seeds.foreground] += seeds.detection.confidence
            votes_against[seeds.background] += seeds.detection.confidence
        return Candidate((*self.sources, *sources), votes_for, votes_against, (*self.weak, *weak))

    def merged(self, others: Iterable["Candidate"]) -> "Candidate":
        """The union of this object and others."""
        others = list(others)
        sources = [seeds for other in others for seeds in other.sources]
        return self.with_sources(sources, [seeds for other in others for seeds in other.weak]) if others else self

    @property
    def detections(self) -> list[Detection]:
        """Its sources and weak detections."""
        return [seeds.detection for seeds in (*self.sources, *self.weak)]

    @cached_property
    def foreground(self) -> Bool[np.ndarray, "n"]:
        """Voxels that more sources place inside than outside."""
        return self.votes_for > self.votes_against

    @cached_property
    def seen(self) -> Bool[np.ndarray, "n"]:
        """Voxels that any source has voted on."""
        return (self.votes_for > 0) | (self.votes_against > 0)

    @cached_property
    def outlined_in(self) -> frozenset[int]:
        """Indices of the views in which a person outlined it."""
        return frozenset(one.detection.view_index for one in self.sources if one.detection.exact)

    @property
    def beside_outlines(self) -> Float32[np.ndarray, "n"]:
        """How many outlines that a person drew of it have each voxel beside them, less those that have it inside."""
        more = np.zeros(len(self.votes_for), np.float32)
        for one in self.sources:
            if one.detection.exact:
                more[one.background] += 1
                more[one.foreground] -= 1
        return more

    @cached_property
    def foreground_voxels(self) -> Int[np.ndarray, "f"]:
        """Indices of the foreground: few of all voxels, so that two candidates are compared quickly."""
        return np.flatnonzero(self.foreground)

    @property
    def is_cut(self) -> bool:
        """Whether the border of the picture cuts it off in all of its sources."""
        return all(_is_cut(one.detection.mask) for one in self.sources)

    def size_m(self, voxel_m: float) -> float:
        """Square root of the surface that a view shows of it, the median over its sources."""
        return float(np.sqrt(np.median([len(one.foreground) for one in self.sources]))) * voxel_m

    @cached_property
    def category(self) -> str:
        """The category with the highest posterior, or, before that is known, with the largest sum of confidences; the
        alphabet decides between equals.
        """
        votes = self.posterior or self.category_votes()
        return min(votes, key=lambda name: (-votes[name], name))

    def category_votes(self) -> dict[str, float]:
        """Sum of the confidences of all its detections, by category."""
        votes: dict[str, float] = {}
        for detection in self.detections:
            votes[detection.category] = votes.get(detection.category, 0.0) + detection.confidence
        return votes


def _is_cut(mask: Bool[np.ndarray, "h w"]) -> bool:
    """Whether a mask touches one side of the picture so far that the object must go on beyond."""
    sides_px = [np.count_nonzero(side) for side in (mask[0], mask[-1], mask[:, 0], mask[:, -1])]
    return bool(max(sides_px) > CUT_SHARE * np.sqrt(np.count_nonzero(mask)))


def overlap(a: Candidate, b: Candidate) -> tuple[float, float]:
    """How much two candidates overlap, counted only where the sources of both have voted.

    Returns:
        Intersection over the smaller foreground, and intersection over union; 0 where the views share too little
        to tell (under a tenth of the smaller foreground).
    """
    shared = np.count_nonzero(b.foreground[a.foreground_voxels])
    if shared == 0:
        return 0.0, 0.0
    # A foreground is seen by its own sources; what counts of it is what the other's sources have seen too.
    in_a, in_b = np.count_nonzero(b.seen[a.foreground_voxels]), np.count_nonzero(a.seen[b.foreground_voxels])
    smaller = min(in_a, in_b)
    if smaller < 0.1 * min(len(a.foreground_voxels), len(b.foreground_voxels)):
        return 0.0, 0.0
    return shared / smaller, shared / (in_a + in_b - shared)


def overlap_of_detection(one: Candidate, seeds: DetectionSeeds) -> tuple[float, float]:
    """``overlap`` between a candidate and a single detection, without making a candidate of the detection."""
    if seeds.detection.confidence <= 0:
        return 0.0, 0.0
    shared, in_one, in_other = _count_shared(one.foreground, one.seen, seeds.foreground, seeds.background)
    smaller = min(in_one, in_other)
    if shared == 0 or smaller < 0.1 * min(len(one.foreground_voxels), len(seeds.foreground)):
        return 0.0, 0.0
    return shared / smaller, shared / (in_one + in_other - shared)


@njit(cache=True, nogil=True)
def _count_shared(foreground, seen, inside, outside):  # pragma: no cover - compiled
    """Voxels that a candidate and a detection share.

    Args:
        foreground: (n,) bool, of the candidate.
        seen: (n,) bool, of the candidate.
        inside: (f,) int32, foreground of the detection.
        outside: (b,) int32, its background.

    Returns:
        How many are in both foregrounds, of the candidate's foreground seen by the detection, and the reverse.
    """
    shared, in_other = 0, 0
    for voxel in inside:
        shared += foreground[voxel]
        in_other += seen[voxel]
    in_one = shared
    for voxel in outside:
        in_one += foreground[voxel]
    return shared, in_one, in_other


def same_object(a: Candidate, b: Candidate, threshold: float) -> bool:
    """Whether two candidates are one object.

    Candidates of one category are if ``threshold`` of the smaller lies in the other; candidates of two categories if
    their IoU is at least that (a cushion on a couch is not the couch). Two outlines that a person drew in one view are
    never one object.
    """
    return not a.outlined_in & b.outlined_in and _enough(overlap(a, b), a.category == b.category, threshold)


def _enough(overlap: tuple[float, float], same_category: bool, threshold: float) -> bool:
    """Whether candidates with this (intersection over smaller, IoU) are one object."""
    return overlap[0 if same_category else 1] >= threshold


def associate_detections(seeds: Sequence[DetectionSeeds], num_voxels: int, threshold: float) -> list[Candidate]:
    """Groups detections into objects: the most confident first, then unions until nothing changes.

    Args:
        seeds: confident detections.
        num_voxels: size of the cloud.
        threshold: share of the commonly seen space that makes two candidates one object.

    Returns:
        Objects, the one with the most confident source first.
    """
    order = sorted(range(len(seeds)), key=lambda i: (-seeds[i].detection.confidence, i))
    candidates: list[Candidate] = []
    for index in order:
        one = seeds[index]
        name = one.detection.category
        place = next(
            (
                i
                for i, other in enumerate(candidates)
                if not (one.detection.exact and one.detection.view_index in other.outlined_in)
                and _enough(overlap_of_detection(other, one), other.category == name, threshold)
            ),
            None,
        )
        if place is None:
            candidates.append(Candidate.of(one, num_voxels))
        else:
            candidates[place] = candidates[place].with_sources([seeds[index]])
    return _merge_until_stable(candidates, threshold)


def _merge_until_stable(candidates: Sequence[Candidate], threshold: float) -> list[Candidate]:
    """Merges pairs of candidates that are one object until there is no such pair."""
    candidates, merged = list(candidates), True
    while merged:
        merged = False
        for i in range(len(candidates)):
            for j in range(len(candidates) - 1, i, -1):
                if same_object(candidates[i], candidates[j], threshold):
                    candidates[i] = candidates[i].merged([candidates.pop(j)])
                    merged = True
    return candidates


def assign_weak_detections(
    candidates: Sequence[Candidate], seeds: Sequence[DetectionSeeds], threshold: float
) -> tuple[list[Candidate], list[DetectionSeeds]]:
    """Associates detections below the confidence threshold with the object that they overlap most.

    Args:
        candidates: the objects. They are compared as their sources left them, so that the order of the weak detections
            does not matter.
        seeds: detections below the threshold.
        threshold: as in ``associate_detections``.

    Returns:
        The objects with their weak detections, and the detections that overlap no object.
    """
    weak: list[list[DetectionSeeds]] = [[] for _ in candidates]
    unassigned = []
    for one in seeds:
        shared = [overlap_of_detection(other, one) for other in candidates]
        name = one.detection.category
        matches = [k for k, other in enumerate(candidates) if _enough(shared[k], other.category == name, threshold)]
        if matches:
            weak[max(matches, key=shared.__getitem__)].append(one)
        elif all(inside < threshold for inside, _ in shared):
            unassigned.append(one)
        # Those inside an object of another category are left out: kept, they made more wrong labels than right ones in
        # 60 training and development episodes (wrong 1293 to 1383, right 3354 to 3330; AP50 69.4 to 69.0).
    return [replace(one, weak=(*one.weak, *own)) for one, own in zip(candidates, weak, strict=True)], unassigned


@dataclass(frozen=True)
class UnsureGroup:
    """Detections below the confidence threshold that share voxels: a candidate object that no view is confident of."""

    seeds: tuple[DetectionSeeds, ...]
    """The most confident first."""
    foreground_voxels: Int[np.ndarray, "f"]
    """Voxels that more of them place inside than outside; at least one."""

    def as_candidate(self, num_voxels: int) -> Candidate:
        """The candidate whose sources they are."""
        first, *others = self.seeds
        return Candidate.of(first, num_voxels).with_sources(others)


def group_unsure(seeds: Sequence[DetectionSeeds], num_voxels: int, threshold: float) -> list[UnsureGroup]:
    """Groups detections that overlap no object.

    Args:
        seeds: detections below the confidence threshold.
        num_voxels: size of the cloud.
        threshold: as in ``associate_detections``.
    """
    # Only voxels in some foreground decide what overlaps, a fraction of the cloud: these are numbered anew.
    place = np.full(num_voxels, -1, np.int32)
    for one in seeds:
        place[one.foreground] = 0
    voxels = np.flatnonzero(place == 0)
    place[voxels] = np.arange(len(voxels))
    compact, given = [], {}
    for one in seeds:
        background = place[one.background]
        compact.append(replace(one, foreground=place[one.foreground], background=background[background >= 0]))
        given[id(compact[-1])] = one
    return [
        UnsureGroup(tuple(given[id(one)] for one in found.sources), voxels[found.foreground_voxels])
        for found in associate_detections(compact, len(voxels), threshold)
        if len(found.foreground_voxels) > 0
    ]


def group_segments(
    candidates: Sequence[Candidate], probability: Float32[np.ndarray, "n k"], threshold: float
) -> list[list[int]]:
    """Groups objects whose segments in space turn out to be one, such as the front and the back of a chair.

    Args:
        candidates: the objects, best first.
        probability: of each object at each point, each of an object by itself.
        threshold: intersection over the smaller segment (one category) or over the union (two categories).

    Returns:
        Indices of the objects of each group, groups in order of their first object.
    """
    from scipy.sparse import csc_array

    inside = csc_array(probability > 0.5, dtype=np.int64)
    together = (inside.T @ inside).toarray()  # points that each two segments share; of one with itself, its size
    groups: list[list[int]] = []
    for k, candidate in enumerate(candidates):
        for group in groups:
            first = group[0]
            shared, sizes = together[k, first], (together[k, k], together[first, first])
            same = candidate.category == candidates[first].category
            base = min(sizes) if same else sum(sizes) - shared
            apart = any(candidate.outlined_in & candidates[member].outlined_in for member in group)
            if shared and shared >= threshold * base and not apart:
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def is_consistent(candidate: Candidate, confident: float, other_views: int = OTHER_VIEWS) -> bool:
    """Whether enough views are confident of an object and all of them call it by one name.

    Args:
        candidate: the object.
        confident: detections at least this confident count; those below neither help nor harm.
        other_views: how many views there must be besides the one a label stems from.

    Source: thesis A.5: at least three other views with confident detections of the object, and a single class among
    them. There it improved some classes and thinned out others, and was left off.
    """
    confident_ones = [one.detection for one in candidate.sources if one.detection.confidence >= confident]
    views = {detection.view_index for detection in confident_ones}
    return len(views) > other_views and len({detection.category for detection in confident_ones}) == 1
