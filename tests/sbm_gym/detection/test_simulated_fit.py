"""Fitting the simulated detector: what it has said itself is found again."""

import dataclasses

import numpy as np
import pytest

from sbm_gym.detection.detector_views import CellView, DetectorViews, ObjectView
from sbm_gym.detection.lasting_phantoms import LastingPhantoms
from sbm_gym.detection.simulated import CategoryTraits, SimulatedDetector, SimulatedDetectorConfig
from sbm_gym.detection.simulated_fit import fit_settings, predicted_shares
from sbm_gym.detection.visibility import ObservedObject

TRAITS = {
    "chair": CategoryTraits(0.8, 0.0, ("couch",)),
    "couch": CategoryTraits(-0.4, 3.0, ("bed",)),
    "tv": CategoryTraits(-0.4, 0.5, ("fridge",)),
}
TRUE = SimulatedDetectorConfig(
    base_logit=1.5,
    size_gain=1.2,
    good_size=0.2,
    hidden_penalty=5.0,
    truncated_penalty=3.0,
    model_sigma=0.5,
    object_sigma=0.6,
    viewpoint_sigma=0.8,
    frame_sigma=0.0,
    traits=TRAITS,
)
POSE_SIGMA = 1.0
PHANTOMS = LastingPhantoms(-1.0, 1.5, 1.2, 1.0, (("fridge", 0.6), ("tv", 0.4)))


def sigmoid(logit):
    return 1.0 / (1.0 + np.exp(-logit))


def made_up_views(count=9000, seed=0) -> DetectorViews:
    """Views of objects and cells at random, with confidences as a detector with the true settings has them."""
    rng = np.random.default_rng(seed)
    detector = SimulatedDetector(TRUE)
    objects = []
    for number in range(count):
        instance = int(rng.integers(150))
        category = tuple(TRAITS)[instance % 3]
        observed = ObservedObject(
            instance,
            category,
            f"{category}/{instance % 30}",
            f"scene/{instance}",
            float(rng.uniform(0.3, 1.0)),
            float(rng.choice([0.0, rng.uniform(0.0, 0.8)])),
            float(rng.uniform(-np.pi, np.pi)),
            float(rng.uniform(0.0, 0.6)),
            float(rng.uniform(0.8, 4.0)),
        )
        area_share = float(np.exp(rng.uniform(np.log(2e-3), np.log(0.2))))
        for _ in range(2):  # Two headings at one place.
            confidence = sigmoid(detector.logit(observed, area_share) + POSE_SIGMA * rng.normal())
            seen = float(confidence) if confidence >= 0.05 else 0.0
            objects.append(ObjectView(number, observed, area_share, seen, 0.0))
    cells = []
    luck = rng.normal(size=400)
    for _ in range(12000):
        cell, area_share = int(rng.integers(400)), float(np.exp(rng.uniform(np.log(2e-3), np.log(0.5))))
        confidence = sigmoid(PHANTOMS.logit(luck[cell], area_share) + PHANTOMS.pose_sigma * rng.normal())
        name = ("fridge", "tv")[cell % 5 >= 3]
        seen = confidence >= 0.05
        cells.append(CellView(f"scene/{cell}", area_share, float(confidence) * seen, name if seen else ""))
    return DetectorViews(tuple(objects), tuple(cells), count)


@pytest.fixture(scope="module")
def fitted():
    views = made_up_views()
    return views, fit_settings(views, SimulatedDetectorConfig(), LastingPhantoms(0.0, 0.0, 0.0, 0.0, ()))


@pytest.mark.slow
def test_penalties_biases_and_spreads_are_found_again(fitted):
    _, found = fitted
    assert found.size_gain == pytest.approx(TRUE.size_gain, rel=0.15)
    assert found.good_size == pytest.approx(TRUE.good_size, rel=0.2)
    assert found.hidden_penalty == pytest.approx(TRUE.hidden_penalty, rel=0.15)
    assert found.truncated_penalty == pytest.approx(TRUE.truncated_penalty, rel=0.15)
    assert found.above_penalty_per_rad == pytest.approx(TRUE.above_penalty_per_rad, rel=0.2)
    bias = {name: found.base_logit + one.bias for name, one in found.traits.items()}
    assert bias["chair"] - bias["tv"] == pytest.approx(1.2, abs=0.5)
    assert found.traits["couch"].behind == pytest.approx(3.0, abs=0.6)
    assert found.traits["chair"].behind < 0.4
    whole = np.sqrt(found.object_sigma**2 + found.viewpoint_sigma**2 + found.pose_sigma**2)
    assert whole == pytest.approx(np.sqrt(0.6**2 + 0.8**2 + POSE_SIGMA**2), rel=0.15)
    assert found.pose_sigma == pytest.approx(POSE_SIGMA, rel=0.25)


@pytest.mark.slow
def test_it_is_expected_to_be_as_often_sure(fitted):
    views, found = fitted
    shares = predicted_shares(found, views.objects, (0.05, 0.5, 0.9))
    real = [np.mean([one.right >= level for one in views.objects]) for level in (0.05, 0.5, 0.9)]
    assert shares == pytest.approx(real, abs=0.03)


@pytest.mark.slow
def test_phantoms_are_found_again(fitted):
    _, found = fitted
    phantoms = found.lasting_phantoms
    assert phantoms is not None
    assert phantoms.logit_when_full == pytest.approx(PHANTOMS.logit_when_full, abs=0.3)
    assert phantoms.size_gain == pytest.approx(PHANTOMS.size_gain, rel=0.15)
    assert phantoms.cell_sigma == pytest.approx(PHANTOMS.cell_sigma, rel=0.2)
    assert phantoms.pose_sigma == pytest.approx(PHANTOMS.pose_sigma, rel=0.15)
    assert dict(phantoms.categories) == pytest.approx({"fridge": 0.6, "tv": 0.4}, abs=0.08)


def test_a_detector_that_finds_nothing_cannot_be_fitted():
    views = made_up_views(200)
    blind = tuple(dataclasses.replace(one, right=0.0) for one in views.objects)
    with pytest.raises(ValueError, match="0 detections of objects in 400 views of objects: too few"):
        fit_settings(
            dataclasses.replace(views, objects=blind),
            SimulatedDetectorConfig(),
            LastingPhantoms(0.0, 0.0, 0.0, 0.0, ()),
        )


@pytest.mark.slow
def test_wrong_names_are_counted(fitted):
    views, right = fitted
    mixed = tuple(
        dataclasses.replace(one, right=0.0, wrong=one.right) if number % 4 == 0 else one
        for number, one in enumerate(views.objects[:4000])
    )
    found = fit_settings(
        dataclasses.replace(views, objects=mixed, cells=()),
        SimulatedDetectorConfig(),
        LastingPhantoms(0.0, 0.0, 0.0, 0.0, ()),
    )
    assert found.confusion > right.confusion + 0.2
    assert found.lasting_phantoms is None
