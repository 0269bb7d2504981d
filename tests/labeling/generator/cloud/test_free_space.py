from dataclasses import replace

import numba
import numpy as np
import pytest

from labeling.core.types import Detection
from labeling.core.views import RgbdViews
from labeling.generator.cloud.free_space import MIN_MISSES, clear_free_space, free_space_points
from labeling.generator.cloud.voxel_cloud import Cloud, build_cloud
from labeling.generator.propagate import propagate
from labeling.generator.settings.label_config import LabelConfig

from ...synthetic_room import make_episode

VOXEL_M = 0.05


@pytest.fixture(scope="module")
def room():
    return make_episode(3, num_views=8, size=(90, 120), num_objects=4, confident_share=0.5)


def cloud_of(room, depth_m) -> tuple[Cloud, RgbdViews]:
    views = RgbdViews(room.rgb, depth_m, room.intrinsics, room.camera_to_world)
    return build_cloud(views, VOXEL_M), views


def spoilt(room, share: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Depth in which single pixels of every view report something half as far away."""
    bad = np.random.default_rng(0).random(room.depth_m.shape) < share
    bad &= room.depth_m > 0
    return np.where(bad, 0.5 * room.depth_m, room.depth_m).astype(np.float32), bad


def test_exact_depth_has_no_points_in_free_space(room) -> None:
    cloud, views = cloud_of(room, room.depth_m)
    assert free_space_points(cloud, views).mean() < 1e-3
    assert clear_free_space(cloud, views) is views


def test_points_in_front_of_what_others_see_are_found(room) -> None:
    depth_m, bad = spoilt(room)
    cloud, views = cloud_of(room, depth_m)
    cleared = clear_free_space(cloud, views).depth_m == 0
    assert np.mean(cleared[bad]) > 0.6
    assert np.mean(cleared[~bad & (room.depth_m > 0)]) < 0.003


def test_too_few_misses_prove_nothing(room) -> None:
    depth_m, _ = spoilt(room)
    few = slice(0, MIN_MISSES)
    views = RgbdViews(room.rgb[few], depth_m[few], room.intrinsics[few], room.camera_to_world[few])
    assert not free_space_points(build_cloud(views, VOXEL_M), views).any()


def test_the_number_of_threads_does_not_matter(room) -> None:
    cloud, views = cloud_of(room, spoilt(room)[0])
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = free_space_points(cloud, views)
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(alone, free_space_points(cloud, views))


def test_something_that_was_there_once_is_not_labelled_where_it_no_longer_is(room) -> None:
    """A person walks through one view: the room behind is known from the others, so, if everything is held to stand
    still, the person is no object."""
    depth_m = room.depth_m.copy()
    mask = np.zeros(room.size, bool)
    mask[20:75, 45:75] = True
    depth_m[0][mask] = 0.45 * depth_m[0][mask]
    person = Detection(0, "person", 0.97, mask)

    def objects(free_space: bool):
        config = LabelConfig(free_space=free_space, moving=False, calibrate=False, weak_evidence=False, min_posterior=1)
        return propagate(replace(room, depth_m=depth_m), (person,), config).labels

    without = {one.view_index for one in objects(False) if one.modal.any()}
    held = [one for one in objects(True) if one.view_index == 0]
    assert 0 in without
    assert sum(np.count_nonzero(one.modal) for one in held) < 0.3 * np.count_nonzero(mask)
