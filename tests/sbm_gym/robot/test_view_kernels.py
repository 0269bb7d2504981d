"""The compiled loops over views do what plain NumPy does."""

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from labeling.core.geometry import intrinsics_from_fov, look_at, project, unproject, unproject_depth
from labeling.core.types import Detection
from labeling.core.views import Camera
from sbm_gym.robot import view_kernels
from sbm_gym.robot.object_memory import MemoryConfig, SeenSurface, ViewBins, find
from sbm_gym.robot.seen_space import SeenSpace
from sbm_gym.worlds.geometry.grid_kernels import free_steps
from sbm_gym.worlds.geometry.navigable import NavigableMap

SEEDS = st.integers(0, 2**32 - 1)


def random_view(rng):
    """A camera within a few metres of the origin that looks about, and a depth image with holes."""
    size = int(rng.integers(3, 40)), int(rng.integers(3, 40))
    eye = np.array([*rng.uniform(-2.0, 2.0, 2), rng.uniform(0.5, 2.0)])
    pose = look_at(eye, eye + rng.normal(size=3) + [0.1, 0.0, 0.0])
    depth_m = rng.uniform(0.5, 6.0, size).astype(np.float32)
    depth_m[rng.random(size) < 0.1] = 0.0
    return Camera(intrinsics_from_fov(size[1], size[0], np.pi / 2), pose, size), depth_m


def pixels_in_view(points_m, camera, min_depth_m, max_depth_m=np.inf):
    """Numbers of the points that lie in a picture, row and column of each one's pixel, and its z-depth."""
    pixels, depth_m = project(points_m, camera.intrinsics, camera.camera_to_world)
    within = (depth_m > min_depth_m) & (depth_m < max_depth_m)
    x, y = np.rint(np.where(within[:, None], pixels, -1.0)).T
    within &= (x >= 0) & (x < camera.size[1]) & (y >= 0) & (y < camera.size[0])
    return np.flatnonzero(within), y[within].astype(int), x[within].astype(int), depth_m[within]


@given(SEEDS)
def test_shown_points_are_counted(seed):
    rng = np.random.default_rng(seed)
    camera, _ = random_view(rng)
    points_m, ids = rng.uniform(-4.0, 4.0, (7, 30, 3)), rng.permutation(7).astype(np.int32)
    instance_map = rng.integers(0, 9, camera.size).astype(np.int32)
    inside, rows, columns, _ = pixels_in_view(points_m.reshape(-1, 3), camera, 1e-3)
    owner = inside // 30
    told = view_kernels.count_shown(points_m, ids, instance_map, camera.intrinsics, camera.camera_to_world, 1e-3)
    np.testing.assert_array_equal(told[0], np.bincount(owner, minlength=7))
    shown = owner[instance_map[rows, columns] == ids[owner]]
    np.testing.assert_array_equal(told[1], np.bincount(shown, minlength=7))


@given(SEEDS)
def test_points_that_agree_with_depth_are_counted(seed):
    rng = np.random.default_rng(seed)
    camera, depth_m = random_view(rng)
    points_m = rng.uniform(-4.0, 4.0, (200, 3))
    _, rows, columns, point_m = pixels_in_view(points_m, camera, view_kernels.MIN_DEPTH_M)
    seen_m = depth_m[rows, columns]
    agrees = (seen_m > 0.0) & (point_m - seen_m < 0.7) & (point_m - seen_m > -0.9)
    told = view_kernels.count_agreeing(points_m, depth_m, camera.intrinsics, camera.camera_to_world, 0.7, 0.9)
    assert told == np.count_nonzero(agrees)


