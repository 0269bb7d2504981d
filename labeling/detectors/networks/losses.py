"""Mask R-CNN's two training stages with what torchvision's lack: regions to ignore, and labels of low confidence.

A target is torchvision's (``boxes`` (n, 4) xyxy in pixels, ``labels`` (n,), ``masks`` (n, h, w)) plus

- ``weights`` (n,) in [0, 1], how well the mask of each object is known: losses of boxes and masks count by it;
- ``presence`` (n,) in [0, 1], how surely each object is there: what matches an object of presence p counts as p of the
  object and 1 - p of background, so that it is found with as little confidence;
- ``ignored`` (k, 4), boxes of regions of which nothing is known: anchors and proposals that lie mostly in one and match
  no object are neither positive nor negative;
- ``unannotated`` (c,), labels of categories that nobody would have annotated in the picture: what matches no object is
  background or one of these. No anchor there is negative, and the probabilities of all of them together are what
  background should have.

With weights and presences of 1, nothing ignored and nothing unannotated, all losses are torchvision's. Source: Cermelli
et al. 2020, "Modeling the Background for Incremental Learning in Semantic Segmentation", equation 5 (unannotated
categories).
"""

from typing import Any, Self

import torch
from torch.nn import functional

from labeling.detectors.networks.torchvision_operators import torchvision

Tensor = torch.Tensor
Target = dict[str, Tensor]

INSIDE = 0.5
"""Share of a box that must lie in an ignored region for the box to be ignored."""

_BETA = 1 / 9  # of the smooth L1 loss, as in torchvision


def inside_ignored(boxes: Tensor, regions: Tensor) -> Tensor:
    """Which boxes (n, 4) lie mostly within one of the regions (k, 4)."""
    if len(regions) == 0:
        return torch.zeros(len(boxes), dtype=torch.bool, device=boxes.device)
    low = torch.maximum(boxes[:, None, :2], regions[None, :, :2])
    high = torch.minimum(boxes[:, None, 2:], regions[None, :, 2:])
    shared = (high - low).clamp(min=0).prod(dim=2)
    area = (boxes[:, 2:] - boxes[:, :2]).prod(dim=1)
    return (shared > INSIDE * area[:, None].clamp(min=1e-6)).any(dim=1)


def with_training_losses(network: Any) -> Any:
    """Gives a Mask R-CNN that is to be trained these losses; it detects as before.

    They are no part of the network by itself: what is detected does not depend on how networks are trained.

    Args:
        network: whose ``rpn`` and ``roi_heads`` are torchvision's, or are from here already; changed and returned.
    """
    network.rpn = WeightedProposals.from_torchvision(network.rpn)
    network.roi_heads = WeightedHeads.from_torchvision(network.roi_heads)
    return network


class _FromTorchvision:
    @classmethod
    def from_torchvision(cls, module: Any) -> Self:
        """Takes over parts and settings of torchvision's module, which is not to be used any more."""
        made = cls.__new__(cls)
        made.__dict__ = module.__dict__
        return made


