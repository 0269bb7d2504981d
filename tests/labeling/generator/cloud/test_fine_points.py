import numpy as np
import pytest

from labeling.core.geometry import unproject_depth
from labeling.core.views import RgbdViews
from labeling.generator.cloud.fine_points import fine_points
from labeling.generator.cloud.voxel_cloud import build_cloud

from .test_voxel_cloud import views


@pytest.mark.parametrize("spacing_m", [0.05, 0.7])
def test_fine_points_are_means_of_the_pixels_of_chosen_voxels(spacing_m: float) -> None:
    """Spacings below and above that of the voxels; a point is of the voxel that its last pixel fell into."""
    rgb, depth, intrinsics, poses = views(8)
    room = RgbdViews(rgb, depth, intrinsics, poses)
    cloud = build_cloud(room, voxel_m=0.4)
    chosen = np.random.default_rng(0).random(cloud.num_points) < 0.4
    fine = fine_points(room, cloud, chosen, spacing_m)
    shown, beside = cloud.voxel_of_pixel, chosen.copy()
    for a, b in ((shown[:, :, 1:], shown[:, :, :-1]), (shown[:, 1:], shown[:, :-1])):
        for one, other in ((a, b), (b, a)):
            beside[one[(one >= 0) & (other >= 0) & chosen[other]]] = True
    points = np.concatenate([unproject_depth(depth[v], intrinsics[v], poses[v])[0] for v in range(3)])
    voxel = shown[depth > 0]
    points, voxel = points[beside[voxel]], voxel[beside[voxel]]
    cells = np.floor(points / spacing_m).astype(int)
    _, first, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    members = [np.flatnonzero(cell.ravel() == number) for number in np.argsort(first)]
    members = [own for own in members if chosen[voxel[own[-1]]]]
    np.testing.assert_array_equal(fine.voxel, [voxel[own[-1]] for own in members])
    np.testing.assert_allclose(fine.points, [points[own].mean(axis=0) for own in members], atol=1e-5)
    assert fine.spacing_m == spacing_m


def test_they_move_apart_until_they_are_few_enough() -> None:
    room = RgbdViews(*views(9))
    cloud = build_cloud(room, voxel_m=0.4)
    fine = fine_points(room, cloud, np.ones(cloud.num_points, bool), 0.01, max_points=200)
    assert len(fine.points) <= 200
    assert fine.spacing_m > 0.01


def test_more_points_than_the_first_table_holds() -> None:
    rng = np.random.default_rng(1)
    depth = rng.uniform(1.0, 3.0, (1, 300, 400)).astype(np.float32)
    camera = np.array([[[300.0, 0, 199.5], [0, 300.0, 149.5], [0, 0, 1]]])
    room = RgbdViews(np.zeros((1, 300, 400, 3), np.uint8), depth, camera, np.eye(4)[None])
    cloud = build_cloud(room, voxel_m=0.5)
    fine = fine_points(room, cloud, np.ones(cloud.num_points, bool), 0.002)
    assert len(fine.points) > 100_000
    assert np.all(np.diff(np.unique(fine.voxel, return_index=True)[1]) > 0)


def test_no_voxel_chosen_gives_no_points() -> None:
    room = RgbdViews(*views(10))
    cloud = build_cloud(room, voxel_m=0.4)
    assert fine_points(room, cloud, np.zeros(cloud.num_points, bool), 0.1).points.shape == (0, 3)
