import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov, look_at, unproject_depth
from labeling.core.views import RgbdViews
from labeling.generator.cloud.ground import find_ground, ground_of_objects, height_coefficients, seeds_above_ground
from labeling.generator.cloud.voxel_cloud import Cloud, build_cloud

from ...synthetic_room import Part, render

RUG = Part((0.3, 0.2, 0.0075), (0.9, 0.7, 0.0075), (0.6, 0.1, 0.1))
FOOT = Part((-1.2, 0.4, 0.01), (0.18, 0.18, 0.01), (0.2, 0.2, 0.2))
OBJECT_M = 0.6


def views_of(parts, noise_m: float = 0.0, shift_m: float = 0.0) -> RgbdViews:
    """Four views from the corners of a room, with independent noise of depth, lifted as a whole."""
    rng, size = np.random.default_rng(0), (90, 120)
    intrinsics = intrinsics_from_fov(size[1], size[0], np.deg2rad(80))
    rgb, depth, poses = [], [], []
    for x, y in ((-2, -2), (2, -2), (2, 2), (-2, 2)):
        pose = look_at(np.array([x, y, 1.5]), np.zeros(3))
        colour, depth_m, _ = render(parts, pose, intrinsics, *size)
        rgb.append(colour)
        depth.append(depth_m + rng.normal(0, noise_m, size).astype(np.float32))
        pose[2, 3] += shift_m
        poses.append(pose)
    return RgbdViews(np.stack(rgb), np.stack(depth), np.repeat(intrinsics[None], 4, 0), np.stack(poses))


def cloud_of(views: RgbdViews) -> Cloud:
    return build_cloud(views, 0.04)


def all_free(cloud: Cloud):
    return np.ones(cloud.num_points, bool)


def test_heights_are_those_of_unprojected_pixels() -> None:
    views = views_of([RUG])
    y, x = np.mgrid[0 : views.size[0], 0 : views.size[1]]
    for view, (a, b, c, d) in enumerate(height_coefficients(views)):
        points, pixels = unproject_depth(
            views.depth_m[view].astype(float), views.intrinsics[view], views.camera_to_world[view]
        )
        heights = (a * x + b * y + c) * views.depth_m[view] + d
        np.testing.assert_allclose(heights.ravel()[pixels], points[:, 2], atol=1e-5)


@pytest.mark.parametrize("shift_m", [0.0, -1.37])
def test_floor_and_rug_are_ground_and_the_foot_of_a_lamp_is_not(shift_m: float) -> None:
    views = views_of([RUG, FOOT], shift_m=shift_m)
    cloud = cloud_of(views)
    ground = find_ground(cloud, views, all_free(cloud), OBJECT_M)
    apart = np.abs(cloud.points - [0, 0, shift_m] - np.array(RUG.centre))[:, :2]
    low = np.abs(cloud.points[:, 2] - shift_m) < 0.05
    on_rug = low & np.all(apart < np.array(RUG.half[:2]) - 0.05, axis=1)
    off_rug = low & np.any(apart > np.array(RUG.half[:2]) + 0.05, axis=1)
    assert np.allclose(ground.height_m[on_rug], 0.015 + shift_m, atol=0.003)
    assert np.mean(np.abs(ground.height_m[off_rug] - shift_m) < 0.003) > 0.99
    assert 0.005 < ground.rise_m < 0.01
    on_foot = low & np.all(np.abs(cloud.points - np.array(FOOT.centre))[:, :2] < 0.12, axis=1)
    assert np.all(ground.pixels_above[on_foot] > 0)
    assert np.all(ground.pixels_above[on_rug] == 0)
    assert np.mean(ground.pixels_above[off_rug & ~on_foot] > 0) < 0.05


def test_pixels_above_are_counted_as_one_by_one() -> None:
    views = views_of([RUG, FOOT, Part((0, -0.8, 0.3), (0.03, 0.03, 0.3), (0.5, 0.4, 0.3))], noise_m=0.004)
    cloud = cloud_of(views)
    ground = find_ground(cloud, views, all_free(cloud), OBJECT_M)
    expected = np.zeros(cloud.num_points, int)
    for view in range(views.num_views):
        points, pixels = unproject_depth(
            views.depth_m[view].astype(float), views.intrinsics[view], views.camera_to_world[view]
        )
        voxels = cloud.voxel_of_pixel[view].ravel()[pixels]
        np.add.at(expected, voxels, points[:, 2] > ground.top_m[voxels])
    low = cloud.points[:, 2] < 0.1
    assert np.mean(ground.pixels_above[low] == expected[low]) > 0.999
    above = cloud.points[:, 2] > 0.2
    np.testing.assert_array_equal(ground.pixels_above[above], cloud.counts[above])


