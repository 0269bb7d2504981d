"""Labels of the objects of a scene in those of its episodes that have not found them themselves."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from labeling.core.episode import Episode
from labeling.core.episode_labels import LabelledObject
from labeling.core.errors import EpisodeFormatError
from labeling.core.rle import decode_mask
from labeling.core.types import PseudoLabel
from labeling.formats.ply import read_ply
from labeling.generator.label_jobs import EpisodeResult, Job
from labeling.generator.sharing.scene_groups import scene_of
from labeling.generator.sharing.scene_objects import (
    ObjectMasks,
    ObjectObservation,
    SceneObject,
    associate_observations,
    project_objects,
)
from labeling.io.episodes import read_episode
from labeling.io.file_names import cloud_file
from labeling.io.label_records import EpisodeRecord, LabelRecord, ObjectRecord

MIN_CONFIDENCE = 0.6
"""Objects less confident than this stay with the episode that found them."""
EXPLAINED_SHARE = 0.3
"""Share of an object's pixels in a view from which on the labels that are there are taken to be of it."""


def share_scenes(
    job: Job, results: Sequence[EpisodeResult], progress: Callable[[Iterable[Any]], Iterable[Any]] = iter
) -> list[EpisodeResult]:
    """Labels what one episode of a scene has found in the others, too.

    Args:
        job: what the episodes were labelled with; their clouds are there.
        results: how it went with each.
        progress: wraps the sequence of results, to draw a progress bar.

    Returns:
        The results, with records that have more objects and labels. Episodes whose ``episode.json`` names no scene,
        those alone in theirs, and those labelled together with all others of theirs, are as before.

    Raises:
        EpisodeFormatError: if an ``episode.json`` or a cloud is malformed.
    """
    folders = {one.name: job.dataset / one.folder for one in results}
    scenes = {one.name: scene_of(folders[one.name]) for one in results if one.record is not None}
    members: dict[Any, set[str]] = defaultdict(set)
    for name, scene in scenes.items():
        members[scene].add(name)
    known = {one.name: {one.name, *one.labelled_with} for one in results}
    scenes = {
        name: scene for name, scene in scenes.items() if any(known[other] < members[scene] for other in members[scene])
    }
    observations: dict[tuple[str, ...], list[ObjectObservation]] = defaultdict(list)
    for one in results:
        scene = scenes.get(one.name)
        if scene is not None and one.record is not None:
            observations[scene].extend(_observations(job, one, one.record))
    objects = {scene: associate_observations(found) for scene, found in observations.items()}
    shared = []
    for one in progress(results):
        scene = scenes.get(one.name)
        missing = [] if scene is None else [other for other in objects[scene] if not other.is_found_in(known[one.name])]
        if missing and one.record is not None:
            one = _with_shared(job, folders[one.name], one, one.record, missing)
        shared.append(one)
    return shared


def _observations(job: Job, result: EpisodeResult, record: EpisodeRecord) -> Iterator[ObjectObservation]:
    """The objects of an episode that are confident enough to be shared, and no guests of this episode.

    One that has sources only in episodes that it was labelled together with is theirs to share.
    """
    file = cloud_file(job.out, result.name)
    try:
        cloud = read_ply(file)
    except (OSError, ValueError) as error:
        raise EpisodeFormatError(f"{error}; delete {file} and label again") from None
    points = np.stack([cloud["x"], cloud["y"], cloud["z"]], axis=1)
    for one in record.objects:
        if one.sources and one.score >= MIN_CONFIDENCE and one.box_3d is not None and not one.only_here:
            yield ObjectObservation(
                episode=result.name,
                instance_id=one.instance_id,
                category=one.category,
                confidence=one.score,
                box_3d=one.box_3d,
                points=points[cloud["label"] == one.instance_id],
                source_view_index=one.sources[0].view_index,
                source_confidence=one.sources[0].confidence,
            )


def _with_shared(
    job: Job, folder: Path, result: EpisodeResult, record: EpisodeRecord, missing: Sequence[SceneObject]
) -> EpisodeResult:
    """The result with the objects of its scene that it is missing, as far as its views show them."""
    episode = read_episode(folder, job.recording, ground_truth=False)
    if record.poses is not None and record.poses.camera_to_world is not None:
        episode = replace(episode, camera_to_world=np.array(record.poses.camera_to_world))
    found: dict[int, list[tuple[int, ObjectMasks]]] = defaultdict(list)
    for view, labelled in enumerate(_labelled(record, episode)):
        masks_of = project_objects(missing, episode.depth_m[view], episode.camera(view))
        for number, masks in enumerate(masks_of):
            if masks is None or np.count_nonzero(masks.modal) < job.label.min_mask_px or _is_explained(masks, labelled):
                continue
            found[number].append((view, masks))
            labelled |= masks.modal
    objects, labels = [], []
    first_id = 1 + max((one.instance_id for one in record.objects), default=0)
    for instance_id, number in enumerate(sorted(found), start=first_id):
        best = missing[number].best
        origin = {"episode": best.episode, "instance_id": best.instance_id}
        here = LabelledObject(instance_id, best.category, best.confidence, best.box_3d, sources=())
        objects.append(ObjectRecord.of(here, shared_from=origin))
        for view, masks in found[number]:
            label = PseudoLabel(
                view_index=view,
                instance_id=instance_id,
                category=best.category,
                confidence=best.confidence,
                modal=masks.modal,
                amodal=masks.amodal,
                source_view_index=best.source_view_index,
                source_confidence=best.source_confidence,
            )
            labels.append(LabelRecord.of(label, source_episode=best.episode))
    shared = replace(
        record,
        objects=(*record.objects, *objects),
        labels=tuple(sorted([*record.labels, *labels], key=lambda label: label.view)),
        categories=tuple(dict.fromkeys([*record.categories, *(one.category for one in objects)])),
    )
    return replace(result, record=shared)


def _labelled(record: EpisodeRecord, episode: Episode) -> Bool[np.ndarray, "views h w"]:
    """What an episode's own labels cover."""
    covered = np.zeros((episode.num_views, *episode.size), bool)
    for label in record.labels:
        if label.modal is not None:
            covered[label.view] |= decode_mask(label.modal.segmentation)
    return covered


def _is_explained(masks: ObjectMasks, labelled: Bool[np.ndarray, "h w"]) -> bool:
    """Whether labels cover so much of an object's visible pixels that they are of this very object."""
    return bool(np.count_nonzero(masks.modal & labelled) > EXPLAINED_SHARE * np.count_nonzero(masks.modal))
