import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as oracle

from labeling.core.rle import check_rle, decode_mask, encode_mask, rle_area, rle_box_xywh

masks = st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(lambda size: arrays(np.bool_, size))


def blocks(seed: int, size: tuple[int, int] = (240, 320)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    mask = np.zeros(size, bool)
    for _ in range(4):
        y, x = rng.integers(0, size[0]), rng.integers(0, size[1])
        mask[y : y + rng.integers(1, 80), x : x + rng.integers(1, 80)] ^= True
    return mask


def check_against_pycocotools(mask: np.ndarray) -> None:
    rle = encode_mask(mask)
    theirs = oracle.encode(np.asfortranarray(mask, np.uint8))
    assert rle == {"size": list(mask.shape), "counts": theirs["counts"].decode()}
    assert rle_area(rle) == mask.sum()
    assert rle_box_xywh(rle) == oracle.toBbox(theirs).tolist()
    back = decode_mask(rle)
    assert back.flags.c_contiguous
    np.testing.assert_array_equal(back, mask)


@settings(max_examples=200)
@given(masks)
def test_any_mask_is_encoded_as_pycocotools_does(mask: np.ndarray) -> None:
    check_against_pycocotools(mask)


@pytest.mark.parametrize("seed", range(5))
def test_masks_of_pictures_are_encoded_as_pycocotools_does(seed: int) -> None:
    check_against_pycocotools(blocks(seed))


def test_masks_in_any_memory_order_give_the_same_text() -> None:
    mask = blocks(9)
    assert encode_mask(np.asfortranarray(mask)) == encode_mask(mask)
    assert encode_mask(mask[::2, ::3]) == encode_mask(mask[::2, ::3].copy())


@settings(max_examples=300)
@given(st.binary(max_size=12), st.integers(1, 9), st.integers(1, 9))
def test_any_bytes_are_decoded_to_a_mask_of_the_size_or_refused(text: bytes, height: int, width: int) -> None:
    rle = {"size": [height, width], "counts": text}
    try:
        mask = decode_mask(rle)
    except ValueError:
        with pytest.raises(ValueError):
            check_rle(rle)
        return
    assert mask.shape == (height, width)
    np.testing.assert_array_equal(decode_mask(encode_mask(mask)), mask)


@pytest.mark.parametrize("damage", [lambda t: t[:-1], lambda t: t + "1", lambda t: "!" + t, lambda t: "~" * 40 + t])
def test_damaged_text_is_refused(damage) -> None:
    rle = encode_mask(blocks(3))
    with pytest.raises(ValueError, match="RLE"):
        check_rle({**rle, "counts": damage(rle["counts"])})


@settings(max_examples=200)
@given(masks, st.data())
def test_missing_pixels_are_counted(mask: np.ndarray, data) -> None:
    """Text of a picture with fewer columns, stated to be of the whole one."""
    fewer = data.draw(st.integers(1, mask.shape[1]))
    text = encode_mask(mask[:, :fewer])["counts"]
    rle = {"size": list(mask.shape), "counts": text}
    if fewer == mask.shape[1]:
        check_rle(rle)
    else:
        with pytest.raises(ValueError, match=f"cover {mask.shape[0] * fewer} pixels"):
            check_rle(rle)


@given(masks)
def test_decode_reads_what_pycocotools_writes(mask):
    rle = dict(oracle.encode(np.asfortranarray(mask, np.uint8)))
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
