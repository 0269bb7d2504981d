"""Episodes as networks are given them: small pictures, depth and poses, around the place where the grid stands."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8

from labeling.core.errors import EpisodeFormatError
from labeling.core.geometry import invert_rigid, project
from labeling.core.views import RgbdViews
from labeling.io.episodes import find_episodes, read_episode
from labeling.memory.lifting.placement import grid_and_floor, place_grid
from labeling.memory.networks.view_batch import Views
from labeling.memory.settings.grid_spec import Around
from labeling.memory.settings.memory_spec import SceneSize

DEPTH_FACTOR = 2
"""Depth is kept at this multiple of the pictures' size, so that voxels nearby are filled without holes."""
MIN_VIEWS = 3
"""Of an episode that look at the grid: one to remember, one to predict, one to spare."""


@dataclass(frozen=True, eq=False)
class SmallScene:
    """The views of an episode that look at the middle of the grid."""

    name: str
    rgb: UInt8[np.ndarray, "v h w 3"]
    depth_m: Float32[np.ndarray, "v hd wd"]
    intrinsics: Float[np.ndarray, "v 3 3"]
    depth_intrinsics: Float[np.ndarray, "v 3 3"]
    camera_to_world: Float[np.ndarray, "v 4 4"]
    centre_m: Float[np.ndarray, "3"]
    """Middle of the grid, world."""
    floor_m: float | None
    """Height of the floor, world; None if the grid was placed without one (``floor_height``)."""
    view_index: tuple[int, ...]
    """Of each view, in the episode."""
    digest: str
    """Of the views as they were recorded, in hexadecimal."""

    @property
    def num_views(self) -> int:
        """How many views there are."""
        return len(self.rgb)

    @property
    def floor_in_grid_m(self) -> float | None:
        """Height of the floor in the frame of the grid."""
        return None if self.floor_m is None else self.floor_m - float(self.centre_m[2])

    def grid_to_world(self, first: int) -> Float[np.ndarray, "4 4"]:
        """Where the grid stands if view ``first`` is the first that goes into the memory."""
        return place_grid(self.centre_m, self.camera_to_world[first])

    def chosen(self, views: Sequence[int]) -> "SmallScene":
        """Some of the views, in this order, around the same middle."""
        kept = list(views)
        return SmallScene(
            self.name,
            self.rgb[kept],
            self.depth_m[kept],
            self.intrinsics[kept],
            self.depth_intrinsics[kept],
            self.camera_to_world[kept],
            self.centre_m,
            self.floor_m,
            tuple(self.view_index[view] for view in kept),
            self.digest,
        )

    def views(self, chosen: Sequence[int], first: int) -> Views:
        """Some views, as a batch of one scene, in the frame of the grid that view ``first`` gives."""
        chosen = list(chosen)
        world_to_grid = invert_rigid(self.grid_to_world(first))
        rgb = torch.from_numpy(self.rgb[chosen]).permute(0, 3, 1, 2).float() / 255
        return Views(
            _float(self.intrinsics[chosen]),
            _float(world_to_grid @ self.camera_to_world[chosen]),
            (self.rgb.shape[1], self.rgb.shape[2]),
            rgb[None],
            _float(self.depth_m[chosen]),
            _float(self.depth_intrinsics[chosen]),
        )


def _float(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.float32))[None]


def small_scene(name: str, views: RgbdViews, spec: SceneSize, around: Around = "fixated") -> SmallScene:
    """Makes views small, and leaves out those that do not have the middle of the grid in the picture.

    Args:
        name: of the episode.
        views: of any size.
        spec: of the network, or its size.
        around: where the grid stands.

    Raises:
        EpisodeFormatError: if fewer than ``MIN_VIEWS`` views look at the grid, or there is no depth.
    """
    try:
        centre, floor_m = grid_and_floor(views, spec.grid, around)
    except ValueError as error:
        raise EpisodeFormatError(f"{name}: {error}, so that it cannot be remembered in 3-D") from None
    looking = [view for view in range(views.num_views) if _looks_at(views, view, centre)]
    if len(looking) < MIN_VIEWS:
        raise EpisodeFormatError(
            f"{name}: {len(looking)} of its {views.num_views} views look at the middle of the grid, fewer than the "
            f"{MIN_VIEWS} that it takes"
        )
    return shrunk(name, views, looking, spec, centre, floor_m)


