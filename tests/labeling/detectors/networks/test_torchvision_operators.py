"""The fallback operators against torchvision's own pure-Python reference, and against brute force."""

import sys

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.detectors.networks import torchvision_operators
from labeling.detectors.networks.torchvision_operators import compiled_operators_load, nms, roi_align, torchvision


def reference(*arguments):
    return sys.modules["torchvision.ops.roi_align"]._roi_align.__wrapped__(*arguments)  # type: ignore[attr-defined]


def random_rois(rng: np.random.Generator, number: int, height: float, width: float, over: float) -> torch.Tensor:
    """Boxes that reach over the rim by this share of the picture."""
    corners = rng.uniform(-over, 1 + over, (number, 2, 2)) * [width, height]
    boxes = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    return torch.from_numpy(np.concatenate([rng.integers(0, 2, (number, 1)), boxes], axis=1))


@pytest.mark.parametrize("aligned", [False, True])
@pytest.mark.parametrize("sampling", [-1, 1, 2, 3])
@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), height=st.integers(1, 9), width=st.integers(1, 9), rows=st.integers(1, 5))
def test_roi_align_and_its_gradient_are_those_of_the_reference(sampling, aligned, seed, height, width, rows):
    rng = np.random.default_rng(seed)
    features = torch.from_numpy(rng.normal(size=(2, 3, height, width)))
    # The reference takes no more samples per cell than the picture has pixels, which tells only outside of it.
    rois = random_rois(rng, 6, 4.0 * height, 4.0 * width, 0.3 if sampling > 0 else 0.0)
    settings_ = (0.25, rows, 4, sampling, aligned)
    ours, theirs = features.clone().requires_grad_(), features.clone().requires_grad_()
    a, b = roi_align(ours, rois, *settings_), reference(theirs, rois, *settings_)
    torch.testing.assert_close(a, b, rtol=0, atol=1e-12)
    upstream = torch.from_numpy(rng.normal(size=tuple(a.shape)))
    (ga,) = torch.autograd.grad(a, ours, upstream)
    (gb,) = torch.autograd.grad(b, theirs, upstream)
    torch.testing.assert_close(ga, gb, rtol=0, atol=1e-12)


def test_roi_align_of_no_boxes_is_empty_and_can_be_differentiated():
    features = torch.zeros(1, 3, 4, 4, requires_grad=True)
    pooled = roi_align(features, torch.zeros(0, 5), 1.0, 2, 2, 2, False)
    assert pooled.shape == (0, 3, 2, 2)
    pooled.sum().backward()


def brute_force_nms(boxes: np.ndarray, scores: np.ndarray, threshold: float) -> list[int]:
    kept: list[int] = []
    for i in np.argsort(-scores, kind="stable"):
        overlaps = []
        for j in kept:
            sides = np.minimum(boxes[i, 2:], boxes[j, 2:]) - np.maximum(boxes[i, :2], boxes[j, :2])
            shared = np.prod(np.maximum(sides, 0))
            areas = np.prod(boxes[i, 2:] - boxes[i, :2]) + np.prod(boxes[j, 2:] - boxes[j, :2])
            overlaps.append(shared / (areas - shared))
        if not any(overlap > threshold for overlap in overlaps):
            kept.append(int(i))
    return kept


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6), number=st.integers(0, 40), threshold=st.sampled_from([0.1003, 0.3107, 0.5003, 0.7701])
)
def test_nms_is_that_of_brute_force(seed, number, threshold):
    rng = np.random.default_rng(seed)
    corner = rng.integers(0, 30, (number, 2))
    boxes = np.concatenate([corner, corner + rng.integers(1, 25, (number, 2))], axis=1).astype(np.float32)
    scores = rng.integers(0, 12, number).astype(np.float32) / 12
    kept = nms(torch.from_numpy(boxes), torch.from_numpy(scores), threshold)
    assert kept.tolist() == brute_force_nms(boxes, scores, threshold)


def test_torchvision_reaches_the_operators_by_its_own_functions():
    boxes = torch.tensor([[0.0, 0, 10, 10], [1, 1, 10, 10], [20, 20, 30, 30]])
    assert torchvision.ops.nms(boxes, torch.tensor([0.5, 0.9, 0.1]), 0.5).tolist() == [1, 2]
    features = torch.rand(1, 2, 8, 8)
    pooled = torchvision.ops.roi_align(features, [boxes[:1]], (2, 2), 0.5, 2)
    torch.testing.assert_close(pooled, reference(features, torch.tensor([[0.0, 0, 0, 10, 10]]), 0.5, 2, 2, 2, False))


def test_nothing_is_replaced_where_the_compiled_operators_load():
    assert (torchvision_operators._LIBRARY is None) == compiled_operators_load()


def test_torchvision_asks_the_real_compiler_what_it_supports():
    from torch._dynamo.utils import is_compile_supported  # not before: it is large

    asked = sys.modules["torchvision.ops.roi_align"].is_compile_supported
    assert asked("cpu") == is_compile_supported("cpu")
