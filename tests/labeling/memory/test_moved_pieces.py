"""Made-up motion: what is drawn against where the truth says it went, and against rooms that are rendered anew."""

from dataclasses import replace

import numpy as np
import pytest

from labeling.core.geometry import invert_rigid, project, transform_points, unproject_depth
from labeling.memory.flow import moved_pieces
from labeling.memory.flow.flow_detector import points_of
from labeling.memory.flow.moved_pieces import FlowTruth, with_moved_pieces
from labeling.memory.flow.view_pairs import view_pairs
from labeling.memory.settings.flow_settings import TrainFlowConfig
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.settings.memory_spec import MemorySpec
from labeling.memory.view_prediction.scenes import SmallScene

from ..synthetic_room import Part, render
from .orbits import orbit_episode, ring
from .test_flow import BOX, OTHER, moving_episode

MEMORY = MemorySpec("cn3d", GridSpec((8, 16, 16), 0.3), 8, 8, 8, size=(48, 48))
"""Depth is 96 x 96, as episodes are recorded here, so that no pixel is left out."""
NEAR_M = 0.06


def standing_pair(seed: int = 3) -> SmallScene:
    episode = orbit_episode(seed, ring(seed, views=16), size=(96, 96))
    return view_pairs(episode.name, episode, MEMORY)[0]


def moved_points(pair: SmallScene, truth: FlowTruth) -> tuple[np.ndarray, np.ndarray]:
    """Points of the first view in voxels that move as a whole, and where they go by the truth; world, metres."""
    points, _ = points_of(pair, 0)
    grid = MEMORY.grid
    cells = np.floor((points + 0.5 * np.array(grid.extent_m)) / grid.voxel_m).astype(int)
    inside = np.all((cells >= 0) & (cells < np.array(grid.shape[::-1])), axis=1)
    x, y, z = cells[inside].T
    moves = truth.moves[0, 0].numpy()[z, y, x] > 0.99
    flow = truth.flow_m[0].numpy()[:, z, y, x].T[moves]
    grid_to_world = pair.grid_to_world(0)
    before = points[inside][moves]
    return transform_points(grid_to_world, before), transform_points(grid_to_world, before + flow)


