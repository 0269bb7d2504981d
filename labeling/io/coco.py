"""COCO files: those of an episode (``detections.json``, ``ground_truth.json``), and those of any annotation tool.

The functions that check one field (``read_mask``, ``read_rle``, ``read_score``, ``read_size``, ``is_ignored``) serve
whatever reads COCO.
"""

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from jaxtyping import Bool

from labeling.core.geometry import is_rotation
from labeling.core.masks import blank_masks, fill_polygons
from labeling.core.rle import check_rle, decode_mask, encode_mask
from labeling.core.types import Box3d, Detection, GroundTruth
from labeling.formats.checked_json import Json
from labeling.formats.pixel_limit import too_large

if TYPE_CHECKING:
    from labeling.core.episode import Episode

T = TypeVar("T")

SLIVER_AREA_SHARE = 32 / 256**2
"""What shows less than this share of the picture nobody would annotate: ground truth of simulated scenes marks it
``ignore``, and labels of it are learnt as regions to ignore."""


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


def read_mask(record: Json, name: str, size: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """A mask of the picture's size, RLE or polygons.

    Raises:
        EpisodeFormatError: naming file and field, if it is malformed or of another size.
    """
    with _naming(record.get(name), size) as segmentation:
        polygons = isinstance(segmentation.value, list)
        return fill_polygons(segmentation.value, size) if polygons else decode_mask(segmentation.value)


def read_rle(record: Json, name: str, size: tuple[int, int]) -> dict[str, Any]:
    """The same as compressed RLE, decoded only where it has to be.

    Raises:
        EpisodeFormatError: naming file and field, if it is malformed or of another size.
    """
    with _naming(record.get(name), size) as segmentation:
        if isinstance(segmentation.value, dict) and isinstance(segmentation.value.get("counts"), str):
            check_rle(segmentation.value)
            return segmentation.value
    return encode_mask(read_mask(record, name, size))


@contextlib.contextmanager
def _naming(segmentation: Json, size: tuple[int, int]) -> Iterator[Json]:
    """Checks the size before anything is decoded, so that a forged one claims no memory; errors name file and field."""
    if not isinstance(segmentation.value, list):
        stated = segmentation.mapping().get("size", list(size))
        if stated != list(size):
            raise segmentation.error(f"must be the picture's {list(size)} (height, width), not {stated}", "size")
    try:
        yield segmentation
    except ValueError as error:
        raise segmentation.error(str(error)) from None


def read_score(record: Json, default: float | None = None) -> float:
    """A confidence in [0, 1]."""
    score = record.number("score", default)
    if not 0.0 <= score <= 1.0:
        raise record.error(f"a score lies in [0, 1], not {score:g}", "score")
    return score


def read_size(image: Json) -> tuple[int, int]:
    """Height and width in pixels."""
    for name in ("height", "width"):
        if image.integer(name) <= 0:
            raise image.error(f"must be above 0, not {image.integer(name)}", name)
    size = image.integer("height"), image.integer("width")
    if problem := too_large(*size):
        raise image.error(problem, "height")
    return size


def is_ignored(record: Json) -> bool:
    """Whether an annotation marks a region to leave out of account: COCO's ``iscrowd``, or ``ignore``."""
    return any(record.flag(name) for name in ("iscrowd", "ignore"))


def image_of(record: Json, images: Mapping[int, T]) -> T:
    """What stands under the ``image_id`` of an annotation or a result."""
    image_id = record.integer("image_id")
    if image_id not in images:
        raise record.error(f"unknown image id {image_id}; there are {len(images)} images", "image_id")
    return images[image_id]


def read_detections(file: Json, table: CategoryTable, episode: "Episode", images: Json | None) -> tuple[Detection, ...]:
    """Reads COCO results: a list of ``image_id category_id segmentation score``, or with ``bbox`` for segmentation.

    Args:
        file: content of ``detections.json``.
        table: names of the category ids.
        episode: the views the results speak of.
        images: a COCO file whose ``images`` map image ids to colour files; without one an image id is the index of
            the view.
    """
    views = view_of_image(images, episode)
    records, detections = file.items(), []
    for record, mask in zip(records, blank_masks(len(records), episode.size), strict=True):
        score = read_score(record)
        view = image_of(record, views)
        if view is not None:
            whole, box = _mask_or_box(record, episode, view)
            detections.append(Detection(view, table.name(record), score, _copied(whole, mask), box_xyxy=box))
    return tuple(detections)


def _copied(mask: Bool[np.ndarray, "h w"], blank: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """One of ``blank_masks``, filled: it takes memory for the rows of the mask only."""
    rows = np.flatnonzero(mask.any(axis=1))
    blank[rows] = mask[rows]
    return blank


def read_shared_file(
    file: Json, episode: "Episode", place: str, scored: bool
) -> tuple[tuple[Detection, ...], tuple[str, ...]]:
    """Reads the masks that a COCO file (``images annotations categories``) has for the pictures of one episode.

    Args:
        file: its content; it may speak of other episodes too.
        episode: the views.
        place: folder of the episode relative to its dataset, ``.`` if it is the dataset. If not, the pictures' file
            names must tell the episode; if it is, the bare file name is enough where it is unique. Of several pictures
            that end like one view that counts which names the episode's folder, too.
        scored: whether each annotation has a ``score``. If not, they are a person's, and certain.

    Returns:
        The masks, and what there is to note.
    """
    table = CategoryTable.from_files([file])
    views = _view_of_shared_image(file, episode, place)
    if not any(view is not None for view in views.values()):
        if place == ".":
            raise file.error(f"none of its {len(views)} pictures is a frame of {episode.name}", "images")
        return (), (f"{file.file}: has no picture of this episode",)
    found = []
    for record in file.list_of("annotations"):
        view = image_of(record, views)
        if view is not None and (scored or not is_ignored(record)):
            mask, box = _mask_or_box(record, episode, view)
            score = read_score(record) if scored else 1.0
            exact = not scored and box is None
            # A person's box is as certain as an outline, only the mask in it is not.
            found.append(Detection(view, table.name(record), score, mask, exact, box if scored else None))
    boxes = sum(not (scored or one.exact) for one in found)
    note = f"{file.file}: {boxes} of {len(found)} annotations are boxes, whose masks were made here"
    return tuple(found), (note,) if boxes else ()


def _mask_or_box(
    record: Json, episode: "Episode", view: int
) -> tuple[Bool[np.ndarray, "h w"], tuple[float, float, float, float] | None]:
    """The mask of an annotation or a result; where it has only a ``bbox``, one that is made from it, and the box."""
    outlined = record.has("segmentation") and record.get("segmentation").value not in (None, [])
    if outlined and not record.flag("mask_from_box"):
        return read_mask(record, "segmentation", episode.size), None
    if not outlined and not record.has("bbox"):
        raise record.error("is missing, and so is bbox", "segmentation")
    left, top, width, height = record.array("bbox", (4,)).tolist()
    if not (width > 0 and height > 0):
        raise record.error(f"is left, top, width, height, and {width:g} x {height:g} pixels hold nothing", "bbox")
    box = left, top, left + width, top + height
    if outlined:
        return read_mask(record, "segmentation", episode.size), box
    from labeling.core.box_masks import mask_in_box

    return mask_in_box(episode.rgb[view], np.array(box, np.float32), episode.depth_m[view]), box


def read_ground_truth(file: Json, table: CategoryTable, episode: "Episode") -> tuple[GroundTruth, ...]:
    """Reads COCO instances. ``instance_id``, ``amodal_segmentation`` and ``box_3d`` are this project's additions; where
    the instance is not named, objects of one category are taken to be one object per view in order of appearance.
    """
    views = view_of_image(file, episode)
    seen: dict[tuple[int, int], int] = {}
    ids: dict[tuple[int, int], int] = {}
    records, labels = file.list_of("annotations"), []
    blank = iter(blank_masks(2 * len(records), episode.size))
    for record in records:
        view, category_id = image_of(record, views), record.integer("category_id")
        if view is None:
            continue
        if record.has("instance_id"):
            instance_id = record.integer("instance_id")
        else:
            rank = seen[view, category_id] = seen.get((view, category_id), 0) + 1
            instance_id = ids.setdefault((category_id, rank), len(ids) + 1)
        modal, amodal = _copied(read_mask(record, "segmentation", episode.size), next(blank)), None
        if record.has("amodal_segmentation"):
            amodal = _copied(read_mask(record, "amodal_segmentation", episode.size), next(blank))
        labels.append(
            GroundTruth(
                view_index=view,
                instance_id=instance_id,
                category=table.name(record),
                modal=modal,
                amodal=amodal,
                box_3d=read_box_3d(record.get("box_3d")) if record.has("box_3d") else None,
                ignore=is_ignored(record),
            )
        )
    return tuple(labels)


def read_box_3d(record: Json) -> Box3d:
    """Reads centre, extent and rotation of a 3-D box."""
    return Box3d(record.array("centre", (3,)), record.array("extent", (3,)), record.array("rotation", (3, 3)))


def read_valid_box_3d(record: Json) -> Box3d:
    """Reads a 3-D box that has a volume.

    Raises:
        EpisodeFormatError: naming file and field, if the box has no volume, or its axes are no rotation.
    """
    box = read_box_3d(record)
    if not np.all(box.extent_m > 0):
        raise record.error(f"the extent of a 3-D box must be above 0, not {box.extent_m.tolist()}", "extent")
    if not is_rotation(box.rotation):
        raise record.error("must be a rotation: orthonormal columns, determinant 1", "rotation")
    return box


def view_of_image(images: Json | None, episode: "Episode") -> dict[int, int | None]:
    """Maps image ids to views, by colour file name where a COCO file lists them, else by the frame's position.

    Frames of the recording that the episode leaves out map to None.
    """
    frames = episode.frame_names or episode.file_names
    view_of_name: dict[str, int | None] = dict.fromkeys(frames)
    view_of_name.update({name: view for view, name in enumerate(episode.file_names)})
    if images is None or not images.has("images"):
        if not episode.frame_names:
            return {view: view for view in range(episode.num_views)}
        return {position: view_of_name[name] for position, name in enumerate(frames)}
    view_of_image = {}
    for image in images.list_of("images"):
        name = _plain(image.text("file_name"))
        if name not in view_of_name:
            raise image.error(f"{name!r} is not a frame of the recording", "file_name")
        view_of_image[image.integer("id")] = view_of_name[name]
    return view_of_image


def _view_of_shared_image(file: Json, episode: "Episode", place: str) -> dict[int, int | None]:
    """Maps the image ids of a file that several episodes may share to views; None for other pictures."""
    views: dict[str, int | None] = {}
    for view, name in enumerate(episode.file_names):
        parts = PurePosixPath(place, name).parts
        least = len(PurePosixPath(name).parts) + 1 if place != "." else 1
        for start in range(len(parts) - least + 1):
            ending = "/".join(parts[start:])
            views[ending] = view if ending not in views else None  # a bare name that two views share names neither
    found: dict[int, int | None] = {}
    names: dict[int, dict[str, list[int]]] = {}
    for image in file.list_of("images"):
        name, number = _plain(image.text("file_name")), image.integer("id")
        parts = PurePosixPath(name).parts
        endings = ("/".join(parts[start:]) for start in range(len(parts)))
        view = found[number] = next((views[ending] for ending in endings if ending in views), None)
        if view is not None:
            names.setdefault(view, {}).setdefault(name, []).append(number)
    for view, called in names.items():
        if len(called) == 1:
            continue
        # Pictures of several episodes end alike; those of this one also name its folder.
        own = f"{episode.name}/{episode.file_names[view]}"
        of_others = [name for name in called if not f"/{name}".endswith(f"/{own}")]
        if len(of_others) != len(called) - 1:
            raise file.error(
                f"{' and '.join(map(repr, sorted(called)))} may both be {episode.file_names[view]!r}; give the folder "
                f"of all these episodes in place of {episode.name}, or a file that speaks of {episode.name} alone",
                "images",
            )
        found.update({number: None for name in of_others for number in called[name]})
    return found


def _plain(name: str) -> str:
    """A file name without ``./`` and with forward slashes."""
    return PurePosixPath(name.replace("\\", "/")).as_posix()
