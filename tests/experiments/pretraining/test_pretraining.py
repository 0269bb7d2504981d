import itertools
import json

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.pretrain_compact import main
from experiments.pretraining.augmentation import (
    PretrainAugmentConfig,
    mosaic,
    random_affine,
    random_view,
    stream,
    warp_sample,
)
from experiments.pretraining.loop import PretrainConfig, PretrainTask, share_of_training
from experiments.pretraining.world_views import summary
from labeling.core.errors import UsageError
from labeling.core.rle import encode_mask
from labeling.detectors.data.annotated_pictures import AnnotatedPicture, Annotation
from labeling.detectors.data.augment import AugmentConfig, Sample
from labeling.detectors.networks.mask_rcnn import build_network
from labeling.detectors.networks.spec import NetworkSpec
from labeling.detectors.networks.weights import load_network
from labeling.metrics.matching import MaskInstance
from labeling.training.checkpoint import Progress
from labeling.training.loop import train

NAMES = ("chair", "table")
PLAIN = PretrainAugmentConfig(mosaic=0.0, jpeg=0.0, grey=0.0, recolour=AugmentConfig(colour=0.0, blur=0.0, noise=0.0))


def coloured(size=(60, 80)) -> Sample:
    """Two rectangles of one pure colour each on black."""
    rgb, masks = np.zeros((*size, 3), np.uint8), np.zeros((2, *size), bool)
    masks[0, 5:30, 10:40], masks[1, 28:55, 45:75] = True, True
    rgb[masks[0]], rgb[masks[1]] = (255, 0, 0), (0, 255, 0)
    return Sample(rgb, masks, np.array([1, 2]), np.ones(2, np.float32), np.zeros(2, bool))


@pytest.fixture
def photographs(tmp_path):
    """Six pictures of a red or green rectangle."""
    pictures = []
    for number in range(6):
        rng = np.random.default_rng(number)
        rgb, mask = np.full((64, 64, 3), 90, np.uint8), np.zeros((64, 64), bool)
        top, left = rng.integers(4, 24, 2)
        mask[top : top + 30, left : left + 30] = True
        rgb[mask] = (200, 30, 30) if number % 2 else (30, 200, 30)
        file = tmp_path / f"{number}.png"
        cv2.imwrite(str(file), rgb[..., ::-1])
        pictures.append(AnnotatedPicture(file, (64, 64), (Annotation(NAMES[number % 2], encode_mask(mask)),)))
    return pictures


def test_a_warp_that_moves_nothing_changes_nothing():
    sample = coloured()
    same = warp_sample(sample, (60, 80), np.eye(3)[:2], np.random.default_rng(0))
    np.testing.assert_array_equal(same.rgb, sample.rgb)
    np.testing.assert_array_equal(same.masks, sample.masks)
    np.testing.assert_array_equal(same.labels, sample.labels)


