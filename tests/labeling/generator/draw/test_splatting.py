import numpy as np

from labeling.core.geometry import intrinsics_from_fov, look_at, project, splat
from labeling.core.views import Camera
from labeling.generator.draw.splatting import nearest_points, silhouettes

INTRINSICS = intrinsics_from_fov(40, 30, 1.2)
POSE = look_at(np.array([0.0, 0.0, 1.0]), np.array([3.0, 0.2, 0.8]))


def cloud(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform([-1, -2, -1], [5, 2, 3], (count, 3)).astype(np.float32)


def test_single_pixel_points_are_drawn_as_the_plain_splat_draws_them() -> None:
    points = cloud(3000)
    points = points[project(points.astype(float), INTRINSICS, POSE)[1] > 0.01]
    expected, _ = splat(points.astype(float), INTRINSICS, POSE, 30, 40)
    ours = nearest_points(points, Camera(INTRINSICS, POSE, (30, 40)), 1e-6)
    assert np.mean(ours == expected) > 0.995  # a point on the border between two pixels may fall to either


def test_of_two_points_on_a_ray_the_nearer_is_drawn() -> None:
    points = np.array([[4.0, 0.2, 0.8], [2.0, 0.1, 0.9], [3.0, 0.15, 0.85]], np.float32)
    index = nearest_points(points, Camera(INTRINSICS, POSE, (30, 40)), 0.5)
    assert index[15, 20] == 1


def test_points_cover_squares_of_their_size() -> None:
    point = np.array([[3.0, 0.2, 0.8]], np.float32)
    depth = project(point.astype(float), INTRINSICS, POSE)[1][0]
    side = 0.6 * INTRINSICS[0, 0] / depth
    covered = np.count_nonzero(nearest_points(point, Camera(INTRINSICS, POSE, (30, 40)), 0.6) == 0)
    assert (side - 1) ** 2 <= covered <= (side + 1) ** 2


def test_hidden_objects_are_drawn_whole() -> None:
    points = np.array([[4.0, 0.26, 0.74], [2.0, 0.13, 0.87]], np.float32)
    masks = silhouettes(points, np.array([0, 1], np.int32), 2, Camera(INTRINSICS, POSE, (30, 40)), 0.4)
    assert masks[0].any()
    assert masks[1].any()
    assert np.any(masks[0] & masks[1])


def test_points_without_object_and_points_behind_are_not_drawn() -> None:
    points = np.array([[3.0, 0.2, 0.8], [-3.0, 0.0, 1.0]], np.float32)
    assert not silhouettes(points, np.array([-1, 0], np.int32), 1, Camera(INTRINSICS, POSE, (30, 40)), 0.3).any()
    assert np.all(nearest_points(points[1:], Camera(INTRINSICS, POSE, (30, 40)), 0.3) == -1)


def test_squares_over_the_border_are_cut_there() -> None:
    size = (30, 40)
    for seed in range(20):
        points = cloud(50, seed)
        big = nearest_points(points, Camera(INTRINSICS, POSE, size), 1.5)
        assert big.shape == size
        assert big.max() < 50
