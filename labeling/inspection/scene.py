"""What pictures and the viewer show of one labelled episode: cloud, boxes, cameras."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int32, UInt8

from labeling.core.errors import EpisodeFormatError, LabelFormatError, SbmError
from labeling.core.types import Box3d
from labeling.core.views import Camera
from labeling.formats.checked_json import Json, read_json
from labeling.formats.ply import hues, read_ply
from labeling.io.coco import CategoryTable, image_of, is_ignored, read_box_3d
from labeling.io.episodes import find_episodes
from labeling.io.file_names import BOXES_FILE, MODAL_FILE, SUMMARY_FILE, TRUTH_FILE, cloud_file
from labeling.io.label_set import recording_config, stated_dataset
from labeling.io.recordings.recording_config import RecordingConfig


@dataclass(frozen=True)
class SceneObject:
    """One object of an episode."""

    number: int
    """1, 2, ... within the episode, as the cloud's labels are."""
    title: str
    box: Box3d
    colour: tuple[float, float, float]
    """In [0, 1]; the hue that the object has in the cloud."""
    category: str
    confidence: float
    instance_id: int
    """As in the label set."""
    views: tuple[int, ...]
    """Of the episode: where it is labelled, in order."""
    source: str
    """Where it was found: ``view 3 (0.97)``, with the episode before it if that is another one; empty if unknown."""
    consistency: float | None = None
    """Share, in [0, 1], of the views it was detected in whose surest detection calls it what the label does; None if
    the label set names no detection of it."""


@dataclass(frozen=True)
class TrueObject:
    """One object as the ground truth of the recording has it."""

    category: str
    box: Box3d


@dataclass(frozen=True)
class LabelledScene:
    """One labelled episode."""

    name: str
    points: Float[np.ndarray, "n 3"]
    colours: UInt8[np.ndarray, "n 3"]
    labels: Int32[np.ndarray, "n"]
    objects: tuple[SceneObject, ...]
    cameras: tuple[Camera, ...]
    """One a view. Empty if the dataset is no longer where the label set says."""
    place: tuple[str, str] | None = None
    """World and scene, whose episodes share a world frame; None if the recording does not say."""
    truth: tuple[TrueObject, ...] = ()
    """What really stands there, as far as the recording knows; without what is ignored or moves."""


def read_scenes(folder: Path, most: int | None = None) -> list[LabelledScene]:
    """The labelled episodes of a label set, in its order.

    Args:
        folder: of the label set.
        most: read no more than so many, the first ones; clouds of many episodes fill memory.

    Raises:
        LabelFormatError: if a file is missing or malformed.
    """
    try:
        summary = read_json(folder / SUMMARY_FILE)
        modal = read_json(folder / MODAL_FILE)
        names_of = {one.integer("id"): one.text("name") for one in modal.list_of("categories")}
        views_of = _views_of_objects(modal)
        boxes_of: defaultdict[str, list[Json]] = defaultdict(list)
        for box in read_json(folder / BOXES_FILE).list_of("boxes"):
            boxes_of[box.text("episode")].append(box)
        recordings, config = _recordings(folder, summary)
        labelled = [e.file_name("name") for e in summary.list_of("episodes") if e.text("status") == "labelled"]
        scenes = []
        for name in labelled[:most]:
            found = boxes_of[name]
            tints = hues(np.arange(1, len(found) + 1)).tolist()
            objects = []
            for number, (box, tint) in enumerate(zip(found, tints, strict=True), start=1):
                category, confidence = names_of.get(box.integer("category_id"), "?"), box.number("score")
                title, instance_id = f"{number} {category} {confidence:.2f}", box.integer("instance_id")
                named = (number, title, read_box_3d(box), tuple(tint), category, confidence, instance_id)
                views = tuple(sorted(views_of.get((name, instance_id), ())))
                objects.append(SceneObject(*named, views, _source(box), _consistency(box, category)))
            file = cloud_file(folder, name)
            try:
                cloud = read_ply(file)
            except (OSError, ValueError) as error:
                raise LabelFormatError(f"{file}: cannot be read ({error})") from None
            points = np.stack([cloud["x"], cloud["y"], cloud["z"]], axis=1).astype(float)
            colours = np.stack([cloud["red"], cloud["green"], cloud["blue"]], axis=1)
            labels = np.asarray(cloud["label"], np.int32)
            there = np.isfinite(points).all(axis=1)  # labeling.inspect tells of others
            points, colours, labels = points[there], colours[there], labels[there]
            recorded = _recorded(recordings.get(name), config)
            scenes.append(LabelledScene(name, points, colours, labels, tuple(objects), *recorded))
        return scenes
    except EpisodeFormatError as error:
        raise LabelFormatError(str(error)) from None


