"""The parts of ``compact``: a small Mask R-CNN for pictures of 128 to 320 pixels.

EfficientNet-Lite0, a feature pyramid of 128 channels, and heads whose 3x3 convolutions are depthwise separable: an
eighth of the work, which on a CPU is what the frame time is made of.
"""

from collections import OrderedDict

import torch
from torch import nn
from torch.nn.functional import interpolate, max_pool2d

from labeling.detectors.networks.efficientnet_lite import CHANNELS, EfficientNetLite0, conv_norm
from labeling.detectors.networks.torchvision_operators import torchvision

WIDTH = 128
HIDDEN = 256
"""Width of the box head."""
MASK_WIDTH = 64
"""Width of the mask head, which would otherwise be most of the frame time of a crowded picture."""
ANCHORS_PX = (16, 32, 64, 128, 256)
PROPOSALS = 100
CANONICAL_PX = 128
"""Boxes of this size are pooled from stride 16; a 7x7 grid then has cells of about one feature."""


class SeparableConv(nn.Sequential):
    """A 3x3 convolution per channel, then a 1x1 convolution across channels, with ReLU."""

    def __init__(self, channels: int) -> None:
        super().__init__(
            nn.Conv2d(channels, channels, 3, padding=1, groups=channels, bias=False),
            nn.Conv2d(channels, channels, 1),
            nn.ReLU(inplace=True),
        )


class Pyramid(nn.Module):
    """Feature pyramid, strides 4 to 64. Source: Lin et al. 2017."""

    def __init__(self) -> None:
        super().__init__()
        self.lateral = nn.ModuleList(conv_norm(channels, WIDTH, 1, activation=False) for channels in CHANNELS)
        self.output = nn.ModuleList(
            nn.Sequential(
                nn.Conv2d(WIDTH, WIDTH, 3, padding=1, groups=WIDTH, bias=False),
                *conv_norm(WIDTH, WIDTH, 1, activation=False),
            )
            for _ in CHANNELS
        )

    def forward(self, features: "OrderedDict[str, torch.Tensor]") -> "OrderedDict[str, torch.Tensor]":
        """Features by the names of the trunk's, and "pool" from the deepest of them."""
        names, values = list(features), list(features.values())
        carried = self.lateral[-1](values[-1])
        found = {names[-1]: self.output[-1](carried)}
        for level in range(len(values) - 2, -1, -1):
            carried = self.lateral[level](values[level]) + interpolate(carried, scale_factor=2.0, mode="nearest")
            found[names[level]] = self.output[level](carried)
        ordered = OrderedDict((name, found[name]) for name in names)
        ordered["pool"] = max_pool2d(ordered[names[-1]], 1, 2)
        return ordered


class Backbone(nn.Module):
    """Trunk and pyramid."""

    out_channels = WIDTH

    def __init__(self) -> None:
        super().__init__()
        self.trunk = EfficientNetLite0()
        self.pyramid = Pyramid()

    def forward(self, x: torch.Tensor) -> "OrderedDict[str, torch.Tensor]":
        """Features of (b, 3, h, w), whose sides are multiples of 32."""
        return self.pyramid(self.trunk(x))


class ProposalHead(nn.Module):
    """Objectness and box of every anchor."""

    def __init__(self, anchors: int) -> None:
        super().__init__()
        self.conv = SeparableConv(WIDTH)
        self.cls_logits = nn.Conv2d(WIDTH, anchors, 1)
        self.bbox_pred = nn.Conv2d(WIDTH, 4 * anchors, 1)
        for layer in (self.cls_logits, self.bbox_pred):
            nn.init.normal_(layer.weight, std=0.01)
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]

    def forward(self, features: list[torch.Tensor]) -> tuple[list[torch.Tensor], list[torch.Tensor]]:
        """Per level (b, anchors, h, w) and (b, 4 * anchors, h, w)."""
        hidden = [self.conv(feature) for feature in features]
        return [self.cls_logits(x) for x in hidden], [self.bbox_pred(x) for x in hidden]


def compact_parts(num_classes: int) -> nn.Module:
    """A Mask R-CNN of torchvision's made of these parts; ``num_classes`` counts the background."""
    models = torchvision.models.detection
    ratios = (0.5, 1.0, 2.0)
    pool = torchvision.ops.MultiScaleRoIAlign
    levels = [str(level) for level in range(len(CHANNELS))]
    return models.MaskRCNN(
        Backbone(),
        rpn_anchor_generator=models.anchor_utils.AnchorGenerator(
            tuple((size,) for size in ANCHORS_PX), (ratios,) * len(ANCHORS_PX)
        ),
        rpn_head=ProposalHead(len(ratios)),
        rpn_pre_nms_top_n_train=300,
        rpn_pre_nms_top_n_test=150,
        rpn_post_nms_top_n_train=200,
        rpn_post_nms_top_n_test=PROPOSALS,
        rpn_batch_size_per_image=128,
        box_roi_pool=pool(levels, 7, 2, canonical_scale=CANONICAL_PX),
        box_head=models.faster_rcnn.TwoMLPHead(WIDTH * 7 * 7, HIDDEN),
        box_predictor=models.faster_rcnn.FastRCNNPredictor(HIDDEN, num_classes),
        box_batch_size_per_image=64,
        box_detections_per_img=40,
        mask_roi_pool=pool(levels, 14, 2, canonical_scale=CANONICAL_PX),
        mask_head=nn.Sequential(
            nn.Conv2d(WIDTH, MASK_WIDTH, 1), nn.ReLU(inplace=True), *(SeparableConv(MASK_WIDTH) for _ in range(3))
        ),
        mask_predictor=models.mask_rcnn.MaskRCNNPredictor(MASK_WIDTH, MASK_WIDTH, num_classes),
    )
