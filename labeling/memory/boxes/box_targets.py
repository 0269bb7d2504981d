"""What a network is to say of boxes: heat maps from above, and what stands at each peak.

Boxes stand upright, so that the grid is looked at from above: the column of voxels in which the middle of a box lies
answers for it. Source: Zhou et al. 2019, "Objects as Points"; Yin et al. 2021, "Center-based 3D Object Detection". Yaw
is known within half a turn and learnt as sine and cosine of twice the angle; whether the sides of a box that is nearly
square are called one way or the other does not matter (``other_name``).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
from jaxtyping import Float
from torch import Tensor

from labeling.memory.settings.grid_spec import GridSpec

OFFSET, HEIGHT, SIDES, YAW = slice(0, 2), slice(2, 3), slice(3, 6), slice(6, 8)
"""Where numbers of a box stand: middle less that of its column (x, y; in voxels), height of the middle (metres, frame
of the grid), logarithms of length, width and height (metres), sine and cosine of twice the yaw."""
NUMBERS = 8
SPREAD, LEAST_SPREAD = 0.15, 0.7
"""Standard deviation of a peak: share of the box's shorter side, and least, in voxels."""
NEARLY_SQUARE = 1.25
"""Longer over shorter side below which it does not matter which is which."""


@dataclass(frozen=True)
class GridBox:
    """A box that is to be found, in the frame of the grid."""

    numbers: Float[Tensor, "7"]
    """Middle, length, width, height (metres), yaw (radians), as ``labeling.detectors3d.upright_boxes`` has them."""
    category: int
    weight: float = 1.0
    """In the loss."""
    counts: bool = True
    """Whether it is to be found; else it is neither right nor wrong to find it."""


@dataclass(frozen=True)
class BoxTargets:
    """What is to be said of a batch of scenes."""

    heat: Float[Tensor, "b k y x"]
    """Of each category: 1 in columns that answer for a box, falling to 0 around them."""
    known: Float[Tensor, "b k y x"]
    """0 where it does not matter."""
    numbers: Float[Tensor, "b 8 y x"]
    """Of the box that a column answers for."""
    weight: Float[Tensor, "b 1 y x"]
    """Of that box; 0 in columns that answer for none."""
    filled: Float[Tensor, "b 1 z y x"]
    """1 in voxels in which surfaces of objects lie."""

    def to(self, device: torch.device | str) -> "BoxTargets":
        """On another device."""
        return BoxTargets(**{one.name: getattr(self, one.name).to(device) for one in fields(self)})


def column_of(numbers: Float[Tensor, "7"], grid: GridSpec) -> tuple[int, int] | None:
    """The column (row y, column x) in which the middle of a box lies; None outside of the grid."""
    place = (numbers[:3] + 0.5 * numbers.new_tensor(grid.extent_m)) / grid.voxel_m
    if bool((place < 0).any()) or bool((place >= place.new_tensor(grid.shape[::-1])).any()):
        return None
    return int(place[1]), int(place[0])


def box_targets(boxes: Sequence[GridBox], categories: int, grid: GridSpec) -> BoxTargets:
    """Targets of one scene.

    Args:
        boxes: where the middles of two lie in one column, the heavier one is kept, of equal ones the larger. Boxes
            whose middle lies outside of the grid are left out.
        categories: how many there are.
        grid: of the memory.

    Returns:
        A batch of one, without what is filled (``filled_voxels``).
    """
    _, rows, columns = grid.shape
    heat, known = torch.zeros(1, categories, rows, columns), torch.ones(1, categories, rows, columns)
    numbers, weight = torch.zeros(1, NUMBERS, rows, columns), torch.zeros(1, 1, rows, columns)
    y, x = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
    for one in sorted(boxes, key=lambda box: (box.weight, float(box.numbers[3:6].prod()))):
        place = column_of(one.numbers, grid)
        if place is None:
            continue
        spread = max(LEAST_SPREAD, SPREAD * float(one.numbers[4]) / grid.voxel_m)
        peak = torch.exp(-0.5 * ((y - place[0]) ** 2 + (x - place[1]) ** 2) / spread**2)
        if not one.counts:
            known[0, one.category] *= (peak < 0.1).float()
            continue
        heat[0, one.category] = torch.maximum(heat[0, one.category], peak)
        numbers[0, :, place[0], place[1]] = encode(one.numbers, place, grid)
        weight[0, 0, place[0], place[1]] = one.weight
    known = torch.where(heat == 1, torch.ones_like(known), known)
    return BoxTargets(heat, known, numbers, weight, torch.zeros(1, 1, *grid.shape))


def encode(box: Float[Tensor, "7"], column: tuple[int, int], grid: GridSpec) -> Float[Tensor, "8"]:
    """Numbers of a box, as the column that answers for it says them."""
    middle = box.new_tensor(column[::-1]) + 0.5
    half = 0.5 * box.new_tensor(grid.extent_m[:2])
    offset = (box[:2] + half) / grid.voxel_m - middle
    return torch.cat([offset, box[2:3], box[3:6].log(), (2 * box[6:7]).sin(), (2 * box[6:7]).cos()])


def decode(numbers: Float[Tensor, "n 8"], columns: Float[Tensor, "n 2"], grid: GridSpec) -> Float[Tensor, "n 7"]:
    """Boxes of numbers that columns (y, x) say, in the frame of the grid; yaw in (-pi / 2, pi / 2]."""
    half = 0.5 * numbers.new_tensor(grid.extent_m[:2])
    middle = (columns.flip(1) + 0.5 + numbers[:, OFFSET]) * grid.voxel_m - half
    yaw = 0.5 * torch.atan2(numbers[:, 6], numbers[:, 7])
    return torch.cat([middle, numbers[:, HEIGHT], numbers[:, SIDES].exp(), yaw[:, None]], dim=1)


def other_name(numbers: Float[Tensor, "n 8"]) -> Float[Tensor, "n 8"]:
    """The same boxes with length and width exchanged, turned by a quarter."""
    order = torch.tensor([0, 1, 2, 4, 3, 5, 6, 7], device=numbers.device)
    sign = numbers.new_tensor([1, 1, 1, 1, 1, 1, -1, -1])
    return numbers[:, order] * sign


def joined(targets: Sequence[BoxTargets]) -> BoxTargets:
    """Several scenes as one batch."""
    return BoxTargets(**{one.name: torch.cat([getattr(t, one.name) for t in targets]) for one in fields(BoxTargets)})