@given(st.integers(0, 2**32 - 1), st.integers(48, 200), st.integers(48, 200))
@settings(max_examples=60)
def test_masks_stay_on_their_objects(seed, height, width):
    rng = np.random.default_rng(seed)
    sample = coloured()
    warp = random_affine((60, 80), (height, width), PLAIN, rng)
    view = warp_sample(sample, (height, width), warp, rng)
    # Colours of neighbours mix over the width of an enlarged pixel.
    rim = 2 * int(np.ceil(np.sqrt(abs(np.linalg.det(warp[:, :2]))) + 2)) + 1
    assert view.rgb.shape == (height, width, 3)
    assert view.masks.shape[1:] == (height, width)
    for mask, label in zip(view.masks, view.labels, strict=True):
        assert mask.any()
        inner = (
            cv2.erode(
                mask.astype(np.uint8), np.ones((rim, rim), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
            )
            > 0
        )
        colour = (255, 0, 0) if label == 1 else (0, 255, 0)
        assert np.all(np.abs(view.rgb[inner].astype(int) - colour) <= 3)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_photographs_larger_than_a_view_fill_it(seed):
    """Without turns, a photograph that is larger than its view leaves no rim, and a smaller one lies in it whole."""
    rng = np.random.default_rng(seed)
    from dataclasses import replace

    config = replace(PLAIN, turn_rad=0.0, aspect=0.0)
    warp = random_affine((50, 50), (100, 100), config, rng)
    corners = np.array([[-0.5, -0.5, 1.0], [49.5, 49.5, 1.0]]) @ warp.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    if (high - low)[0] >= 100:
        assert np.all(low <= -0.5 + 1e-6)
        assert np.all(high >= 99.5 - 1e-6)
    else:
        assert np.all(low >= -0.5 - 1e-6)
        assert np.all(high <= 99.5 + 1e-6)


def test_objects_that_a_view_cuts_off_are_ignored():
    # Only the left fifth of the first rectangle is left.
    shift = np.array([[1.0, 0.0, -35.0], [0.0, 1.0, 0.0]])
    view = warp_sample(coloured(), (60, 60), shift, np.random.default_rng(0))
    assert view.labels.tolist() == [1, 2]
    assert view.ignore.tolist() == [True, False]


def test_a_mosaic_holds_all_of_its_parts():
    sample = coloured((32, 32))
    whole = mosaic([((row, column), sample) for row in (0, 32) for column in (0, 32)], 64)
    assert whole.rgb.shape == (64, 64, 3)
    assert len(whole.masks) == 4 * len(sample.masks)
    np.testing.assert_array_equal(whole.rgb[32:, :32], sample.rgb)
    assert whole.masks.sum() == 4 * sample.masks.sum()
    assert whole.masks[-1, 32:, 32:].sum() == sample.masks[-1].sum()


def test_batches_are_functions_of_their_number(photographs):
    config = PretrainAugmentConfig()
    first = list(itertools.islice(stream(photographs, NAMES, config, 2, 7, 0, lambda step: 64), 3))
    later = next(stream(photographs, NAMES, config, 2, 7, 2, lambda step: 64))
    np.testing.assert_array_equal(first[2][0], later[0])
    assert first[2][0].shape == (2, 3, 64, 64)
    assert not np.array_equal(first[0][0], first[1][0])


def test_views_show_annotated_objects(photographs):
    labels = {
        int(label)
        for seed in range(20)
        for label in random_view(photographs, NAMES, PretrainAugmentConfig(), 96, np.random.default_rng(seed)).labels
    }
    assert labels == {1, 2}


def test_steps_or_time_end_training_whichever_is_first():
    config = PretrainConfig(minutes=10.0, iterations=100)
    assert share_of_training(Progress(50, 1.0), config) == pytest.approx(0.5)
    assert share_of_training(Progress(10, 9.0), config) == pytest.approx(0.9)


@pytest.mark.nightly
def test_a_killed_run_ends_like_one_that_was_not(photographs, tmp_path):
    config = PretrainConfig(
        minutes=1e6, iterations=4, batch_size=2, sides=((64,),), warmup=1, checkpoint_minutes=1e-6, settle=1.0
    )

    def network():
        import torch

        torch.manual_seed(0)
        return build_network(NetworkSpec("compact", NAMES))

    def silent(text: str) -> None:
        del text

    class KilledError(Exception):
        pass

    def dies(text: str) -> None:
        if text.startswith("step 2"):
            raise KilledError

    def pretrain(out, pictures, say):
        task = PretrainTask(network(), pictures, [], config, PretrainAugmentConfig())
        train(task, out, say)
        return task.candidate

    whole = pretrain(tmp_path / "whole", photographs, silent)
    with pytest.raises(KilledError):
        pretrain(tmp_path / "killed", photographs, dies)
    # What there is at that moment can be used.
    assert load_network(tmp_path / "killed" / "pretrained.safetensors").spec.categories == NAMES
    resumed = pretrain(tmp_path / "killed", photographs, silent)
    for name, value in whole.state_dict().items():
        np.testing.assert_allclose(resumed.state_dict()[name], value, atol=1e-6, err_msg=name)
    history = json.loads((tmp_path / "killed" / "history.json").read_text())
    assert [record["step"] for record in history] == [1, 2, 3, 4]
    with pytest.raises(UsageError, match="other data or settings"):
        pretrain(tmp_path / "killed", photographs[:3], silent)


@pytest.mark.parametrize("change", [{"minutes": 0.0}, {"iterations": 0}, {"batch_size": 0}, {"sides": ((32,),)}])
def test_settings_that_make_no_sense_are_refused(change):
    with pytest.raises(UsageError, match="--" + next(iter(change)).replace("_", "-")):
        PretrainConfig(**change).check()


@pytest.mark.parametrize("option", ["--minutes", "--steps", "--batch-size"])
def test_the_command_says_what_is_wrong_in_one_line(tmp_path, capsys, option):
    assert main(["--photographs", str(tmp_path / "p"), option, "-1"]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"error: {option}")
    assert captured.err.count("\n") == 1


def test_summary_counts_confident_detections():
    def item(image, category, columns, confidence=1.0, ignore=False):
        mask = np.zeros((8, 8), bool)
        mask[:, columns] = True
        return MaskInstance(image, category, encode_mask(mask), confidence, ignore)

    truths = [item(0, "chair", slice(0, 4)), item(1, "chair", slice(0, 4)), item(2, "table", slice(0, 8), ignore=True)]
    found = [
        item(0, "chair", slice(0, 4), 0.95),
        item(1, "table", slice(0, 4), 0.92),
        item(1, "chair", slice(0, 3), 0.4),
        item(2, "table", slice(0, 8), 0.99),
    ]
    row = summary(truths, found)
    # The detection of what is ignored does not count; the table that is a chair is wrong.
    assert row["confident_detections"] == 2
    assert row["confident_precision"] == 50.0
    assert row["confident_recall"] == 50.0
    assert row["objects"] == 2
    assert row["ap50_per_class"]["chair"] == 100.0