def _views_of_objects(modal: Json) -> dict[tuple[str, int], set[int]]:
    """By episode and instance the views that it is labelled in."""
    views = {one.integer("id"): (one.text("episode"), one.integer("view")) for one in modal.list_of("images")}
    found: dict[tuple[str, int], set[int]] = {}
    for record in modal.list_of("annotations"):
        if not is_ignored(record):
            episode, view = image_of(record, views)
            found.setdefault((episode, record.integer("instance_id")), set()).add(view)
    return found


def _source(box: Json) -> str:
    """The most confident detection that an object stems from, in words."""
    sources = box.list_of("sources") if box.has("sources") else []
    if not sources:
        return ""
    best = max(sources, key=lambda one: one.number("confidence"))
    elsewhere = f"{box.get('shared_from').text('episode')}, " if box.has("shared_from") else ""
    return f"{elsewhere}view {best.integer('view_index')} ({best.number('confidence'):.2f})"


def _consistency(box: Json, category: str) -> float | None:
    surest: dict[int, tuple[float, bool]] = {}
    for source in box.list_of("sources") if box.has("sources") else []:
        if source.has("category"):
            vote = source.number("confidence"), source.text("category") == category
            view = source.integer("view_index")
            surest[view] = max(surest.get(view, vote), vote)
    return sum(agrees for _, agrees in surest.values()) / len(surest) if surest else None


def _recordings(folder: Path, summary: Json) -> tuple[dict[str, Path], RecordingConfig]:
    """Folders of the recorded episodes, by name, and how they are read; none if the recording is gone."""
    dataset = stated_dataset(folder, summary)
    if dataset is None or not dataset.is_dir():
        return {}, RecordingConfig()
    try:
        config = recording_config(summary.mapping())
        return {path.resolve().name: path for path in find_episodes(dataset, config)}, config
    except SbmError:
        return {}, RecordingConfig()


def _recorded(
    episode: Path | None, config: RecordingConfig
) -> tuple[tuple[Camera, ...], tuple[str, str] | None, tuple[TrueObject, ...]]:
    """Where the views were taken from, in which scene, and what stands there; nothing if the recording is gone."""
    from labeling.generator.sharing.scene_groups import scene_of
    from labeling.io.recordings.layouts import frames_of
    from labeling.io.recordings.pictures import read_colour

    if episode is None:
        return (), None, ()
    try:
        frames = frames_of(episode, config).frames
        size = read_colour(frames[0].colour_file).shape[:2]
        cameras = tuple(Camera(frame.camera((size[0], size[1])), frame.camera_to_world, size) for frame in frames)
        return cameras, scene_of(episode), _truth(episode)
    except SbmError:
        return (), None, ()


def _truth(episode: Path) -> tuple[TrueObject, ...]:
    """The boxes of an episode's ground truth, one an object; none if there is no ground truth."""
    if not (episode / TRUTH_FILE).is_file():
        return ()
    file = read_json(episode / TRUTH_FILE)
    table = CategoryTable.from_files([file])
    found: dict[int, TrueObject] = {}
    moves: set[int] = set()
    for record in file.list_of("annotations"):
        if is_ignored(record) or not (record.has("box_3d") and record.has("instance_id")):
            continue
        number, box = record.integer("instance_id"), read_box_3d(record.get("box_3d"))
        before = found.setdefault(number, TrueObject(table.name(record), box)).box
        if not np.allclose(before.centre_m, box.centre_m) or not np.allclose(before.rotation, box.rotation):
            moves.add(number)
    return tuple(one for number, one in sorted(found.items()) if number not in moves)


def together(scenes: Sequence[LabelledScene]) -> LabelledScene:
    """Episodes that share a world frame as one: all clouds, objects numbered on, and cameras.

    Args:
        scenes: at least one.
    """
    objects: list[SceneObject] = []
    truth: list[TrueObject] = []
    labels = []
    for scene in scenes:
        # What several episodes have seen stands there once.
        truth += [one for one in scene.truth if not any(_is_same(one, other) for other in truth)]
        labels.append(np.where(scene.labels > 0, scene.labels + len(objects), 0).astype(np.int32))
        for one in scene.objects:
            number = len(objects) + 1
            title = f"{number} {one.category} {one.confidence:.2f}"
            objects.append(replace(one, number=number, title=title, source=f"{scene.name}: {one.source}"))
    return LabelledScene(
        name=" + ".join(scene.name for scene in scenes),
        points=np.concatenate([scene.points for scene in scenes]),
        colours=np.concatenate([scene.colours for scene in scenes]),
        labels=np.concatenate(labels),
        objects=tuple(objects),
        cameras=tuple(camera for scene in scenes for camera in scene.cameras),
        place=scenes[0].place,
        truth=tuple(truth),
    )


def _is_same(one: TrueObject, other: TrueObject) -> bool:
    return one.category == other.category and bool(np.allclose(one.box.corners(), other.box.corners(), atol=1e-3))
