"""The atlas of one scene on disk.

A folder holds ``atlas.json`` (the key of what it was made from, and the poses) and ``views.bin``: a table of where the
parts of each view begin (int64, places x (4 headings + 1)), then the parts. While an atlas is being built there is a
file for each place; ``finish`` puts them together.
"""

import hashlib
import itertools
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64

from labeling.core.errors import SbmError
from labeling.formats.atomic import atomic_file
from labeling.formats.checked_json import read_json
from labeling.runtime.run_folder import claim_run_folder
from sbm_gym.atlas.pose_grid import FEWEST_HEADINGS, PoseGrid
from sbm_gym.atlas.stored_views import (
    StoredView,
    decode_depth,
    decode_detections,
    decode_ids,
    encode_depth,
    encode_detections,
    encode_ids,
)
from sbm_gym.worlds.world import WorldContents

FORMAT = 1
KEY_FILE, VIEWS_FILE, PARTS_FOLDER = "atlas.json", "views.bin", "parts"
DEPTH_UNIT_M = 0.001
_PARTS = 4
"""Parts of a view: depth, geom ids, the detector's depth, detections."""


class AtlasError(SbmError):
    """An atlas is missing, damaged or of something else; the message says what to do."""


@dataclass(frozen=True)
class AtlasKey:
    """What the views of an atlas depend on."""

    scene: str
    scene_digest: str
    detector: str
    detector_digest: str
    image_size: tuple[int, int]
    detector_size: tuple[int, int]
    camera_height_m: float
    tilt_rad: float
    """Tilt of the camera in all views; up is positive."""

    def as_json(self) -> dict[str, Any]:
        """The key as it is written to ``atlas.json``."""
        return json.loads(json.dumps(asdict(self)))


def scene_digest(world: WorldContents) -> str:
    """A digest of where things stand in a world: its navigable floor, its objects and their models."""
    digest = hashlib.sha256(np.ascontiguousarray(world.navigable.free).tobytes())
    digest.update(np.asarray(world.navigable.origin_m, float).tobytes())
    for one in world.objects:
        box = one.box_3d
        digest.update(f"{one.instance_id} {one.category} {one.model_name}".encode())
        digest.update(np.concatenate([box.centre_m, box.extent_m, np.ravel(box.rotation)]).tobytes())
    return digest.hexdigest()[:16]


def folder_name(scene: str) -> str:
    """Name of the folder of a scene's atlas."""
    return scene.replace("/", "-")


def scene_folder(atlas: Path, scene: str) -> Path:
    """The folder of a scene's atlas."""
    return atlas / folder_name(scene)


def finished_folders(atlas: Path) -> set[str]:
    """Names of the folders of finished atlases."""
    return {path.parent.name for path in atlas.glob(f"*/{VIEWS_FILE}")}


class SceneAtlas:
    """The finished atlas of a scene, to look views up. The file is mapped into memory, which processes share."""

    def __init__(self, atlas: Path, key: AtlasKey) -> None:
        """Opens the atlas of a scene.

        Args:
            atlas: the folder of all scenes' atlases.
            key: what its views must depend on.

        Raises:
            AtlasError: if there is none, it is unfinished or damaged, or was made of something else.
            EpisodeFormatError: if its JSON is malformed.
        """
        folder = scene_folder(atlas, key.scene)
        if not (folder / KEY_FILE).is_file():
            raise AtlasError(f"{atlas} has no views of scene {key.scene!r}; python -m sbm_gym.build_atlas makes them")
        content = read_json(folder / KEY_FILE)
        check_key(folder, content.mapping(), key)
        self._sizes, self._unit_m = (key.image_size, key.detector_size), DEPTH_UNIT_M
        self._path = folder / VIEWS_FILE
        places_m = content.array("places_m", (len(content.list_of("places_m")), 2))
        headings = content.integer("num_headings")
        if headings < FEWEST_HEADINGS or not len(places_m):
            raise AtlasError(f"{folder} is damaged: {len(places_m)} places, {headings} headings; build it again")
        self.poses = PoseGrid(places_m, headings)
        """Places and headings of the views."""
        if not self._path.is_file():
            raise AtlasError(f"{folder} is not finished; the same python -m sbm_gym.build_atlas goes on with it")
        shape = (len(self.poses.places_m), _PARTS * self.poses.num_headings + 1)
        if self._path.stat().st_size == 0:  # which cannot be mapped
            raise AtlasError(f"{self._path} is damaged; delete {folder} and build it again")
        self._content = np.memmap(self._path, np.uint8, "r").data
        table_bytes = 8 * shape[0] * shape[1]
        damaged = len(self._content) <= table_bytes
        if not damaged:
            self._starts: Int64[np.ndarray, "places parts"] = np.frombuffer(
                self._content[:table_bytes], np.int64
            ).reshape(shape)
            damaged = self._starts[-1, -1] != len(self._content) or bool((np.diff(self._starts) < 0).any())
            damaged = damaged or bool((self._starts < table_bytes).any() or (self._starts > len(self._content)).any())
        if damaged:
            raise AtlasError(f"{self._path} is damaged; delete {folder} and build it again")

    def view(self, place: int, heading: int, view_index: int) -> StoredView:
        """The stored view of a pose.

        Args:
            place: number of a place.
            heading: number of a heading.
            view_index: given to its detections.

        Raises:
            AtlasError: if its part of the file is damaged.
        """
        starts = self._starts[place, _PARTS * heading : _PARTS * heading + _PARTS + 1].tolist()
        depth, ids, detector_depth, found = (self._content[a:b] for a, b in itertools.pairwise(starts))
        image_size, detector_size = self._sizes
        try:
            return StoredView(
                decode_depth(depth, image_size, self._unit_m),
                decode_ids(ids, image_size),
                decode_depth(detector_depth, detector_size, self._unit_m),
                decode_detections(found, detector_size, view_index),
            )
        except Exception as error:  # of zlib, JSON, masks
            raise AtlasError(
                f"{self._path} is damaged ({error}); delete {self._path.parent} and build it again"
            ) from None