class WeightedProposals(_FromTorchvision, torchvision.models.detection.rpn.RegionProposalNetwork):
    """The region proposal network; see the module."""

    _weights: list[Tensor]
    _presence: list[Tensor]

    def assign_targets_to_anchors(
        self, anchors: list[Tensor], targets: list[Target]
    ) -> tuple[list[Tensor], list[Tensor]]:
        """As torchvision does; then takes out negatives in ignored regions, and keeps what the loss asks for."""
        labels, matched = super().assign_targets_to_anchors(anchors, targets)
        self._weights, self._presence = [], []
        for boxes, label, box, target in zip(anchors, labels, matched, targets, strict=True):
            unknown = inside_ignored(boxes, target["ignored"]) | (len(target["unannotated"]) > 0)
            label[(label == 0) & unknown] = -1
            weight, presence = torch.ones_like(label), torch.ones_like(label)
            positive = label > 0
            if positive.any():
                # torchvision does not say which object an anchor was matched to, but it gives the object's box.
                same = (box[positive][:, None] == target["boxes"][None]).all(dim=2).to(torch.uint8).argmax(dim=1)
                weight[positive] = target["weights"].to(weight)[same]
                presence[positive] = target["presence"].to(presence)[same]
            self._weights.append(weight)
            self._presence.append(presence)
        return labels, matched

    def compute_loss(
        self, objectness: Tensor, pred_bbox_deltas: Tensor, labels: list[Tensor], regression_targets: list[Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Losses of objectness and boxes; a positive's presence is the objectness that it should have."""
        positives, negatives = self.fg_bg_sampler(labels)
        positive = torch.where(torch.cat(positives))[0]
        sampled = torch.cat([positive, torch.where(torch.cat(negatives))[0]])
        weight, presence, label = torch.cat(self._weights), torch.cat(self._presence), torch.cat(labels)
        number = max(1, sampled.numel())
        box_loss = functional.smooth_l1_loss(
            pred_bbox_deltas[positive], torch.cat(regression_targets)[positive], beta=_BETA, reduction="none"
        )
        objectness_loss = functional.binary_cross_entropy_with_logits(
            objectness.flatten()[sampled], (label * presence)[sampled], reduction="sum"
        )
        return objectness_loss / number, (weight[positive, None] * box_loss).sum() / number


class WeightedHeads(_FromTorchvision, torchvision.models.detection.roi_heads.RoIHeads):
    """The heads for class, box and mask; see the module."""

    def forward(
        self,
        features: dict[str, Tensor],
        proposals: list[Tensor],
        image_shapes: list[tuple[int, int]],
        targets: list[Target] | None = None,
    ) -> tuple[list[dict[str, Tensor]], dict[str, Tensor]]:
        """Detections, or the losses while training."""
        if not self.training or targets is None:
            return super().forward(features, proposals, image_shapes, None)
        boxes, matched, labels = self._sample(proposals, targets)
        pooled = self.box_head(self.box_roi_pool(features, boxes, image_shapes))
        class_logits, box_regression = self.box_predictor(pooled)
        goals = [
            target["boxes"].to(box)[index] if len(target["boxes"]) else torch.zeros_like(box)
            for target, index, box in zip(targets, matched, boxes, strict=True)
        ]
        regression_targets = torch.cat(self.box_coder.encode(goals, boxes))
        label = torch.cat(labels)
        weight, presence = (
            torch.cat(
                [
                    _of_objects(target[which].to(boxes[0]), of, index)
                    for target, of, index in zip(targets, labels, matched, strict=True)
                ]
            )
            for which in ("weights", "presence")
        )
        unannotated = torch.cat(
            [
                torch.zeros(len(box), class_logits.shape[1], dtype=torch.bool, device=label.device).index_fill_(
                    1, target["unannotated"].to(label.device), True
                )
                for box, target in zip(boxes, targets, strict=True)
            ]
        )
        losses = box_losses(class_logits, box_regression, label, regression_targets, weight, presence, unannotated)
        positive = [torch.where(label > 0)[0] for label in labels]
        mask_boxes = [box[index] for box, index in zip(boxes, positive, strict=True)]
        mask_features = self.mask_head(self.mask_roi_pool(features, mask_boxes, image_shapes))
        losses["loss_mask"] = mask_loss(
            self.mask_predictor(mask_features),
            mask_boxes,
            [target["masks"] for target in targets],
            [index[chosen] for index, chosen in zip(matched, positive, strict=True)],
            label[label > 0],
            weight[label > 0],
        )
        return [], losses

    def _sample(
        self, proposals: list[Tensor], targets: list[Target]
    ) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
        """Boxes to learn from, the object each was matched to, and its label."""
        truths = [target["boxes"].to(proposals[0]) for target in targets]
        proposals = self.add_gt_proposals(proposals, truths)
        matched, labels = self.assign_targets_to_proposals(proposals, truths, [t["labels"] for t in targets])
        for boxes, label, target in zip(proposals, labels, targets, strict=True):
            label[(label == 0) & inside_ignored(boxes, target["ignored"].to(boxes))] = -1
        chosen = self.subsample(labels)

        def taken(values: list[Tensor]) -> list[Tensor]:
            return [value[index] for value, index in zip(values, chosen, strict=True)]

        return taken(proposals), taken(matched), taken(labels)


def _of_objects(values: Tensor, label: Tensor, matched: Tensor) -> Tensor:
    """What boxes have of the objects (n,) that they were matched to; background has 1."""
    found = torch.ones(len(label), dtype=values.dtype, device=values.device)
    found[label > 0] = values[matched[label > 0]]
    return found


def box_losses(
    class_logits: Tensor,
    box_regression: Tensor,
    label: Tensor,
    regression_targets: Tensor,
    weight: Tensor,
    presence: Tensor,
    unannotated: Tensor,
) -> dict[str, Tensor]:
    """Losses of class and box over n sampled boxes.

    Args:
        class_logits: (n, classes).
        box_regression: (n, 4 * classes).
        label: (n,), 0 for background.
        regression_targets: (n, 4).
        weight: (n,), of positives, in the loss of boxes.
        presence: (n,), of positives, the probability of their class that they should have.
        unannotated: (n, classes): what background may be besides.
    """
    number = max(1, len(label))
    allowed = unannotated.clone()
    allowed[:, 0] = True
    log_probability = class_logits.log_softmax(dim=1)
    of_background = -log_probability.masked_fill(~allowed, -torch.inf).logsumexp(dim=1)
    of_object = functional.nll_loss(log_probability, label, reduction="none")
    classifier = torch.where(label == 0, of_background, presence * of_object + (1 - presence) * of_background)
    positive = torch.where(label > 0)[0]
    regression = box_regression.reshape(len(label), box_regression.shape[1] // 4, 4)[positive, label[positive]]
    box = functional.smooth_l1_loss(regression, regression_targets[positive], beta=_BETA, reduction="none")
    return {
        "loss_classifier": classifier.sum() / number,
        "loss_box_reg": (weight[positive, None] * box).sum() / number,
    }


def mask_loss(
    logits: Tensor, boxes: list[Tensor], masks: list[Tensor], matched: list[Tensor], label: Tensor, weight: Tensor
) -> Tensor:
    """Loss of the masks over the positive boxes.

    Args:
        logits: (p, classes, m, m).
        boxes: positive boxes of each picture, p in all.
        masks: of the objects of each picture (n, h, w).
        matched: the object each box was matched to.
        label: (p,).
        weight: (p,).
    """
    if len(label) == 0:
        return logits.sum() * 0
    side = logits.shape[-1]
    project = torchvision.models.detection.roi_heads.project_masks_on_boxes
    wanted = torch.cat([project(m, b, i, side) for m, b, i in zip(masks, boxes, matched, strict=True) if len(b)]).to(
        logits.dtype
    )
    predicted = logits[torch.arange(len(label), device=label.device), label]
    loss = functional.binary_cross_entropy_with_logits(predicted, wanted, reduction="none").mean(dim=(1, 2))
    return (weight * loss).mean()
