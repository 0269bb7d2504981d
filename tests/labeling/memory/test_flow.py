"""Flow on volumes: warps and their inverses, shifts that are found again, made-up motion, what moves as boxes."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from labeling.core.box_overlap import box_iou_3d
from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.types import Box3d, GroundTruth, ObjectMotion
from labeling.memory.flow.correlation_flow import correlation_flow, matched, shifted, shifts
from labeling.memory.flow.flow_evaluation import endpoint_errors, moving_truths, true_flow
from labeling.memory.flow.flow_losses import flow_losses, matching_loss
from labeling.memory.flow.flow_net import FlowHead, FlowOutput, Remembered
from labeling.memory.flow.flow_training import FlowTask
from labeling.memory.flow.moved_pieces import FlowTruth, voxel_truth, with_moved_pieces
from labeling.memory.flow.moving_objects import boxes_of_groups, group_flow
from labeling.memory.flow.seen_through import compare_points, seen_through
from labeling.memory.flow.true_pairs import TruePair
from labeling.memory.flow.view_pairs import view_pairs
from labeling.memory.flow.warping import warp_back
from labeling.memory.lifting.voxel_grid import voxel_centres
from labeling.memory.networks.weights import build_memory
from labeling.memory.settings.flow_settings import FlowSpec, TrainFlowConfig
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.settings.memory_spec import MemorySpec

from ..synthetic_room import Part, render
from .orbits import orbit_episode, ring

SPEC = GridSpec((16, 24, 24), 0.1)
MEMORY = MemorySpec("cn3d", GridSpec((8, 16, 16), 0.3), 8, 8, 8, size=(32, 32))


def blobs(centres: np.ndarray, spec: GridSpec = SPEC, sigma_m: float = 0.2) -> torch.Tensor:
    """(1, n, z, y, x) an analytic volume: a channel for each blob."""
    away = voxel_centres(spec)[None] - torch.from_numpy(centres.astype(np.float32))[:, None, None, None]
    return torch.exp(-away.square().sum(-1) / (2 * sigma_m**2))[None]


def constant_flow(step_m: tuple[float, float, float], spec: GridSpec = SPEC) -> torch.Tensor:
    return torch.tensor(step_m).reshape(1, 3, 1, 1, 1).expand(1, 3, *spec.shape).contiguous()


def test_a_warp_by_a_known_flow_and_back_is_identity_in_the_common_volume():
    volume = torch.from_numpy(np.random.default_rng(0).random((1, 2, *SPEC.shape), np.float32))
    step = (0.3, -0.2, 0.1)  # whole voxels
    there = warp_back(volume, constant_flow(step), SPEC)
    back = warp_back(there, -constant_flow(step), SPEC)
    inner = (..., slice(2, -2), slice(3, -3), slice(4, -4))
    assert torch.allclose(back[inner], volume[inner], atol=1e-4)
    assert not torch.allclose(there[inner], volume[inner], atol=0.1)


def test_a_warp_takes_what_lies_where_the_flow_ends():
    centre = np.array([[0.1, -0.2, 0.0]])
    step = (0.15, 0.07, -0.05)  # fractions
    later = blobs(centre + np.array(step))
    assert torch.allclose(warp_back(later, constant_flow(step), SPEC), blobs(centre), atol=0.1)
    assert warp_back(later, constant_flow((9.0, 0.0, 0.0)), SPEC).abs().max() == 0


def test_a_coarse_volume_is_warped_as_a_fine_one():
    fine = blobs(np.array([[0.2, 0.0, 0.1]]), sigma_m=0.4)
    coarse = torch.nn.functional.avg_pool3d(fine, 2)
    flow = constant_flow((0.2, 0.0, 0.0))
    warped = warp_back(coarse, flow[..., ::2, ::2, ::2], SPEC)
    expected = torch.nn.functional.avg_pool3d(warp_back(fine, flow, SPEC), 2)
    inner = (..., slice(2, -2), slice(2, -2), slice(2, -2))
    assert torch.allclose(warped[inner], expected[inner], atol=0.03)


def test_shifted_volumes_hold_what_lies_that_far_away():
    volume = torch.arange(4 * 5 * 6.0).reshape(1, 1, 4, 5, 6)
    assert torch.equal(shifted(volume, shifts()[13]), volume)
    moved = shifted(volume, (1, -1, 0))
    assert torch.equal(moved[..., 1:, :-1], volume[..., :-1, 1:])
    assert moved[..., -1].abs().max() == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "step_voxels", [(1, 0, 0), (0, -2, 0), (3, 2, 1), (0.5, 0, 0), (1.4, -0.7, 0.3), (4.3, 0, 0), (0, 0, 0.4)]
)
def test_correlation_recovers_a_rigid_shift_of_a_volume_to_well_below_a_voxel(step_voxels):
    centres = np.array([[0.3, 0.2, 0.1], [-0.4, -0.3, -0.2], [0.1, -0.5, 0.2]])
    step = 0.1 * np.array(step_voxels)
    first, second = blobs(centres), blobs(centres + step)
    flow = correlation_flow(first, second, SPEC)[0]
    inside = first[0].amax(dim=0) > 0.5
    error = (flow[:, inside] - torch.from_numpy(step.astype(np.float32))[:, None]).norm(dim=0)
    assert error.mean() < 0.03  # of voxels of 0.1


def test_correlation_finds_no_flow_between_identical_volumes():
    volume = torch.from_numpy(np.random.default_rng(1).random((2, 4, *SPEC.shape), np.float32))
    assert correlation_flow(volume, volume, SPEC).abs().max() == 0
    assert correlation_flow(0 * volume, 0 * volume, SPEC).abs().max() == 0


def test_correlation_moves_only_what_moves():
    still, moving = np.array([[-0.7, -0.6, 0.0]]), np.array([[0.6, 0.6, 0.0]])
    step = np.array([0.2, 0.0, 0.0])
    first, second = (torch.cat([blobs(still), blobs(at)], dim=1) for at in (moving, moving + step))
    flow = correlation_flow(first, second, SPEC)[0]
    assert flow[:, first[0, 0] > 0.5].norm(dim=0).max() < 0.02
    assert (flow[:, first[0, 1] > 0.5] - torch.tensor(step, dtype=torch.float32)[:, None]).norm(dim=0).mean() < 0.04


def remembered(volume: torch.Tensor) -> Remembered:
    filled = (volume.amax(dim=1, keepdim=True) > 0.3).float()
    return Remembered(volume, filled, 1 - filled, torch.zeros(len(volume), 2, *volume.shape[2:]))


@pytest.mark.nightly
def test_the_network_learns_shifts_of_volumes_and_zero_for_identical_ones():
    """The law of the untrained search, for learnt flow: after a few hundred small steps."""
    spec = GridSpec((8, 12, 12), 0.1)
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    head = FlowHead(4, 16)
    optimizer = torch.optim.Adam(head.parameters(), 2e-3)

    def drawn(still: bool) -> tuple[Remembered, Remembered, torch.Tensor, torch.Tensor]:
        centres = rng.uniform(-0.25, 0.25, (4, 3))
        step = np.zeros(3) if still else rng.uniform(-0.15, 0.15, 3)
        first, second = (blobs(one, spec, 0.15) for one in (centres, centres + step))
        target = constant_flow((0.0, 0.0, 0.0), spec) + torch.from_numpy(step.astype(np.float32)).reshape(1, 3, 1, 1, 1)
        return remembered(first), remembered(second), target, first.amax(dim=1, keepdim=True) > 0.3

    for number in range(250):
        first, second, target, inside = drawn(still=number % 4 == 0)
        loss = ((head(first, second, spec).flow_m - target).abs() * inside).sum() / inside.sum()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    errors: dict[bool, list[float]] = {True: [], False: []}
    for number in range(20):
        still = number % 2 == 0
        first, second, target, inside = drawn(still)
        with torch.no_grad():
            error = (head(first, second, spec).flow_m - target).norm(dim=1, keepdim=True)
        errors[still].append(float(error[inside].mean()))
    assert np.mean(errors[True]) < 0.02
    assert np.mean(errors[False]) < 0.05  # half a voxel; the shifts are 0.14 long on average


def test_the_best_match_is_where_a_volume_went_and_nowhere_for_what_is_empty():
    centre = np.array([[0.1, -0.2, 0.0]])
    first, second = blobs(centre), blobs(centre + np.array([0.1, 0.0, -0.1]))
    alike, best = matched(first, second)
    inside = first[0, 0] > 0.5
    assert torch.allclose(alike.sum(dim=1), torch.ones(1, *SPEC.shape), atol=1e-5)
    assert torch.allclose(best[0][:, inside].mean(dim=1), torch.tensor([1.0, 0.0, -1.0]), atol=0.35)
    _, none = matched(first, first)
    assert none[0][:, inside].mean(dim=1).abs().max() < 0.05
    assert matched(0 * first, 0 * first)[1].abs().max() < 1e-5


def test_losses_vanish_where_everything_is_right_and_where_nothing_is_known():
    flow = constant_flow((0.1, 0.0, 0.0))
    moves = torch.ones(1, 1, *SPEC.shape)
    right = FlowOutput(flow, 50 * moves)
    losses = flow_losses(right, FlowTruth(flow, moves, moves), SPEC)
    assert all(float(one) < 1e-6 for one in losses.values())
    wrong = flow_losses(FlowOutput(0 * flow, -5 * moves), FlowTruth(flow, moves, moves), SPEC)
    assert float(wrong["flow"]) == pytest.approx(1.0)
    assert float(wrong["moves"]) > 3
    unknown = flow_losses(FlowOutput(0 * flow, -5 * moves), FlowTruth(flow, moves, 0 * moves), SPEC)
    assert all(float(one) == 0 for one in unknown.values())


def test_features_match_best_along_the_true_flow():
    centres = np.array([[0.3, 0.2, 0.1], [-0.4, -0.3, -0.2]])
    step = (0.2, -0.1, 0.0)
    first, second = remembered(blobs(centres)), remembered(blobs(centres + np.array(step)))
    along, none, wrong = (
        float(matching_loss(first, second, constant_flow(one), SPEC))
        for one in (step, (0.0, 0.0, 0.0), (-0.2, 0.1, 0.0))
    )
    assert along < 0.2 < none < wrong


# Views -------------------------------------------------------------------------------------------------------------

BOX = Part((0.5, 0.1, 0.35), (0.3, 0.25, 0.35), (0.9, 0.2, 0.1), 0.0, False, 1)
OTHER = Part((-0.6, -0.4, 0.3), (0.25, 0.25, 0.3), (0.1, 0.3, 0.9), 0.0, False, 2)


def moving_episode(step_m: tuple[float, float] = (0.25, 0.1), size: tuple[int, int] = (96, 96)) -> Episode:
    """Two views from slightly different places; between them one of two boxes moves."""
    intrinsics = intrinsics_from_fov(size[1], size[0], np.deg2rad(80))
    poses = [look_at(np.array([2.2, y, 1.5]), np.array([0.0, 0.0, 0.4])) for y in (-0.1, 0.25)]
    moved = replace(BOX, centre=(BOX.centre[0] + step_m[0], BOX.centre[1] + step_m[1], BOX.centre[2]))
    parts = [[BOX, OTHER], [moved, OTHER]]
    drawn = [render(own, pose, intrinsics, *size, room_m=5.6) for own, pose in zip(parts, poses, strict=True)]
    object_to_world = np.repeat(np.eye(4)[None], 2, 0)
    object_to_world[0, :3, 3], object_to_world[1, :3, 3] = BOX.centre, moved.centre
    truths = [
        GroundTruth(view, part.instance, "box", drawn[view][2] == part.instance, box_3d=box_of(part))
        for view in range(2)
        for part in parts[view]
    ]
    return Episode(
        name="moving",
        rgb=np.stack([rgb for rgb, _, _ in drawn]),
        depth_m=np.stack([depth for _, depth, _ in drawn]),
        intrinsics=np.repeat(intrinsics[None], 2, 0),
        camera_to_world=np.stack(poses),
        file_names=("rgb/000.png", "rgb/001.png"),
        ground_truth=tuple(truths),
        motion=(ObjectMotion(1, "box", object_to_world),),
    )


def box_of(part: Part) -> Box3d:
    return Box3d(np.array(part.centre), 2 * np.array(part.half), np.eye(3))


def test_pairs_are_views_in_a_row_that_see_something_in_common():
    episode = moving_episode()
    (pair,) = view_pairs(episode.name, episode, MEMORY)
    assert pair.view_index == (0, 1)
    assert np.linalg.norm(pair.centre_m[:2]) < 1.5
    alone = orbit_episode(0, ring(0, views=3), size=(48, 48))  # 120 degrees from each other
    with pytest.raises(EpisodeFormatError, match="no two of its 3 views follow each other within 40 degrees"):
        view_pairs(alone.name, alone, MEMORY)
    blind = replace(episode, depth_m=np.zeros_like(episode.depth_m))
    with pytest.raises(EpisodeFormatError, match="with depth in both"):
        view_pairs(blind.name, blind, MEMORY)


def test_what_has_left_is_seen_through_and_what_stands_is_found_again():
    episode = moving_episode((0.0, 0.9))
    (pair,) = view_pairs(episode.name, episode, MEMORY)
    first, second = pair.views([0], 0), pair.views([1], 0)
    world_to_grid = np.linalg.inv(pair.grid_to_world(0))
    top_of = [np.array(part.centre) + np.array([0, 0, part.half[2]]) for part in (BOX, OTHER)]
    points = torch.from_numpy(np.stack([world_to_grid[:3, :3] @ one + world_to_grid[:3, 3] for one in top_of]))
    gone, found = compare_points(points[None].float(), second)
    assert gone.tolist() == [[True, False]]
    assert found.tolist() == [[False, True]]
    shares = seen_through(first, second, MEMORY.grid)
    truth = true_flow(episode, pair, MEMORY.grid)
    moving, standing = (truth.moves[0, 0] >= 0.5), (truth.known[0, 0] > 0) & (truth.moves[0, 0] == 0)
    assert shares[0, 0][moving].mean() > 0.5
    assert shares[0, 0][standing].mean() < 0.02
    assert shares[0, 1][standing].mean() > 0.6
    same = seen_through(first, first, MEMORY.grid)
    assert same[0, 0].max() == 0


def test_true_flow_is_that_of_objects_and_zero_elsewhere():
    episode = moving_episode()
    (pair,) = view_pairs(episode.name, episode, MEMORY)
    truth = true_flow(episode, pair, MEMORY.grid)
    moving = truth.moves[0, 0] >= 0.5
    flow = truth.flow_m[0][:, moving].double().numpy().T @ pair.grid_to_world(0)[:3, :3].T
    assert moving.sum() > 3
    assert np.allclose(flow, [0.25, 0.1, 0.0], atol=1e-3)
    assert truth.flow_m[0][:, ~moving].abs().max() == 0
    errors = endpoint_errors(0 * truth.flow_m, truth, truth.known)
    assert np.allclose(errors[0], np.hypot(0.25, 0.1), atol=1e-3)
    assert errors[1].max() == 0
    with pytest.raises(UsageError, match=r"has no motion\.json"):
        true_flow(replace(episode, motion=None), pair, MEMORY.grid)


def test_pairs_with_truth_are_learnt_from_in_either_order():
    episode = moving_episode()
    (pair,) = view_pairs("one", episode, MEMORY)
    known = TruePair.of(episode, pair, MEMORY.grid)
    for backwards, one in ((False, pair), (True, pair.chosen((1, 0)))):
        sample, truth = known.sample(backwards), true_flow(episode, one, MEMORY.grid)
        for name in ("flow_m", "moves", "known"):
            assert torch.equal(getattr(sample.truth, name), getattr(truth, name))
        assert truth.moves.sum() > 0
        assert torch.equal(sample.before.depth_m[0, 0], torch.from_numpy(one.depth_m[0]))
        assert torch.equal(sample.after.depth_m[0, 0], torch.from_numpy(one.depth_m[1]))


def test_what_is_to_be_found_moves_is_shown_and_lies_in_the_grid():
    episode = moving_episode()
    (pair,) = view_pairs(episode.name, episode, MEMORY)
    (one,) = moving_truths(episode, pair, MEMORY.grid)
    assert (one.instance_id, one.ignore) == (1, False)
    assert one.moved_m == pytest.approx(np.hypot(0.25, 0.1))
    small = replace(MEMORY, grid=GridSpec((4, 4, 4), 0.05))
    assert moving_truths(episode, pair, small.grid)[0].ignore
    slow = moving_episode((0.03, 0.0))
    assert moving_truths(slow, view_pairs("slow", slow, MEMORY)[0], MEMORY.grid)[0].ignore
    assert moving_truths(replace(episode, motion=None), pair, MEMORY.grid) == []


def test_flow_that_is_true_is_grouped_into_boxes_of_what_moves():
    episode = moving_episode()
    (pair,) = view_pairs(episode.name, episode, MEMORY)
    grid, grid_to_world = MEMORY.grid, pair.grid_to_world(0)
    truth = true_flow(episode, pair, grid)
    flow, moves = truth.flow_m[0].double().numpy(), truth.moves[0, 0].double().numpy()
    groups = group_flow(flow, moves, truth.known[0, 0].double().numpy(), grid)
    from labeling.memory.flow.flow_detector import points_of

    (found,) = boxes_of_groups(groups, flow, moves, points_of(pair, 0)[0], grid, grid_to_world, pair.floor_in_grid_m)
    assert box_iou_3d(found.box, box_of(BOX)) > 0.4  # a view shows two sides and the top of it
    assert np.allclose(found.displacement_m, [0.25, 0.1, 0.0], atol=1e-3)
    assert 0 < found.confidence <= 1
    assert group_flow(0 * flow, moves, truth.known[0, 0].double().numpy(), grid) == []


def test_neighbours_that_move_differently_are_several_objects():
    grid = GridSpec((4, 8, 8), 0.2)
    flow, moves = np.zeros((3, *grid.shape)), np.zeros(grid.shape)
    moves[1:3, 2:6, 2:6] = 1
    flow[0, 1:3, 2:6, 2:4], flow[0, 1:3, 2:6, 4:6] = 0.3, -0.3
    assert [len(one) for one in group_flow(flow, moves, np.ones(grid.shape), grid)] == [16, 16]
    flow[0] = np.abs(flow[0])
    assert [len(one) for one in group_flow(flow, moves, np.ones(grid.shape), grid)] == [32]


def test_made_up_motion_is_in_the_second_view_and_in_the_truth():
    episode = orbit_episode(3, ring(3, views=16), size=(96, 96))
    pair = view_pairs(episode.name, episode, MEMORY)[0]
    config = TrainFlowConfig(pieces=1, furthest_m=0.4)
    moved_any = 0
    for seed in range(8):
        moved, truth = with_moved_pieces(pair, MEMORY.grid, config, np.random.default_rng(seed))
        again, _ = with_moved_pieces(pair, MEMORY.grid, config, np.random.default_rng(seed))
        assert np.array_equal(moved.depth_m, again.depth_m)
        assert np.array_equal(moved.depth_m[0], pair.depth_m[0])
        assert np.array_equal(moved.rgb[0], pair.rgb[0])
        moves = truth.moves >= 0.5
        assert truth.flow_m.norm(dim=1).max() < 0.4 + 0.25
        assert truth.flow_m[~moves.expand(-1, 3, -1, -1, -1)].abs().max() == 0
        if moves.any():
            moved_any += 1
            assert not np.array_equal(moved.depth_m[1], pair.depth_m[1])
    assert moved_any >= 2


def test_the_flow_of_a_voxel_is_the_mean_of_its_points_that_move():
    grid = GridSpec((4, 4, 4), 1.0)
    points = np.array([[0.2, 0.2, 0.2], [0.4, 0.4, 0.4], [0.6, 0.6, 0.6], [-0.5, 0.5, 0.5], [9.0, 0.0, 0.0]])
    steps = np.array([[0.1, 0, 0], [0.3, 0, 0], [0, 0, 0], [0, 0, 0], [1, 1, 1]])
    truth = voxel_truth(points, points + steps, np.array([True, True, False, False, True]), grid)
    assert truth.known.sum() == 2
    assert truth.moves[0, 0, 2, 2, 2] == pytest.approx(2 / 3)
    assert truth.flow_m[0, :, 2, 2, 2].tolist() == pytest.approx([0.2, 0, 0])
    assert truth.flow_m[0, :, 2, 2, 1].tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (lambda: FlowSpec(MemorySpec("tower")), "flow is told of the volume of a memory, which tower does not have"),
        (lambda: FlowSpec(width=10), "a multiple of 4 up to 1024, not 10"),
    ],
)
def test_specs_that_make_no_sense_are_refused(spec, message):
    with pytest.raises(UsageError, match=message):
        spec()


def test_runs_on_other_episodes_of_the_same_names_are_told_apart():
    memory, config = build_memory(MEMORY), TrainFlowConfig(iterations=1, width=8)
    known = [view_pairs(one.name, one, MEMORY) for one in (moving_episode(), moving_episode((0.2, 0.0)))]
    one, other = [known[0]], [known[1]]
    parts = [(one, [], []), (other, [], []), (one, other, []), (one, [], other), (one, [], [])]
    tasks = [FlowTask(memory, learn, moving, held, config) for learn, moving, held in parts]
    assert len({json.dumps(task.identity["data"]) for task in tasks}) == 4
