"""Mask R-CNN without torchvision's wrapping: batches of equal size in, losses or detections out."""

import copy
import itertools
import math
from collections import OrderedDict
from dataclasses import replace
from typing import Any

import torch
from torch import nn

from labeling.core.detector import DetectorError
from labeling.detectors.networks.compact import compact_parts
from labeling.detectors.networks.efficientnet_lite import load_imagenet_weights
from labeling.detectors.networks.pointwise import use_pointwise
from labeling.detectors.networks.spec import NetworkSpec
from labeling.detectors.networks.torchvision_operators import torchvision

STRIDE = 32
"""Sides of a batch are multiples of this."""
_NORMALISATION = {
    # EfficientNet-Lite's; ImageNet's in torchvision's networks.
    "compact": ((127 / 255,) * 3, (128 / 255,) * 3),
    "maskrcnn_resnet50_fpn": ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225)),
}


class Network(nn.Module):
    """A Mask R-CNN. The names of its parameters are those of torchvision's, so that its weights fit."""

    def __init__(self, spec: NetworkSpec, parts: Any) -> None:
        super().__init__()
        self.spec = spec
        self.backbone = parts.backbone
        self.rpn, self.roi_heads = parts.rpn, parts.roi_heads
        use_pointwise(self)
        self.frozen_statistics = True
        """Whether batch normalisation keeps its statistics while training, as small batches want it."""
        self.mean: torch.Tensor
        self.std: torch.Tensor
        mean, std = _NORMALISATION[spec.architecture]
        self.register_buffer("mean", torch.tensor(mean).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(std).view(1, 3, 1, 1), persistent=False)

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return next(self.parameters()).device

    def train(self, mode: bool = True) -> "Network":
        """Switches to training; batch normalisation goes along only if its statistics are not frozen."""
        super().train(mode)
        if mode and self.frozen_statistics:
            for module in self.modules():
                if isinstance(module, nn.BatchNorm2d):
                    module.eval()
        return self

    def freeze(self, stages: int) -> None:
        """Keeps weights of the trunk as they are: edges and textures look the same everywhere, and the first features
        are the largest, so that learning them costs most.

        Args:
            stages: how many of its parts, from the pictures on; the first is what comes before the residual blocks.
        """
        backbone: Any = self.backbone
        if self.spec.architecture == "compact":
            parts = [backbone.trunk.stem, *backbone.trunk.stages]
        else:
            parts = [backbone.body.conv1, *(backbone.body[f"layer{number}"] for number in range(1, 5))]
        for part in parts[:stages]:
            part.requires_grad_(False)

    def forward(
        self,
        pictures: torch.Tensor,
        sizes: list[tuple[int, int]],
        targets: list[dict[str, torch.Tensor]] | None = None,
    ) -> Any:
        """Runs the network.

        Args:
            pictures: (b, 3, h, w), uint8, RGB; each fills its upper left corner. Sides are multiples of ``STRIDE``.
            sizes: height and width of each picture within.
            targets: what to learn (labeling.detectors.networks.losses); needed while training, for which that module's
                ``with_training_losses`` prepares the network.

        Returns:
            While training a dict of losses; else per picture a dict of ``boxes`` (n, 4), ``labels`` (n,),
            ``scores`` (n,) and ``masks`` (n, 1, 28, 28), the probability of each cell of the box.
        """
        x = (pictures.float() / 255 - self.mean) / self.std
        inside = torch.zeros_like(x[:, :1])
        for index, (height, width) in enumerate(sizes):
            inside[index, :, :height, :width] = 1
        x = (x * inside).contiguous(memory_format=torch.channels_last)
        features = OrderedDict((name, value.float()) for name, value in self.backbone(x).items())
        images = torchvision.models.detection.image_list.ImageList(x, sizes)
        # Half precision is for the features, which are most of the work: boxes in it would be off by a pixel at 1000.
        with torch.autocast(x.device.type, enabled=False):
            proposals, proposal_losses = self.rpn(images, features, targets)
            detections, losses = self.roi_heads(features, proposals, sizes, targets)
        return {**losses, **proposal_losses} if self.training else detections


def build_network(spec: NetworkSpec) -> Network:
    """A network with random weights."""
    classes = 1 + len(spec.categories)
    if spec.architecture == "compact":
        return Network(spec, compact_parts(classes))
    parts = torchvision.models.detection.maskrcnn_resnet50_fpn(weights=None, weights_backbone=None, num_classes=classes)
    # All of these come from the COCO weights, which torchvision trained with normalisation that has no epsilon.
    for module in parts.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eps = 0.0
    return Network(spec, parts)


def build_from_imagenet(spec: NetworkSpec) -> Network:
    """A network to pre-train: the trunk knows ImageNet, everything else is random.

    Raises:
        DetectorError: if the ImageNet weights are not installed, or this architecture comes with other weights.
    """
    if spec.architecture != "compact":
        raise DetectorError(f"only compact is trained from the start here, not {spec.architecture}")
    network = build_network(spec)
    load_imagenet_weights(network.backbone.trunk)
    return network


def with_categories(network: Network, categories: tuple[str, ...]) -> Network:
    """A copy of the network with other outputs; those that it has already keep their weights.

    What it had no name for was background: new categories share the probability of background evenly with it (Cermelli
    et al. 2020, "Modeling the Background for Incremental Learning in Semantic Segmentation", equation 10), and their
    boxes and masks are at first the mean of those of all known categories.

    Args:
        network: as it is.
        categories: the new list.
    """
    old = network.spec.categories
    made = build_network(replace(network.spec, categories=categories))
    kept = [0, *(1 + old.index(name) for name in categories if name in old)]
    place = [0, *(1 + row for row, name in enumerate(categories) if name in old)]
    new = [1 + row for row, name in enumerate(categories) if name not in old]
    theirs, ours = network.state_dict(), made.state_dict()
    for name, value in ours.items():
        if value.shape == theirs[name].shape:
            value.copy_(theirs[name])
            continue
        # Outputs of one class lie together: 1 row, or the 4 of its box.
        group = value.shape[0] // (1 + len(categories))
        ours_by_class, theirs_by_class = (one.view(-1, group, *value.shape[1:]) for one in (value, theirs[name]))
        ours_by_class[place] = theirs_by_class[kept]
        if "cls_score" in name:
            ours_by_class[new] = theirs_by_class[0]
            if name.endswith("bias"):
                ours_by_class[[0, *new]] -= math.log(1 + len(new))
        else:
            ours_by_class[new] = theirs_by_class[1:].mean(dim=0)
    made.load_state_dict(ours)
    return made


def channels_last(network: Network) -> Network:
    """The network with its kernels laid out for pictures whose channels lie together, which convolve faster."""
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def fused(network: Network) -> Network:
    """A copy for inference, whose batch normalisation is part of the convolutions before it."""
    made = copy.deepcopy(network).eval()
    for module in list(made.modules()):
        if not isinstance(module, nn.Sequential):
            continue
        layers = list(module)
        for index, (first, second) in enumerate(itertools.pairwise(layers)):
            if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
                module[index] = torch.nn.utils.fusion.fuse_conv_bn_eval(first, second)
                module[index + 1] = nn.Identity()
    return channels_last(made).requires_grad_(False)
