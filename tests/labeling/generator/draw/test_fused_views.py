import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov
from labeling.core.views import RgbdViews
from labeling.generator.cloud.voxel_cloud import build_cloud
from labeling.generator.draw.fused_views import FusedViews
from labeling.generator.draw.view_masks import NO_OBJECT
from labeling.generator.settings.label_config import LabelConfig

SIZE = (32, 32)
WALL_M, NOISE_M = 2.0, 1.0
HOLE = slice(14, 18)


def views_of_a_wall(num_views: int, noisy: int) -> RgbdViews:
    """A wall seen from one place; the first view has a hole, in which ``noisy`` others see something before it."""
    depth = np.full((num_views, *SIZE), WALL_M, np.float32)
    depth[0, HOLE, HOLE] = 0
    depth[1 : 1 + noisy, HOLE, HOLE] = NOISE_M
    intrinsics = intrinsics_from_fov(SIZE[1], SIZE[0], np.deg2rad(60))
    same = np.broadcast_to(intrinsics, (num_views, 3, 3)), np.broadcast_to(np.eye(4), (num_views, 4, 4))
    return RgbdViews(np.full((num_views, *SIZE, 3), 128, np.uint8), depth, *map(np.array, same))


@pytest.mark.parametrize(
    ("num_views", "noisy", "least_views", "shown_m"),
    [
        (5, 1, 1, NOISE_M),
        (5, 1, 2, WALL_M),  # one view alone is not believed
        (5, 2, 2, NOISE_M),  # two are
        (2, 1, 2, NOISE_M),  # unless there is no other
    ],
)
def test_a_hole_shows_the_nearest_surface_that_enough_views_have_measured(num_views, noisy, least_views, shown_m):
    views = views_of_a_wall(num_views, noisy)
    cloud = build_cloud(views, 0.05)
    fused = FusedViews.of(views, cloud, np.ones(cloud.num_points, bool), 0.03, LabelConfig())
    shown = fused.filling_voxels(0, LabelConfig(fill_views=least_views))[15:17, 15:17]
    assert np.allclose(cloud.points[shown, 2], shown_m, atol=0.05)


@pytest.mark.parametrize(
    ("measured_m", "max_range_m", "filled"),
    [
        (2 * WALL_M, 1.5 * WALL_M, False),  # it looks through where the others have measured a wall
        (1.01 * WALL_M, 0.99 * WALL_M, True),  # it has measured the wall itself, but too far away
        (0.0, 1.5 * WALL_M, True),
        (0.0, 0.99 * WALL_M, False),  # nor would it believe itself what it measures there
    ],
)
def test_what_a_view_has_measured_too_far_away_tells_whether_something_is_there(measured_m, max_range_m, filled):
    views = views_of_a_wall(4, 0)
    cloud = build_cloud(views, 0.01)
    views.depth_m[0, HOLE, HOLE] = measured_m
    views.depth_m[0][views.depth_m[0] == WALL_M] = 0.5 * WALL_M  # of no importance: only holes are filled
    fused = FusedViews.of(views, cloud, np.ones(cloud.num_points, bool), 0.03, LabelConfig())
    shown = fused.filling_voxels(0, LabelConfig(max_range_m=max_range_m))[15:17, 15:17]
    assert np.all(shown >= 0 if filled else shown == NO_OBJECT)


def test_views_that_measured_a_voxel_are_counted_once_each():
    views = views_of_a_wall(4, 1)
    cloud = build_cloud(views, 0.05)
    fused = FusedViews.of(views, cloud, np.ones(cloud.num_points, bool), 0.03, LabelConfig())
    expected = [len({v for v in range(4) if np.any(cloud.voxel_of_pixel[v] == n)}) for n in range(cloud.num_points)]
    assert fused.hits.tolist() == expected
