"""Sizes of objects: how they are measured, and what they say of a category."""

import json
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from labeling.generator.calibration.detector_calibration import FOLDER, calibration_of
from labeling.generator.objects.object_sizes import (
    FEATURES,
    LEAST_POINTS,
    MOST_CHANGE,
    SizeModel,
    fit_size_model,
    measure_size,
    measure_sizes,
)

CHAIR, COUCH = np.array([0.6, 0.5, 0.9]), np.array([2.0, 0.9, 0.8])
"""Length, width and height, metres."""


def box(extent_m: np.ndarray, bottom_m: float = 0.0, turned: float = 0.0, count: int = 4000) -> np.ndarray:
    points = (np.random.default_rng(0).random((count, 3)) - [0.5, 0.5, 0.0]) * extent_m
    rotation = np.array([[np.cos(turned), -np.sin(turned), 0], [np.sin(turned), np.cos(turned), 0], [0, 0, 1]])
    return (points @ rotation.T + [3.0, -2.0, bottom_m]).astype(np.float32)


@cache
def samples(seed: int, count: int = 60):
    """Chairs, couches and walls, all of which the detector takes for chairs, or for couches, half and half."""
    rng, found = np.random.default_rng(seed), []
    for k in range(count):
        truth = ("chair", "couch", None)[k % 3]
        extent = {"chair": CHAIR, "couch": COUCH, None: np.array([1.2, 0.1, 2.3])}[truth]
        size = measure_size(box(extent * rng.uniform(0.8, 1.2, 3), count=300), 0.0)
        assert size is not None
        found.append(({"chair": 0.4, "couch": 0.4}, size, truth))
    return [found[k] for k in rng.permutation(count)]


@cache
def fitted(seed: int) -> SizeModel:
    return fit_size_model(samples(seed))


@settings(max_examples=30)
@given(st.floats(-3.1, 3.1), st.floats(-2, 30), st.floats(0, 1.5))
def test_turning_and_moving_an_object_leaves_its_size(turned: float, floor_m: float, above_m: float) -> None:
    size = measure_size(box(COUCH, floor_m + above_m, turned), floor_m)
    assert size is not None
    assert np.exp(size[:3]) == pytest.approx(0.96 * COUCH, rel=0.03)  # without the tails of both ends
    assert size[3:] == pytest.approx([above_m + 0.02 * COUCH[2], above_m + 0.98 * COUCH[2]], abs=0.03)


def test_too_few_points_have_no_size() -> None:
    points = np.concatenate([box(CHAIR), np.zeros((LEAST_POINTS - 1, 3), np.float32)])
    owner = np.repeat([4, 7], [4000, LEAST_POINTS - 1])
    known, unknown, absent = measure_sizes(points, owner, [4, 7, 9])
    assert known is not None
    assert (unknown, absent) == (None, None)
    assert measure_sizes(points[:0], owner[:0], [4]) == [None]


def test_a_flat_thing_has_a_finite_size() -> None:
    size = measure_size(box(np.array([1.0, 0.0, 0.6])), 0.0)
    assert size is not None
    assert np.all(np.isfinite(size))


def test_what_is_as_long_as_a_couch_is_called_one() -> None:
    model = fitted(0)
    assert model.weight > 0
    for truth, extent in (("chair", CHAIR), ("couch", COUCH)):
        size = measure_size(box(extent), 0.0)
        assert size is not None
        found = model.posterior({"chair": 0.4, "couch": 0.4}, size)
        assert max(found, key=lambda name: found[name]) == truth
        assert found[truth] > 0.7
    wall = measure_size(box(np.array([1.2, 0.1, 2.3])), 0.0)
    assert wall is not None
    assert sum(model.posterior({"chair": 0.4, "couch": 0.4}, wall).values()) < 0.7


def test_categories_of_unknown_size_keep_their_odds() -> None:
    model, size = fitted(1), measure_size(box(CHAIR), 0.0)
    assert size is not None
    assert model.posterior({"cup": 0.3, "vase": 0.2}, size) == pytest.approx({"cup": 0.3, "vase": 0.2})
    mixed = model.posterior({"cup": 0.3, "chair": 0.3}, size)
    assert mixed["chair"] == pytest.approx(mixed["cup"])  # cups are not known to be of another size


def test_a_trace_of_a_known_category_says_nothing_of_an_object_of_unknown_size() -> None:
    model, size = fitted(1), measure_size(box(CHAIR), 0.0)
    assert size is not None
    for trace in ("chair", "couch"):
        assert model.posterior({"cup": 0.6, trace: 1e-4}, size)["cup"] == pytest.approx(0.6, abs=1e-3)


@settings(max_examples=50)
@given(st.floats(0.01, 0.4), st.floats(0.01, 0.4), st.lists(st.floats(-5, 5), min_size=5, max_size=5))
def test_no_size_says_whether_an_object_is_of_a_category_without_one(
    bus: float, chair: float, size: list[float]
) -> None:
    model = fitted(0)
    found = model.posterior({"bus": bus, "chair": chair, "couch": 0.1}, np.array(size))
    assert found["bus"] / sum(found.values()) == pytest.approx(bus / (bus + chair + 0.1))


@settings(max_examples=50)
@given(st.floats(0.01, 0.99), st.lists(st.floats(-5, 5), min_size=5, max_size=5))
def test_no_size_makes_much_of_what_the_detector_says(chance: float, size: list[float]) -> None:
    """Of one name: the odds change by what is allowed, whatever the size."""
    found = fitted(1).posterior({"chair": chance}, np.array(size))["chair"]
    change = np.log(found / (1 - found)) - np.log(chance / (1 - chance))
    assert MOST_CHANGE[0] - 1e-6 <= change <= MOST_CHANGE[1] + 1e-6


@settings(max_examples=50)
@given(st.integers(0, 1000), st.lists(st.floats(0, 0.33), min_size=1, max_size=3))
@example(27, [5e-324])
def test_probabilities_stay_probabilities(seed: int, chances: list[float]) -> None:
    rng = np.random.default_rng(seed)
    names = ("chair", "couch", "cup")
    spread = np.eye(len(FEATURES)) * rng.uniform(0.01, 1)
    model = SizeModel(
        {name: rng.normal(0, 1, 5) for name in ("", "chair", "couch")},
        dict.fromkeys(("", "chair", "couch"), spread),
        float(rng.uniform(0, 1)),
        float(rng.normal()),
    )
    found = model.posterior(dict(zip(names, chances, strict=False)), rng.normal(0, 3, 5))
    assert all(0 <= value <= 1 for value in found.values())
    assert sum(found.values()) <= 1 + 1e-9


def test_nothing_to_learn_from_says_nothing() -> None:
    model, size = fit_size_model([]), measure_size(box(CHAIR), 0.0)
    assert size is not None
    assert model.posterior({"chair": 0.6}, size) == pytest.approx({"chair": 0.6})


@pytest.mark.parametrize("detector", ["compact", "simulated"])
def test_the_sizes_that_are_shipped_are_plausible(detector: str) -> None:
    model = calibration_of(detector).sizes
    assert model.weight > 0
    assert np.exp(model.mean["couch"][0]) > 1.3 * np.exp(model.mean["chair"][0])
    assert all(np.all(np.linalg.eigvalsh(one) > 0) for one in model.covariance.values())
    assert json.loads((FOLDER / f"{detector}.json").read_text())["fitted_to"]["sizes"] > 200
