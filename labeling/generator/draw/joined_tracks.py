"""One object for each track: labels of its places become labels of what has moved from place to place."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from labeling.core.episode_labels import EpisodeLabels, LabelledObject, Place
from labeling.core.types import PseudoLabel


def join_tracks(labels: EpisodeLabels, tracks: Sequence[int | None]) -> EpisodeLabels:
    """Makes objects of places.

    What has moved is labelled in the views that show it, where they show it; elsewhere it is not hidden but gone. It
    has no 3-D box, since it is in no one place, but one in each of its places; its points are taken out of the cloud.

    Args:
        labels: as drawn, of objects in one place each, numbered from 1.
        tracks: the track of each of these, None for what stands still.

    Returns:
        The same labels if nothing moves.
    """
    if all(track is None for track in tracks):
        return labels
    first: dict[int, int] = {}
    places: list[list[int]] = []
    for k, track in enumerate(tracks):
        if track is not None and track in first:
            places[first[track]].append(k)
            continue
        if track is not None:
            first[track] = len(places)
        places.append([k])
    # What stands still comes first: its numbers are those of the boxes and of the cloud.
    places.sort(key=lambda own: tracks[own[0]] is not None)
    number = {labels.objects[k].instance_id: place for place, own in enumerate(places, start=1) for k in own}
    moves = [tracks[own[0]] is not None for own in places]
    seen = _views(labels.labels)
    objects = tuple(
        _object([labels.objects[k] for k in own], place, moves[place - 1], seen)
        for place, own in enumerate(places, start=1)
    )
    best = {one.instance_id: one.sources[0] for one in objects if one.sources}
    drawn: dict[tuple[int, int], PseudoLabel] = {}
    for one in labels.labels:
        place = number[one.instance_id]
        source = best[place] if moves[place - 1] else None
        if source is not None:
            if not one.modal.any():
                continue
            one = replace(
                one,
                category=objects[place - 1].category,
                source_view_index=source.view_index,
                source_confidence=source.confidence,
            )
        key = one.view_index, place
        one = replace(one, instance_id=place)
        drawn[key] = _together(drawn[key], one) if key in drawn else one
    return replace(labels, objects=objects, labels=tuple(drawn.values()), cloud=_cloud(labels, places, moves))


def _views(labels: Sequence[PseudoLabel]) -> dict[int, tuple[int, ...]]:
    """The views that show each object."""
    found: dict[int, set[int]] = {}
    for one in labels:
        if one.modal.any():
            found.setdefault(one.instance_id, set()).add(one.view_index)
    return {name: tuple(sorted(views)) for name, views in found.items()}


def _object(
    own: Sequence[LabelledObject], number: int, moves: bool, seen: Mapping[int, tuple[int, ...]]
) -> LabelledObject:
    if not moves:
        return replace(own[0], instance_id=number)
    sources = sorted((s for one in own for s in one.sources), key=lambda s: (-s.confidence, s.view_index))
    best = max(own, key=lambda one: one.confidence)
    places = tuple(Place(one.box_3d, seen[one.instance_id]) for one in own if one.instance_id in seen)
    return replace(best, instance_id=number, box_3d=None, sources=tuple(sources), places=places)


def _together(one: PseudoLabel, other: PseudoLabel) -> PseudoLabel:
    """Two labels of one object in one view as one."""
    larger = one if np.count_nonzero(one.modal) >= np.count_nonzero(other.modal) else other
    return replace(larger, modal=one.modal | other.modal, amodal=one.amodal | other.amodal)


def _cloud(labels: EpisodeLabels, places: Sequence[Sequence[int]], moves: Sequence[bool]):
    """The cloud without the points of what moves, with a column of probabilities for each object."""
    cloud = labels.cloud
    number_of = np.zeros(len(labels.objects) + 1, np.int32)
    for number, own in enumerate(places, start=1):
        for k in own:
            number_of[labels.objects[k].instance_id] = number
    instance_id = number_of[cloud.instance_id]
    stays = ~np.array([False, *moves])[instance_id]
    kept = cloud.probability[stays]
    probability = np.stack([kept[:, own].max(axis=1) for own in places], axis=1)
    return replace(
        cloud,
        points=cloud.points[stays],
        colours=cloud.colours[stays],
        instance_id=instance_id[stays],
        probability=probability,
    )
