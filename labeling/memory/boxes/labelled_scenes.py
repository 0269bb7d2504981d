"""Episodes with 3-D boxes, from label sets or from ground truth, as networks are given them."""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.core.geometry import unproject_depth
from labeling.core.rle import rle_area
from labeling.core.types import Box3d
from labeling.detectors3d.upright_boxes import encode_box
from labeling.formats.checked_json import read_json
from labeling.io.coco import CategoryTable, is_ignored, read_rle, read_score, read_size, read_valid_box_3d
from labeling.io.episodes import find_episodes, read_episode
from labeling.io.file_names import BOXES_FILE, MODAL_FILE
from labeling.io.label_set import read_label_set, recording_config
from labeling.memory.settings.grid_spec import Around
from labeling.memory.settings.memory_spec import SceneSize
from labeling.memory.view_prediction.scenes import SmallScene, small_scene

SEEN_SHARE = 0.001
"""Of a picture's pixels, from which on a view shows an object."""
ABOVE_BOTTOM_M = 0.04
"""What lies lower above the bottom of a box is taken for what it stands on: the floor, or a table."""


@dataclass(frozen=True)
class SceneObject:
    """An object of an episode."""

    category: str
    box: Box3d
    """In the world; upright."""
    weight: float
    """In the loss, in [0, 1]: the confidence of the label."""
    ignore: bool
    """Neither to be found nor to be missed."""
    shown_by: Bool[np.ndarray, "v"]
    """Which views of the scene show it."""


@dataclass(frozen=True)
class LabelledScene:
    """The views of an episode that look at the grid, and the objects of the whole episode."""

    scene: SmallScene
    objects: tuple[SceneObject, ...]
    surface: Float[np.ndarray, "n 3"]
    """Points on the objects' surfaces that any view has seen, world, metres."""

    @property
    def digest(self) -> str:
        """Of the views as they were recorded, and of what is said of objects, in hexadecimal."""
        found = hashlib.sha256(self.scene.digest.encode())
        for one in self.objects:
            found.update(json.dumps([one.category, one.weight, one.ignore]).encode())
            for array in (one.box.centre_m, one.box.extent_m, one.box.rotation, one.shown_by):
                found.update(np.ascontiguousarray(array).tobytes())
        return found.hexdigest()


@dataclass
class _Found:
    """An object while its records are read."""

    category: str
    box: Box3d
    weight: float = 1.0
    ignore: bool = True
    """Until a record says otherwise."""
    shares: dict[int, float] = field(default_factory=dict)
    """By view of the episode, share of its pixels that show the object."""


def read_labelled_scenes(
    paths: Sequence[Path], spec: SceneSize, around: Around = "fixated", dataset: Path | None = None
) -> tuple[list[LabelledScene], list[str]]:
    """Reads label sets, or episodes with ground truth.

    Args:
        paths: folders of label sets that ``labeling.generate`` wrote, or episodes or datasets with ground truth.
        spec: of the memory, or its size.
        around: where the grid stands.
        dataset: where the recordings of a label set lie, if not where it says.

    Returns:
        The scenes, and a sentence about each episode that had to be left out.

    Raises:
        SbmError: if there is nothing to learn from, or something is malformed.
    """
    from labeling.runtime.cli import progress_bar

    scenes, notes = [], []
    for path in paths:
        read = _of_label_set(path, dataset) if (path / MODAL_FILE).is_file() else _of_episodes(path)
        objects = 0
        for episode, found in progress_bar(read, unit="episode", desc="reading episodes"):
            objects += len(found)
            try:
                scenes.append(labelled_scene(episode, found, spec, around))
            except EpisodeFormatError as error:
                notes.append(str(error))
        if not objects:
            raise UsageError(
                f"{path}: holds no object with a 3-D box; give a label set (labeling.generate) or episodes whose "
                "ground_truth.json has box_3d"
            )
    if not any(one.objects for one in scenes):
        raise UsageError(f"no episode with 3-D boxes can be remembered; the first: {(notes or ['there is none'])[0]}")
    return scenes, notes


def category_names(scenes: Sequence[LabelledScene]) -> tuple[str, ...]:
    """All categories of objects that are to be found, sorted."""
    return tuple(sorted({one.category for scene in scenes for one in scene.objects if not one.ignore}))


