"""Phantoms that stay where they are, and the settings fitted to real detectors that use them."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.views import Camera
from sbm_gym.detection.fitted_settings import FOLDER, as_json, fitted_detectors, fitted_settings, settings_file
from sbm_gym.detection.lasting_phantoms import LastingPhantoms, background_cells
from sbm_gym.detection.simulated import SimulatedDetector, SimulatedDetectorConfig, SimulatedView
from sbm_gym.env.view_detectors import is_simulated, make_detector
from sbm_gym.scenes.profiles import INDOOR

PHANTOMS = LastingPhantoms(3.0, 1.0, 1.5, 1.0, (("fridge", 0.75), ("tv", 0.25)))
ALONE = SimulatedDetectorConfig(phantoms_per_view=0.0, lasting_phantoms=PHANTOMS)


def view_of_a_wall(x_m=0.0, distance_m=3.0, index=0, scene="room") -> SimulatedView:
    """A wall across the world's +X axis at x = 4, 1.5 m up, seen straight on."""
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    pose[:3, 3] = 4.0 - distance_m, x_m, 1.5
    depth_m = np.full((48, 48), distance_m, np.float32)
    camera = Camera.from_fov(pose, (48, 48), 0.5 * np.pi)
    return SimulatedView(index, np.zeros((48, 48), np.int32), depth_m, (), 0.0, camera, scene)


def detect(view, seed=0):
    return SimulatedDetector(ALONE).detect(np.random.default_rng(seed), view)


@settings(max_examples=25)
@given(st.floats(-2, 2), st.floats(0.5, 3), st.sampled_from([0.5, 1.0, 2.0]), st.floats(0.0, 1.0), st.floats(1.2, 3.0))
def test_cells_divide_the_background_as_a_loop_over_pixels_does(x_m, distance_m, cell_m, low_m, high_m):
    view = view_of_a_wall(x_m, distance_m)
    instance_map = view.instance_map.copy()
    instance_map[10:20, 10:20] = 1
    depth_m = view.depth_m.copy()
    depth_m[:5] = 0.0
    assert view.camera is not None
    cells = dict(background_cells(depth_m, instance_map, view.camera, cell_m, (low_m, high_m), 0.0))
    covered = np.sum([np.zeros_like(instance_map), *cells.values()], axis=0)
    eye_m, k = view.camera.camera_to_world[:3, 3], view.camera.intrinsics
    for row, column in [(4, 8), (7, 30), (15, 15), (24, 24), (40, 3), (47, 47)]:
        ray = [(column - k[0, 2]) / k[0, 0], (row - k[1, 2]) / k[1, 1], 1.0]
        point_m = eye_m + view.camera.camera_to_world[:3, :3] @ np.array(ray) * depth_m[row, column]
        if min(abs(point_m[2] - low_m), abs(point_m[2] - high_m)) < 1e-5:
            continue
        counts = depth_m[row, column] > 0 and not instance_map[row, column] and low_m <= point_m[2] <= high_m
        assert covered[row, column] == int(counts)
        between = np.abs(point_m / cell_m - np.round(point_m / cell_m)).min() < 1e-5
        if counts and not between:
            assert cells[tuple(np.floor(point_m / cell_m).astype(int).tolist())][row, column]


def test_small_cells_are_left_out():
    view = view_of_a_wall()
    assert view.camera is not None
    every = dict(background_cells(view.depth_m, view.instance_map, view.camera, 1.0, (0.0, 3.0), 0.0))
    large = dict(background_cells(view.depth_m, view.instance_map, view.camera, 1.0, (0.0, 3.0), 0.03))
    assert set(large) == {name for name, mask in every.items() if mask.mean() >= 0.03}
    assert len(large) < len(every)


def test_a_phantom_stays_whoever_looks_again_and_keeps_its_name_from_elsewhere():
    found = detect(view_of_a_wall())
    assert found
    assert detect(view_of_a_wall(), seed=1) == found
    by_place = {}
    for x_m in np.linspace(-1.0, 1.0, 9):
        view = view_of_a_wall(x_m)
        assert view.camera is not None
        cells = dict(background_cells(view.depth_m, view.instance_map, view.camera, 1.0, PHANTOMS.heights_m, 1e-3))
        for detection in detect(view):
            name = next(name for name, mask in cells.items() if np.array_equal(mask, detection.mask))
            by_place.setdefault(name, set()).add(detection.category)
    assert len(by_place) > 3
    assert all(len(names) == 1 for names in by_place.values())
    assert set.union(*by_place.values()) == {"fridge", "tv"}


def test_phantoms_differ_between_scenes_and_need_a_name_of_one():
    assert detect(view_of_a_wall(scene="a")) != detect(view_of_a_wall(scene="b"))
    assert detect(view_of_a_wall(scene="")) == []
    assert detect(dataclasses.replace(view_of_a_wall(), camera=None)) == []


@given(st.floats(-3, 3), st.floats(1e-3, 0.5))
def test_large_cells_are_surer_phantoms(luck, area_share):
    assert PHANTOMS.logit(luck, 2.0 * area_share) > PHANTOMS.logit(luck, area_share)
    assert PHANTOMS.logit(luck + 0.1, area_share) > PHANTOMS.logit(luck, area_share)


def test_categories_are_taken_by_their_shares():
    names = [PHANTOMS.category(luck) for luck in np.linspace(0.0, 0.9999, 400)]
    assert names.count("fridge") == pytest.approx(300, abs=2)


def test_the_settings_that_come_with_the_project_can_be_read_and_written():
    profile = INDOOR
    assert "compact" in fitted_detectors(profile.kind)
    found = fitted_settings("compact", profile.kind, profile.detector)
    assert found.categories == profile.detector.categories
    assert found.lasting_phantoms is not None
    assert sum(share for _, share in found.lasting_phantoms.categories) == pytest.approx(1.0, abs=1e-2)
    again = as_json(found)
    assert again["lasting_phantoms"]["cell_m"] == found.lasting_phantoms.cell_m
    assert (FOLDER / f"compact_{profile.kind}.json").is_file()


def test_a_simulated_detector_fitted_to_a_real_one_bears_its_name():
    detector = make_detector("simulated:compact", INDOOR)
    assert detector.name == "compact"
    assert not detector.needs_detail
    assert is_simulated("simulated:compact")
    assert not is_simulated("compact")


def test_one_that_has_not_been_fitted_is_refused_with_what_to_do():
    with pytest.raises(
        ValueError, match=r"not been fitted to 'nonsense' in indoor .*it has to: compact.*fit_simulated"
    ):
        make_detector("simulated:nonsense", INDOOR)


def test_detectors_whose_names_are_paths_have_a_file_in_the_folder(tmp_path):
    assert settings_file(tmp_path, "out/run", "indoor").parent == tmp_path
    assert settings_file(tmp_path, "onnx:a.onnx", "indoor") != settings_file(tmp_path, "onnx:b.onnx", "indoor")
