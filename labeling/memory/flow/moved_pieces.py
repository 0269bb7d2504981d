"""Motion that is known because it is made up: pieces of a scene are moved before the second of two views is taken.

No label says what is a piece: it is whatever hangs together around a random point above the floor. What the second view
would have shown is put together from its own picture and depth: the piece is taken out, what lies behind is continued,
and the piece is drawn where it has been moved to. So the gaps and shadows of views that were really taken from two
places stay in. Source: Harley et al. 2020, section 3.3, "synthetic rigid motion", where volumes are moved.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int, UInt8
from torch import Tensor

from labeling.core.geometry import transform_points, unproject_depth
from labeling.core.splatting import splat
from labeling.core.views import Camera
from labeling.generator.cloud.connected_components import label_cells
from labeling.memory.lifting.unprojection import pixel_rays
from labeling.memory.lifting.voxel_grid import crop, voxel_of
from labeling.memory.settings.flow_settings import TrainFlowConfig
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.view_prediction.scenes import SmallScene

ABOVE_FLOOR_M = 0.06
"""Lower nothing is taken for a part of a piece."""
CELL_M = 0.12
"""Points in neighbouring cells of this edge hang together."""
RADIUS_M = (0.3, 0.9)
"""How far a piece reaches around its point at most: from, to."""
FEWEST_POINTS = 40
"""Of a piece, in each view."""
SPLAT_SIZE = 2.0
"""Pixels that a moved point covers, so that no gaps open in a piece that comes nearer."""
BEHIND_M = 0.4
"""What was hidden by a piece lies at least so far behind it, but never below the floor."""
LEAST_STEP_M = 0.03
"""How far a piece is moved at least. Steps are uniform in their logarithm, so that slow motion is learnt as well."""


@dataclass(frozen=True)
class FlowTruth:
    """What is known of the voxels of the first view."""

    flow_m: Float[Tensor, "b 3 z y x"]
    """To the time of the second view, in the frame of the grid, metres."""
    moves: Float[Tensor, "b 1 z y x"]
    """Share of a voxel's points that move."""
    known: Float[Tensor, "b 1 z y x"]
    """1 for voxels in which the first view has points."""

    def to(self, device: torch.device | str) -> "FlowTruth":
        """On another device."""
        return FlowTruth(self.flow_m.to(device), self.moves.to(device), self.known.to(device))

    def cropped(self, places: Sequence[tuple[slice, slice, slice]]) -> "FlowTruth":
        """A part of each scene of the batch, by slices along z, y, x."""
        return FlowTruth(*(crop(one, places) for one in (self.flow_m, self.moves, self.known)))


def voxel_truth(
    points: Float[np.ndarray, "n 3"], moved: Float[np.ndarray, "n 3"], moves: Bool[np.ndarray, "n"], grid: GridSpec
) -> FlowTruth:
    """Flow of voxels from that of points: means, of the moving ones where these are the most.

    Args:
        points: in the frame of the grid, metres.
        moved: where each of them is later.
        moves: which of them belong to what moves.
        grid: whose voxels.

    Returns:
        Of a batch of one.
    """
    index, inside = voxel_of(grid, torch.from_numpy(points.astype(np.float32)))
    index, chosen = index[inside], inside.numpy()
    size = grid.shape[0] * grid.shape[1] * grid.shape[2]
    count = torch.bincount(index, minlength=size).float()
    of_moving = torch.from_numpy(moves[chosen].astype(np.float32))
    share = torch.bincount(index, of_moving, minlength=size).float() / count.clamp(min=1)
    flow = torch.zeros(3, size)
    steps = torch.from_numpy((moved - points)[chosen].astype(np.float32))
    for axis in range(3):
        total = torch.bincount(index, steps[:, axis] * of_moving, minlength=size).float()
        flow[axis] = total / (share * count).clamp(min=1) * (share >= 0.5)
    shaped = [one.reshape(1, -1, *grid.shape) for one in (flow, share, (count > 0).float())]
    return FlowTruth(*shaped)