@given(SEEDS)
def test_floor_is_noted_where_nothing_stands_before_it(seed):
    rng = np.random.default_rng(seed)
    camera, depth_m = random_view(rng)
    cells = np.argwhere(np.ones((12, 15), bool))
    centres_m = 0.5 * cells[:, ::-1] - 3.0
    points_m = np.column_stack([centres_m, np.zeros(len(centres_m))])
    numbers, rows, columns, floor_m = pixels_in_view(points_m, camera, view_kernels.MIN_DEPTH_M, 5.0)
    slope_m = floor_m**2 / (camera.intrinsics[1, 1] * camera.camera_to_world[2, 3])
    seen_m = depth_m[rows, columns]
    expected = np.full((12, 15), -1, np.int32)
    expected[tuple(cells[numbers[(seen_m > 0.0) & (floor_m - seen_m < 0.3 + slope_m)]].T)] = 4
    told = np.full((12, 15), -1, np.int32)
    view_kernels.note_floor(centres_m, cells, depth_m, camera.intrinsics, camera.camera_to_world, 5.0, 0.3, 4, told)
    np.testing.assert_array_equal(told, expected)
    view_kernels.note_near(centres_m, cells, 0.3, -0.2, 1.7, 5, told)
    expected[tuple(cells[np.linalg.norm(centres_m - [0.3, -0.2], axis=1) < 1.7].T)] = 5
    np.testing.assert_array_equal(told, expected)


@given(SEEDS)
def test_seen_space_is_where_the_pixels_points_are(seed):
    rng = np.random.default_rng(seed)
    camera, depth_m = random_view(rng)
    space = SeenSpace(np.array([-2.0, -3.0]), np.array([3.0, 2.5]), 0.25)
    space.add(depth_m, camera)
    filled, origin_m, cell_m = space.grid
    points_m, _ = unproject_depth(depth_m, camera.intrinsics, camera.camera_to_world)
    cells = np.floor((points_m - origin_m) / cell_m).astype(int)
    expected = np.zeros_like(filled)
    expected[tuple(cells[np.all((cells >= 0) & (cells < filled.shape), axis=1)].T)] = True
    np.testing.assert_array_equal(filled, expected)


