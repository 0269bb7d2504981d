"""The network: a memory of each of two times, and flow between them, coarse to fine.

Source: PWC-Net (Sun et al. 2018: pyramid, warping, cost volume) in 3-D, as Harley et al. 2020, section 3.3; thesis
2.3.3. Beside features it is given what each time knows to be occupied and to be free, and what of it the other time
sees through or finds again, which the papers leave out: what is seen through has moved, what is hidden may not have.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from labeling.memory.flow.correlation_flow import matched, shifts
from labeling.memory.flow.seen_through import seen_through
from labeling.memory.flow.warping import warp_back
from labeling.memory.lifting.voxel_grid import crop
from labeling.memory.networks.blocks import SLOPE, Conv3d
from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.networks.grnn import Grnn
from labeling.memory.networks.tower import Tower
from labeling.memory.networks.view_batch import Views
from labeling.memory.networks.weights import build_memory
from labeling.memory.settings.flow_settings import FlowSpec
from labeling.memory.settings.grid_spec import GridSpec

LEVELS = 3
"""Of the pyramid: voxels of 4, 2 and 1."""
KNOWN = 4
"""Channels beside features: occupied, free, seen through by the other time, found again by it."""


@dataclass(frozen=True)
class Remembered:
    """A memory of one time, beside another one."""

    features: Float[Tensor, "b c z y x"]
    occupied: Float[Tensor, "b 1 z y x"]
    """1 where a surface was seen."""
    free: Float[Tensor, "b 1 z y x"]
    """1 where views saw through and there is no surface."""
    checked: Float[Tensor, "b 2 z y x"]
    """Shares of points that the other time sees through, and that it finds again."""

    @property
    def known(self) -> Float[Tensor, "b 4 z y x"]:
        """All but the features."""
        return torch.cat([self.occupied, self.free, self.checked], dim=1)

    def cropped(self, places: Sequence[tuple[slice, slice, slice]]) -> "Remembered":
        """A part of each scene of the batch, by slices along z, y, x."""
        return Remembered(*(crop(one, places) for one in (self.features, self.occupied, self.free, self.checked)))


@dataclass(frozen=True)
class FlowOutput:
    """What is said of every voxel of the earlier time."""

    flow_m: Float[Tensor, "b 3 z y x"]
    """To the later time; x, y, z of the grid, metres."""
    moves: Float[Tensor, "b 1 z y x"]
    """Logits: whether what is there moves."""


class FlowBlock(nn.Sequential):
    """3x3x3 convolution and leaky ReLU. Nothing is normalised: most of a volume is empty, and parts are learnt on."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__(Conv3d(inputs, outputs, 3, stride, 1), nn.LeakyReLU(SLOPE, inplace=True))
        nn.init.kaiming_normal_(self[0].weight, SLOPE)  # type: ignore[arg-type]
        nn.init.zeros_(self[0].bias)  # type: ignore[arg-type]


class FlowLevel(nn.Module):
    """One level: what is left of the flow once the later time is warped by what is known of it.

    The place that matches best is a part of the answer, as far as it is trusted, so that there is little to learn.
    """

    def __init__(self, channels: int, width: int, coarser: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            FlowBlock(len(shifts()) + 2 * channels + 6 + coarser, width), FlowBlock(width, width)
        )
        self.flow = Conv3d(width, 4, 3, padding=1)
        nn.init.zeros_(self.flow.weight)
        nn.init.zeros_(self.flow.bias)  # type: ignore[arg-type]

    def forward(
        self,
        first: Float[Tensor, "b c z y x"],
        second: Float[Tensor, "b c z y x"],
        flow_m: Float[Tensor, "b 3 z y x"],
        hidden: Float[Tensor, "b h z y x"],
        spec: GridSpec,
    ) -> tuple[Float[Tensor, "b 3 z y x"], Float[Tensor, "b w z y x"]]:
        """Flow and hidden channels of this level, from those of the coarser one at this level's size."""
        edge_m = spec.extent_m[0] / first.shape[-1]
        warped = warp_back(second, flow_m, spec)
        likeness, best = matched(first, warped)
        found = self.layers(torch.cat([likeness, best, first, warped, flow_m / edge_m, hidden], dim=1))
        step, trust = self.flow(found).split([3, 1], dim=1)
        return flow_m + (step + trust.sigmoid() * best) * edge_m, found


