"""What one time has measured and another one contradicts: a surface that it sees through has gone."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from labeling.memory.lifting.unprojection import NEAR_M, depth_points
from labeling.memory.lifting.voxel_grid import invert, transform, voxel_of
from labeling.memory.networks.view_batch import Views
from labeling.memory.settings.grid_spec import GridSpec

TOLERANCE_M, TOLERANCE_SHARE = 0.04, 0.01
"""A surface is where it was if depth says so within this, plus this share of its distance."""
ONE_SURFACE_M = 0.3
"""Pixels side by side whose depth differs by less see one surface."""


def seen_through(views: Views, other: Views, grid: GridSpec) -> Float[Tensor, "b 2 z y x"]:
    """Of the points that lie in each voxel, which share another time sees through, and which share it finds again.

    What it cannot see, because something hides it or it lies out of the picture, is neither. Outlines are treated with
    care: a point is seen through if all nine pixels around it see further, found again if its own sees it, or if
    they see one surface that passes through it.

    Args:
        views: of one time, in the frame of the grid.
        other: of the other time, likewise.
        grid: whose voxels.
    """
    points = depth_points(
        views.depth_m.flatten(0, 1), views.depth_intrinsics.flatten(0, 1), views.camera_to_grid.flatten(0, 1)
    )
    points = points.flatten(1, 2).unflatten(0, views.depth_m.shape[:2]).flatten(1, 2)
    gone, found = compare_points(points, other)
    index, inside = voxel_of(grid, points)
    size = grid.shape[0] * grid.shape[1] * grid.shape[2]
    sums = []
    for chosen in (inside, gone & inside, found & inside):
        flat = points.new_zeros(len(points), size)
        sums.append(flat.scatter_add_(1, index, chosen.to(points.dtype)))
    shares = torch.stack([one / sums[0].clamp(min=1) for one in sums[1:]], dim=1)
    return shares.unflatten(2, grid.shape)


def compare_points(points: Float[Tensor, "b n 3"], other: Views) -> tuple[Bool[Tensor, "b n"], Bool[Tensor, "b n"]]:
    """Which points any view of another time sees through, and which it finds again (then they are not seen through).

    Args:
        points: in the frame of the grid, metres; NaN is neither.
        other: views of the other time.
    """
    gone = torch.zeros(points.shape[:2], dtype=torch.bool, device=points.device)
    found = gone.clone()
    for view in range(other.depth_m.shape[1]):
        depth_m = other.depth_m[:, view, None]
        height, width = depth_m.shape[2:]
        in_camera = transform(invert(other.camera_to_grid[:, view]), points)
        z_m = in_camera[..., 2]
        intrinsics = other.depth_intrinsics[:, view]
        focal = torch.stack([intrinsics[:, 0, 0], intrinsics[:, 1, 1]], dim=-1)[:, None]
        pixel = torch.round(in_camera[..., :2] / z_m.clamp(min=NEAR_M)[..., None] * focal + intrinsics[:, None, :2, 2])
        x, y = pixel.unbind(-1)
        shown = (z_m > NEAR_M) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
        place = torch.where(shown, y * width + x, y.new_zeros(())).long()
        missing = depth_m <= 0
        nearest = -functional.max_pool2d(-torch.where(missing, 0.0, depth_m), 3, stride=1, padding=1)
        nearest = nearest.flatten(1).gather(1, place)  # 0 beside pixels without a return: nothing is known there
        farthest = functional.max_pool2d(depth_m, 3, stride=1, padding=1).flatten(1).gather(1, place)
        tolerance_m = TOLERANCE_M + TOLERANCE_SHARE * z_m
        within = (nearest - tolerance_m < z_m) & (z_m < farthest + tolerance_m)
        there_m = depth_m.flatten(1).gather(1, place)
        exact = (there_m > 0) & ((there_m - z_m).abs() < tolerance_m)
        found |= shown & (exact | (within & (nearest > 0) & (farthest - nearest < ONE_SURFACE_M)))
        gone |= shown & (nearest > z_m + tolerance_m)
    return gone & ~found, found
