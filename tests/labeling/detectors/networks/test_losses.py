"""The training stages: torchvision's where every label is certain; weights and ignored regions by their laws."""

from typing import Any

import numpy as np
import pytest
import torch

from labeling.detectors.networks.compact import compact_parts
from labeling.detectors.networks.losses import WeightedHeads, WeightedProposals, box_losses, inside_ignored
from labeling.detectors.networks.torchvision_operators import torchvision

SIZE = (64, 96)


@pytest.fixture(scope="module")
def stage():
    """Parts of torchvision's, ours made of the same parts, and features of two pictures."""
    torch.manual_seed(0)
    parts: Any = compact_parts(3)
    parts.train()
    features = parts.backbone(torch.randn(2, 3, *SIZE))
    images = torchvision.models.detection.image_list.ImageList(torch.zeros(2, 3, *SIZE), [SIZE, SIZE])
    ours = WeightedProposals.from_torchvision(parts.rpn), WeightedHeads.from_torchvision(parts.roi_heads)
    for one in ours:
        one.train()
    return parts, ours, {k: v.detach() for k, v in features.items()}, images


def target(
    weights=(1.0, 1.0), boxes=((4, 4, 30, 40), (40, 20, 90, 60)), regions=(), unannotated=(), presence=(1.0, 1.0)
):
    kept = torch.tensor(boxes, dtype=torch.float32).reshape(-1, 4)
    masks = torch.zeros(len(kept), *SIZE, dtype=torch.uint8)
    for mask, (left, top, right, bottom) in zip(masks, kept.long().tolist(), strict=True):
        mask[top:bottom, left : (left + right) // 2] = 1
    return {
        "boxes": kept,
        "labels": torch.arange(len(kept)) % 2 + 1,
        "masks": masks,
        "weights": torch.tensor(weights[: len(kept)], dtype=torch.float32),
        "presence": torch.tensor(presence[: len(kept)], dtype=torch.float32),
        "ignored": torch.tensor(regions, dtype=torch.float32).reshape(-1, 4),
        "unannotated": torch.tensor(unannotated, dtype=torch.int64),
    }


def losses(stages, features, images, targets) -> dict[str, float]:
    rpn, heads = stages
    torch.manual_seed(5)
    proposals, first = rpn(images, features, targets)
    fixed = [torch.tensor([[2.0, 2, 28, 38], [41, 22, 88, 61], [10, 40, 60, 62], [60, 0, 95, 18]]) for _ in proposals]
    torch.manual_seed(6)
    _, second = heads(features, fixed, images.image_sizes, targets)
    return {name: float(value.detach()) for name, value in {**first, **second}.items()}


def test_losses_are_torchvisions_where_all_labels_are_certain(stage):
    parts, ours, features, images = stage
    targets = [target(), target(boxes=((10, 10, 50, 50),))]
    assert losses(ours, features, images, targets) == pytest.approx(
        losses((parts.rpn, parts.roi_heads), features, images, targets), rel=1e-5
    )


OF_SHAPE, OF_PRESENCE = {"loss_rpn_box_reg", "loss_box_reg", "loss_mask"}, {"loss_objectness", "loss_classifier"}


@pytest.mark.parametrize(("counted", "named"), [("weights", OF_SHAPE), ("presence", OF_PRESENCE)])
def test_losses_are_linear_in_weight_and_presence_of_a_label(stage, counted, named):
    """Boxes and masks count by the weight alone, class and objectness by the presence alone."""
    _, ours, features, images = stage

    def at(value):
        return losses(ours, features, images, [target(**{counted: (value, 1.0)}), target()])

    none, half, full = at(0.0), at(0.5), at(1.0)
    assert set(full) == OF_SHAPE | OF_PRESENCE
    for name, value in half.items():
        assert value == pytest.approx(0.5 * (none[name] + full[name]), rel=1e-4)
        assert (none[name] == full[name]) == (name not in named)
    if named == OF_SHAPE:
        assert all(none[name] < full[name] for name in named)


def test_labels_of_no_weight_teach_no_shape_and_those_of_no_presence_background(stage):
    _, ours, features, images = stage
    nothing = {"weights": (0.0, 0.0), "presence": (0.0, 0.0)}
    found = losses(ours, features, images, [target(**nothing), target(**nothing)])
    assert all(found[name] == 0.0 for name in OF_SHAPE)
    assert all(found[name] > 0 for name in OF_PRESENCE)


@pytest.mark.parametrize("presence", [0.0, 0.3, 0.8, 1.0])
def test_a_label_is_best_found_with_its_presence_as_confidence(presence):
    confidence = torch.linspace(0.001, 0.999, 999)
    logits = torch.stack([(1 - confidence).log(), confidence.log(), torch.full_like(confidence, -50.0)], dim=1)
    certain = torch.zeros(1, 3, dtype=torch.bool)
    found = [
        float(
            box_losses(
                one[None],
                torch.zeros(1, 12),
                torch.tensor([1]),
                torch.zeros(1, 4),
                torch.ones(1),
                torch.tensor([presence]),
                certain,
            )["loss_classifier"]
        )
        for one in logits
    ]
    assert float(confidence[int(np.argmin(found))]) == pytest.approx(presence, abs=0.0015)


def test_anchors_of_a_doubtful_label_are_best_objects_with_its_presence(stage):
    _, (rpn, _), features, images = stage
    targets = [target(presence=(0.3, 0.3)), target(presence=(0.3, 0.3))]
    anchors = rpn.anchor_generator(images, list(features.values()))
    labels, _ = rpn.assign_targets_to_anchors(anchors, targets)
    label = torch.cat(labels)
    nowhere = [torch.zeros(len(one), 4) for one in labels]

    def at(confidence):
        logit = torch.where(label > 0, torch.logit(torch.tensor(confidence)), torch.tensor(-20.0))
        torch.manual_seed(5)
        return float(rpn.compute_loss(logit, torch.cat(nowhere), labels, nowhere)[0])

    confidences = np.arange(0.05, 1.0, 0.05)
    assert confidences[np.argmin([at(float(one)) for one in confidences])] == pytest.approx(0.3)


def test_where_everything_is_ignored_nothing_is_learnt(stage):
    _, ours, features, images = stage
    nothing = target(boxes=(), regions=((-500, -500, 700, 700),))
    assert set(losses(ours, features, images, [nothing, nothing]).values()) == {0.0}


def test_an_ignored_region_takes_nothing_from_the_objects_in_it(stage):
    _, ours, features, images = stage
    everywhere = ((-500, -500, 700, 700),)
    found = losses(ours, features, images, [target(regions=everywhere), target(regions=everywhere)])
    assert all(value > 0 for value in found.values())


def test_a_picture_without_objects_is_all_background(stage):
    parts, ours, features, images = stage
    targets = [target(boxes=()), target(boxes=())]
    assert losses(ours, features, images, targets) == pytest.approx(
        losses((parts.rpn, parts.roi_heads), features, images, targets), rel=1e-5
    )


def test_boxes_are_ignored_that_lie_mostly_inside_a_region():
    boxes = torch.tensor([[0.0, 0, 10, 10], [6, 0, 16, 10], [4, 0, 14, 10], [50, 50, 60, 60]])
    regions = torch.tensor([[-5.0, -5, 10, 20], [59, 59, 60, 60]])
    assert inside_ignored(boxes, regions).tolist() == [True, False, True, False]
    assert inside_ignored(boxes, torch.zeros(0, 4)).tolist() == [False] * 4


def test_background_that_may_be_something_unnamed_shares_its_probability_with_it():
    logits = torch.tensor([[0.3, -0.2, 1.1], [0.3, -0.2, 1.1], [2.0, 0.5, -1.0]])
    label, presence = torch.tensor([0, 1, 0]), torch.tensor([1.0, 0.5, 1.0])
    unannotated = torch.tensor([[False, False, True], [False, False, True], [False, False, False]])
    nowhere, sure = (torch.zeros(3, 12), label, torch.zeros(3, 4)), torch.ones(3)
    found = box_losses(logits, *nowhere, sure, presence, unannotated)["loss_classifier"]
    share = logits.exp() / logits.exp().sum(dim=1, keepdim=True)
    unnamed = -(share[0, 0] + share[0, 2]).log()  # of the second box, too, as far as its label is doubted
    expected = unnamed + 0.5 * unnamed - 0.5 * share[1, 1].log() - share[2, 0].log()
    assert float(found) == pytest.approx(float(expected / 3), rel=1e-6)


def test_where_something_is_unnamed_no_anchor_is_negative(stage):
    _, (rpn, _), features, images = stage
    anchors = rpn.anchor_generator(images, list(features.values()))
    plain, _ = rpn.assign_targets_to_anchors(anchors, [target(), target()])
    unsure, _ = rpn.assign_targets_to_anchors(anchors, [target(unannotated=(2,)), target()])
    assert torch.equal(plain[1], unsure[1])
    assert torch.equal(plain[0] > 0, unsure[0] > 0)
    assert (plain[0] == 0).any()
    assert not (unsure[0] == 0).any()


def test_losses_stay_finite_where_all_categories_are_unnamed(stage):
    _, ours, features, images = stage
    every = target(boxes=(), unannotated=(1, 2))
    found = losses(ours, features, images, [every, every])
    assert found["loss_objectness"] == 0.0
    assert found["loss_classifier"] == pytest.approx(0.0, abs=1e-5)
