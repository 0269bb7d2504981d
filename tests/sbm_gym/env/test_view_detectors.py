"""Real detectors in the environment: they see pictures and nothing else, and what they find is what the robot knows."""

import numpy as np
import pytest

from labeling.core.detector import stack_detections
from labeling.core.geometry import unproject_depth
from labeling.detectors import registry
from sbm_gym.env.fixation_env import FixationEnv

from ..box_rooms import BoxRooms

SIZE = (96, 96)


class Stripes:
    """Finds one sure "fridge": the middle of the picture. Keeps what it was shown."""

    name, categories, batch_size, digest = "stripes", ("fridge", "bed"), 1, ""

    def __init__(self):
        self.shown = []

    def detect(self, rgb, depth_m=None):
        assert depth_m is not None
        self.shown += list(zip(rgb, depth_m, strict=True))
        mask = np.zeros(rgb.shape[1:3], bool)
        mask[40:56, 40:56] = True
        return [stack_detections([("fridge", 0.95, mask), ("bed", 0.3, ~mask)], rgb.shape[1:3]) for _ in rgb]


@pytest.fixture
def stripes(monkeypatch):
    detector = Stripes()
    monkeypatch.setattr(registry, "detector_by_name", lambda name: detector)
    return detector


def test_real_detectors_look_at_smooth_pictures_of_their_own_size(stripes):
    env = FixationEnv(BoxRooms(), detector="compact", detector_size=SIZE)
    observation, _ = env.reset(seed=3)
    assert observation["rgb"].shape == (84, 84, 3)
    assert env.categories == stripes.categories
    for _ in range(2):
        env.step(np.array([0.0, 0.0, 0.7, 0.0]))
        capture = env.capture(*SIZE)
        rgb, depth_m = stripes.shown[-1]
        assert np.array_equal(rgb, capture.rgb)
        assert np.array_equal(depth_m, capture.depth_m)
    assert len(stripes.shown) == 3, "a capture of the size that the detector looked at has its detections already"
    env.capture(64, 64)
    assert stripes.shown[-1][0].shape == (64, 64, 3)


def test_what_a_real_detector_finds_is_confirmed_where_depth_says_it_is(stripes):
    env = FixationEnv(BoxRooms(), detector="compact", detector_size=SIZE)
    _, info = env.reset(seed=3)
    known = info["fixation_target"]
    assert known["category"] == "fridge"
    capture = env.capture(*SIZE)
    depth_m = np.zeros_like(capture.depth_m)
    depth_m[40:56, 40:56] = capture.depth_m[40:56, 40:56]
    points, _ = unproject_depth(depth_m, capture.intrinsics, capture.camera_to_world)
    assert np.linalg.norm(known["centroid_m"] - points.mean(axis=0)) < 0.1
    assert [(d.category, pytest.approx(d.confidence)) for d in capture.detections] == [("fridge", 0.95), ("bed", 0.3)]


def test_the_shipped_network_runs_in_the_loop_and_repeats_itself():
    def episode():
        env = FixationEnv(BoxRooms(), detector="compact", detector_size=SIZE)
        env.reset(seed=5)
        env.step(np.array([0.0, 0.0, 1.0, 0.0]))
        return env.categories, [(d.category, d.confidence, d.mask.sum()) for d in env.simulation.detections]

    first = episode()
    assert {"chair", "bed", "car"} <= set(first[0])
    assert first == episode()


def test_unknown_detectors_name_the_known_ones():
    with pytest.raises(ValueError, match=r"unknown detector 'yolo'.*compact.*simulated"):
        FixationEnv(BoxRooms(), detector="yolo")
