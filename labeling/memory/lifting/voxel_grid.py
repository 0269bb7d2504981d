"""Voxel grids: shape, resolution, and where a point of the grid's frame lies in a tensor.

The frame of a grid has its origin in the middle of the grid and +Z up. Tensors of a grid are (..., z, y, x), so that
3-D convolutions and ``grid_sample`` take them as they are; points and extents are x, y, z, metres.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from labeling.memory.settings.grid_spec import GridSpec


def voxel_centres(spec: GridSpec, device: torch.device | str = "cpu") -> Float[Tensor, "z y x 3"]:
    """Centres of all voxels in the frame of the grid, metres."""
    z, y, x = (spec.voxel_m * (torch.arange(n, device=device) + 0.5 - 0.5 * n) for n in spec.shape)
    grid_z, grid_y, grid_x = torch.meshgrid(z, y, x, indexing="ij")
    return torch.stack([grid_x, grid_y, grid_z], dim=-1)


def voxel_of(spec: GridSpec, points: Float[Tensor, "*n 3"]) -> tuple[Int[Tensor, "*n"], Bool[Tensor, "*n"]]:
    """Which voxel each point lies in.

    Returns:
        Flat (row-major) indices of voxels, 0 outside of the grid; and which points lie inside.
    """
    _, size_y, size_x = spec.shape
    half = 0.5 * points.new_tensor(spec.extent_m)
    cell = torch.floor((points + half) / spec.voxel_m)
    inside = torch.isfinite(cell).all(-1) & (cell >= 0).all(-1) & (cell < cell.new_tensor(spec.shape[::-1])).all(-1)
    x, y, z = torch.where(inside[..., None], cell, cell.new_zeros(())).long().unbind(-1)
    return (z * size_y + y) * size_x + x, inside


def sample_grid(
    volume: Float[Tensor, "b c z y x"], points: Float[Tensor, "b *n 3"], spec: GridSpec
) -> Float[Tensor, "b c *n"]:
    """Trilinear samples of a volume at points of the grid's frame; 0 outside.

    Between the outermost voxel centres and one voxel beyond, samples fade to 0.
    """
    half = 0.5 * points.new_tensor(spec.extent_m)
    normalised = (points / half).reshape(len(points), 1, 1, -1, 3)
    sampled = functional.grid_sample(volume, normalised, mode="bilinear", padding_mode="zeros", align_corners=False)
    return sampled.reshape(*volume.shape[:2], *points.shape[1:-1])


def transform(matrix: Float[Tensor, "b 4 4"], points: Float[Tensor, "b *n 3"]) -> Float[Tensor, "b *n 3"]:
    """Applies a transform to the points of each sample of a batch."""
    flat = points.reshape(len(points), -1, 3)
    return (flat @ matrix[:, :3, :3].transpose(1, 2) + matrix[:, None, :3, 3]).reshape(points.shape)


def invert(matrix: Float[Tensor, "*b 4 4"]) -> Float[Tensor, "*b 4 4"]:
    """Inverses of rigid transforms."""
    rotation = matrix[..., :3, :3].transpose(-1, -2)
    inverse = torch.zeros_like(matrix)
    inverse[..., :3, :3] = rotation
    inverse[..., :3, 3] = -(rotation @ matrix[..., :3, 3:])[..., 0]
    inverse[..., 3, 3] = 1.0
    return inverse


def crop(
    volume: Float[Tensor, "b c z y x"], places: Sequence[tuple[slice, slice, slice]]
) -> Float[Tensor, "b c d h w"]:
    """A part of each volume of a batch, by slices along z, y, x; all of one size."""
    return torch.stack([one[:, z, y, x] for one, (z, y, x) in zip(volume, places, strict=True)])