def with_moved_pieces(
    pair: SmallScene, grid: GridSpec, config: TrainFlowConfig, rng: np.random.Generator
) -> tuple[SmallScene, FlowTruth]:
    """Moves up to ``config.pieces`` pieces of a pair of views in which nothing moves.

    Args:
        pair: of two views.
        grid: of the memory, around ``pair.centre_m``.
        config: how many pieces, and how far they are moved.
        rng: draws pieces and motions.

    Returns:
        The pair with another second view, from which all pieces have been taken out before any is drawn anew; and flow
        from the first to the second, in the grid of the first. Where no floor is known nothing is moved.
    """
    grid_to_world = pair.grid_to_world(0)
    world_to_grid = np.linalg.inv(grid_to_world)
    clouds, pixels = [], []
    for view in range(2):
        found, flat = unproject_depth(
            pair.depth_m[view], pair.depth_intrinsics[view].astype(float), pair.camera_to_world[view].astype(float)
        )
        clouds.append(transform_points(world_to_grid, found))
        pixels.append(flat)
    first, second = clouds
    moved, moves = first.copy(), np.zeros(len(first), bool)
    free = np.ones(len(second), bool)
    taken: list[Int[np.ndarray, "_"]] = []
    placed: list[Float[np.ndarray, "_ 3"]] = []
    for _ in range(int(rng.integers(config.pieces + 1))):
        belongs = _piece(clouds, pair.floor_in_grid_m, grid, rng)
        if belongs is None:
            continue
        of_first, of_second = belongs(first) & ~moves, belongs(second) & free
        if min(of_first.sum(), of_second.sum()) < FEWEST_POINTS:
            continue
        motion = _motion(second[of_second].mean(axis=0), config, rng)
        moved[of_first] = transform_points(motion, first[of_first])
        moves |= of_first
        free &= ~of_second
        taken.append(pixels[1][of_second])
        placed.append(transform_points(grid_to_world @ motion, second[of_second]))
    changed = pair
    if taken:
        rgb, depth_m = _redrawn(pair, np.concatenate(taken), np.concatenate(placed))
        changed = replace(pair, rgb=np.stack([pair.rgb[0], rgb]), depth_m=np.stack([pair.depth_m[0], depth_m]))
    return changed, voxel_truth(first, moved, moves, grid)


