"""The network: a memory of views, and a head that looks at it from above."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from labeling.memory.boxes.box_targets import NUMBERS
from labeling.memory.networks.blocks import ConvBlock2d, ConvBlock3d
from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.networks.grnn import Grnn
from labeling.memory.networks.scene_memory import SceneMemory
from labeling.memory.networks.tower import Tower
from labeling.memory.networks.view_batch import Views
from labeling.memory.networks.weights import build_memory
from labeling.memory.settings.box_settings import BoxSpec

FIRST_HEAT = 0.1
"""Before any training, of every column. Source: Lin et al. 2017, "Focal Loss for Dense Object Detection"."""


@dataclass(frozen=True)
class BoxOutput:
    """What is said of a batch of scenes; see ``BoxTargets``."""

    heat: Float[Tensor, "b k y x"]
    """Logits."""
    numbers: Float[Tensor, "b 8 y x"]
    filled: Float[Tensor, "b 1 z y x"]
    """Logits."""


class BoxHead(nn.Module):
    """A memory to heat maps, numbers of boxes, and voxels that objects fill."""

    def __init__(self, channels: int, depth: int, width: int, categories: int) -> None:
        """Makes a head.

        Args:
            channels: of the memory.
            depth: voxels of the grid from bottom to top.
            width: channels of maps.
            categories: how many there are.
        """
        super().__init__()
        self.volume = ConvBlock3d(channels + 1, channels)
        self.filled = nn.Conv3d(channels, 1, 1)
        self.flat = nn.Conv2d((channels + 1) * depth, width, 1)
        self.fine = ConvBlock2d(width, width)
        self.coarse = nn.Sequential(
            ConvBlock2d(width, 2 * width, stride=2), ConvBlock2d(2 * width, 2 * width), ConvBlock2d(2 * width, width)
        )
        self.both = ConvBlock2d(width, width)
        self.heat = nn.Sequential(ConvBlock2d(width, width), nn.Conv2d(width, categories, 1))
        self.numbers = nn.Sequential(ConvBlock2d(width, width), nn.Conv2d(width, NUMBERS, 1))
        nn.init.constant_(self.heat[-1].bias, math.log(FIRST_HEAT / (1 - FIRST_HEAT)))  # type: ignore[arg-type]

    def forward(self, memory: SceneMemory) -> BoxOutput:
        """Logits and numbers of all columns, logits of all voxels.

        What a memory imagines where no view has seen anything is left out: boxes are of what was seen.
        """
        volume = self.volume(torch.cat([memory.features * memory.seen, memory.occupied], dim=1))
        filled = self.filled(volume)
        seen_from_above = torch.cat([volume, filled.sigmoid()], dim=1).flatten(1, 2)
        fine = self.fine(self.flat(seen_from_above))
        coarse = functional.interpolate(self.coarse(fine), size=fine.shape[2:], mode="nearest")
        both = self.both(fine + coarse)
        return BoxOutput(self.heat(both), self.numbers(both), filled)


class BoxNet(nn.Module):
    """Views in, boxes out.

    The memory is a whole one, with its decoder, which takes no part in finding boxes.
    """

    def __init__(self, spec: BoxSpec) -> None:
        super().__init__()
        self.spec = spec
        memory = build_memory(spec.memory)
        assert not isinstance(memory, Tower), "BoxSpec refuses memories without a volume"
        self.memory: Grnn | Cn3d = memory
        depth = spec.memory.grid.shape[0]
        self.head = BoxHead(spec.memory.channels, depth, spec.memory.width, len(spec.categories))

    def forward(self, views: Views) -> BoxOutput:
        """What a memory of ``views`` says."""
        return self.head(self.memory.remember(views))
