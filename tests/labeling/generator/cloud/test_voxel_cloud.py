import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov, look_at, unproject_depth
from labeling.core.views import RgbdViews
from labeling.generator.cloud.voxel_cloud import build_cloud


def views(seed: int = 0, holes: float = 0.3):
    rng = np.random.default_rng(seed)
    poses = np.stack([look_at(np.array([1.0, 2.0 * v, 1.5]), np.array([3.0, 0.5, 0.2])) for v in range(3)])
    intrinsics = np.stack([intrinsics_from_fov(24, 18, 1.0)] * 3)
    depth = rng.uniform(0.5, 4.0, (3, 18, 24)).astype(np.float32) * (rng.random((3, 18, 24)) > holes)
    return rng.integers(0, 256, (3, 18, 24, 3), dtype=np.uint8), depth.astype(np.float32), intrinsics, poses


@pytest.mark.parametrize("voxel_m", [0.05, 0.3])
def test_voxels_hold_the_mean_of_their_pixels(voxel_m: float) -> None:
    rgb, depth, intrinsics, poses = views()
    cloud = build_cloud(RgbdViews(rgb, depth, intrinsics, poses), voxel_m)
    points = np.concatenate([unproject_depth(depth[v], intrinsics[v], poses[v])[0] for v in range(3)])
    colours = rgb[depth > 0] / 255
    voxel = cloud.voxel_of_pixel[depth > 0]
    assert np.all(cloud.voxel_of_pixel[depth == 0] == -1)
    assert set(voxel) == set(range(cloud.num_points))
    for number in range(cloud.num_points):
        inside = voxel == number
        assert cloud.counts[number] == inside.sum()
        np.testing.assert_allclose(cloud.points[number], points[inside].mean(axis=0), atol=1e-5)
        np.testing.assert_allclose(cloud.colours[number], colours[inside].mean(axis=0), atol=1e-6)


def test_pixels_share_a_voxel_exactly_if_they_share_a_cell() -> None:
    rgb, depth, intrinsics, poses = views(1)
    cloud = build_cloud(RgbdViews(rgb, depth, intrinsics, poses), 0.25)
    points = np.concatenate([unproject_depth(depth[v], intrinsics[v], poses[v])[0] for v in range(3)])
    origin = np.floor(poses[:, :3, 3].mean(axis=0) / 0.25) * 0.25
    cells = np.unique(np.floor((points - origin) / 0.25).astype(int), axis=0, return_inverse=True)[1]
    pairs = np.unique(np.stack([cells, cloud.voxel_of_pixel[depth > 0]]), axis=1)
    assert pairs.shape[1] == cells.max() + 1 == cloud.num_points


def test_returns_beyond_range_are_not_used() -> None:
    rgb, depth, intrinsics, poses = views(2)
    cloud = build_cloud(RgbdViews(rgb, depth, intrinsics, poses), 0.1, max_range_m=2.0)
    np.testing.assert_array_equal(cloud.voxel_of_pixel >= 0, (depth > 0) & (depth <= 2.0))


def test_voxels_grow_until_the_cloud_is_small_enough() -> None:
    rgb, depth, intrinsics, poses = views(3)
    cloud = build_cloud(RgbdViews(rgb, depth, intrinsics, poses), 0.01, max_voxels=100)
    assert cloud.num_points <= 100
    assert cloud.voxel_m > 0.01
    np.testing.assert_array_equal(cloud.voxel_of_pixel >= 0, depth > 0)


def test_no_depth_at_all_gives_an_empty_cloud() -> None:
    rgb, depth, intrinsics, poses = views(4)
    assert build_cloud(RgbdViews(rgb, np.zeros_like(depth), intrinsics, poses), 0.1).num_points == 0


def test_a_voxel_needs_a_size() -> None:
    with pytest.raises(ValueError, match="positive"):
        build_cloud(RgbdViews(*views()), voxel_m=0.0)


def test_many_voxels_are_numbered_in_order_of_appearance() -> None:
    """More than the first table holds."""
    rng = np.random.default_rng(5)
    poses = np.stack([look_at(np.array([0.0, 0.0, 1.5]), np.array([3.0, 0.5, 0.2]))] * 2)
    intrinsics = np.stack([intrinsics_from_fov(320, 240, 1.0)] * 2)
    depth = rng.uniform(0.5, 40.0, (2, 240, 320)).astype(np.float32)
    cloud = build_cloud(RgbdViews(np.zeros((2, 240, 320, 3), np.uint8), depth, intrinsics, poses), 0.1)
    assert cloud.num_points > 100_000
    first = np.unique(cloud.voxel_of_pixel, return_index=True)[1]
    assert np.all(np.diff(first) > 0)
    assert cloud.counts.sum() == depth.size


def test_a_view_sees_the_voxels_of_its_pixels() -> None:
    rgb, depth, intrinsics, poses = views(6)
    cloud = build_cloud(RgbdViews(rgb, depth, intrinsics, poses), 0.2)
    for view in range(3):
        seen, ranks, pixels = cloud.voxels_of_view(view)
        shown = cloud.voxel_of_pixel[view]
        np.testing.assert_array_equal([seen, pixels], np.unique(shown[shown >= 0], return_counts=True))
        np.testing.assert_array_equal(np.where(ranks >= 0, seen[ranks], -1), shown)
    assert cloud.voxels_of_view(1)[1] is cloud.voxels_of_view(1)[1]


def test_points_within_a_box() -> None:
    cloud = build_cloud(RgbdViews(*views(7)), voxel_m=0.1)
    low, high = cloud.points[3], cloud.points[3] + np.array([0.5, 0.7, 0.4], np.float32)
    inside = cloud.within(low, high)
    np.testing.assert_array_equal(inside, np.all((cloud.points >= low) & (cloud.points <= high), axis=1))
    assert inside[3]


def test_views_that_show_the_same_again_make_voxels_no_coarser() -> None:
    rgb, depth, intrinsics, poses = views(6)
    once = build_cloud(RgbdViews(rgb, depth, intrinsics, poses), 0.05)
    many = [np.concatenate([part] * 12) for part in (rgb, depth, intrinsics, poses)]
    most = int(0.9 * once.num_points)
    cloud = build_cloud(RgbdViews(*many), 0.05, max_voxels=most)
    assert 0.5 * most < cloud.num_points <= most
