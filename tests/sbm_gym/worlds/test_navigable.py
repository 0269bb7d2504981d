import heapq
import itertools

import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from sbm_gym.worlds.geometry.navigable import NavigableMap, navigable_map


@st.composite
def maps(draw):
    """Grids with some blocked cells, somewhere in the world."""
    ny, nx = draw(st.integers(3, 12)), draw(st.integers(3, 12))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    free = rng.random((ny, nx)) > draw(st.sampled_from([0.1, 0.25, 0.4]))
    free[rng.integers(ny), rng.integers(nx)] = True
    return NavigableMap(free, rng.uniform(-3, 3, 2), 0.05), rng


def grid_distance(free, start, goal, cell_m):
    """Dijkstra by hand over 8 neighbours, without cutting corners."""
    best, queue = {start: 0.0}, [(0.0, start)]
    while queue:
        length, (i, j) = heapq.heappop(queue)
        if (i, j) == goal:
            return length
        for di in (-1, 0, 1):
            for dj in (-1, 0, 1):
                a, b = i + di, j + dj
                if not (0 <= a < free.shape[0] and 0 <= b < free.shape[1] and free[a, b]):
                    continue
                if di and dj and not (free[i, b] and free[a, j]):
                    continue
                new = length + cell_m * np.hypot(di, dj)
                if new < best.get((a, b), np.inf) - 1e-12:
                    best[(a, b)] = new
                    heapq.heappush(queue, (new, (a, b)))
    return np.inf


def cell_of(grid, point):
    j, i = np.floor((point - grid.origin_m) / grid.cell_m).astype(int)
    return int(i), int(j)


@given(maps())
def test_random_points_are_free_and_connected(case):
    grid, rng = case
    for _ in range(5):
        point = grid.random_point(rng)
        assert grid.is_free(point)
        assert grid.largest_component[cell_of(grid, point)]


@given(maps())
def test_a_path_exists_exactly_where_the_grid_connects_and_is_never_longer(case):
    grid, rng = case
    cells = np.argwhere(grid.free)
    start, goal = (cells[rng.integers(len(cells))] for _ in range(2))
    a, b = (grid.origin_m + grid.cell_m * (cell[::-1] + 0.5) for cell in (start, goal))
    shortest = grid_distance(grid.free, tuple(map(int, start)), tuple(map(int, goal)), grid.cell_m)
    path = grid.shortest_path(a, b)
    if path is None:
        assert shortest == np.inf
        return
    np.testing.assert_array_equal(path[[0, -1]], [a, b])
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert length <= shortest + 1e-9
    assert length >= np.linalg.norm(b - a) - 1e-9
    for p, q in itertools.pairwise(path):
        assert grid.line_is_free(p, q)


@given(maps())
def test_free_lines_pass_over_free_points_only(case):
    grid, rng = case
    high = grid.origin_m + grid.cell_m * np.array(grid.free.shape[::-1])
    a, b = rng.uniform(grid.origin_m, high, (2, 2))
    along = a + np.linspace(0, 1, 400)[:, None] * (b - a)
    everywhere = all(grid.is_free(point) for point in along)
    if grid.line_is_free(a, b):
        assert everywhere
    assert grid.line_is_free(a, b) == grid.line_is_free(b, a)
    ends = np.stack([b, a, b])
    straight = [number for number, end in enumerate(ends) if grid.line_is_free(a, end)]
    assert grid.first_straight(a, ends) == (straight[0] if straight else -1)


@given(maps())
def test_nearest_free_is_free_and_nearest(case):
    grid, rng = case
    point = grid.origin_m + rng.uniform(-0.3, 1.0, 2)
    nearest = grid.nearest_free(point)
    assert grid.is_free(nearest)
    if grid.is_free(point):
        np.testing.assert_array_equal(nearest, point)
    else:
        cells = np.argwhere(grid.largest_component)
        centres = grid.origin_m + grid.cell_m * (cells[:, ::-1] + 0.5)
        assert np.linalg.norm(nearest - point) == pytest.approx(np.linalg.norm(centres - point, axis=1).min())


def test_outside_is_never_free():
    grid = NavigableMap(np.ones((4, 6), bool), np.array([1.0, 2.0]), 0.05)
    assert grid.is_free(np.array([1.01, 2.01]))
    for point in ([0.99, 2.1], [1.31, 2.1], [1.1, 1.99], [1.1, 2.21]):
        assert not grid.is_free(np.array(point))
    assert grid.shortest_path(np.array([0.0, 0.0]), np.array([1.1, 2.1])) is None


