"""Boxes around masks against pycocotools, overlap against counting."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pycocotools import mask as pycoco_mask

from labeling.core.masks import blank_masks, box_xywh, box_xyxy, mask_iou, pairwise_mask_iou

masks = hnp.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12)))


@given(masks)
def test_box_is_the_tightest(mask):
    left, top, width, height = box_xywh(mask)
    assert all(isinstance(value, float) for value in (left, top, width, height))
    if not mask.any():
        assert (left, top, width, height) == (0, 0, 0, 0)
        return
    y, x = np.nonzero(mask)
    assert (left, top) == (x.min(), y.min())
    assert (left + width - 1, top + height - 1) == (x.max(), y.max())
    expected = pycoco_mask.toBbox(pycoco_mask.encode(np.asfortranarray(mask, np.uint8)))
    np.testing.assert_array_equal([left, top, width, height], expected)
    assert box_xyxy(mask) == (left, top, left + width, top + height)


@given(hnp.arrays(bool, (2, 4, 5)))
def test_mask_iou_agrees_with_counting_pixel_sets(pair):
    a, b = (set(map(tuple, np.argwhere(mask))) for mask in pair)
    assert mask_iou(*pair) == (len(a & b) / len(a | b) if a | b else 0)
    assert mask_iou(*pair) == mask_iou(*pair[::-1])


@given(st.integers(0, 5), st.tuples(st.integers(1, 90), st.integers(1, 90)))
def test_blank_masks_are_empty_and_their_own(count, size):
    masks = blank_masks(count, size)
    assert (masks.shape, masks.dtype) == ((count, *size), bool)
    assert not masks.any()
    if count:
        masks[-1] = True
        assert masks.sum() == size[0] * size[1]
        assert not blank_masks(count, size).any()


def test_overlaps_are_those_of_single_masks() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.random((3, 8, 9)) < 0.5, rng.random((4, 8, 9)) < 0.5
    b[0] = False
    expected = [[np.sum(x & y) / max(np.sum(x | y), 1) for y in b] for x in a]
    assert np.allclose(pairwise_mask_iou(a, b), expected)
