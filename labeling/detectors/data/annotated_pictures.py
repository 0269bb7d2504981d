"""Annotated pictures to train on and to score detectors with: label sets, episodes with ground truth, COCO folders and
COCO files, told apart by their files (docs/detectors.md).

All are COCO instances: ``images`` (``id file_name width height``), ``categories`` (``id name``) and ``annotations``
(``image_id category_id segmentation``, RLE or polygons; a person's, or of a detector with a ``score`` in [0, 1]).
An annotation with ``iscrowd: 1`` or ``ignore: true`` marks a region to ignore. A COCO folder may be split: with
subfolders ``train`` and ``val``, each a COCO folder, training takes the first and scoring the second.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.core.rle import rle_area
from labeling.formats.checked_json import read_json
from labeling.io.coco import SLIVER_AREA_SHARE, CategoryTable, image_of, is_ignored, read_rle, read_score, read_size
from labeling.io.file_names import ABOUT_FILE, MODAL_FILE, TRUTH_FILE
from labeling.io.label_set import read_label_set

ANNOTATIONS_FILE, PICTURES_FOLDER = "annotations.json", "images"


@dataclass(frozen=True)
class Annotation:
    """One object in one picture."""

    category: str
    rle: dict
    """COCO RLE of its visible part."""
    weight: float = 1.0
    """Of the annotation in the loss, in [0, 1]: its confidence."""
    ignore: bool = False
    """Nothing is known here: detections are neither right nor wrong."""


@dataclass(frozen=True)
class AnnotatedPicture:
    """One picture on disk and what is in it; complete, in that what is not annotated is background."""

    file: Path
    size: tuple[int, int]
    """Height and width in pixels."""
    annotations: tuple[Annotation, ...]
    scene: str = ""
    """Which scene it shows, where an episode tells; views of one scene show the same objects."""

    def rgb(self) -> UInt8[np.ndarray, "h w 3"]:
        """Reads the picture.

        Raises:
            EpisodeFormatError: if it is missing, damaged, or of another size than stated.
        """
        import cv2

        from labeling.io.recordings.pictures import read_picture

        # As recordings are read, whose labels these are: pixels as they are stored, whatever way a viewer turns them.
        picture = read_picture(self.file, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if picture.shape[:2] != self.size:
            raise EpisodeFormatError(
                f"{self.file}: is {picture.shape[:2]} pixels (height, width), but {self.size} stated"
            )
        return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def read_pictures(path: Path, part: str = "train", dataset: Path | None = None) -> list[AnnotatedPicture]:
    """Reads annotated pictures; see the module for what ``path`` may be.

    Args:
        path: label set, episodes with ground truth, COCO folder or COCO file.
        part: "train" or "val", of a COCO folder that is split.
        dataset: where the pictures of a label set lie; by default where it says.

    Raises:
        SbmError: if there is nothing to be read, or it is malformed.
    """
    if path.is_file():
        return read_coco(path, _pictures_folder(path.parent))
    if not path.is_dir():
        raise UsageError(f"{path}: no such folder; give a label set, episodes with ground truth, or a COCO folder")
    if (path / MODAL_FILE).is_file():
        return _without_slivers(read_coco(path / MODAL_FILE, read_label_set(path).find_dataset(dataset)))
    if is_split(path):
        path = path / part
    if (path / ANNOTATIONS_FILE).is_file():
        return read_coco(path / ANNOTATIONS_FILE, _pictures_folder(path))
    if (path / TRUTH_FILE).is_file():
        return _read_episode(path)
    below = sorted(p.parent for p in path.glob(f"*/{TRUTH_FILE}") if not p.parent.name.startswith("."))
    if not below:
        raise UsageError(
            f"{path}: nothing to learn or to score here; looked for {MODAL_FILE} (label set), {ANNOTATIONS_FILE} (COCO "
            f"folder), train/{ANNOTATIONS_FILE} and val/{ANNOTATIONS_FILE} (split one), and {TRUTH_FILE} (episodes)"
        )
    return [picture for folder in below for picture in _read_episode(folder)]


def is_split(path: Path) -> bool:
    """Whether this is a COCO folder in parts ``train`` and ``val``."""
    return all((path / part / ANNOTATIONS_FILE).is_file() for part in ("train", "val"))


def read_coco(file: Path, folder: Path) -> list[AnnotatedPicture]:
    """Reads one COCO file, in the order of its ``images``.

    Args:
        file: COCO instances.
        folder: what the pictures' file names are relative to.

    Raises:
        EpisodeFormatError: naming file and field, if it is malformed.
    """
    content = read_json(file)
    table = CategoryTable.from_files([content])
    pictures: dict[int, AnnotatedPicture] = {}
    found: dict[int, list[Annotation]] = {}
    for image in content.list_of("images"):
        name = image.relative_path("file_name")
        number, size = image.integer("id"), read_size(image)
        if number in pictures:
            raise image.error(f"id {number} is used twice", "id")
        pictures[number] = AnnotatedPicture(folder / name, size, ())
        found[number] = []
    for record in content.list_of("annotations"):
        size = image_of(record, pictures).size
        rle, score = read_rle(record, "segmentation", size), read_score(record, 1.0)
        found[record.integer("image_id")].append(Annotation(table.name(record), rle, score, is_ignored(record)))
    return [replace(picture, annotations=tuple(found[number])) for number, picture in pictures.items()]


def _without_slivers(pictures: list[AnnotatedPicture]) -> list[AnnotatedPicture]:
    """What shows too little to be annotated, and is right as often as not, becomes a region to ignore."""

    def change(one: Annotation) -> Annotation:
        height, width = one.rle["size"]
        return replace(one, ignore=True) if rle_area(one.rle) < SLIVER_AREA_SHARE * height * width else one

    return with_annotations(pictures, change)


def _read_episode(folder: Path) -> list[AnnotatedPicture]:
    scene = folder.name
    if (folder / ABOUT_FILE).is_file():
        about = read_json(folder / ABOUT_FILE)
        scene = about.text("scene") if about.has("scene") else scene
    return [replace(picture, scene=scene) for picture in read_coco(folder / TRUTH_FILE, folder)]


def _pictures_folder(folder: Path) -> Path:
    inside = folder / PICTURES_FOLDER
    return inside if inside.is_dir() else folder


# Choosing ------------------------------------------------------------------------------------------------------------


def category_names(pictures: Iterable[AnnotatedPicture]) -> tuple[str, ...]:
    """All categories that are annotated, sorted."""
    return tuple(sorted({a.category for picture in pictures for a in picture.annotations if not a.ignore}))


def with_annotations(
    pictures: Sequence[AnnotatedPicture], change: Callable[[Annotation], Annotation | None]
) -> list[AnnotatedPicture]:
    """The same pictures with other annotations; those that become None are left out."""
    return [
        replace(picture, annotations=tuple(new for new in map(change, picture.annotations) if new is not None))
        for picture in pictures
    ]


def train_val_split(
    pictures: Sequence[AnnotatedPicture], every: int = 10
) -> tuple[list[AnnotatedPicture], list[AnnotatedPicture]]:
    """Splits pictures: every tenth is held out; of a single one, none."""
    held = [picture for index, picture in enumerate(pictures) if index % every == every - 1]
    kept = [picture for index, picture in enumerate(pictures) if index % every != every - 1]
    return kept, held
