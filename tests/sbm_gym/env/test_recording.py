"""What captures hold is consistent: camera, depth, masks and boxes speak of the same things."""

import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov, unproject
from labeling.io.coco import SLIVER_AREA_SHARE
from sbm_gym.env.fixation_env import FixationEnv
from sbm_gym.env.recording import SLIVER_VISIBLE_SHARE, episode_of_captures

from ..box_rooms import BoxRooms


@pytest.fixture(scope="module")
def captures():
    env = FixationEnv(BoxRooms())
    found = []
    for seed in range(4):
        env.reset(seed=seed)
        for _ in range(6):
            found.append(env.capture(96, 128))
            env.step(np.array([0.4, 0.2, 1, 0]))
    return found


def test_masks_unproject_into_their_boxes(captures):
    checked = 0
    for capture in captures:
        for label in capture.ground_truth:
            y, x = np.nonzero(label.modal)
            pixels, depth = np.stack([x, y], axis=1).astype(float), capture.depth_m[y, x].astype(float)
            points = unproject(pixels, depth, capture.intrinsics, capture.camera_to_world)
            local = np.abs((points - label.box_3d.centre_m) @ label.box_3d.rotation)
            assert np.all(local <= label.box_3d.extent_m / 2 + 0.05)
            checked += 1
    assert checked > 15


def test_modal_masks_are_disjoint_parts_of_amodal_ones(captures):
    for capture in captures:
        labels = capture.ground_truth
        assert all(np.all(label.amodal[label.modal]) and label.modal.any() for label in labels)
        if labels:
            assert np.max(np.sum([label.modal for label in labels], axis=0)) == 1


def test_slivers_and_nothing_else_are_ignored(captures):
    for capture in captures:
        for label in capture.ground_truth:
            area, whole = np.count_nonzero(label.modal), np.count_nonzero(label.amodal)
            assert label.ignore == (area < SLIVER_AREA_SHARE * label.modal.size or area < SLIVER_VISIBLE_SHARE * whole)


def test_wide_captures_keep_square_pixels_and_the_field_of_view(captures):
    for capture in captures:
        assert capture.rgb.shape == (96, 128, 3)
        assert np.array_equal(capture.intrinsics, intrinsics_from_fov(128, 96, np.pi / 2))
        assert all(detection.mask.shape == (96, 128) for detection in capture.detections)


def test_episodes_number_views_in_order(captures):
    episode = episode_of_captures(captures[:5], ("chair",), {"seed": 0}, name="0000")
    assert episode.num_views == 5
    labels = [(d.view_index, d.category) for d in episode.detections or ()]
    assert labels == [(view, d.category) for view in range(5) for d in captures[view].detections]
    with pytest.raises(ValueError, match="at least one"):
        episode_of_captures([], (), {})
