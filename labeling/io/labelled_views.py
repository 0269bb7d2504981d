"""A label set view by view, with pictures, cameras, masks and 3-D boxes: what exports and the viewer show."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, UInt8

from labeling.core.errors import EpisodeFormatError, LabelFormatError, UsageError
from labeling.core.rle import decode_mask, rle_area
from labeling.core.types import Box3d
from labeling.core.views import Camera
from labeling.formats.checked_json import Json, read_json
from labeling.io.coco import CategoryTable, image_of, is_ignored, read_rle, read_score, read_size, read_valid_box_3d
from labeling.io.episodes import find_episodes, read_episode
from labeling.io.file_names import BOXES_FILE, MODAL_FILE
from labeling.io.label_set import read_label_set, recording_config


@dataclass(frozen=True)
class ViewLabel:
    """One object in one view."""

    instance_id: int
    category: str
    confidence: float
    mask: Bool[np.ndarray, "h w"]
    """At least one pixel."""
    box_3d: Box3d | None
    """In the world; None if the label set has none."""


@dataclass(frozen=True)
class LabelledView:
    """One view and its labels."""

    episode: str
    index: int
    """Of the view in its episode."""
    rgb: UInt8[np.ndarray, "h w 3"]
    camera: Camera
    labels: tuple[ViewLabel, ...]
    """The least confident first, so that what is drawn over another is surer."""

    @property
    def name(self) -> str:
        """Unique in the label set, and good for a file name."""
        return f"{self.episode}_{self.index:03d}"


def categories_of(labels: Path) -> tuple[str, ...]:
    """Names of a label set's categories, in the order of their ids; where it declares none, of those that labels have.

    Raises:
        LabelFormatError: naming file and field, if the label set is malformed.
    """
    read_label_set(labels)
    modal = read_json(labels / MODAL_FILE)
    table = CategoryTable.from_files([modal])
    by_id = {record.integer("category_id"): table.name(record) for record in modal.list_of("annotations")}
    return table.names or tuple(by_id[number] for number in sorted(by_id))


def labelled_views(
    labels: Path, dataset: Path | None = None, min_confidence: float = 0.0, only: str | None = None
) -> Iterator[LabelledView]:
    """Every view of a label set, those without a label too; regions to ignore are left out.

    Args:
        labels: folder of the label set.
        dataset: where the episodes lie; by default where the label set says.
        min_confidence: labels below are left out.
        only: name of an episode; the others are left out.

    Raises:
        LabelFormatError: naming file and field, if the label set is malformed.
        UsageError: if an episode of it is not in the dataset.
        EpisodeFormatError: if an episode is malformed.
    """
    label_set = read_label_set(labels)
    config = recording_config(label_set.provenance)
    folders = {path.resolve().name: path for path in find_episodes(label_set.find_dataset(dataset), config)}
    try:
        of_episode = _by_episode(labels, min_confidence, only)
    except EpisodeFormatError as error:
        raise LabelFormatError(str(error)) from None
    for name, views in of_episode.items():
        if name not in folders:
            raise UsageError(f"{labels}: episode {name!r} is not in the dataset; say where it lies with --dataset")
        episode = read_episode(folders[name], config, ground_truth=False, detections=False)
        for view, found in views.items():
            if not 0 <= view < episode.num_views:
                raise LabelFormatError(f"{labels}: episode {name!r} has no view {view}")
            camera = Camera(episode.intrinsics[view], episode.camera_to_world[view], episode.size)
            yield LabelledView(name, view, episode.rgb[view], camera, tuple(one.decoded() for one in found))


class _StoredLabel(NamedTuple):
    """A ``ViewLabel`` as it is stored: the masks of thousands of views would not fit memory."""

    instance_id: int
    category: str
    confidence: float
    rle: dict[str, Any]
    box_3d: Box3d | None

    def decoded(self) -> ViewLabel:
        return ViewLabel(self.instance_id, self.category, self.confidence, decode_mask(self.rle), self.box_3d)


def _by_episode(labels: Path, min_confidence: float, only: str | None) -> dict[str, dict[int, list[_StoredLabel]]]:
    file = read_json(labels / MODAL_FILE)
    table = CategoryTable.from_files([file])
    boxes = _boxes(labels / BOXES_FILE)
    views, sizes = {}, {}
    found: dict[str, dict[int, list[_StoredLabel]]] = defaultdict(dict)
    for image in file.list_of("images"):
        view = (image.file_name("episode"), image.integer("view"))
        views[image.integer("id")], sizes[view] = view, read_size(image)
        if only in (None, view[0]):
            found[view[0]][view[1]] = []
    for record in file.list_of("annotations"):
        view, score = image_of(record, views), read_score(record)
        if only not in (None, view[0]):
            continue
        rle = read_rle(record, "segmentation", sizes[view])
        if is_ignored(record) or score < min_confidence or not rle_area(rle):
            continue
        number = record.integer("instance_id")
        label = _StoredLabel(number, table.name(record), score, rle, boxes.get((view[0], number)))
        found[view[0]][view[1]].append(label)
    return {
        name: {view: sorted(there, key=lambda one: one.confidence) for view, there in of_view.items()}
        for name, of_view in found.items()
    }


def _boxes(path: Path) -> dict[tuple[str, int], Box3d]:
    """By episode and instance; empty if the label set has no file of boxes."""
    records: list[Json] = read_json(path).list_of("boxes") if path.is_file() else []
    return {(one.text("episode"), one.integer("instance_id")): read_valid_box_3d(one) for one in records}