def behind_m(pair: SmallScene, points: np.ndarray) -> np.ndarray:
    """How far behind points the second view has measured something at their pixels; NaN out of the picture."""
    pixels, depth_m = project(points, pair.depth_intrinsics[1].astype(float), pair.camera_to_world[1].astype(float))
    columns, rows = np.round(pixels).astype(int).T
    height, width = pair.depth_m[1].shape
    shown = (depth_m > 0.05) & (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    found = np.full(len(points), np.nan)
    found[shown] = pair.depth_m[1][rows[shown], columns[shown]] - depth_m[shown]
    return found


def test_what_the_first_view_shows_is_found_again_where_the_truth_says_it_went():
    pair, config = standing_pair(), TrainFlowConfig(pieces=1, furthest_m=0.8, furthest_turn_deg=0.0)
    there, gone = [], []
    for seed in range(60):
        changed, truth = with_moved_pieces(pair, MEMORY.grid, config, np.random.default_rng(seed))
        before, after = moved_points(pair, truth)
        if len(before) and np.linalg.norm(after[0] - before[0]) > 3 * NEAR_M:
            shown = np.abs(behind_m(pair, before)) < NEAR_M  # by the second view, too, as it was recorded
            there.append(behind_m(changed, after[shown]))
            gone.append(behind_m(changed, before[shown]))
    assert len(there) >= 6
    error, left = np.concatenate(there), np.concatenate(gone)
    error = error[np.isfinite(error)]
    assert np.mean(np.abs(error) < NEAR_M) > 0.7
    assert np.mean(error > NEAR_M) < 0.04  # seen through; what is hidden by something else is nearer
    assert np.mean(left > NEAR_M) > 0.5  # a piece that is moved by less than its size hides a part of where it was


def test_nothing_is_continued_below_the_floor():
    pair, config = standing_pair(), TrainFlowConfig(pieces=3)
    lowest = 0.0
    for seed in range(10):
        changed, _ = with_moved_pieces(pair, MEMORY.grid, config, np.random.default_rng(seed))
        pose, intrinsics = changed.camera_to_world[1].astype(float), changed.depth_intrinsics[1].astype(float)
        points, _ = unproject_depth(changed.depth_m[1], intrinsics, pose)
        lowest = min(lowest, points[:, 2].min())
    assert lowest > -0.03  # the floor is at 0


def test_pieces_that_pass_before_others_are_whole(monkeypatch: pytest.MonkeyPatch):
    """Two boxes are moved; the room is rendered anew with both where they are then."""
    episode = moving_episode((0.0, 0.0))
    (pair,) = view_pairs(episode.name, episode, MEMORY)
    grid_to_world, floor_m = pair.grid_to_world(0), pair.floor_in_grid_m
    assert floor_m is not None
    steps = ((0.0, -0.45, 0.0), (0.2, 0.9, 0.0))  # the first goes before the place of the second
    boxes, motions = iter((BOX, OTHER)), iter(steps)

    def piece(*_):
        box = next(boxes)
        half = np.array(box.half) + 0.02
        return lambda points: (
            np.all(np.abs(transform_points(grid_to_world, points) - box.centre) < half, axis=1)
            & (points[:, 2] > floor_m + 0.02)
        )

    def motion(*_):
        found = np.eye(4)
        found[:3, 3] = invert_rigid(grid_to_world)[:3, :3] @ next(motions)
        return found

    monkeypatch.setattr(moved_pieces, "_piece", piece)
    monkeypatch.setattr(moved_pieces, "_motion", motion)

    seed = next(one for one in range(99) if np.random.default_rng(one).integers(3) == 2)
    changed, _ = with_moved_pieces(pair, MEMORY.grid, TrainFlowConfig(pieces=2), np.random.default_rng(seed))
    parts: list[Part] = [
        replace(one, centre=tuple(np.add(one.centre, step))) for one, step in zip((BOX, OTHER), steps, strict=True)
    ]
    intrinsics, pose = pair.depth_intrinsics[1].astype(float), pair.camera_to_world[1].astype(float)
    _, true_m, instance = render(parts, pose, intrinsics, 96, 96, room_m=5.6)
    right = np.abs(changed.depth_m[1] - true_m) < NEAR_M
    assert np.mean(right[instance == BOX.instance]) > 0.85
    assert np.mean(right[instance == OTHER.instance]) > 0.6  # a side of it is seen that was not seen before
    assert np.mean(right) > 0.95


def test_steps_are_uniform_in_their_logarithm():
    rng, config = np.random.default_rng(0), TrainFlowConfig(furthest_m=0.48, furthest_turn_deg=0.0)
    steps_m = [np.linalg.norm(moved_pieces._motion(np.zeros(3), config, rng)[:3, 3]) for _ in range(2000)]
    shares = np.histogram(steps_m, 0.03 * 2.0 ** np.arange(5))[0] / len(steps_m)
    assert np.allclose(shares, 0.25, atol=0.04)
    short = TrainFlowConfig(furthest_m=0.02, furthest_turn_deg=0.0)
    assert np.linalg.norm(moved_pieces._motion(np.zeros(3), short, rng)[:3, 3]) == pytest.approx(0.02)


def test_where_no_floor_is_known_nothing_is_moved():
    pair = replace(standing_pair(), floor_m=None)
    for seed in range(4):
        changed, truth = with_moved_pieces(pair, MEMORY.grid, TrainFlowConfig(), np.random.default_rng(seed))
        assert changed is pair
        assert truth.moves.max() == 0
        assert truth.known.sum() > 0
