"""Small U-Nets in 2-D and 3-D, and what they are made of.

Source: Ronneberger et al. 2015 (the thesis' [52]); residual sums at skips instead of concatenations, which halves the
cost of the widest layers.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

SLOPE = 0.1
"""Of leaky ReLUs."""


def _norm(channels: int) -> nn.Module:
    """Of groups of channels: batches are small."""
    return nn.GroupNorm(min(4, channels), channels)


class Conv3d(nn.Conv3d):
    """``torch.nn.Conv3d``, as fast for one volume as for several: in one thread only batches go to oneDNN."""

    def forward(self, input: Float[Tensor, "b c z y x"]) -> Float[Tensor, "b d z2 y2 x2"]:
        """A single volume on a single thread is convolved twice over: that is faster than once without oneDNN."""
        if len(input) == 1 and input.device.type == "cpu" and torch.get_num_threads() == 1:
            return super().forward(input.expand(2, -1, -1, -1, -1))[:1]
        return super().forward(input)


class ConvBlock2d(nn.Sequential):
    """3x3 convolution, normalisation, leaky ReLU: (b, c, h, w) -> (b, d, h / stride, w / stride)."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__(
            nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False), _norm(outputs), nn.LeakyReLU(SLOPE, inplace=True)
        )


class ConvBlock3d(nn.Sequential):
    """3x3x3 convolution, normalisation, leaky ReLU: (b, c, z, y, x) -> (b, d, z / stride, y / stride, x / stride)."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__(
            Conv3d(inputs, outputs, 3, stride, 1, bias=False), _norm(outputs), nn.LeakyReLU(SLOPE, inplace=True)
        )


class UNet2d(nn.Module):
    """Features of pictures, at half their size, that know of an eighth of it."""

    def __init__(self, inputs: int, outputs: int, width: int) -> None:
        super().__init__()
        self.stem = ConvBlock2d(inputs, width, stride=2)
        self.down_4 = nn.Sequential(ConvBlock2d(width, 2 * width, stride=2), ConvBlock2d(2 * width, 2 * width))
        self.down_8 = nn.Sequential(ConvBlock2d(2 * width, 3 * width, stride=2), ConvBlock2d(3 * width, 3 * width))
        self.up_4 = nn.Conv2d(3 * width, 2 * width, 1)
        self.up_2 = nn.Conv2d(2 * width, width, 1)
        self.last = nn.Sequential(ConvBlock2d(width, width), nn.Conv2d(width, outputs, 1))

    def forward(self, pictures: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h2 w2"]:
        """Features of half the height and width."""
        half = self.stem(pictures)
        quarter = self.down_4(half)
        eighth = self.down_8(quarter)
        quarter = quarter + _up(self.up_4(eighth), quarter)
        half = half + _up(self.up_2(quarter), half)
        return self.last(half)


class UNet3d(nn.Module):
    """Features of volumes, at their size, that know of a quarter of it."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.stem = ConvBlock3d(inputs, outputs)
        self.down_2 = nn.Sequential(ConvBlock3d(outputs, 2 * outputs, stride=2), ConvBlock3d(2 * outputs, 2 * outputs))
        self.down_4 = nn.Sequential(
            ConvBlock3d(2 * outputs, 3 * outputs, stride=2), ConvBlock3d(3 * outputs, 3 * outputs)
        )
        self.up_2 = nn.Conv3d(3 * outputs, 2 * outputs, 1)
        self.up_1 = nn.Conv3d(2 * outputs, outputs, 1)
        self.last = Conv3d(outputs, outputs, 3, padding=1)
        self.around = nn.Conv3d(inputs, outputs, 1)

    def forward(self, volumes: Float[Tensor, "b c z y x"]) -> Float[Tensor, "b d z y x"]:
        """Features of all voxels."""
        whole = self.stem(volumes)
        half = self.down_2(whole)
        quarter = self.down_4(half)
        half = half + _up(self.up_2(quarter), half)
        whole = whole + _up(self.up_1(half), whole)
        return self.last(whole) + self.around(volumes)


def _up(small: Tensor, like: Tensor) -> Tensor:
    """Nearest neighbours, to the size of another map."""
    return functional.interpolate(small, size=like.shape[2:], mode="nearest")
