"""Flow without learning: blocks of voxels are compared with blocks nearby, coarse to fine.

Source: the cost volumes and the warping of PWC-Net (Sun et al. 2018) in 3-D, as Harley et al. 2020 have them, with sums
over blocks in the place of learnt layers.
"""

import itertools

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from labeling.memory.flow.warping import warp_back
from labeling.memory.settings.grid_spec import GridSpec

STRIDES = (4, 2, 1, 1, 1)
"""Voxels that are averaged into one, level by level; each level reaches one of them further."""
BLOCK = 5
"""Edge of the blocks that are compared, in voxels of the level."""
MATCHED, SHARPNESS = 3, 0.05
"""Likewise of what networks compare; and of the energy of a block, which difference makes another place e times less
likely."""
STAY = 2e-4
"""A block stays where it is if it differs by less than this share of its energy from what is there later."""


def shifts() -> list[tuple[int, int, int]]:
    """All shifts by up to one voxel along x, y, z; the one by none is in the middle."""
    return list(itertools.product((-1, 0, 1), (-1, 0, 1), (-1, 0, 1)))


def shifted(volume: Float[Tensor, "b c z y x"], shift: tuple[int, int, int]) -> Float[Tensor, "b c z y x"]:
    """What lies at every voxel plus a shift by up to one voxel along x, y, z; 0 out of the grid."""
    padded = functional.pad(volume, (1, 1, 1, 1, 1, 1))
    z, y, x = volume.shape[2:]
    by_x, by_y, by_z = (1 + one for one in shift)
    return padded[:, :, by_z : by_z + z, by_y : by_y + y, by_x : by_x + x]


def matched(
    first: Float[Tensor, "b c z y x"], second: Float[Tensor, "b c z y x"]
) -> tuple[Float[Tensor, "b 27 z y x"], Float[Tensor, "b 3 z y x"]]:
    """How alike blocks around every voxel are to those around its neighbours at the other time, and which match.

    Args:
        first: features of one time.
        second: of the other time.

    Returns:
        Shares of likeness of all ``shifts`` (a softmax), and their mean shift along x, y, z, voxels: 0 where all is
        empty.
    """
    differences = [(first - shifted(second, one)).square().mean(dim=1) for one in shifts()]
    energy = 0.5 * (first.square() + second.square()).mean(dim=1, keepdim=True)
    volume = torch.cat([torch.stack(differences, dim=1), energy], dim=1)
    volume = functional.avg_pool3d(functional.pad(volume, [MATCHED // 2] * 6), MATCHED, stride=1)
    alike = torch.softmax(-volume[:, :-1] / (SHARPNESS * volume[:, -1:] + 1e-6), dim=1)
    steps = torch.tensor(shifts(), dtype=first.dtype, device=first.device)
    return alike, torch.einsum("bkzyx,ka->bazyx", alike, steps)


def correlation_flow(
    first: Float[Tensor, "b c z y x"], second: Float[Tensor, "b c z y x"], spec: GridSpec
) -> Float[Tensor, "b 3 z y x"]:
    """Flow from one volume to another, of up to eight voxels.

    At each level the second volume is warped by what is known so far, and blocks around every voxel are compared with
    blocks one voxel further: sums of squared differences. A parabola through the best and its neighbours tells
    fractions of a voxel.

    Args:
        first: volume of the earlier time; empty space is 0.
        second: of the later time.
        spec: of both grids.

    Returns:
        x, y, z, metres; exactly 0 where both volumes are the same, and where blocks are empty.
    """
    flow = torch.zeros_like(first[:, :3]) if first.shape[1] >= 3 else first.new_zeros(len(first), 3, *first.shape[2:])
    for stride in STRIDES:
        step_m = stride * spec.voxel_m
        before, after = (_averaged(one, stride) for one in (first, warp_back(second, flow, spec)))
        cost = torch.stack([_block((before - shifted(after, one)).square()) for one in shifts()])
        energy = _block(before.square()) + _block(after.square())
        found = _best(cost, energy) * step_m
        flow = flow + functional.interpolate(found, size=first.shape[2:], mode="trilinear", align_corners=False)
    return flow


def _averaged(volume: Tensor, stride: int) -> Tensor:
    return volume if stride == 1 else functional.avg_pool3d(volume, stride, ceil_mode=True)


def _block(squares: Float[Tensor, "b c z y x"]) -> Float[Tensor, "b z y x"]:
    """Sums over channels, means over blocks."""
    padded = functional.pad(squares.sum(dim=1, keepdim=True), [BLOCK // 2] * 6)
    return functional.avg_pool3d(padded, BLOCK, stride=1)[:, 0]


def _best(cost: Float[Tensor, "27 b z y x"], energy: Float[Tensor, "b z y x"]) -> Float[Tensor, "b 3 z y x"]:
    """The shift of least cost, voxels; none where nothing differs."""
    table = cost.unflatten(0, (3, 3, 3))
    at = cost.argmin(dim=0)
    stays = cost[13] <= STAY * energy
    found = []
    for axis in range(3):
        others = [one for one in range(3) if one != axis]
        line = table.amin(dim=others)  # best of the two other axes
        bend = line[0] - 2 * line[1] + line[2]
        fraction = torch.where(bend > 1e-12, 0.5 * (line[0] - line[2]) / bend.clamp(min=1e-12), bend.new_zeros(()))
        whole = torch.div(at, (9, 3, 1)[axis], rounding_mode="floor") % 3 - 1
        middle = whole == 0
        found.append(torch.where(middle, fraction.clamp(-0.5, 0.5), whole.to(fraction.dtype)))
    return torch.stack(found, dim=1) * (~stays)[:, None]
