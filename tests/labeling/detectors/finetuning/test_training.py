"""Training: it learns, it goes on after a kill as if nothing had been, and it refuses what makes no sense."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from labeling.core.errors import SbmError, UsageError
from labeling.core.rle import encode_mask
from labeling.detectors.data.annotated_pictures import read_pictures, with_annotations
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.detectors.finetuning.presets import PRESETS
from labeling.detectors.finetuning.training import FinetuneTask
from labeling.detectors.networks.calibration import calibrated, fit_calibration, outcomes
from labeling.detectors.networks.mask_rcnn import build_from_imagenet, build_network
from labeling.detectors.networks.network_detector import NetworkDetector
from labeling.detectors.networks.spec import Calibration, NetworkSpec
from labeling.detectors.networks.weights import load_network
from labeling.detectors.scoring import KINDS, evaluate
from labeling.metrics.matching import MaskInstance
from labeling.metrics.resampled_ap import RESAMPLES
from labeling.training.config import CHECKPOINT_FILE, HISTORY_FILE, WEIGHTS_FILE
from labeling.training.loop import train

from ..toy_pictures import CATEGORIES, NO_AUGMENTATION, write_coco_folder

SPEC = NetworkSpec("compact", CATEGORIES, short_side_px=(64, 320))
PLAIN = replace(NO_AUGMENTATION, short_side_px=(64, 320))
SHORT = replace(
    PRESETS["paper"], iterations=4, batch_size=1, learning_rate=1e-4, warmup=0, validate_every=2, optimizer="adamw"
)


@pytest.fixture
def pictures(tmp_path):
    return read_pictures(write_coco_folder(tmp_path / "photos", 4))


def network():
    torch.manual_seed(0)
    return build_from_imagenet(SPEC)


def quietly(start, out, *arguments):
    return train(FinetuneTask(start, *arguments), out, say=lambda text: None)


@pytest.mark.slow
def test_the_loss_falls(pictures, tmp_path):
    config = replace(SHORT, iterations=24, learning_rate=1e-3, validate_every=8)
    state = quietly(network(), tmp_path / "run", pictures, [], config, PLAIN)
    first, _, last = (record["loss"] for record in state.history)
    assert last < 0.8 * first


@pytest.mark.nightly
def test_a_tiny_set_is_learnt_by_heart(tmp_path):
    pictures = read_pictures(write_coco_folder(tmp_path / "photos", 6, side=96))
    config = replace(SHORT, iterations=100, batch_size=4, learning_rate=1e-3, warmup=10, validate_every=50)
    quietly(network(), tmp_path / "run", pictures, pictures, config, AugmentConfig(crop=0.0, short_side_px=(96, 96)))
    best = load_network(tmp_path / "run" / WEIGHTS_FILE)
    scores = evaluate(NetworkDetector(best, "toy"), pictures)
    assert scores.mask_ap50 is not None
    assert scores.mask_ap50 > 0.95


@pytest.mark.slow
def test_a_killed_run_goes_on_as_if_it_had_never_stopped(pictures, tmp_path):
    config = replace(SHORT, average=0.9, replay_share=0.25)
    source = read_pictures(write_coco_folder(tmp_path / "source", 2, first_seed=50))

    def run(name, iterations):
        return quietly(network(), tmp_path / name, pictures, [], replace(config, iterations=iterations), PLAIN, source)

    run("whole", 4)
    run("broken", 2)
    leftover = tmp_path / "broken" / f".{CHECKPOINT_FILE}.1.tmp"
    leftover.write_bytes(b"half a checkpoint")
    state = run("broken", 4)
    assert state.iteration == 4
    whole, broken = (tmp_path / name / WEIGHTS_FILE for name in ("whole", "broken"))
    assert whole.read_bytes() == broken.read_bytes()
    history = [json.loads((tmp_path / name / HISTORY_FILE).read_text()) for name in ("whole", "broken")]
    assert history[0] == history[1]


@pytest.mark.slow
def test_a_folder_with_another_run_is_left_alone(pictures, tmp_path):
    one_step = replace(SHORT, iterations=1)
    quietly(network(), tmp_path / "run", pictures, [], one_step, PLAIN)
    with pytest.raises(UsageError, match="another --out"):
        quietly(network(), tmp_path / "run", pictures, [], replace(one_step, learning_rate=1e-2), PLAIN)
    other = {"started_from_digest": "another network's"}
    with pytest.raises(UsageError, match="another --out"):
        quietly(network(), tmp_path / "run", pictures, [], one_step, PLAIN, (), "cpu", other)
    (tmp_path / "run" / CHECKPOINT_FILE).write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(SbmError, match="is damaged"):
        quietly(network(), tmp_path / "run", pictures, [], one_step, PLAIN)


def test_checkpoints_that_would_run_code_are_not_opened(pictures, tmp_path):
    class Trap:
        def __reduce__(self):
            return (shutil.rmtree, (str(tmp_path / "precious"),))

    (tmp_path / "precious").mkdir()
    (tmp_path / "run").mkdir()
    torch.save({"identity": Trap()}, tmp_path / "run" / CHECKPOINT_FILE)
    with pytest.raises(SbmError, match="is damaged"):
        quietly(network(), tmp_path / "run", pictures, [], replace(SHORT, iterations=1), PLAIN)
    assert (tmp_path / "precious").is_dir()


@pytest.mark.slow
def test_training_stops_early_and_keeps_the_best(pictures, tmp_path):
    # So small a rate changes nothing: no validation is better than the first.
    config = replace(SHORT, iterations=40, learning_rate=1e-12, validate_every=1, patience=2)
    state = quietly(network(), tmp_path / "run", pictures, pictures[:1], config, PLAIN)
    assert state.best_iteration == 1
    assert state.iteration == 3
    assert load_network(tmp_path / "run" / WEIGHTS_FILE).spec.about["trained"]["iteration"] == 1


@pytest.mark.slow
@pytest.mark.parametrize(("new_categories", "share"), [((), 0.25), (CATEGORIES[-1:], 1.0)])
def test_what_is_kept_lies_between_start_and_what_was_learnt(pictures, tmp_path, new_categories, share):
    # Outputs of new categories knew nothing at the start: there, what was learnt is kept.
    config = replace(SHORT, iterations=2, learning_rate=1e-2, interpolate=0.25)
    task = FinetuneTask(network(), pictures, [], config, PLAIN, new_categories=new_categories)
    train(task, tmp_path / "run", say=lambda text: None)
    start, learnt = network().state_dict(), task.network.state_dict()
    kept = load_network(tmp_path / "run" / WEIGHTS_FILE).state_dict()
    moved = 0
    for name, value in task.candidate.state_dict().items():
        expected = start[name] + share * (learnt[name] - start[name]) if value.is_floating_point() else learnt[name]
        assert torch.allclose(value, expected, atol=1e-6), name
        assert torch.allclose(kept[name], value, rtol=1e-3, atol=1e-4), name  # half precision on disk
        moved += not torch.allclose(learnt[name], start[name], atol=1e-3)
    assert moved > 20


@pytest.mark.slow
def test_pictures_without_labels_teach_background(pictures, tmp_path):
    empty = with_annotations(pictures, lambda one: None)
    state = quietly(network(), tmp_path / "run", empty, [], replace(SHORT, iterations=2), PLAIN)
    assert state.history[0]["loss_box_reg"] == state.history[0]["loss_mask"] == 0.0
    assert state.history[0]["loss_objectness"] > 0


def test_a_loss_that_is_no_number_ends_training(pictures, tmp_path):
    broken = network()
    with torch.no_grad():
        broken.roi_heads.box_predictor.cls_score.bias.fill_(float("nan"))
    with pytest.raises(SbmError, match="training broke down in step 0"):
        quietly(broken, tmp_path / "run", pictures, [], SHORT, PLAIN)


@pytest.mark.parametrize("change", [{"iterations": 0}, {"learning_rate": -1.0}, {"replay_share": 1.0}, {"seed": -1}])
def test_settings_of_training_that_make_no_sense_are_refused(change):
    with pytest.raises(UsageError, match=f"--{next(iter(change)).replace('_', '-')} must "):
        replace(FinetuneConfig(), **change).check()


# Scores --------------------------------------------------------------------------------------------------------------


class Oracle:
    """Finds what is annotated, half as sure of balls, and a category that nobody annotated."""

    name, batch_size, digest = "oracle", 2, ""
    categories = (*CATEGORIES, "vase")

    def __init__(self, pictures):
        self.of_picture = {picture.rgb().tobytes(): picture for picture in pictures}

    def detect(self, rgb, depth_m=None):
        from labeling.core.detector import stack_detections
        from labeling.core.rle import decode_mask

        found = []
        for picture in rgb:
            known = self.of_picture[picture.tobytes()].annotations
            every = [(one.category, 0.5 if one.category == "ball" else 1.0, decode_mask(one.rle)) for one in known]
            found.append(stack_detections([*every, ("vase", 0.9, np.ones(picture.shape[:2], bool))], picture.shape[:2]))
        return found


def test_a_perfect_detector_scores_one_and_a_random_one_does_not(pictures):
    scores = evaluate(Oracle(pictures), pictures, resample=True)
    assert scores.resampled is None  # nobody knows of which scenes they are
    in_scenes = [replace(picture, scene=f"home {number % 4}") for number, picture in enumerate(pictures)]
    resampled = evaluate(Oracle(in_scenes), in_scenes, resample=True).resampled
    assert resampled is not None
    assert set(resampled) == {f"{kind}_{figure}" for kind in KINDS for figure in ("ap", "ap30", "ap50")}
    assert all(len(draws) == RESAMPLES and min(draws) == 1.0 for draws in resampled.values())
    assert (scores.mask_ap50, scores.mask_ap30, scores.box_ap50, scores.box_ap30) == pytest.approx((1.0,) * 4)
    assert set(scores.per_class_ap50) == set(scores.per_class_ap30) == set(CATEGORIES)
    assert scores.per_class_box_ap50 == scores.per_class_box_ap30 == dict.fromkeys(CATEGORIES, pytest.approx(1.0))
    assert (scores.own_box_ap50, scores.own_box_ap) == pytest.approx((1.0,) * 2)
    assert (scores.pictures, scores.objects) == (4, 8)
    torch.manual_seed(0)
    guess = evaluate(NetworkDetector(build_network(SPEC), "guess"), pictures)
    assert guess.mask_ap50 is not None
    assert guess.mask_ap50 < 0.3


def test_a_category_scores_the_same_where_others_are_not_annotated(pictures):
    class Forgetful(Oracle):
        """Takes all things for balls in every second picture."""

        def detect(self, rgb, depth_m=None):
            found = super().detect(rgb)
            return [
                replace(one, categories=("ball",) * len(one.scores)) if i % 2 == 0 else one
                for i, one in enumerate(found)
            ]

    in_scenes = [replace(picture, scene=f"home {number % 4}") for number, picture in enumerate(pictures)]
    balls = with_annotations(in_scenes, lambda one: one if one.category == "ball" else None)
    every, alone = (evaluate(Forgetful(in_scenes), some, resample=True) for some in (in_scenes, balls))
    assert set(alone.per_class_ap50) == {"ball"}
    assert 0.0 < (alone.mask_ap50 or 0.0) < 1.0
    for figure in ("per_class_ap50", "per_class_ap30", "per_class_box_ap50", "per_class_own_box_ap50"):
        assert getattr(alone, figure)["ball"] == pytest.approx(getattr(every, figure)["ball"])
    assert alone.mask_ap50 == pytest.approx(alone.per_class_ap50["ball"])
    assert alone.resampled is not None


def test_boxes_of_a_detector_are_scored_as_it_gives_them_and_as_its_masks_have_them(pictures):
    class WideBoxes(Oracle):
        def detect(self, rgb, depth_m=None):
            found = super().detect(rgb)
            return [replace(one, boxes_xyxy=one.boxes_xyxy + np.array([-60, -60, 60, 60], np.float32)) for one in found]

    scores = evaluate(WideBoxes(pictures), pictures)
    assert scores.box_ap50 == scores.mask_ap50 == pytest.approx(1.0)
    assert scores.own_box_ap50 == scores.own_box_ap30 == 0.0
    assert set(scores.per_class_own_box_ap50.values()) == {0.0}


def test_calibration_recovers_the_temperature_that_outcomes_were_drawn_with():
    rng = np.random.default_rng(0)
    z = rng.normal(0, 2, 20_000)
    right = rng.random(len(z)) < 1 / (1 + np.exp(-(z / 2.5 - 0.7)))
    scores = 1 / (1 + np.exp(-z))
    fitted = fit_calibration(scores.tolist(), right.tolist())
    assert fitted.temperature == pytest.approx(2.5, rel=0.1)
    assert fitted.bias == pytest.approx(-0.7, abs=0.1)
    confident = calibrated(scores.astype(np.float32), fitted)
    assert np.all(np.diff(confident[np.argsort(scores)]) >= 0)
    assert right[confident > 0.6].mean() == pytest.approx(confident[confident > 0.6].mean(), abs=0.02)


@pytest.mark.parametrize("right", [[True] * 50, [False] * 50, [True, False]])
def test_too_little_to_calibrate_on_changes_nothing(right):
    assert fit_calibration([0.5] * len(right), right) == Calibration()


def test_outcomes_follow_cocos_rule():
    def one(category, left, confidence=1.0, ignore=False):
        mask = np.zeros((10, 40), bool)
        mask[:, left : left + 10] = True
        return MaskInstance("a", category, encode_mask(mask), confidence, ignore)

    truths = [one("box", 0), one("ball", 20), one("box", 30, ignore=True)]
    found = [one("box", 1, 0.6), one("box", 0, 0.8), one("box", 20, 0.7), one("ball", 25, 0.4), one("box", 30, 0.9)]
    scores, right = outcomes(found, truths)
    assert sorted(zip(scores, right, strict=True)) == [(0.4, False), (0.6, False), (0.7, False), (0.8, True)]


def test_pictures_are_as_large_in_training_as_when_the_network_looks(pictures):
    spec = replace(network().spec, short_side_px=(48, 64))
    task = FinetuneTask(build_network(spec), pictures, [], FinetuneConfig(), AugmentConfig(crop=0.0))
    sides = [min(task.dataset[number].rgb.shape[:2]) for number in range(12)]
    assert 48 <= min(sides) <= max(sides) <= 64
    assert task.identity["augment"]["short_side_px"] == (48, 64)
    told = FinetuneTask(build_network(spec), pictures, [], FinetuneConfig(), AugmentConfig(short_side_px=(96, 96)))
    assert min(told.dataset[0].rgb.shape[:2]) == 96
