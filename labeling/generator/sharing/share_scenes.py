"""Labels of the objects of a scene in those of its episodes that have not found them themselves."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from labeling.core.episode_labels import LabelledObject
from labeling.core.errors import EpisodeFormatError
from labeling.core.rle import decode_mask
from labeling.core.types import Box3d, PseudoLabel
from labeling.generator.label_jobs import Job
from labeling.generator.label_writer import EpisodeResult, label_record, object_record
from labeling.generator.sharing.scene_objects import (
    ObjectMasks,
    ObjectObservation,
    SceneObject,
    associate_observations,
    project_objects,
)
from labeling.io.episodes import read_episode
from labeling.io.file_names import cloud_file
from labeling.io.formats.checked_json import read_json
from labeling.io.formats.ply import read_ply

MIN_CONFIDENCE = 0.6
"""Objects less sure than this stay with the episode that found them."""
EXPLAINED_SHARE = 0.3
"""Share of an object's pixels in a view from which on the labels that are there already explain it."""


def share_scenes(
    job: Job, states: Sequence[EpisodeResult], progress: Callable[[Iterable[Any]], Iterable[Any]] = iter
) -> list[EpisodeResult]:
    """Labels what one episode of a scene has found in the others, too.

    Args:
        job: what the episodes were labelled with; their clouds are there.
        states: how it went with each.
        progress: wraps the sequence of states, to draw a progress bar.

    Returns:
        The states, with records that have more objects and labels. Episodes whose ``episode.json`` names no scene, and
        those alone in theirs, are as before.

    Raises:
        EpisodeFormatError: if an ``episode.json`` or a cloud is malformed.
    """
    folders = {state.name: job.dataset / state.folder for state in states}
    scene_of = {state.name: _scene(folders[state.name]) for state in states if state.record is not None}
    observations: dict[tuple[str, ...], list[ObjectObservation]] = defaultdict(list)
    for state in states:
        scene = scene_of.get(state.name)
        if scene is not None:
            observations[scene].extend(_observations(job, state))
    objects = {scene: associate_observations(found) for scene, found in observations.items()}
    return [_with_shared(job, state, folders[state.name], objects, scene_of) for state in progress(states)]


def _scene(folder: Path) -> tuple[str, ...] | None:
    """World and scene of an episode, None if it does not say."""
    file = folder / "episode.json"
    if not file.is_file():
        return None
    about = read_json(file)
    if not about.has("scene"):
        return None
    return (about.text("world") if about.has("world") else "", about.text("scene"))


def _observations(job: Job, state: EpisodeResult) -> Iterator[ObjectObservation]:
    """The objects of an episode that are sure enough to be told to others."""
    file = cloud_file(job.out, state.name)
    try:
        cloud = read_ply(file)
    except (OSError, ValueError) as error:
        raise EpisodeFormatError(f"{error}; delete {file} and label again") from None
    points = np.stack([cloud["x"], cloud["y"], cloud["z"]], axis=1)
    for one in (state.record or {})["objects"]:
        if one["score"] >= MIN_CONFIDENCE:
            box = Box3d(*(np.asarray(one[name], float) for name in ("centre", "extent", "rotation")))
            own = points[cloud["label"] == one["instance_id"]]
            source = one["sources"][0]
            yield ObjectObservation(
                state.name,
                one["instance_id"],
                one["category"],
                one["score"],
                box,
                own,
                source["view_index"],
                source["confidence"],
            )


def _with_shared(
    job: Job,
    state: EpisodeResult,
    folder: Path,
    objects: dict[tuple[str, ...], list[SceneObject]],
    scene_of: dict[str, tuple[str, ...] | None],
) -> EpisodeResult:
    scene = scene_of.get(state.name)
    missing = [] if scene is None else [one for one in objects[scene] if not one.is_found_in(state.name)]
    if state.record is None or not missing:
        return state
    episode = read_episode(folder, job.recording, ground_truth=False)
    record = state.record
    own = _labelled(record, episode.num_views, episode.size)
    next_id = 1 + max((one["instance_id"] for one in record["objects"]), default=0)
    found: dict[int, list[tuple[int, ObjectMasks]]] = defaultdict(list)
    for view, known in enumerate(own):
        seen = project_objects(missing, episode.depth_m[view], episode.camera(view))
        for number, one in enumerate(seen):
            if one is None or np.count_nonzero(one.modal) < job.label.min_mask_px or _is_explained(one, known):
                continue
            found[number].append((view, one))
            known |= one.modal
    objects_here, labels_here = [], []
    for instance_id, number in enumerate(sorted(found), start=next_id):
        objects_here.append(_object(missing[number], instance_id))
        labels_here += [_label(missing[number], view, instance_id, one) for view, one in found[number]]
    shared = {
        "objects": [*record["objects"], *objects_here],
        "labels": sorted([*record["labels"], *labels_here], key=lambda label: label["view"]),
        "categories": list(dict.fromkeys([*record["categories"], *(one["category"] for one in objects_here)])),
    }
    return replace(state, record={**record, **shared})


def _labelled(record: dict[str, Any], views: int, size: tuple[int, int]) -> Bool[np.ndarray, "views h w"]:
    """What an episode's own labels cover."""
    found = np.zeros((views, *size), bool)
    for label in record["labels"]:
        if label["modal"] is not None:
            found[label["view"]] |= decode_mask(label["modal"]["segmentation"])
    return found


def _is_explained(found: ObjectMasks, known: Bool[np.ndarray, "h w"]) -> bool:
    return bool(np.count_nonzero(found.modal & known) > EXPLAINED_SHARE * np.count_nonzero(found.modal))


def _object(one: SceneObject, instance_id: int) -> dict[str, Any]:
    best = one.best
    here = LabelledObject(instance_id, best.category, best.confidence, best.box_3d, sources=())
    return {**object_record(here), "shared_from": {"episode": best.episode, "instance_id": best.instance_id}}


def _label(one: SceneObject, view: int, instance_id: int, found: ObjectMasks) -> dict[str, Any]:
    best = one.best
    here = PseudoLabel(
        view,
        instance_id,
        best.category,
        best.confidence,
        found.modal,
        found.amodal,
        best.source_view_index,
        best.source_confidence,
    )
    return {**label_record(here), "source_episode": best.episode}
