"""What pictures and the viewer show of one labelled episode: cloud, boxes, cameras."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int32, UInt8

from labeling.core.errors import EpisodeFormatError, LabelFormatError, SbmError
from labeling.core.types import Box3d
from labeling.core.views import Camera
from labeling.formats.checked_json import Json, read_json
from labeling.formats.ply import hues, read_ply
from labeling.io.coco import read_box_3d
from labeling.io.episodes import find_episodes
from labeling.io.file_names import BOXES_FILE, MODAL_FILE, SUMMARY_FILE, cloud_file
from labeling.io.label_set import recording_config, stated_dataset


@dataclass(frozen=True)
class SceneObject:
    """One object of an episode."""

    number: int
    """1, 2, ... within the episode, as the cloud's labels are."""
    title: str
    box: Box3d
    colour: tuple[float, float, float]


@dataclass(frozen=True)
class LabelledScene:
    """One labelled episode."""

    name: str
    points: Float[np.ndarray, "n 3"]
    colours: UInt8[np.ndarray, "n 3"]
    labels: Int32[np.ndarray, "n"]
    objects: tuple[SceneObject, ...]
    cameras: tuple[Camera, ...]
    """Empty if the dataset is no longer where the label set says."""


def read_scenes(folder: Path) -> list[LabelledScene]:
    """The labelled episodes of a label set, in its order.

    Raises:
        LabelFormatError: if a file is missing or malformed.
    """
    try:
        summary = read_json(folder / SUMMARY_FILE)
        names_of = {one.integer("id"): one.text("name") for one in read_json(folder / MODAL_FILE).list_of("categories")}
        boxes = read_json(folder / BOXES_FILE).list_of("boxes")
        labelled = [e.file_name("name") for e in summary.list_of("episodes") if e.text("status") == "labelled"]
        scenes = []
        for name in labelled:
            found = [box for box in boxes if box.text("episode") == name]
            tints = hues(np.arange(1, len(found) + 1)).tolist()
            objects = []
            for number, (box, tint) in enumerate(zip(found, tints, strict=True), start=1):
                title = f"{number} {names_of.get(box.integer('category_id'), '?')} {box.number('score'):.2f}"
                objects.append(SceneObject(number, title, read_box_3d(box), tuple(tint)))
            file = cloud_file(folder, name)
            try:
                cloud = read_ply(file)
            except (OSError, ValueError) as error:
                raise LabelFormatError(f"{file}: cannot be read ({error})") from None
            points = np.stack([cloud["x"], cloud["y"], cloud["z"]], axis=1).astype(float)
            colours = np.stack([cloud["red"], cloud["green"], cloud["blue"]], axis=1)
            labels, cameras = np.asarray(cloud["label"], np.int32), _cameras(folder, summary, name)
            scenes.append(LabelledScene(name, points, colours, labels, tuple(objects), cameras))
        return scenes
    except EpisodeFormatError as error:
        raise LabelFormatError(str(error)) from None


def _cameras(folder: Path, summary: Json, name: str) -> tuple[Camera, ...]:
    """Where the views were taken from; nothing if the recording cannot be found any more."""
    from labeling.io.recordings.layouts import frames_of
    from labeling.io.recordings.pictures import read_colour

    dataset = stated_dataset(folder, summary)
    if dataset is None or not dataset.is_dir():
        return ()
    try:
        config = recording_config(summary.mapping())
        episode = next(path for path in find_episodes(dataset, config) if path.resolve().name == name)
        frames = frames_of(episode, config).frames
        size = read_colour(frames[0].colour_file).shape[:2]
        return tuple(Camera(frame.camera((size[0], size[1])), frame.camera_to_world, size) for frame in frames)
    except (SbmError, StopIteration):
        return ()
