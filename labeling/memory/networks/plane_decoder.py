"""From a memory to maps of any view: planes of depth, what is in front of them, and 2-D convolutions.

Source: Tung et al. 2019, "Projection and decoding"; thesis 2.1.1. Two liberties: beside the planes one after the other
the decoder is given their alpha composite, so that it need not learn what hides what from nothing; and plain residual
convolutions stand for the convolutional LSTM.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from labeling.memory.lifting.projection import composite, plane_depths, project_planes
from labeling.memory.networks.blocks import ConvBlock2d
from labeling.memory.networks.view_batch import Cameras
from labeling.memory.settings.grid_spec import GridSpec

FIRST_OPACITY = -3.0
"""Bias of opacities before any training: nearly all is transparent."""


class Residual(nn.Module):
    """Two convolutions beside a shortcut, (b, c, h, w) -> (b, c, h, w)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.inner = nn.Sequential(ConvBlock2d(channels, channels), nn.Conv2d(channels, channels, 3, padding=1))

    def forward(self, maps: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        """The maps and what is added to them."""
        return maps + self.inner(maps)


class PlaneDecoder(nn.Module):
    """Maps of half the pictures' size, of ``outputs`` channels, for every camera."""

    def __init__(self, grid: GridSpec, channels: int, planes: int, width: int, outputs: int) -> None:
        super().__init__()
        self.grid, self.planes = grid, planes
        self.opacity = nn.Conv3d(channels, 1, 1)
        nn.init.constant_(self.opacity.bias, FIRST_OPACITY)  # type: ignore[arg-type]
        self.mix = nn.Conv2d(channels * planes, width, 1)
        self.front = nn.Conv2d(channels + 1 + planes, width, 1)
        self.residuals = nn.Sequential(Residual(width), Residual(width))
        self.last = nn.Conv2d(width, outputs, 1)

    def forward(
        self, memory: Float[Tensor, "b c z y x"], cameras: Cameras, occupied: Float[Tensor, "b 1 z y x"]
    ) -> Float[Tensor, "n d h2 w2"]:
        """Maps of all cameras of all scenes, one after the other.

        Args:
            memory: of each scene.
            cameras: in the frame of its grid.
            occupied: where some view has seen a surface; opaque, whatever the memory says.
        """
        scenes, views = cameras.camera_to_grid.shape[:2]
        size = cameras.size[0] // 2, cameras.size[1] // 2
        alpha = self.opacity(memory).sigmoid()
        alpha = alpha + occupied * (1 - alpha) * 0.9
        volume = torch.cat([memory, alpha], dim=1).repeat_interleave(views, dim=0)
        pose, intrinsics = cameras.camera_to_grid.flatten(0, 1), cameras.resized(size).flatten(0, 1)
        depths_m = plane_depths(pose, self.grid, self.planes)
        sampled = project_planes(volume, intrinsics, pose, size, depths_m, self.grid)
        planes, opacity = sampled[:, :-1], sampled[:, -1:]
        seen, weights = composite(planes, opacity)
        depth = (weights * depths_m[:, :, None, None]).sum(dim=1, keepdim=True) / self.grid.radius_m
        mixed = self.mix(planes.flatten(1, 2)) + self.front(torch.cat([seen, depth, weights], dim=1))
        assert len(mixed) == scenes * views
        return self.last(self.residuals(mixed))


class RgbHead(nn.Module):
    """Maps of half size to logits of colours at full size: (n, c, h / 2, w / 2) -> (n, 3, h, w)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.widen = nn.Sequential(nn.Conv2d(channels, 4 * 16, 1), nn.PixelShuffle(2), ConvBlock2d(16, 16))
        self.last = nn.Conv2d(16, 3, 3, padding=1)

    def forward(self, maps: Float[Tensor, "n c h2 w2"]) -> Float[Tensor, "n 3 h w"]:
        """Logits; their sigmoids are colours in [0, 1]."""
        return self.last(self.widen(maps))
