"""What a frustum PointNet learns from: objects in views, each with the points around it, its mask and its 3-D box."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from labeling.core.episode import Episode
from labeling.core.errors import LabelFormatError, UsageError
from labeling.core.masks import box_xywh
from labeling.core.types import Box3d
from labeling.detectors3d.frustums import (
    Frustum,
    azimuth_of_pixel,
    box_centre,
    crop_frustum,
    horizontal_rays,
    make_frustum,
)
from labeling.detectors3d.upright_boxes import encode_box
from labeling.formats.checked_json import Json, read_json
from labeling.io.coco import CategoryTable, image_of, is_ignored, read_mask, read_valid_box_3d
from labeling.io.episodes import find_episodes, read_episode
from labeling.io.file_names import BOXES_FILE, MODAL_FILE
from labeling.io.label_set import read_label_set, recording_config

MARGIN = 0.15
"""How far beyond its 2-D box the points around an object are kept, in sides of the box: augmentation moves the box."""
KEPT_POINTS = 4096
"""Of them, at most."""
MIN_POINTS = 16
"""An object of which fewer points are seen teaches nothing."""
MIN_MASK_PX = 64
"""Nor does one of which fewer pixels are seen."""
BEYOND_BOX = 1.15
"""Points of a mask that lie outside of its 3-D box, grown so many times, are what the mask has in excess."""


@dataclass(frozen=True)
class FrustumSample:
    """One object in one view."""

    episode: str
    """Its name."""
    category: str
    frustum: Frustum
    """Of its 2-D box with a margin."""
    foreground: Bool[np.ndarray, "n"]
    """Which points are the object's."""
    box_xyxy: tuple[float, float, float, float]
    """The tightest 2-D box around what is seen of it."""
    box: Box3d
    """In the world; of the whole object."""
    weight: float
    """In the loss, in [0, 1]: the confidence of the label."""
    rays: Float[np.ndarray, "2 3"]
    """Maps a pixel (x, y, 1) to the horizontal part of its ray in the world."""

    def crop(self, box_xyxy: tuple[float, float, float, float]) -> tuple[Frustum, Bool[np.ndarray, "m"]]:
        """The frustum of another 2-D box within the margin, and which of its points are the object's."""
        frustum, kept = crop_frustum(self.frustum, box_xyxy, azimuth_of_pixel(box_centre(box_xyxy), self.rays))
        return frustum, self.foreground[kept]


def read_frustum_samples(path: Path, seed: int = 0, dataset: Path | None = None) -> list[FrustumSample]:
    """Reads a label set, or episodes with ground truth.

    Args:
        path: folder of a label set that ``labeling.generate`` wrote, or an episode or dataset with ground truth.
        seed: chooses which points are kept.
        dataset: where the recordings of a label set lie, if not where it says.

    Raises:
        SbmError: if there is nothing to learn from, or something is malformed.
    """
    if (path / MODAL_FILE).is_file():
        found = list(_of_label_set(path, seed, dataset))
    else:
        found = list(_of_episodes(path, seed))
    if not found:
        raise UsageError(
            f"{path}: holds no object with a 3-D box of which at least {MIN_MASK_PX} pixels and {MIN_POINTS} "
            "points are seen; give a label set (labeling.generate) or episodes whose ground_truth.json has box_3d"
        )
    return found


def category_names(samples: Sequence[FrustumSample]) -> tuple[str, ...]:
    """All categories, sorted."""
    return tuple(sorted({one.category for one in samples}))


def median_sizes(samples: Sequence[FrustumSample], categories: Sequence[str]) -> tuple[tuple[float, float, float], ...]:
    """Median length, width and height of the boxes of each category; an object counts once for each view of it."""
    found = []
    for name in categories:
        sides = np.array([encode_box(one.box)[3:6] for one in samples if one.category == name])
        length, width, height = (float(side) for side in np.median(sides, axis=0))
        found.append((length, width, height))
    return tuple(found)


def _of_episodes(path: Path, seed: int) -> Iterator[FrustumSample]:
    for number, folder in enumerate(find_episodes(path)):
        episode = read_episode(folder)
        for place, one in enumerate(episode.ground_truth or ()):
            if one.box_3d is not None and not one.ignore:
                rng = np.random.default_rng([seed, number, place])
                sample = make_frustum_sample(episode, one.view_index, one.category, one.modal, one.box_3d, 1.0, rng)
                if sample is not None:
                    yield sample


def _of_label_set(path: Path, seed: int, dataset: Path | None) -> Iterator[FrustumSample]:
    labels = read_label_set(path)
    dataset = labels.find_dataset(dataset)
    boxes_file = read_json(path / BOXES_FILE)
    boxes = {record.integer("instance_id"): read_valid_box_3d(record) for record in boxes_file.list_of("boxes")}
    modal = read_json(path / MODAL_FILE)
    table = CategoryTable.from_files([modal])
    views = {image.integer("id"): (image.text("episode"), image.integer("view")) for image in modal.list_of("images")}
    of_episode: dict[str, list[tuple[int, Json]]] = defaultdict(list)
    for record in modal.list_of("annotations"):
        episode, view = image_of(record, views)
        if not is_ignored(record) and record.integer("instance_id") in boxes:
            of_episode[episode].append((view, record))
    config = recording_config(labels.provenance)
    for number, folder in enumerate(find_episodes(dataset, config)):
        wanted = of_episode.pop(folder.resolve().name, [])
        if not wanted:
            continue
        episode = read_episode(folder, config, ground_truth=False)
        for place, (view, record) in enumerate(wanted):
            if not 0 <= view < episode.num_views:
                raise LabelFormatError(f"{path}: episode {episode.name!r} has no view {view}")
            mask, box = read_mask(record, "segmentation", episode.size), boxes[record.integer("instance_id")]
            rng = np.random.default_rng([seed, number, place])
            sample = make_frustum_sample(episode, view, table.name(record), mask, box, record.number("score", 1.0), rng)
            if sample is not None:
                yield sample
    if of_episode:
        raise UsageError(f"{dataset}: lacks episode {min(of_episode)!r} of {path}; give its place with --dataset")


def make_frustum_sample(
    episode: Episode,
    view: int,
    category: str,
    mask: Bool[np.ndarray, "h w"],
    box: Box3d,
    weight: float,
    rng: np.random.Generator,
) -> FrustumSample | None:
    """One object in one view; None if too little is seen of it.

    Args:
        episode: the views.
        view: which.
        category: of the object.
        mask: what is seen of it.
        box: of the whole object, in the world.
        weight: in the loss, in [0, 1].
        rng: chooses the points that are kept.

    Raises:
        UsageError: if the box is none, or tilted.
    """
    encode_box(box)
    if np.count_nonzero(mask) < MIN_MASK_PX:
        return None
    x, y, width, height = box_xywh(mask)
    wide = (x - MARGIN * width, y - MARGIN * height, x + (1 + MARGIN) * width, y + (1 + MARGIN) * height)
    camera = episode.camera(view)
    frustum = make_frustum(episode.depth_m[view], camera, wide, KEPT_POINTS, rng)
    columns, rows = frustum.pixels.T.astype(int)
    local_box = frustum.from_world(box)
    inside = np.abs((frustum.points - local_box.centre_m) @ local_box.rotation) <= 0.5 * BEYOND_BOX * box.extent_m
    foreground = mask[rows, columns] & np.all(inside, axis=1)
    if np.count_nonzero(foreground) < MIN_POINTS:
        return None
    box_xyxy = x, y, x + width, y + height
    return FrustumSample(episode.name, category, frustum, foreground, box_xyxy, box, weight, horizontal_rays(camera))