class FlowHead(nn.Module):
    """Two memories to flow."""

    def __init__(self, channels: int, width: int) -> None:
        """Makes a head.

        Args:
            channels: of the memory.
            width: of layers.
        """
        super().__init__()
        self.pyramid = nn.ModuleList(
            [FlowBlock(channels + KNOWN, width), *(FlowBlock(width, width, stride=2) for _ in range(LEVELS - 1))]
        )
        self.levels = nn.ModuleList(FlowLevel(width, width, width) for _ in range(LEVELS))
        self.moves = nn.Sequential(FlowBlock(width + 2 * KNOWN + 3, width), nn.Conv3d(width, 1, 1))

    def forward(self, before: Remembered, after: Remembered, spec: GridSpec) -> FlowOutput:
        """Flow from ``before`` to ``after``.

        Args:
            before: memory of the earlier time.
            after: of the later time, in the same grid.
            spec: of the grid.
        """
        inputs = [torch.cat([one.features, one.known], dim=1) for one in (before, after)]
        firsts, seconds = (self._features(one) for one in inputs)
        coarsest = firsts[-1]
        flow, hidden = coarsest.new_zeros(len(coarsest), 3, *coarsest.shape[2:]), torch.zeros_like(coarsest)
        for number in reversed(range(LEVELS)):
            size = firsts[number].shape[2:]
            flow, hidden = (_resized(one, size) for one in (flow, hidden))
            flow, hidden = self.levels[number](firsts[number], seconds[number], flow, hidden, spec)
        moves = self.moves(torch.cat([hidden, before.known, after.known, flow / spec.voxel_m], dim=1))
        return FlowOutput(flow, moves)

    def _features(self, volume: Tensor) -> list[Tensor]:
        found = []
        for layer in self.pyramid:
            volume = layer(volume)
            found.append(volume)
        return found


class FlowNet(nn.Module):
    """Views of two times in, flow out. The memory is a whole one, whose weights stay as they are."""

    def __init__(self, spec: FlowSpec) -> None:
        super().__init__()
        self.spec = spec
        memory = build_memory(spec.memory)
        assert not isinstance(memory, Tower), "FlowSpec refuses memories without a volume"
        self.memory: Grnn | Cn3d = memory.requires_grad_(False)
        self.head = FlowHead(spec.memory.channels, spec.width)

    @torch.no_grad()
    def remember(self, views: Views, other: Views) -> Remembered:
        """A memory of views of one time, beside those of the other one."""
        mapped = self.memory.mapper(views)
        remembered = self.memory.merge(mapped) if isinstance(self.memory, Cn3d) else self.memory.remember(views)
        free = mapped.free.amax(dim=1) * (1 - remembered.occupied)
        checked = seen_through(views, other, self.spec.memory.grid)
        return Remembered(remembered.features, remembered.occupied, free, checked)

    def both(self, before: Views, after: Views) -> tuple[Remembered, Remembered]:
        """Memories of two times."""
        return self.remember(before, after), self.remember(after, before)

    def forward(self, before: Views, after: Views) -> FlowOutput:
        """Flow from the time of ``before`` to that of ``after``; both in the frame of one grid."""
        return self.head(*self.both(before, after), self.spec.memory.grid)


def _resized(volume: Tensor, size: torch.Size) -> Tensor:
    if volume.shape[2:] == size:
        return volume
    return functional.interpolate(volume, size=size, mode="trilinear", align_corners=False)