def check_key(folder: Path, content: Mapping[str, Any], key: AtlasKey) -> None:
    """Checks that an atlas was made from what is asked for.

    Raises:
        AtlasError: naming what differs.
    """
    written = content.get("key")
    written = written if isinstance(written, dict) else {}
    differing = [
        f"{name} {written.get(name)} there, {value} asked for"
        for name, value in key.as_json().items()
        if written.get(name) != value
    ]
    if content.get("format") != FORMAT:
        differing = [f"format {content.get('format')} there, {FORMAT} read here"]
    if differing:
        raise AtlasError(f"{folder} holds other views ({'; '.join(differing)}); build them into another folder")


def _decisive(content: Mapping[str, Any]) -> dict[str, Any]:
    """What must agree for an atlas that was begun to be gone on with, by name."""
    places, key = content.get("places_m"), content.get("key")
    places = places if isinstance(places, list) else []
    return {
        "format": content.get("format"),
        **(key if isinstance(key, dict) else {}),
        "headings": content.get("num_headings"),
        "places": f"{len(places)} ({hashlib.sha256(repr(places).encode()).hexdigest()[:8]})",
    }


class AtlasBuilder:
    """Writes the atlas of one scene, place by place; what is there already is not made again."""

    def __init__(self, atlas: Path, key: AtlasKey, poses: PoseGrid) -> None:
        """Begins an atlas, or goes on with it.

        Args:
            atlas: the folder of all scenes' atlases; made if it does not exist.
            key: what its views depend on.
            poses: places and headings of the views to be made.

        Raises:
            UsageError: if an atlas of something else, or of other poses, has been begun there.
        """
        self._folder = scene_folder(atlas, key.scene)
        self.poses = poses
        """Places and headings of the views to be made."""
        content = {
            "format": FORMAT,
            "key": key.as_json(),
            "num_headings": poses.num_headings,
            "places_m": poses.places_m.tolist(),
        }
        claim_run_folder(self._folder, KEY_FILE, content, _decisive, "views")

    @property
    def is_finished(self) -> bool:
        """Whether all views are there."""
        return (self._folder / VIEWS_FILE).is_file()

    def missing_places(self) -> list[int]:
        """The places whose views are yet to be made."""
        if self.is_finished:
            return []
        return [place for place in range(len(self.poses.places_m)) if not self._part(place).is_file()]

    def write_place(self, place: int, views: Sequence[StoredView]) -> None:
        """Writes the views of one place, a view for each heading."""
        parts = [
            part
            for view in views
            for part in (
                encode_depth(view.depth_m, DEPTH_UNIT_M),
                encode_ids(view.geom_id),
                encode_depth(view.detector_depth_m, DEPTH_UNIT_M),
                encode_detections(view.detections),
            )
        ]
        ends = np.cumsum([0, *map(len, parts)]).astype(np.int64)
        with atomic_file(self._part(place)) as temporary:
            temporary.write_bytes(ends.tobytes() + b"".join(parts))

    def finish(self) -> None:
        """Puts all places into one file."""
        columns = _PARTS * self.poses.num_headings + 1
        places = range(len(self.poses.places_m))
        starts = np.empty((len(places), columns), np.int64)
        position = starts.nbytes
        for place in places:
            ends = np.fromfile(self._part(place), np.int64, columns)
            starts[place] = position + ends
            position += int(ends[-1])
        with atomic_file(self._folder / VIEWS_FILE) as temporary, temporary.open("wb") as file:
            file.write(starts.tobytes())
            for place in places:
                file.write(self._part(place).read_bytes()[8 * columns :])
        shutil.rmtree(self._folder / PARTS_FOLDER)

    def _part(self, place: int) -> Path:
        return self._folder / PARTS_FOLDER / f"{place:05d}.bin"
