"""C-N3D's egomotion: a view's volume is moved with six degrees of freedom until it fits the memory, coarse to fine.

At each level rotations around the best so far are tried, and for each of them all shifts within a window at once, by
cross-correlation. Source: Harley et al. 2020, section 3.1, "Egomotion estimation"; thesis 2.3.1. There a network that
was trained on true poses compares features; here volumes are compared as ``labeling.memory.lifting.rotation_search``
does it, over what both have seen, whatever their channels are.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from labeling.memory.lifting.rotation_search import LEAST_ENERGY, gaze_rotation
from labeling.memory.lifting.stabilisation import warp
from labeling.memory.lifting.voxel_grid import invert
from labeling.memory.settings.grid_spec import GridSpec

LEAST_SHARED = 0.5
"""Of what both volumes hold, what must lie where both have seen for a correlation to count in full; without such a
bound, floors and walls that overlap a little win."""


@dataclass(frozen=True)
class Level:
    """One step of the search."""

    stride: int
    """Voxels that are averaged into one."""
    window: int
    """Shifts that are tried along each axis: up to so many averaged voxels either way."""
    yaws_rad: tuple[float, ...]
    """Turns about the vertical that are tried, in addition to the best so far."""
    tilts_rad: tuple[float, ...]
    """Likewise about the two horizontal axes, in all combinations."""
    keep: int = 1
    """How many of the best go on to the next level."""


def _around(step: float, count: int) -> tuple[float, ...]:
    return tuple(step * number for number in range(-count, count + 1))


LEVELS = (
    Level(2, 4, _around(0.175, 4), (0.0,), keep=4),
    Level(1, 2, _around(0.09, 1), _around(0.09, 1)),
    Level(1, 1, _around(0.045, 1), _around(0.045, 1)),
    Level(1, 1, _around(0.02, 1), _around(0.02, 1)),
)
"""From 40 degrees and 8 voxels to a degree or two and a fraction of a voxel. Averages of 4 voxels tell too little."""


@dataclass(frozen=True)
class RigidAlignment:
    """Where a view was found to be."""

    view_to_memory: Float[Tensor, "4 4"]
    """Takes points of the view's grid to the memory's, metres."""
    correlation: float
    """There, at the last level; 1 where volumes agree, more is possible of averages."""


def align(
    memory: Float[Tensor, "c z y x"],
    memory_seen: Float[Tensor, "1 z y x"],
    view: Float[Tensor, "c z y x"],
    view_seen: Float[Tensor, "1 z y x"],
    spec: GridSpec,
    start: Float[Tensor, "4 4"] | None = None,
    levels: Sequence[Level] = LEVELS,
) -> RigidAlignment:
    """Finds how a view's volume is to be moved to fit the memory.

    Args:
        memory: what is known.
        memory_seen: 1 where it is: occupied or free.
        view: volume of the view, in a grid of its own.
        view_seen: likewise.
        spec: of both grids.
        start: guess of the transform from the view's grid to the memory's, such as odometry; none if None.
        levels: of the search.
    """
    first = torch.eye(4).to(memory) if start is None else start.to(memory)
    kept = [RigidAlignment(first, -2.0)]
    both = torch.cat([view, view_seen])[None]
    for level in levels:
        coarse = _averaged(memory, level.stride), _averaged(memory_seen, level.stride)
        tried = []
        turns = itertools.product(level.yaws_rad, level.tilts_rad, level.tilts_rad)
        for around, turn in itertools.product(kept, turns):
            moved = _rotation(*turn).to(memory) @ around.view_to_memory
            moved[:3, 3] = around.view_to_memory[:3, 3]  # turns about the view's own middle
            turned = _averaged(warp(both, invert(moved)[None], spec)[0], level.stride)
            scores = _scores(*coarse, turned[:-1], turned[-1:], level.window)
            moved[:3, 3] += _peak(scores) * level.stride * spec.voxel_m
            tried.append(RigidAlignment(moved, float(scores.max())))
        kept = sorted(tried, key=lambda one: -one.correlation)[: level.keep]
    return kept[0]


def _rotation(yaw_rad: float, tilt_x_rad: float, tilt_y_rad: float) -> Float[Tensor, "4 4"]:
    """About the vertical, after tilts about +X and +Y."""
    c, s = torch.cos(torch.tensor(tilt_x_rad)), torch.sin(torch.tensor(tilt_x_rad))
    about_x = torch.eye(3)
    about_x[1, 1], about_x[1, 2], about_x[2, 1], about_x[2, 2] = c, -s, s, c
    matrix = torch.eye(4)
    matrix[:3, :3] = gaze_rotation(yaw_rad, tilt_y_rad) @ about_x
    return matrix


def _averaged(volume: Float[Tensor, "c z y x"], stride: int) -> Float[Tensor, "c z2 y2 x2"]:
    return volume if stride == 1 else functional.avg_pool3d(volume[None], stride)[0]


def _scores(
    memory: Float[Tensor, "c z y x"],
    memory_seen: Float[Tensor, "1 z y x"],
    other: Float[Tensor, "c z y x"],
    other_seen: Float[Tensor, "1 z y x"],
    window: int,
) -> Float[Tensor, "w w w"]:
    """Normalised correlation for every shift of ``other`` by -window to window voxels along z, y, x."""
    product = _cross(memory, other, window)
    energy = _cross(memory.square().sum(dim=0, keepdim=True), other_seen, window)
    energy = energy * _cross(memory_seen, other.square().sum(dim=0, keepdim=True), window)
    whole = memory.square().sum() * other.square().sum()
    floor = torch.clamp(LEAST_SHARED * whole.sqrt(), min=LEAST_ENERGY)
    return product / torch.maximum(energy.clamp(min=0).sqrt(), floor)


def _cross(fixed: Float[Tensor, "c z y x"], moving: Float[Tensor, "c z y x"], window: int) -> Float[Tensor, "w w w"]:
    """Sum over channels and voxels of ``fixed(p) moving(p - s)``, for shifts s within the window."""
    size = [side + window for side in fixed.shape[1:]]
    spectra = torch.fft.rfftn(fixed, s=size, dim=(1, 2, 3)), torch.fft.rfftn(moving, s=size, dim=(1, 2, 3))
    whole = torch.fft.irfftn((spectra[0] * spectra[1].conj()).sum(dim=0), s=size, dim=(0, 1, 2))
    shifts = torch.arange(-window, window + 1, device=fixed.device)
    z, y, x = (shifts % side for side in size)
    return whole[z[:, None, None], y[None, :, None], x[None, None, :]]


def _peak(scores: Float[Tensor, "w w w"]) -> Float[Tensor, "3"]:
    """Shift with the highest score along x, y, z, voxels; a parabola through its neighbours tells fractions."""
    window, width = scores.shape[0] // 2, scores.shape[0]
    flat = int(scores.argmax())
    at = [flat // width**2, flat // width % width, flat % width]
    found = []
    for axis in (2, 1, 0):
        place = at[axis]
        fraction = 0.0
        if 0 < place < width - 1:
            line = [float(scores[(*at[:axis], place + step, *at[axis + 1 :])]) for step in (-1, 0, 1)]
            bend = line[0] - 2 * line[1] + line[2]
            fraction = 0.5 * (line[0] - line[2]) / bend if bend < -1e-9 else 0.0
        found.append(place - window + fraction)
    return torch.tensor(found).to(scores)
