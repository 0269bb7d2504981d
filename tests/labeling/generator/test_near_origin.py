"""Recordings far from the origin of their world frame get the labels that they would get near it."""

from dataclasses import replace

import numpy as np
import pytest

from labeling import LabelConfig, propagate
from labeling.core.masks import mask_iou
from labeling.formats.ply import read_ply, write_ply
from labeling.generator.near_origin import moved_views, offset_of

from ..synthetic_room import make_episode

UTM_M = np.array([500123.0, 5412345.0, 217.0])


@pytest.fixture(scope="module")
def room():
    return make_episode(seed=3, num_views=8, size=(72, 96))


@pytest.fixture(scope="module")
def here(room):
    labels = propagate(room, room.detections)
    assert len(labels.objects) > 2
    return labels


def centres_m(labels):
    return np.array([one.box_3d.centre_m for one in labels.objects if one.box_3d is not None])


def test_labels_hundreds_of_kilometres_away_are_the_same_to_the_millimetre(room, here):
    by_m = np.array([500100.0, 5412300.0, -200.0])
    there = propagate(moved_views(room, by_m), room.detections)
    assert [one.category for one in there.objects] == [one.category for one in here.objects]
    np.testing.assert_allclose(centres_m(there) - by_m, centres_m(here), atol=1e-3)
    np.testing.assert_allclose(there.cloud.points - by_m, here.cloud.points, atol=1e-3)
    assert len(here.labels) == len(there.labels)
    pairs = [(a.modal, b.modal) for a, b in zip(here.labels, there.labels, strict=True)]
    assert min(mask_iou(a, b) for a, b in pairs if a is not None and b is not None) > 0.98


@pytest.mark.parametrize("by_m", [np.array([40.0, -30.0, 10.0]), UTM_M], ids=["40 m", "UTM"])
def test_labels_are_alike_where_the_voxels_of_the_world_divide_the_room_otherwise(room, here, by_m):
    there = propagate(moved_views(room, by_m), room.detections)
    assert [one.category for one in there.objects] == [one.category for one in here.objects]
    np.testing.assert_allclose(centres_m(there) - by_m, centres_m(here), atol=0.1)
    masks = {(one.view_index, one.instance_id): one.modal for one in there.labels}
    ious = []
    for one in here.labels:
        other = masks.get((one.view_index, one.instance_id))
        ious.append(0.0 if one.modal is None or other is None else mask_iou(one.modal, other))
    assert np.median(ious) > 0.85


def test_recordings_near_the_origin_stay_where_they_are(room):
    assert not offset_of(room).any()
    assert not offset_of(moved_views(room, np.array([40.0, -40.0, 0.0]))).any()
    offset_m = offset_of(moved_views(room, UTM_M))
    assert np.abs(offset_m - UTM_M).max() <= 60.0


def test_refined_poses_are_moved_back(room):
    rng = np.random.default_rng(0)
    poses = np.array(room.camera_to_world, float)
    poses[:, :3, 3] += rng.normal(0.0, 0.03, (len(poses), 3))
    shaken = replace(room, camera_to_world=poses)
    config = LabelConfig(refine_poses="on")
    here = propagate(shaken, room.detections, config).poses
    there = propagate(moved_views(shaken, UTM_M), room.detections, config).poses
    assert here is not None
    assert there is not None
    assert here.camera_to_world is not None
    assert there.camera_to_world is not None
    near, far = np.array(here.camera_to_world), np.array(there.camera_to_world)
    far[:, :3, 3] -= UTM_M
    np.testing.assert_allclose(far, near, atol=2e-3)


def test_clouds_far_away_keep_millimetres_on_disk(tmp_path):
    points = UTM_M + np.array([[0.001, 0.0, 0.0], [0.0, 0.002, 0.0]])
    write_ply(tmp_path / "far.ply", points, np.zeros((2, 3)), np.array([0, 1]), np.ones(2))
    vertices = read_ply(tmp_path / "far.ply")
    np.testing.assert_allclose(np.stack([vertices[axis] for axis in "xyz"], axis=1), points, atol=1e-9)