def labelled_scene(
    episode: Episode, found: "Mapping[int, _Found]", spec: SceneSize, around: Around = "fixated"
) -> LabelledScene:
    """One episode.

    Args:
        episode: the views.
        found: objects by number.
        spec: of the memory, or its size.
        around: where the grid stands.

    Raises:
        EpisodeFormatError: if the episode cannot be remembered; see ``small_scene``.
        UsageError: if a box is tilted, or is none.
    """
    scene = small_scene(episode.name, episode, spec, around)
    objects = []
    for one in found.values():
        encode_box(one.box)
        shown_by = np.array([one.shares.get(view, 0.0) >= SEEN_SHARE for view in scene.view_index])
        objects.append(SceneObject(one.category, one.box, one.weight, one.ignore, shown_by))
    boxes = [one.box for one in objects if not one.ignore]
    return LabelledScene(scene, tuple(objects), _surface(scene, boxes, spec.grid.voxel_m))


def true_scene(episode: Episode, spec: SceneSize, around: Around = "fixated") -> LabelledScene:
    """An episode with its ground truth; see ``labelled_scene``."""
    return labelled_scene(episode, _true_objects(episode), spec, around)


def _true_objects(episode: Episode) -> dict[int, _Found]:
    found: dict[int, _Found] = {}
    for one in episode.ground_truth or ():
        if one.box_3d is None:
            continue
        ours = found.setdefault(one.instance_id, _Found(one.category, one.box_3d))
        ours.ignore &= one.ignore
        ours.shares[one.view_index] = float(one.modal.mean())
    return found


def _of_episodes(path: Path) -> Iterator[tuple[Episode, dict[int, _Found]]]:
    for folder in find_episodes(path):
        episode = read_episode(folder)
        yield episode, _true_objects(episode)


def _of_label_set(path: Path, dataset: Path | None) -> Iterator[tuple[Episode, dict[int, _Found]]]:
    labels = read_label_set(path)
    dataset = labels.find_dataset(dataset)
    modal = read_json(path / MODAL_FILE)
    table = CategoryTable.from_files([modal])
    of_episode: dict[str, dict[int, _Found]] = defaultdict(dict)
    found: dict[int, _Found] = {}
    for record in read_json(path / BOXES_FILE).list_of("boxes"):
        number, box = record.integer("instance_id"), read_valid_box_3d(record)
        found[number] = of_episode[record.text("episode")][number] = _Found("", box, read_score(record, 1.0))
    images = {one.integer("id"): one for one in modal.list_of("images")}
    for record in modal.list_of("annotations"):
        number = record.integer("instance_id") if record.has("instance_id") else -1
        if number in found:
            image, one = images[record.integer("image_id")], found[number]
            one.category, one.ignore = table.name(record), one.ignore and is_ignored(record)
            height, width = read_size(image)
            area = rle_area(read_rle(record, "segmentation", (height, width)))
            one.shares[image.integer("view")] = area / (height * width)
    config = recording_config(labels.provenance)
    for folder in find_episodes(dataset, config):
        wanted = of_episode.pop(folder.resolve().name, {})
        seen = {number: one for number, one in wanted.items() if one.shares}
        if seen:
            yield read_episode(folder, config, ground_truth=False), seen
    missing = [name for name, some in of_episode.items() if any(one.shares for one in some.values())]
    if missing:
        raise UsageError(f"{dataset}: lacks episode {min(missing)!r} of {path}; give its place with --dataset")


def _surface(scene: SmallScene, boxes: Sequence[Box3d], voxel_m: float) -> Float[np.ndarray, "n 3"]:
    """Points inside of boxes that depth measured in any view, one in each cell of half a voxel."""
    kept = [np.zeros((0, 3))]
    for view in range(scene.num_views if boxes else 0):
        pose = scene.camera_to_world[view].astype(float)
        points, _ = unproject_depth(scene.depth_m[view], scene.depth_intrinsics[view].astype(float), pose)
        for box in boxes:
            local = (points - box.centre_m) @ box.rotation
            inside = np.all(np.abs(local) <= 0.5 * box.extent_m, axis=1)
            kept.append(points[inside & (points[:, 2] > box.corners()[:, 2].min() + ABOVE_BOTTOM_M)])
    points = np.concatenate(kept)
    _, first = np.unique(np.floor(points / (0.5 * voxel_m)).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]
