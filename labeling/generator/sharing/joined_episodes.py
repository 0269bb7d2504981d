"""Joins the episodes of one scene into one recording, and splits its labels by episode again.

An object may be unsure in the views of each episode and sure in all of them together, and a false detection of one
episode may be contradicted by the others. So confidences are compared with thresholds only after all episodes of a
scene have been fused. Beyond the thesis, which labels each episode by itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from labeling.core.episode import Episode
from labeling.core.episode_labels import EpisodeLabels, LabelledObject
from labeling.core.pose_check import PoseCheck
from labeling.core.types import Detection
from labeling.core.views import RgbdViews


@dataclass(frozen=True)
class EpisodePart:
    """The labels of one episode of a joined recording."""

    labels: EpisodeLabels
    """View indices and instance ids are those of the episode (from 0, from 1); sources of objects are its own views."""
    origins: dict[int, tuple[int, int]]
    """For each object that has sources only in other episodes, by instance id: the index of such an episode and the
    object's instance id there."""
    source_episodes: tuple[int, ...]
    """For each label the index of the episode that its ``source_view_index`` refers to."""


def join_episodes(
    episodes: Sequence[Episode], detections: Sequence[Sequence[Detection]]
) -> tuple[RgbdViews, list[Detection]]:
    """Concatenates the views of episodes of one scene and renumbers their detections.

    Args:
        episodes: at least one, with pictures of one size and poses in one world frame.
        detections: those of each episode.
    """
    arrays = ("rgb", "depth_m", "intrinsics", "camera_to_world")
    views = RgbdViews(*(np.concatenate([getattr(one, name) for one in episodes]) for name in arrays))
    starts = np.cumsum([0, *(one.num_views for one in episodes)])
    moved = [
        replace(one, view_index=one.view_index + int(start))
        for start, found in zip(starts, detections, strict=False)
        for one in found
    ]
    return views, moved


def split_labels(labels: EpisodeLabels, num_views: Sequence[int]) -> list[EpisodePart]:
    """Splits the labels of a joined recording by episode.

    Each episode gets the objects that one of its views shows or was a source of, and the cloud of the whole scene. What
    has moved from episode to episode, and is in one place in the views of one, has its box of that place there.

    Args:
        labels: of the joined views.
        num_views: number of views of each episode.
    """
    starts = np.cumsum([0, *num_views])

    def place(view_index: int) -> tuple[int, int]:
        """Index of the episode of a joined view, and the view's index in it."""
        episode = int(np.searchsorted(starts, view_index, side="right")) - 1
        return episode, view_index - int(starts[episode])

    shown = [{one.instance_id for one in labels.labels if place(one.view_index)[0] == k} for k in range(len(num_views))]
    for one in labels.objects:
        for source in one.sources:
            shown[place(source.view_index)[0]].add(one.instance_id)
    ids = [{name: number for number, name in enumerate(sorted(names), start=1)} for names in shown]
    return [_part(labels, k, place, ids, int(starts[k]), int(starts[k + 1])) for k in range(len(num_views))]


def _part(
    labels: EpisodeLabels,
    episode: int,
    place: Callable[[int], tuple[int, int]],
    ids: list[dict[int, int]],
    start: int,
    end: int,
) -> EpisodePart:
    own = ids[episode]
    objects, origins = [], {}
    kept = [column for column, one in enumerate(labels.objects) if one.instance_id in own]
    for one in (labels.objects[column] for column in kept):
        places = [place(source.view_index) for source in one.sources]
        sources = tuple(
            replace(source, view_index=view)
            for source, (k, view) in zip(one.sources, places, strict=True)
            if k == episode
        )
        number = own[one.instance_id]
        if not sources and places:
            first = places[0][0]
            origins[number] = first, ids[first][one.instance_id]
        objects.append(_standing(replace(one, instance_id=number, sources=sources), start, end))
    found = [one for one in labels.labels if start <= one.view_index < end]
    source_places = [place(one.source_view_index) for one in found]
    number_of = np.zeros(1 + max((one.instance_id for one in labels.objects), default=0), np.int32)
    number_of[list(own)] = list(own.values())
    cloud = labels.cloud
    return EpisodePart(
        replace(
            labels,
            objects=tuple(objects),
            labels=tuple(
                replace(
                    one,
                    view_index=one.view_index - start,
                    instance_id=own[one.instance_id],
                    source_view_index=view,
                )
                for one, (_, view) in zip(found, source_places, strict=True)
            ),
            cloud=replace(cloud, instance_id=number_of[cloud.instance_id], probability=cloud.probability[:, kept]),
            ignored=tuple(
                replace(one, view_index=one.view_index - start, instance_id=own.get(one.instance_id or 0))
                for one in labels.ignored
                if start <= one.view_index < end
            ),
            poses=labels.poses and _poses_of(labels.poses, start, end),
        ),
        origins,
        tuple(k for k, _ in source_places),
    )


def _standing(one: LabelledObject, start: int, end: int) -> LabelledObject:
    """An object as the views from ``start`` to ``end`` show it."""
    places = []
    for place in one.places:
        views = tuple(view - start for view in place.view_indices if start <= view < end)
        places += [replace(place, view_indices=views)] if views else []
    if len(places) == 1 and places[0].box_3d is not None:
        return replace(one, box_3d=places[0].box_3d, places=(), only_here=True)
    return replace(one, places=tuple(places))


def _poses_of(poses: PoseCheck, start: int, end: int) -> PoseCheck:
    """The part of a pose check that concerns the views from ``start`` to ``end``."""
    refined = poses.camera_to_world
    return replace(
        poses,
        view_residual_m=poses.view_residual_m[start:end],
        rotation_deg=poses.rotation_deg[start:end],
        translation_m=poses.translation_m[start:end],
        moved_m=poses.moved_m[start:end],
        camera_to_world=refined and refined[start:end],
    )