@given(SEEDS, st.floats(0.05, 1.0))
def test_points_of_masks(seed, share):
    rng = np.random.default_rng(seed)
    camera, depth_m = random_view(rng)
    noise = cv2.resize(rng.random((4, 4)), camera.size[::-1], interpolation=cv2.INTER_CUBIC)
    mask = noise < np.quantile(noise, share)
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    chosen = inner if np.count_nonzero(inner) >= 0.3 * np.count_nonzero(mask) else mask
    y, x = np.nonzero(chosen & (depth_m > 0.0) & (depth_m < 5.0))
    told = find(Detection(0, "chair", 0.9, mask), depth_m, camera, MemoryConfig(max_depth_m=5.0, min_mask_share=0.02))
    if len(x) < 3 or np.count_nonzero(mask) < 0.02 * mask.size:
        assert told is None
        return
    pixels = np.stack([x, y], axis=1).astype(float)
    points_m = unproject(pixels, depth_m[y, x].astype(float), camera.intrinsics, camera.camera_to_world)
    off_m = np.abs(points_m - points_m.mean(axis=0))
    kept_m = points_m[np.all(off_m <= 3.0 * points_m.std(axis=0) + 1e-9, axis=1)]
    assert told is not None
    np.testing.assert_allclose(told.points_m, kept_m, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(told.centroid_m, told.points_m.mean(axis=0))
    assert told.size_m == np.ptp(told.points_m, axis=0).max()
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    assert view_kernels.window_of(mask) == (rows[0], rows[-1] + 1, columns[0], columns[-1] + 1)


@given(SEEDS)
def test_bins_of_views_are_those_of_sorted_edges_and_whole_sectors(seed):
    rng = np.random.default_rng(seed)
    bins = ViewBins(num_azimuths=int(rng.integers(1, 30)))
    cameras_m, centroids_m = rng.normal(0.0, 2.0, (7, 1, 3)), rng.normal(0.0, 2.0, (1, 5, 3))
    inside, (azimuths, rings, layers) = bins.cells(cameras_m, centroids_m)
    x, y, z = np.moveaxis(cameras_m - centroids_m, -1, 0)
    ranges_m = np.hypot(x, y)
    low_m, *_, high_m = bins.range_edges_m
    np.testing.assert_array_equal(inside, (ranges_m >= low_m) & (ranges_m < high_m))
    np.testing.assert_array_equal(rings, np.digitize(ranges_m, bins.range_edges_m[1:-1]))
    np.testing.assert_array_equal(layers, np.digitize(np.arctan2(z, ranges_m), bins.elevation_edges_rad))
    np.testing.assert_array_equal(azimuths, bins.azimuth_bin(np.arctan2(y, x)))


@given(SEEDS)
def test_points_that_an_object_holds_are_near_its_centroid_or_in_its_box(seed):
    rng = np.random.default_rng(seed)
    surface_m, points_m, margin_m = rng.normal(0.0, 0.5, (30, 3)), rng.normal(0.0, 1.0, (50, 3)), 0.1
    known = SeenSurface(centroid_m=surface_m.mean(axis=0), points_m=surface_m)
    near = np.linalg.norm(points_m - known.centroid_m, axis=1) <= 0.7
    expected = near | known.surrounds(points_m, margin_m)
    np.testing.assert_array_equal(known.holds(points_m, 0.7, margin_m), expected)


@given(SEEDS)
def test_open_directions_have_a_free_place_from_which_the_target_is_seen(seed):
    rng = np.random.default_rng(seed)
    space = SeenSpace(np.array([-2.0, -2.0]), np.array([2.0, 2.0]), 0.25)
    for _ in range(3):
        camera, depth_m = random_view(rng)
        space.add(depth_m, camera)
    navigable = NavigableMap(rng.random((40, 38)) < 0.5, np.array([-2.0, -2.0]), 0.1)
    target_m, offsets_m = rng.uniform(0.0, 1.0, 3), rng.uniform(-2.0, 2.0, (2, 18, 2))
    places_m = target_m[:2] + offsets_m
    eyes_m = np.concatenate([places_m, np.full((2, 18, 1), 1.5)], axis=2).reshape(-1, 3)
    seen = navigable.are_free(places_m) & space.sees(eyes_m, target_m, 0.3).reshape(2, 18)
    told = space.open_directions(target_m, offsets_m, navigable, 1.5, 0.3)
    np.testing.assert_array_equal(told, seen.any(axis=0))


@given(SEEDS)
def test_steps_are_counted_up_to_the_first_place_that_is_not_free(seed):
    rng = np.random.default_rng(seed)
    grid = NavigableMap(rng.random((20, 30)) < 0.9, rng.uniform(-1.0, 1.0, 2), 0.1)
    place_m, angles = grid.origin_m + rng.uniform(0.0, 3.0, 2), rng.uniform(-4.0, 4.0, 9)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    free = grid.are_free(place_m + (np.arange(1, 26) * 0.1)[None, :, None] * directions[:, None])
    blocked = np.concatenate([~free, np.ones((9, 1), bool)], axis=1).argmax(axis=1)
    told = free_steps(grid.free, grid.origin_m, grid.cell_m, place_m[0], place_m[1], directions, 25)
    np.testing.assert_array_equal(told, blocked)


@given(SEEDS, st.floats(-3.0, 3.0))
def test_unseen_floor_is_counted_by_direction_and_distance(seed, yaw_rad):
    rng = np.random.default_rng(seed)
    cells = np.argwhere(rng.random((12, 15)) < 0.8)
    seen_at = rng.integers(-1, 2, (12, 15)).astype(np.int32)
    centres_m, (x, y) = 0.5 * cells[:, ::-1] - 3.0, rng.uniform(-2.0, 2.0, 2)
    rings = ((0.0, 2.0), (2.0, 5.0))
    told = view_kernels.count_unseen(centres_m, cells, seen_at, x, y, yaw_rad, 0.5, rings, 8)
    off_m = centres_m[seen_at[tuple(cells.T)] < 0] - [x, y]
    distances, bearings = np.linalg.norm(off_m, axis=1) / 0.5, np.arctan2(off_m[:, 1], off_m[:, 0]) - yaw_rad
    pieces = np.floor(bearings / (np.pi / 4) + 0.5).astype(int) % 8
    expected = [[np.sum((pieces == k) & (distances >= a) & (distances < b)) for k in range(8)] for a, b in rings]
    np.testing.assert_array_equal(told, expected)
