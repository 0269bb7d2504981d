"""Photographs on disk: a COCO folder that grows set by set, so that making it can be stopped and gone on with."""

import itertools
import sys
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from labeling.cluster.cluster_config import HERE, ClusterConfig, JobFiles
from labeling.cluster.jobs import map_jobs
from labeling.core.errors import UsageError
from labeling.core.masks import box_xywh
from labeling.core.rle import encode_mask
from labeling.detectors.data.annotated_pictures import ANNOTATIONS_FILE, PICTURES_FOLDER
from labeling.formats.atomic import atomic_folder, write_json, write_png
from labeling.formats.checked_json import read_json
from labeling.runtime.run_folder import claim_run_folder
from sbm_gym.assets.catalog.same_libraries import same_libraries
from sbm_gym.photographs.models import CATEGORIES, SPLITS
from sbm_gym.photographs.take import Photograph

SETTINGS_FILE, SET_FILE = "photographs.json", "set.json"
PER_SET = 6
"""Photographs taken of one set, at most."""
INDOOR_SHARE = 0.65
INDOOR = {"chair": 0.8, "couch": 1.5, "plant": 0.9, "tv": 1.6, "fridge": 1.4, "bed": 1.6, "table": 0.8, "toilet": 1.5}
INDOOR |= {"dining": 1.0, "desk": 0.5}
"""Themes of sets indoors, and how often each is drawn."""
OUTDOOR = {"car": 0.6, "truck": 1.0, "bus": 1.0, "motorcycle": 1.0, "bicycle": 1.0}
"""Likewise outdoors, where cars keep all others company."""


@dataclass(frozen=True)
class AlbumSettings:
    """What photographs depend on, and nothing else does."""

    split: str
    seed: int
    size_px: int
    builtin: bool
    """Only models made from seeds."""

    def __post_init__(self) -> None:
        if self.split not in SPLITS:
            raise UsageError(f"there is no split {self.split!r}; known: {', '.join(SPLITS)}")
        if self.seed < 0:
            raise UsageError(f"--seed must not be negative, not {self.seed}")
        if not 64 <= self.size_px <= 1024:
            raise UsageError(f"--size must lie in 64 .. 1024 pixels, not {self.size_px}")


def make_album(
    folder: Path, settings: AlbumSettings, count: int, workers: int = 1, where: ClusterConfig = HERE
) -> None:
    """Takes the photographs that a folder lacks, and writes its ``annotations.json``.

    Args:
        folder: where they go.
        settings: what they depend on. A photograph is the same whatever the count and the number of workers.
        count: how many the annotations list at the end.
        workers: processes.
        where: this machine or a cluster.

    Raises:
        SbmError: if the settings make no sense, the folder holds something else, or no furniture is installed.
    """
    from tqdm import tqdm

    if count < 1 or workers < 1:
        raise UsageError(f"--count and --workers must be at least 1, not {count} and {workers}")
    if not settings.builtin:
        from sbm_gym.assets.catalog.library import default_library

        default_library()  # says what to install if there is none
    claim_run_folder(folder, SETTINGS_FILE, asdict(settings), results="photographs")
    found: list[dict[str, Any]] = []
    work, pictures = partial(make_set, folder, settings), folder / PICTURES_FOLDER
    done = next(number for number in itertools.count() if not _is_made(folder, number))
    # Sets that others make while the last one that counts is waited for stay, for a larger count.
    new = map_jobs(
        work,
        itertools.count(done),
        workers,
        where=where,
        files=JobFiles(pictures, lambda number: [_set_folder(folder, number)], whole=True),
        same=() if settings.builtin else same_libraries(None),
        ordered=True,
    )
    bar = tqdm(total=count, unit="photograph", file=sys.stderr, mininterval=1.0)
    with bar, closing(new):
        for number, photographs in enumerate(itertools.chain(map(work, range(done)), new)):
            found += [{**one, "file_name": f"{number:05d}/{one['file_name']}"} for one in photographs]
            bar.update(min(len(found), count) - bar.n)
            if len(found) >= count:
                break
    write_json(folder / ANNOTATIONS_FILE, _coco(found[:count], settings))


def draw_theme(rng: np.random.Generator) -> tuple[bool, str]:
    """Whether a set is indoors, and what it is mostly about."""
    indoor = bool(rng.random() < INDOOR_SHARE)
    weights = INDOOR if indoor else OUTDOOR
    share = np.array(list(weights.values()))
    return indoor, str(rng.choice(list(weights), p=share / share.sum()))


def photographs_of_set(settings: AlbumSettings, number: int) -> list[Photograph]:
    """Builds one set and takes its photographs.

    Args:
        settings: what they depend on.
        number: of the set, at least 0.
    """
    from sbm_gym.assets.catalog.library import default_library
    from sbm_gym.photographs.interiors import interior
    from sbm_gym.photographs.models import PhotographLibrary
    from sbm_gym.photographs.streets import street
    from sbm_gym.photographs.take import take_photographs

    seed = (settings.seed, SPLITS.index(settings.split), number)
    rng = np.random.default_rng(seed)
    library = PhotographLibrary(None if settings.builtin else default_library(), settings.split, seed)
    indoor, theme = draw_theme(rng)
    photo_set = (interior if indoor else street)(theme, library, rng)
    return take_photographs(photo_set, PER_SET, settings.size_px, rng)


def make_set(folder: Path, settings: AlbumSettings, number: int) -> list[dict[str, Any]]:
    """Takes and writes the photographs of one set, unless they are there.

    Args:
        folder: of the album.
        settings: what photographs depend on.
        number: of the set.

    Returns:
        A record of every photograph: file name within the set's folder, size, annotations.
    """
    place = _set_folder(folder, number)
    if not _is_made(folder, number):
        records = []
        with atomic_folder(place) as temporary:
            for index, one in enumerate(photographs_of_set(settings, number)):
                write_png(temporary / f"{index}.png", one.rgb)
                records.append(_record(f"{index}.png", one))
            write_json(temporary / SET_FILE, {"photographs": records})
    # Read back in any case, so that records are the same whether just made or found.
    return read_json(place / SET_FILE).get("photographs").value


def _set_folder(folder: Path, number: int) -> Path:
    return folder / PICTURES_FOLDER / f"{number:05d}"


def _is_made(folder: Path, number: int) -> bool:
    return (_set_folder(folder, number) / SET_FILE).is_file()


def _record(file_name: str, one: Photograph) -> dict[str, Any]:
    annotations = [
        {
            "category_id": 1 + CATEGORIES.index(a.category),
            "model": a.model_name,
            "segmentation": encode_mask(a.mask),
            "bbox": list(box_xywh(a.mask)),
            "area": int(np.count_nonzero(a.mask)),
            "iscrowd": int(a.ignore),
        }
        for a in one.annotations
    ]
    height, width = one.rgb.shape[:2]
    return {"file_name": file_name, "width": width, "height": height, "annotations": annotations}


def _coco(photographs: list[dict[str, Any]], settings: AlbumSettings) -> dict[str, Any]:
    """COCO instances of photographs; ``model`` of an annotation is this project's addition."""
    images, annotations = [], []
    for number, one in enumerate(photographs, start=1):
        images.append({"id": number, **{key: one[key] for key in ("file_name", "width", "height")}})
        for record in one["annotations"]:
            annotations.append({"id": len(annotations) + 1, "image_id": number, **record})
    categories = [{"id": index, "name": name} for index, name in enumerate(CATEGORIES, start=1)]
    info = {"description": "rendered photographs", **asdict(settings)}
    return {"info": info, "images": images, "categories": categories, "annotations": annotations}