def shrunk(
    name: str,
    views: RgbdViews,
    chosen: Sequence[int],
    spec: SceneSize,
    centre_m: Float[np.ndarray, "3"],
    floor_m: float | None,
) -> SmallScene:
    """Some views, made small.

    Args:
        name: of the episode.
        views: of any size.
        chosen: which of them.
        spec: of the network, or its size.
        centre_m: middle of the grid, world.
        floor_m: height of the floor, world, if it is known.
    """
    chosen = list(chosen)
    height, width = spec.size
    rgb = np.stack([cv2.resize(views.rgb[one], (width, height), interpolation=cv2.INTER_AREA) for one in chosen])
    rows, row_scale, row_offset = _strides(views.size[0], DEPTH_FACTOR * height)
    columns, column_scale, column_offset = _strides(views.size[1], DEPTH_FACTOR * width)
    depth_m = views.depth_m[chosen][:, rows][:, :, columns]
    intrinsics, of_depth = views.intrinsics[chosen].astype(float), views.intrinsics[chosen].astype(float)
    for axis, scale in ((0, width / views.size[1]), (1, height / views.size[0])):
        intrinsics[:, axis, axis] *= scale
        intrinsics[:, axis, 2] = (intrinsics[:, axis, 2] + 0.5) * scale - 0.5
    for axis, scale, offset in ((0, column_scale, column_offset), (1, row_scale, row_offset)):
        of_depth[:, axis, axis] /= scale
        of_depth[:, axis, 2] = (of_depth[:, axis, 2] - offset) / scale
    poses = views.camera_to_world[chosen]
    return SmallScene(
        name, rgb, depth_m, intrinsics, of_depth, poses, centre_m, floor_m, tuple(chosen), _digest(views, chosen)
    )


def _digest(views: RgbdViews, chosen: Sequence[int]) -> str:
    """Changes with any pixel, depth or pose of some views; the same on every machine."""
    found = hashlib.sha256()
    for view in chosen:
        for array in (views.rgb, views.depth_m, views.intrinsics, views.camera_to_world):
            found.update(np.ascontiguousarray(array[view]).tobytes())
    return found.hexdigest()


def joined_digest(digests: Iterable[str]) -> str:
    """One digest of several, in their order."""
    return hashlib.sha256("\n".join(digests).encode()).hexdigest()


def _looks_at(views: RgbdViews, view: int, point: Float[np.ndarray, "3"]) -> bool:
    pixels, depth_m = project(point[None].astype(float), views.intrinsics[view], views.camera_to_world[view])
    inside = (pixels[0] > 0) & (pixels[0] < np.array(views.size[::-1]) - 1)
    return bool(depth_m[0] > 0.1 and inside.all())


def _strides(before: int, after: int) -> tuple[np.ndarray, float, float]:
    """Which of ``before`` pixels are kept, so that ``after`` remain: pixel i was at about scale * i + offset."""
    kept = np.floor((np.arange(after) + 0.5) * before / after).astype(int)
    scale = before / after
    return kept, scale, float(np.mean(kept - scale * np.arange(after)))


def read_scenes(
    datasets: Sequence[Path], spec: SceneSize, around: Around = "fixated"
) -> tuple[list[SmallScene], list[str]]:
    """Reads all episodes of some datasets.

    Returns:
        The scenes, and a sentence about each episode that had to be left out.

    Raises:
        EpisodeFormatError: if a dataset is none, or no episode of all is left.
    """
    from labeling.runtime.cli import progress_bar

    folders = [folder for dataset in datasets for folder in find_episodes(dataset)]
    scenes, notes = [], []
    for folder in progress_bar(folders, desc="reading episodes"):
        try:
            scenes.append(small_scene(folder.name, read_episode(folder, ground_truth=False), spec, around))
        except EpisodeFormatError as error:
            notes.append(str(error))
    if not scenes:
        raise EpisodeFormatError(f"no episode to learn from or to look at; the first: {notes[0]}")
    return scenes, notes


def concatenated(batch: Sequence[Views]) -> Views:
    """Several scenes as one batch; of equal numbers of views."""
    first = batch[0]
    return Views(
        torch.cat([one.intrinsics for one in batch]),
        torch.cat([one.camera_to_grid for one in batch]),
        first.size,
        torch.cat([one.rgb for one in batch]),
        torch.cat([one.depth_m for one in batch]),
        torch.cat([one.depth_intrinsics for one in batch]),
    )
