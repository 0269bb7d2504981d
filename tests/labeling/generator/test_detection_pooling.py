"""Two detectors' findings: each object once, by the surer of the two."""

from itertools import permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from labeling.core.masks import mask_iou
from labeling.core.types import Detection
from labeling.generator.detection_pooling import SAME_OBJECT, pool_detections

SIZE = (6, 8)


@st.composite
def detections(draw: st.DrawFn) -> tuple[Detection, ...]:
    found = []
    for _ in range(draw(st.integers(0, 4))):
        top, left = draw(st.integers(0, 4)), draw(st.integers(0, 5))
        mask = np.zeros(SIZE, bool)
        mask[top : top + draw(st.integers(1, 4)), left : left + draw(st.integers(1, 4))] = True
        view, category = draw(st.integers(0, 1)), draw(st.sampled_from(["bed", "tv"]))
        found.append(Detection(view, category, draw(st.sampled_from([0.1, 0.5, 0.9])), mask))
    return tuple(found)


def same(a: Detection, b: Detection) -> bool:
    return (a.view_index, a.category) == (b.view_index, b.category) and mask_iou(a.mask, b.mask) >= SAME_OBJECT


def numbers_of_pairs(first: tuple[Detection, ...], second: tuple[Detection, ...]) -> set[int]:
    """How many one-to-one pairs mean the same object where the sum of their IoU is greatest; by trying all."""
    few, many = sorted((first, second), key=len)
    found = []
    for chosen in permutations(many, len(few)):
        overlaps = [mask_iou(a.mask, b.mask) for a, b in zip(few, chosen, strict=True) if same(a, b)]
        found.append((sum(overlaps), len(overlaps)))
    return {pairs for overlap, pairs in found if overlap > max(found)[0] - 1e-5}


@given(detections(), detections())
def test_every_object_stays_once(first, second):
    found = pool_detections(first, second)
    assert all(any(one is kept for kept in (*first, *second)) for one in found)
    assert len(first) + len(second) - len(found) in numbers_of_pairs(first, second)
    for gone in (*first, *second):
        if not any(gone is kept for kept in found):
            assert any(same(gone, kept) and kept.confidence >= gone.confidence for kept in found)


@given(detections())
def test_a_detector_beside_one_that_finds_nothing_is_as_it_was(first):
    assert pool_detections(first, ()) == first == pool_detections((), first)


@given(detections())
def test_a_detector_beside_itself_says_nothing_new(first):
    assert sorted(map(id, pool_detections(first, first))) == sorted(map(id, first))


def test_the_surer_of_two_stays_and_other_categories_are_left_alone():
    mask = np.zeros(SIZE, bool)
    mask[1:5, 1:5] = True
    nearly = mask.copy()
    nearly[1, 1:4] = False
    sure, unsure = Detection(0, "bed", 0.9, nearly), Detection(0, "bed", 0.4, mask)
    other, elsewhere = Detection(0, "tv", 0.3, mask), Detection(1, "bed", 0.2, mask)
    assert pool_detections((unsure, other), (sure, elsewhere)) == (other, sure, elsewhere)
    assert pool_detections((sure, other), (unsure, elsewhere)) == (sure, other, elsewhere)
