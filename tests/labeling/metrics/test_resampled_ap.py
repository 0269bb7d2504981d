"""AP of scenes drawn again: against the plain AP of pictures that are really there several times."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.rle import decode_mask, encode_mask
from labeling.core.types import Box3d
from labeling.metrics.box_ap import BoxInstance, average_precision_3d, ranked_box_matches
from labeling.metrics.mask_ap import average_precision
from labeling.metrics.matching import MaskInstance
from labeling.metrics.resampled_ap import resample_matches, resampled_ap, scene_draws

THRESHOLDS = (0.3, 0.5)
SCENES = {0: "attic", 1: "attic", 2: "bath", 3: "cellar", 4: "den"}
"""Of each picture."""


def rectangle(top: int, left: int, height: int, width: int) -> dict:
    mask = np.zeros((8, 10), bool)
    mask[top : top + height, left : left + width] = True
    return encode_mask(mask)


def made_up(seed: int) -> tuple[list[MaskInstance], list[MaskInstance]]:
    """Predictions, no two equally sure, and ground truth."""
    rng = np.random.default_rng(seed)

    def one(truth: bool) -> MaskInstance:
        place = [int(rng.integers(low, high)) for low, high in ((0, 4), (0, 5), (2, 6), (2, 6))]
        return MaskInstance(
            image=int(rng.integers(len(SCENES))),
            category=str(rng.choice(["chair", "plant"])),
            rle=rectangle(*place),
            confidence=1.0 if truth else float(rng.random()),
            ignore=truth and bool(rng.random() < 0.2),
        )

    counts = rng.integers(0, 12, 2)
    return [one(False) for _ in range(counts[0])], [one(True) for _ in range(counts[1])]


def again(items: list, count: dict[str, int]) -> list:
    """Instances of scenes that are there so many times."""
    return [replace(item, image=(item.image, copy)) for item in items for copy in range(count[SCENES[item.image]])]


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["mask", "box"]))
def test_a_scene_that_is_drawn_twice_counts_as_if_it_were_there_twice(seed, kind):
    predictions, truths = made_up(seed)
    names = sorted(set(SCENES.values()))
    found = resampled_ap(predictions, truths, SCENES, THRESHOLDS, kind, resamples=4, seed=seed)
    for draw, times in enumerate(scene_draws(len(names), 4, seed)):
        count = dict(zip(names, times.tolist(), strict=True))

        plain = average_precision(again(predictions, count), again(truths, count), THRESHOLDS, kind)
        for threshold in THRESHOLDS:
            expected = plain.mean[threshold]
            np.testing.assert_allclose(found[threshold][draw], np.nan if expected is None else expected, atol=1e-9)


def boxed(items: list[MaskInstance]) -> list[BoxInstance]:
    """The rectangles of masks as boxes of unit height."""
    found = []
    for item in items:
        rows, columns = np.nonzero(decode_mask(item.rle))
        (top, left), (height, width) = (rows.min(), columns.min()), (np.ptp(rows) + 1, np.ptp(columns) + 1)
        box = Box3d(np.array([left + width / 2, top + height / 2, 0.5]), np.array([width, height, 1.0]), np.eye(3))
        found.append(BoxInstance(item.image, item.category, box, item.confidence, ignore=item.ignore))
    return found


@pytest.mark.slow
@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_scenes_with_boxes_are_drawn_as_often_as_those_with_masks(seed):
    found, truths = map(boxed, made_up(seed))
    names = sorted(set(SCENES.values()))
    resampled = resample_matches(ranked_box_matches(found, truths, THRESHOLDS), SCENES, THRESHOLDS, 4, seed)
    for draw, times in enumerate(scene_draws(len(names), 4, seed)):
        count = dict(zip(names, times.tolist(), strict=True))

        plain = average_precision_3d(again(found, count), again(truths, count), THRESHOLDS)
        for threshold in THRESHOLDS:
            expected = plain.mean[threshold]
            np.testing.assert_allclose(resampled[threshold][draw], np.nan if expected is None else expected, atol=1e-9)


def test_draws_are_paired_and_have_as_many_scenes_as_there_are():
    draws = scene_draws(5, 50, seed=3)
    assert (draws.sum(axis=1) == 5).all()
    np.testing.assert_array_equal(draws, scene_draws(5, 50, seed=3))
    assert (draws != scene_draws(5, 50, seed=4)).any()


def test_alike_scenes_leave_no_doubt():
    square = rectangle(1, 1, 4, 4)
    truths = [MaskInstance(image, "chair", square) for image in SCENES]
    found = [MaskInstance(image, "chair", square, confidence=0.9) for image in SCENES]
    assert set(resampled_ap(found, truths, SCENES, resamples=20)[0.5].round(9)) == {1.0}


def test_nothing_to_find_is_nan_and_a_picture_without_a_scene_is_refused():
    assert np.isnan(resampled_ap([], [], SCENES, resamples=3)[0.5]).all()
    with pytest.raises(ValueError, match="picture '9' has no scene"):
        resampled_ap([], [MaskInstance(9, "chair", rectangle(0, 0, 2, 2))], SCENES)
