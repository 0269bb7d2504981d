"""Masks against pycocotools, boxes and IoU against counting."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pycocotools import mask as pycoco_mask

from labeling.core.masks import box_xywh, mask_iou
from labeling.core.rle import decode_mask, encode_mask
from labeling.core.types import Box3d

masks = hnp.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12)))


@given(masks)
def test_decode_undoes_encode(mask):
    decoded = decode_mask(encode_mask(mask))
    assert decoded.dtype == bool
    np.testing.assert_array_equal(decoded, mask)


@given(masks)
def test_encode_writes_what_pycocotools_writes(mask):
    expected = pycoco_mask.encode(np.asfortranarray(mask, np.uint8))
    assert encode_mask(mask) == {"size": list(mask.shape), "counts": expected["counts"].decode()}


@given(masks)
def test_decode_reads_what_pycocotools_writes(mask):
    rle = dict(pycoco_mask.encode(np.asfortranarray(mask, np.uint8)))
    np.testing.assert_array_equal(decode_mask(rle), mask)  # counts as bytes
    np.testing.assert_array_equal(decode_mask({**rle, "counts": rle["counts"].decode()}), mask)


@given(masks)
def test_decode_reads_uncompressed_runs(mask):
    flat = mask.ravel(order="F")
    borders = (np.flatnonzero(np.diff(flat.astype(int))) + 1).tolist()
    runs = np.diff(np.array([0, *borders, flat.size])).tolist()
    counts = [0, *runs] if flat[0] else runs
    np.testing.assert_array_equal(decode_mask({"size": list(mask.shape), "counts": counts}), mask)


@pytest.mark.parametrize("shape", [(1000, 1), (1, 1000), (700, 900)])
def test_long_runs_survive(shape):
    mask = np.zeros(shape, bool)
    mask.flat[mask.size // 2] = True
    np.testing.assert_array_equal(decode_mask(encode_mask(mask)), mask)


@pytest.mark.parametrize(
    "rle",
    [
        None,
        [],
        "04",
        {},
        {"size": [2, 2]},
        {"counts": "04"},
        {"size": [2], "counts": "04"},
        {"size": [2, 2, 1], "counts": "04"},
        {"size": [0, 4], "counts": ""},
        {"size": [-2, -2], "counts": "04"},
        {"size": [2.0, 2], "counts": "04"},
        {"size": ["2", "2"], "counts": "04"},
        {"size": "22", "counts": "04"},
        {"size": [2, 2], "counts": None},
        {"size": [2, 2], "counts": 4},
        {"size": [2, 2], "counts": ""},
        {"size": [2, 2], "counts": "03"},  # one pixel short
        {"size": [2, 2], "counts": "05"},  # one too many
        {"size": [2, 2], "counts": "0o"},  # ends in the middle of a run
        {"size": [2, 2], "counts": "0T" + "P" * 30 + "0"},  # a run of 4, written with 32 digits
        {"size": [2, 2], "counts": "o" * 1_000_000 + "0"},
        {"size": [2, 2], "counts": "0 4"},
        {"size": [2, 2], "counts": "0é4"},
        {"size": [2, 2], "counts": b"0\xff4"},
        {"size": [2, 2], "counts": [0, 5]},
        {"size": [2, 2], "counts": [5, -1]},
        {"size": [2, 2], "counts": [0, 4.0]},
        {"size": [2, 2], "counts": [[0, 4]]},
        {"size": [2, 2], "counts": []},
        {"size": [True, 4], "counts": [0, 4]},
        {"size": [2, 2], "counts": [0, True, 3]},
    ],
)
def test_malformed_rles_are_refused(rle):
    with pytest.raises(ValueError):
        decode_mask(rle)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@given(st.fixed_dictionaries({"size": st.lists(st.integers(1, 9), min_size=2, max_size=2), "counts": st.text()}))
@example({"size": [2, 2], "counts": "o" * 4000 + "0"})  # a run of thousands of bits
def test_any_text_is_decoded_to_its_size_or_refused(rle):
    try:
        mask = decode_mask(rle)
    except ValueError:
        return
    assert mask.shape == tuple(rle["size"])


@given(st.fixed_dictionaries({"size": json_values, "counts": json_values}) | json_values)
def test_anything_else_is_refused_in_the_same_way(rle):
    try:
        decode_mask(rle)
    except ValueError:
        return
    assert list(np.shape(decode_mask(rle))) == list(rle["size"])


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


@given(hnp.arrays(bool, (2, 4, 5)))
def test_mask_iou_agrees_with_counting_pixel_sets(pair):
    a, b = (set(map(tuple, np.argwhere(mask))) for mask in pair)
    assert mask_iou(*pair) == (len(a & b) / len(a | b) if a | b else 0)
    assert mask_iou(*pair) == mask_iou(*pair[::-1])


def test_box_3d_corners_stand_at_half_extents_along_its_axes():
    quarter_turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    corners = Box3d(np.array([10.0, 0, 0]), np.array([2.0, 4, 6]), quarter_turn).corners()
    np.testing.assert_allclose(corners.min(axis=0), [8, -1, -3])
    np.testing.assert_allclose(corners.max(axis=0), [12, 1, 3])
    assert len(np.unique(corners.round(6), axis=0)) == 8
