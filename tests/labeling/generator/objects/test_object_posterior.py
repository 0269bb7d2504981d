import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.types import Detection
from labeling.generator.calibration.detector_calibration import FOLDER, calibration_of, file_name, is_calibrated
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.object_posterior import (
    FEATURES,
    ObjectModel,
    PlaceObservations,
    fit_object_model,
    observe_places,
)

SUPPORT, VIEWS = FEATURES.index("support"), FEATURES.index("views")


def looks(confidence: dict[str, list[float]], degrees: list[float], side: float = 0.2) -> PlaceObservations:
    """Views from 2 m away, at these azimuths."""
    angle = np.radians(degrees)
    eyes = 2 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return PlaceObservations({name: np.array(row) for name, row in confidence.items()}, np.full(len(angle), side), eyes)


def support(some: PlaceObservations) -> float:
    return float(some.features[0, SUPPORT])


def test_looks_from_one_place_share_one_voice() -> None:
    once = looks({"chair": [0.8, 0.0]}, [0, 180])
    often = looks({"chair": [0.8] * 9 + [0.0]}, [0.0] * 9 + [180])
    around = looks({"chair": [0.8] * 9 + [0.0]}, [36.0 * k for k in range(10)])
    assert support(once) == pytest.approx(0.4)
    assert support(often) == pytest.approx(0.4)
    assert support(around) > 0.7


def test_views_that_miss_it_count_unless_they_hardly_show_it() -> None:
    confidence = {"chair": [0.8, 0.0]}
    assert support(looks(confidence, [0, 180])) == pytest.approx(0.4)
    assert support(looks(confidence, [0, 180], side=0.01)) == pytest.approx(0.8)


def test_pixels_of_every_view_are_counted() -> None:
    """Oracle: the definition."""
    rng = np.random.default_rng(0)
    voxel_of_pixel = rng.integers(-1, 50, (3, 8, 9)).astype(np.int32)
    points = rng.normal(size=(50, 3)).astype(np.float32)
    cloud = Cloud(points, points, np.ones(50, np.int32), voxel_of_pixel, 0.1)
    eyes, voxels = rng.normal(size=(3, 3)), [np.array([3, 8, 20]), np.array([8, 9])]
    found = [Detection(1, "bed", 0.4, np.ones((8, 9), bool)), Detection(1, "bed", 0.3, np.ones((8, 9), bool))]
    for some, own in zip(observe_places(cloud, eyes, [(found, one) for one in voxels]), voxels, strict=True):
        assert np.allclose(some.side**2 * 72, np.isin(voxel_of_pixel, own).sum(axis=(1, 2)))
        assert np.allclose(some.from_object_m, eyes - points[own].mean(axis=0))
        assert {name: row.tolist() for name, row in some.confidence.items()} == {"bed": [0, 0.4, 0]}


def test_a_fit_tells_objects_from_background_and_from_each_other() -> None:
    rng = np.random.default_rng(1)
    samples = []
    for _ in range(400):
        truth = rng.choice(["bed", "couch", "nothing"])
        shown = {name: (rng.random(6) * (0.9 if name == truth else 0.4)).tolist() for name in ("bed", "couch")}
        samples.append((looks(shown, [60.0 * k for k in range(6)]), truth))
    model = fit_object_model(samples[:300])
    right = []
    for one, truth in samples[300:]:
        chances = model.posterior(one)
        chances["nothing"] = 1 - sum(chances.values())
        right.append(max(chances, key=chances.__getitem__) == truth)
    assert np.mean(right) > 0.9


@settings(max_examples=50)
@given(st.integers(0, 10_000))
def test_chances_sum_to_less_than_one_whatever_is_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 6))
    rows = {name: (rng.random(count) * (rng.random(count) < 0.7)).tolist() for name in "abc"[: rng.integers(1, 4)]}
    some = looks(rows, rng.uniform(0, 360, count).tolist(), float(rng.random()))
    model = ObjectModel(np.zeros(5), np.ones(5), rng.normal(size=5), float(rng.normal()), {"a": 1.0})
    found = model.posterior(some)
    assert all(0 < chance < 1 for chance in found.values())
    assert sum(found.values()) < 1


def test_more_views_that_find_it_make_it_likelier() -> None:
    model = calibration_of("compact").objects
    found = [
        model.posterior(looks({"chair": [0.7] * k + [0.0] * (8 - k)}, [45 * v for v in range(8)]))["chair"]
        for k in (1, 3, 6, 8)
    ]
    assert found == sorted(found)


DETECTORS = sorted(file.stem for file in FOLDER.glob("*.json"))


@pytest.mark.parametrize("detector", DETECTORS)
@settings(max_examples=50)
@given(st.data())
def test_a_look_that_grows_surer_of_a_name_never_favours_another(detector: str, data: st.DataObject) -> None:
    views = data.draw(st.integers(2, 8))
    row = st.lists(st.floats(0.01, 0.98), min_size=views, max_size=views)
    found = {name: data.draw(row) for name in "ab"}
    degrees = data.draw(st.lists(st.floats(0, 360), min_size=views, max_size=views))
    view = data.draw(st.integers(0, views - 1))
    surer = [max(one, data.draw(st.floats(0.01, 0.98))) if v == view else one for v, one in enumerate(found["a"])]
    model = calibration_of(detector).objects
    before = model.posterior(looks(found, degrees))
    after = model.posterior(looks({**found, "a": surer}, degrees))
    assert after["a"] / after["b"] >= before["a"] / before["b"] * (1 - 1e-6)


@pytest.mark.parametrize("detector", DETECTORS)
def test_a_dozen_half_sure_views_around_outvote_a_confident_one(detector: str) -> None:
    views = looks({"submarine": [0.95] + [0.0] * 12, "chair": [0.0] + [0.6] * 12}, [360 / 13 * v for v in range(13)])
    found = calibration_of(detector).objects.posterior(views)
    assert found["chair"] > 2 * found["submarine"]


def test_a_detector_that_is_not_calibrated_is_like_most_without_biases() -> None:
    assert is_calibrated("compact")
    assert not is_calibrated("somebody's")
    assert file_name("onnx:models/yolo.onnx") == "onnx_models_yolo.onnx.json"
    default, compact = calibration_of("somebody's").objects, calibration_of("compact").objects
    assert default.category_bias == {} != compact.category_bias
    assert np.array_equal(default.weight, compact.weight)