def test_the_noisier_the_ground_the_higher_must_something_stand_out() -> None:
    rises = []
    for noise_m in (0.0, 0.01, 0.03):
        views = views_of([], noise_m)
        cloud = cloud_of(views)
        ground = find_ground(cloud, views, all_free(cloud), OBJECT_M)
        rises.append(ground.rise_m)
        floor = np.abs(cloud.points[:, 2]) < 0.02
        assert cloud.counts[floor].sum() * 0.08 > ground.pixels_above[floor].sum()
    assert rises == sorted(rises)
    assert rises[0] < 0.01 < rises[-1]


def test_a_cloud_without_a_level_surface_has_its_floor_for_ground() -> None:
    views = views_of([])
    cloud = cloud_of(views)
    ground = find_ground(cloud, views, np.zeros(cloud.num_points, bool), OBJECT_M)
    assert np.allclose(ground.height_m, ground.height_m[0])
    assert ground.height_m[0] == pytest.approx(0, abs=0.04)
    assert not np.any(ground.pixels_above[cloud.points[:, 2] < 0])


def test_objects_have_none_of_the_ground_unless_they_are_flat_on_it() -> None:
    """Oracle: the shapes. A block with the floor around it, a rug, and an object of no points."""
    block = Part((-1.1, -0.9, 0.3), (0.2, 0.2, 0.3), (0.3, 0.4, 0.2))
    views = views_of([RUG, block])
    cloud = cloud_of(views)
    free = find_ground(cloud, views, all_free(cloud), OBJECT_M)
    apart = np.abs(cloud.points - np.array(block.centre))[:, :2]
    around = np.all(apart < 0.5, axis=1) & (cloud.points[:, 2] < 0.65)
    on_rug = np.all(np.abs(cloud.points - np.array(RUG.centre))[:, :2] < np.array(RUG.half[:2]) - 0.05, axis=1)
    on_rug &= free.pixels_above == 0
    owner = np.where(around, 0, np.where(on_rug & (cloud.points[:, 2] < 0.05), 1, -1)).astype(np.int32)
    taken = ground_of_objects(cloud, owner, 3, find_ground(cloud, views, owner < 0, OBJECT_M))
    assert not np.any(taken & (owner == -1))
    assert np.any(owner == 1)
    assert not np.any(taken & (owner == 1))
    beside = around & np.any(apart > 0.24, axis=1) & (cloud.points[:, 2] < 0.02)
    assert np.count_nonzero(beside) > 100
    assert np.mean(taken[beside]) > 0.95
    assert not np.any(taken & (cloud.points[:, 2] > 0.03))
    nothing = ground_of_objects(cloud, np.full_like(owner, -1), 0, free)
    assert not nothing.any()


def test_what_shows_mostly_ground_has_its_seeds_above_it() -> None:
    """Oracle: the shapes. Bars with more of the floor between than of themselves; a block; a rug with floor around."""
    bars = [Part((-1.4 + 0.25 * k, -0.6, 0.3), (0.02, 0.02, 0.3), (0.1, 0.1, 0.1)) for k in range(5)]
    block = Part((0.9, -0.9, 0.3), (0.3, 0.3, 0.3), (0.3, 0.4, 0.2))
    views = views_of([RUG, block, *bars])
    cloud = cloud_of(views)
    ground = find_ground(cloud, views, all_free(cloud), OBJECT_M)

    def seeds_in(low, high) -> tuple[np.ndarray, np.ndarray]:
        inside = np.all((cloud.points > np.array(low)) & (cloud.points < np.array(high)), axis=1)
        voxels = np.flatnonzero(inside).astype(np.int32)
        return voxels, seeds_above_ground(cloud, voxels, ground)

    shown, above = seeds_in((-1.5, -0.9, -0.05), (-0.3, -0.3, 0.7))
    height_m = cloud.points[shown, 2]
    assert np.mean(height_m < 0.02) > 0.6
    assert np.all(np.isin(shown[height_m > 0.04], above))
    assert np.mean(cloud.points[above, 2] < 0.02) < 0.1
    for low, high in (((0.55, -1.25, -0.05), (1.25, -0.55, 0.7)), ((-0.5, -0.4, -0.05), (1.0, 0.8, 0.1))):
        shown, above = seeds_in(low, high)
        assert len(shown) > 100
        np.testing.assert_array_equal(shown, above)


def test_a_coarser_grid_of_a_wide_scene_finds_the_same_floor(monkeypatch) -> None:
    views = views_of([RUG, FOOT])
    cloud = cloud_of(views)
    fine = find_ground(cloud, views, all_free(cloud), OBJECT_M)
    monkeypatch.setattr("labeling.generator.cloud.ground.MAX_CELLS", 2000)
    coarse = find_ground(cloud, views, all_free(cloud), OBJECT_M)
    assert np.median(np.abs(coarse.height_m - fine.height_m)) < 0.005
    beside = np.abs(cloud.points[:, :2] - RUG.centre[:2]).max(axis=1) > 1.2
    np.testing.assert_allclose(coarse.height_m[beside], fine.height_m[beside], atol=0.01)
