import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as oracle

from labeling.core.rle import decode_text, encode_text

masks = st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(lambda size: arrays(np.bool_, size))


def blocks(seed: int, size: tuple[int, int] = (240, 320)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    mask = np.zeros(size, bool)
    for _ in range(4):
        y, x = rng.integers(0, size[0]), rng.integers(0, size[1])
        mask[y : y + rng.integers(1, 80), x : x + rng.integers(1, 80)] ^= True
    return mask


@settings(max_examples=200, deadline=None)
@given(masks)
def test_text_is_that_of_pycocotools(mask: np.ndarray) -> None:
    text, area, box = encode_text(mask)
    theirs = oracle.encode(np.asfortranarray(mask, np.uint8))
    assert text.encode() == theirs["counts"]
    assert area == mask.sum()
    assert list(box) == oracle.toBbox(theirs).tolist()
    np.testing.assert_array_equal(decode_text(text.encode(), mask.shape), mask)


@pytest.mark.parametrize("seed", range(5))
def test_text_of_pictures_comes_back(seed: int) -> None:
    mask = blocks(seed)
    text, area, _ = encode_text(mask)
    assert text.encode() == oracle.encode(np.asfortranarray(mask, np.uint8))["counts"]
    assert area == mask.sum()
    np.testing.assert_array_equal(decode_text(text.encode(), mask.shape), mask)


def test_masks_in_any_memory_order_give_the_same_text() -> None:
    mask = blocks(9)
    assert encode_text(np.asfortranarray(mask)) == encode_text(mask)
    assert encode_text(mask[::2, ::3]) == encode_text(mask[::2, ::3].copy())


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=12), st.integers(1, 9), st.integers(1, 9))
def test_any_bytes_give_a_mask_that_has_this_text_or_none(text: bytes, height: int, width: int) -> None:
    mask = decode_text(text, (height, width))
    if mask is not None:
        assert mask.shape == (height, width)
        np.testing.assert_array_equal(decode_text(encode_text(mask)[0].encode(), mask.shape), mask)


@pytest.mark.parametrize("damage", [lambda t: t[:-1], lambda t: t + b"1", lambda t: b"!" + t, lambda t: b"~" * 40 + t])
def test_damaged_text_is_refused(damage) -> None:
    mask = blocks(3)
    assert decode_text(damage(encode_text(mask)[0].encode()), mask.shape) is None