def test_a_map_without_a_free_cell_says_so():
    grid = NavigableMap(np.zeros((3, 3), bool), np.zeros(2))
    with pytest.raises(ValueError, match="no free cell"):
        grid.random_point(np.random.default_rng(0))
    with pytest.raises(ValueError, match="no free cell"):
        grid.nearest_free(np.zeros(2))


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_a_disc_on_a_free_point_touches_nothing(seed):
    """Brute force: points on the agent's rim, at free places, are in no box and inside the walls."""
    rng = np.random.default_rng(seed)
    low, high = np.array([-2.0, -1.5]), np.array([2.0, 1.5])
    boxes = np.column_stack(
        [rng.uniform(low, high, (4, 2)), rng.uniform(0.05, 0.5, (4, 2)), rng.uniform(-np.pi, np.pi, 4)]
    )
    grid = navigable_map(low, high, boxes)
    points = rng.uniform(low, high, (300, 2))
    free = points[[grid.is_free(point) for point in points]]
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rim = (free[:, None] + 0.18 * np.stack([np.cos(angles), np.sin(angles)], axis=1)).reshape(-1, 2)
    assert np.all(rim >= low - 1e-9)
    assert np.all(rim <= high + 1e-9)
    for x, y, half_x, half_y, yaw in boxes:
        offset = rim - [x, y]
        along = offset @ [np.cos(yaw), np.sin(yaw)]
        across = offset @ [-np.sin(yaw), np.cos(yaw)]
        assert not np.any((np.abs(along) < half_x - 1e-9) & (np.abs(across) < half_y - 1e-9))


def test_an_empty_floor_is_free_up_to_the_radius():
    grid = navigable_map(np.array([0.0, 0.0]), np.array([4.0, 3.0]), np.zeros((0, 5)))
    assert grid.free.mean() > 0.75
    assert grid.is_free(np.array([0.25, 0.25]))
    assert not grid.is_free(np.array([0.17, 1.0]))


@given(maps())
def test_many_places_are_free_where_each_is(case):
    grid, rng = case
    places = grid.origin_m + rng.uniform(-0.2, 0.8, (4, 5, 2))
    found = grid.are_free(places)
    assert found.shape == (4, 5)
    for index in np.ndindex(4, 5):
        assert found[index] == grid.is_free(places[index])


def test_long_ways_around_a_wall_are_found():
    wall = np.array([[0.0, -0.5, 0.1, 2.5, 0.0]])
    room = navigable_map(np.array([-3.0, -3.0]), np.array([3.0, 3.0]), wall)
    path = room.shortest_path(np.array([-0.4, -2.5]), np.array([0.4, -2.5]))
    assert path is not None
    # Up to the end of the wall and down again, many times as far as the crow flies.
    assert 8.0 < np.linalg.norm(np.diff(path, axis=0), axis=1).sum() < 10.5


def test_lines_along_the_lines_of_the_grid_are_free_where_the_cells_above_and_right_are():
    free = np.ones((4, 4), bool)
    free[1, 2] = False
    grid = NavigableMap(free, np.zeros(2), 1.0)
    assert not grid.line_is_free(np.array([0.5, 1.0]), np.array([3.5, 1.0]))
    assert grid.line_is_free(np.array([0.5, 2.0]), np.array([3.5, 2.0]))
    assert not grid.line_is_free(np.array([2.0, 0.5]), np.array([2.0, 2.5]))
    assert grid.line_is_free(np.array([3.0, 0.5]), np.array([3.0, 2.5]))
    assert not grid.line_is_free(np.array([3.5, 0.5]), np.array([4.0, 0.5]))


@given(arrays_of.arrays(bool, arrays_of.array_shapes(min_dims=2, max_dims=2, max_side=9)))
def test_the_largest_part_is_scipys(free):
    labels, count = scipy.ndimage.label(free)  # type: ignore[misc]
    largest = labels == 1 + np.argmax(np.bincount(labels.ravel())[1:]) if count else np.zeros_like(free)
    assert np.array_equal(NavigableMap(free, np.zeros(2)).largest_component, largest)
