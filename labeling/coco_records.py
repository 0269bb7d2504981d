"""The COCO files of an episode: ``detections.json`` (results) and ``ground_truth.json`` (instances)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from labeling.episode_json import Json
from labeling.instances import Box3d, Detection, GroundTruth, decode_mask

if TYPE_CHECKING:
    from labeling.episodes import Episode


@dataclass(frozen=True)
class CategoryTable:
    """Category ids and names. Without any declared categories every id is accepted and named ``category_ID``."""

    name_of_id: dict[int, str]

    @classmethod
    def from_files(cls, files: list[Json]) -> "CategoryTable":
        """Reads the ``categories`` lists of the files that have one; the first file to name an id decides."""
        name_of_id: dict[int, str] = {}
        for file in files:
            if not file.has("categories"):
                continue
            for category in file.list_of("categories"):
                name_of_id.setdefault(category.integer("id"), category.text("name"))
        return cls(name_of_id)

    @property
    def names(self) -> tuple[str, ...]:
        """All names in the order of their ids."""
        return tuple(dict.fromkeys(self.name_of_id[index] for index in sorted(self.name_of_id)))

    def name(self, record: Json) -> str:
        """The category name of an annotation or a result."""
        category_id = record.integer("category_id")
        if not self.name_of_id:
            return f"category_{category_id}"
        if category_id not in self.name_of_id:
            known = ", ".join(f"{i} {name}" for i, name in sorted(self.name_of_id.items()))
            raise record.error(f"unknown category id {category_id}; known: {known}", "category_id")
        return self.name_of_id[category_id]


def read_detections(file: Json, table: CategoryTable, episode: "Episode", images: Json | None) -> tuple[Detection, ...]:
    """Reads COCO results: a list of ``image_id category_id segmentation score``.

    Args:
        file: content of ``detections.json``.
        table: names of the category ids.
        episode: the views the results speak of.
        images: a COCO file whose ``images`` map image ids to colour files; without one an image id is the index of
            the view.
    """
    view_of_image = _view_of_image(images, episode)
    detections = []
    for record in file.items():
        score = record.number("score")
        if not 0.0 <= score <= 1.0:
            raise record.error(f"a score lies in [0, 1], not {score:g}", "score")
        mask = _mask(record, "segmentation", episode.size)
        detections.append(Detection(_view(record, view_of_image), table.name(record), score, mask))
    return tuple(detections)


def read_ground_truth(file: Json, table: CategoryTable, episode: "Episode") -> tuple[GroundTruth, ...]:
    """Reads COCO instances. ``instance_id``, ``amodal_segmentation`` and ``box_3d`` are this project's additions; where
    the instance is not named, objects of one category are taken to be one object per view in order of appearance.
    """
    view_of_image = _view_of_image(file, episode)
    seen: dict[tuple[int, int], int] = {}
    ids: dict[tuple[int, int], int] = {}
    labels = []
    for record in file.list_of("annotations"):
        view, category_id = _view(record, view_of_image), record.integer("category_id")
        if record.has("instance_id"):
            instance_id = record.integer("instance_id")
        else:
            rank = seen[view, category_id] = seen.get((view, category_id), 0) + 1
            instance_id = ids.setdefault((category_id, rank), len(ids) + 1)
        amodal = _mask(record, "amodal_segmentation", episode.size) if record.has("amodal_segmentation") else None
        labels.append(
            GroundTruth(
                view_index=view,
                instance_id=instance_id,
                category=table.name(record),
                modal=_mask(record, "segmentation", episode.size),
                amodal=amodal,
                box_3d=read_box_3d(record.get("box_3d")) if record.has("box_3d") else None,
                ignore=record.has("iscrowd") and record.integer("iscrowd") == 1,
            )
        )
    return tuple(labels)


def read_box_3d(record: Json) -> Box3d:
    """Reads centre, extent and rotation of a 3-D box."""
    return Box3d(record.array("centre", (3,)), record.array("extent", (3,)), record.array("rotation", (3, 3)))


def _view_of_image(images: Json | None, episode: "Episode") -> dict[int, int]:
    """Maps image ids to views, by colour file name where a COCO file lists them, else by position."""
    if images is None or not images.has("images"):
        return {view: view for view in range(episode.num_views)}
    view_of_name = {name: view for view, name in enumerate(episode.file_names)}
    view_of_image = {}
    for image in images.list_of("images"):
        name = image.text("file_name")
        if name not in view_of_name:
            raise image.error(f"{name!r} is not a frame of transforms.json", "file_name")
        view_of_image[image.integer("id")] = view_of_name[name]
    return view_of_image


def _view(record: Json, view_of_image: dict[int, int]) -> int:
    image_id = record.integer("image_id")
    if image_id not in view_of_image:
        raise record.error(f"unknown image id {image_id}; there are {len(view_of_image)} images", "image_id")
    return view_of_image[image_id]


def _mask(record: Json, name: str, size: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    rle = record.get(name)
    if isinstance(rle.value, list):
        raise rle.error("polygons are not supported here; store masks as COCO RLE")
    # The size is checked before anything is decoded, so that a forged size cannot claim memory.
    stated = rle.mapping().get("size")
    if stated is not None and stated != list(size):
        raise rle.error(f"mask size {stated} is not the picture's {list(size)} (height, width)", "size")
    try:
        return decode_mask(rle.value)
    except ValueError as error:
        raise rle.error(str(error)) from None