def _motion(
    about: Float[np.ndarray, "3"], config: TrainFlowConfig, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """A step along the floor and a turn about the vertical through a point."""
    least_m = min(LEAST_STEP_M, config.furthest_m)
    heading, step_m = rng.uniform(0, 2 * np.pi), least_m * (config.furthest_m / least_m) ** rng.uniform()
    yaw = np.radians(config.furthest_turn_deg) * rng.uniform(-1, 1)
    motion = np.eye(4)
    motion[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    motion[:3, 3] = about - motion[:3, :3] @ about + step_m * np.array([np.cos(heading), np.sin(heading), 0])
    return motion


def _piece(
    clouds: list[Float[np.ndarray, "_ 3"]], floor_m: float | None, grid: GridSpec, rng: np.random.Generator
) -> Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, "n"]] | None:
    """Draws a piece: a function that tells which points belong to it; None if nothing is known to stand on a floor."""
    if floor_m is None:
        return None
    half = 0.5 * np.array(grid.extent_m)
    both = np.concatenate(clouds)
    above = both[(both[:, 2] > floor_m + ABOVE_FLOOR_M) & np.all(np.abs(both) < half, axis=1)]
    if len(above) < 2 * FEWEST_POINTS:
        return None
    _, one_each = np.unique(np.floor(above / CELL_M).astype(int), axis=0, return_index=True)
    seed, radius_m = above[int(rng.choice(one_each))], rng.uniform(*RADIUS_M)
    near = above[np.linalg.norm(above[:, :2] - seed[:2], axis=1) < radius_m]
    low = np.floor(near.min(axis=0) / CELL_M).astype(int)
    cells = np.unique(np.floor(near / CELL_M).astype(int) - low, axis=0)
    number, _ = label_cells(cells)
    wanted = np.floor(seed / CELL_M).astype(int) - low
    own = cells[number == number[np.flatnonzero((cells == wanted).all(axis=1))[0]]]
    known = np.zeros(cells.max(axis=0) + 1, bool)
    known[tuple(own.T)] = True

    def belongs(points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        at = np.floor(points / CELL_M).astype(int) - low
        inside = np.all((at >= 0) & (at < known.shape), axis=1) & (points[:, 2] > floor_m + ABOVE_FLOOR_M)
        at[~inside] = 0
        return inside & known[tuple(at.T)]

    return belongs


def _redrawn(
    pair: SmallScene, taken: Int[np.ndarray, "n"], placed: Float[np.ndarray, "n 3"]
) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "hd wd"]]:
    """Picture and depth of the second view with some pixels' points elsewhere.

    Args:
        pair: whose second view.
        taken: flat indices of the depth's pixels.
        placed: where their points are now, world.
    """
    size = pair.depth_m[1].shape
    large = cv2.resize(pair.rgb[1], size[::-1], interpolation=cv2.INTER_LINEAR)
    colours = large.reshape(-1, 3)[taken]
    large, depth_m = _erased(pair, large, taken)
    pose, intrinsics = pair.camera_to_world[1].astype(float), pair.depth_intrinsics[1].astype(float)
    distance_m = (placed - pose[:3, 3]) @ pose[:3, 2]
    index = splat(placed, Camera(intrinsics, pose, size), SPLAT_SIZE * distance_m / intrinsics[0, 0])
    drawn_m = np.where(index >= 0, distance_m[index], np.inf)
    shown = drawn_m < np.where(depth_m > 0, depth_m, np.inf)
    depth_m = np.where(shown, drawn_m, depth_m).astype(np.float32)
    large = np.where(shown[..., None], colours[index], large)
    return cv2.resize(large, pair.rgb.shape[2:0:-1], interpolation=cv2.INTER_AREA), depth_m


def _erased(
    pair: SmallScene, large: UInt8[np.ndarray, "hd wd 3"], taken: Int[np.ndarray, "n"]
) -> tuple[UInt8[np.ndarray, "hd wd 3"], Float[np.ndarray, "hd wd"]]:
    """Picture, of the depth's size, and depth of the second view without what some pixels show.

    What lies around is continued behind it: never before it, and never below the floor.
    """
    from scipy import ndimage

    depth_m = pair.depth_m[1].astype(float)
    hole = np.zeros(depth_m.shape, bool)
    hole.flat[taken] = True
    hole = np.asarray(ndimage.binary_dilation(hole), bool) & (depth_m > 0)
    nearest = ndimage.distance_transform_edt(hole, return_distances=False, return_indices=True)
    rows, columns = np.asarray(nearest)
    around_m = depth_m[rows, columns]
    behind_m = np.minimum(np.maximum(around_m, depth_m + BEHIND_M), _floor_depth(pair))
    behind_m[around_m == 0] = 0
    return large[rows, columns], np.where(hole, behind_m, depth_m)


def _floor_depth(pair: SmallScene) -> Float[np.ndarray, "hd wd"]:
    """z-depth at which the pixels of the second view would see the floor; infinite where they look above it."""
    pose, intrinsics = pair.camera_to_world[1].astype(float), torch.from_numpy(pair.depth_intrinsics[1].astype(float))
    rise = pixel_rays(intrinsics[None], *pair.depth_m[1].shape)[0].numpy() @ pose[2, :3]
    above_m = -np.inf if pair.floor_m is None else pose[2, 3] - pair.floor_m
    return np.where((rise < 0) & (above_m > 0), above_m / np.maximum(-rise, 1e-9), np.inf)
