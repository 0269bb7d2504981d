"""Flow from above: what is drawn lies where it is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.geometry import invert_rigid, transform_points
from labeling.core.types import Box3d
from labeling.memory.flow.flow_pictures import (
    ARROW,
    FOUND,
    TRUE,
    draw_from_above,
    draw_pairs,
    moving_columns,
)
from labeling.memory.flow.moving_objects import LEAST_FLOW, LEAST_SHARE, MovingObject
from labeling.memory.flow.view_pairs import view_pairs
from labeling.memory.settings.grid_spec import GridSpec

from .test_flow import BOX, MEMORY, moving_episode

GRID = MEMORY.grid
HEIGHT_PX = 480


def near(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """(n, 2) pixels, x and y, of about that colour."""
    return np.argwhere(np.abs(picture.astype(int) - colour).max(axis=2) < 60)[:, ::-1]


def to_grid(pair, points_m: np.ndarray) -> np.ndarray:
    """Pixels of points of the world, from the definition of the picture: +X right, +Y up, the grid fills it."""
    at = transform_points(invert_rigid(pair.grid_to_world(0)), points_m)
    x, y, _ = GRID.extent_m
    return np.stack([(at[:, 0] + x / 2) / y, (y / 2 - at[:, 1]) / y], axis=1) * HEIGHT_PX - 0.5


@pytest.fixture
def pair():
    episode = moving_episode()
    return view_pairs(episode.name, episode, MEMORY)[0]


def drawn(pair, found=(), true=(), flow_m=None, moves=None):
    nothing = np.zeros(GRID.shape)
    flow_m = np.zeros((3, *GRID.shape)) if flow_m is None else flow_m
    moves = nothing if moves is None else moves
    return draw_from_above(pair, flow_m, moves, moves, GRID, found, true, HEIGHT_PX)


@pytest.mark.parametrize(("kind", "colour"), [("found", FOUND), ("true", TRUE)])
def test_boxes_are_outlined_where_they_stand(pair, kind, colour):
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])
    box = Box3d(np.array(BOX.centre), np.array([0.8, 0.4, 0.5]), turn)
    given_box = [MovingObject(box, np.zeros(3), 0.5)] if kind == "found" else [box]
    pixels = near(drawn(pair, **{kind: given_box}), colour)
    corners = to_grid(pair, box.corners())
    assert np.abs(pixels.min(axis=0) - corners.min(axis=0)).max() < 5
    assert np.abs(pixels.max(axis=0) - corners.max(axis=0)).max() < 5
    assert len(near(drawn(pair), colour)) == 0


def test_an_arrow_leads_from_a_column_to_where_it_goes(pair):
    moves, flow_m = np.zeros(GRID.shape), np.zeros((3, *GRID.shape))
    moves[2, 5, 4], flow_m[:, 2, 5, 4] = 1.0, (0.9, 0.6, 0.3)
    pixels = near(drawn(pair, flow_m=flow_m, moves=moves), ARROW)
    scale = HEIGHT_PX / GRID.shape[1]
    start = np.array([4.5, GRID.shape[1] - 5.5]) * scale
    end = start + np.array([0.9, -0.6]) / GRID.voxel_m * scale
    assert np.abs(pixels.min(axis=0) - [start[0], end[1]]).max() < 10
    assert np.abs(pixels.max(axis=0) - [end[0], start[1]]).max() < 10
    assert len(near(drawn(pair), ARROW)) == 0


def test_what_was_measured_is_seen_in_its_colour(pair):
    picture = drawn(pair)

    def red_share(x_m: float, y_m: float) -> float:
        column, row = to_grid(pair, np.array([[x_m, y_m, 0.7]]))[0].astype(int)
        around = picture[row - 12 : row + 13, column - 12 : column + 13].reshape(-1, 3).astype(int)
        measured = around[(around < 250).any(axis=1)]
        assert len(measured) > 100
        return ((measured[:, 0] > measured[:, 1] + 30) & (measured[:, 0] > measured[:, 2] + 30)).mean()

    assert red_share(*BOX.centre[:2]) > 0.7
    assert red_share(BOX.centre[0], BOX.centre[1] + 1.0) < 0.05


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_columns_that_move_have_the_mean_flow_of_their_voxels(seed):
    rng, grid = np.random.default_rng(seed), GridSpec((4, 5, 6), 0.5)
    flow_m, moves = rng.normal(0, 0.3, (3, *grid.shape)), rng.random(grid.shape)
    occupied = (rng.random(grid.shape) < 0.5).astype(float)
    expected = {}
    for y in range(5):
        for x in range(6):
            own = [
                flow_m[:2, z, y, x]
                for z in range(4)
                if occupied[z, y, x]
                and moves[z, y, x] >= LEAST_SHARE
                and np.linalg.norm(flow_m[:, z, y, x]) >= LEAST_FLOW * 0.5
            ]
            if own:
                expected[0.5 * (x + 0.5) - 1.5, 0.5 * (y + 0.5) - 1.25] = np.mean(own, axis=0)
    starts, steps = moving_columns(flow_m, moves, occupied, grid)
    assert {tuple(one) for one in starts} == set(expected)
    for start, step in zip(starts, steps, strict=True):
        np.testing.assert_allclose(step, expected[tuple(start)])


def test_pairs_of_any_size_stand_beside_each_other():
    small, wide, above = (np.zeros((*size, 3), np.uint8) for size in ((32, 32), (60, 80), (256, 128)))
    picture = draw_pairs([(small, small, above), (wide, wide, above)], "views 1, 2")
    width = 256 * 80 // 60
    assert picture.shape == (3 * (256 + 18), 2 * width + 4, 3)
    dark = [(picture[row * 274 + 18 : (row + 1) * 274] == 0).all(axis=(0, 2)) for row in range(3)]
    assert [int(one[:width].sum()) for one in dark] == [256, 256, 128]
    assert [int(one[width + 4 :].sum()) for one in dark] == [width, width, 128]
