"""Poses that were shaken are found again, good ones are left alone, and what no view shows is not made up."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.pose_check import PoseCheck
from labeling.core.views import RgbdViews
from labeling.generator.poses.agreement import with_agreeing_poses
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.presets import PAPER, RELEASED

from ...synthetic_room import make_episode

VOXEL_M = 0.04
OFF, ON = LabelConfig(refine_poses="off"), LabelConfig(refine_poses="on")


@pytest.fixture(scope="module")
def room() -> RgbdViews:
    return make_episode(3, num_views=10, size=(96, 128), num_objects=5)


def shaken(views: RgbdViews, seed: int, degrees: float = 2.0, metres: float = 0.05, drift: bool = False) -> RgbdViews:
    """The views with poses off by so much (root mean square); with drift, the last one, after a random walk."""
    rng, count = np.random.default_rng(seed), views.num_views
    by = rng.normal(size=(count, 6)) * np.repeat([np.deg2rad(degrees), metres], 3) / np.sqrt(3)
    by = np.cumsum(by, axis=0) / np.sqrt(count) if drift else by
    poses = views.camera_to_world.copy()
    poses[:, :3, 3] += np.einsum("vab,vb->va", poses[:, :3, :3], by[:, 3:])
    poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(by[:, :3]).as_matrix()
    return replace(views, camera_to_world=poses)


def mend(views: RgbdViews, config: LabelConfig | None = None) -> tuple[RgbdViews, PoseCheck]:
    mended, check = with_agreeing_poses(views, VOXEL_M, config or LabelConfig())
    assert check is not None
    return mended, check


def errors(found: RgbdViews, true: RgbdViews):
    """Of poses, however they lie in the world: degrees and metres of each view."""
    turn = Rotation.from_matrix(true.camera_to_world[:, :3, :3] @ found.camera_to_world[:, :3, :3].transpose(0, 2, 1))
    mean = turn.mean()
    places = found.camera_to_world[:, :3, 3] @ mean.as_matrix().T
    offsets = true.camera_to_world[:, :3, 3] - places
    return np.degrees((turn * mean.inv()).magnitude()), np.linalg.norm(offsets - offsets.mean(axis=0), axis=1)


@pytest.mark.parametrize("drift", [False, True])
def test_shaken_poses_are_found_again(room, drift):
    views = shaken(room, seed=1, drift=drift)
    mended, check = mend(views)
    degrees, metres = errors(mended, room)
    assert degrees.max() < 0.25
    assert metres.max() < 0.015
    assert np.mean(errors(views, room)[0]) > 5 * np.mean(degrees)
    assert check.camera_to_world == mended.camera_to_world.tolist()
    assert (check.refined_residual_m or 1.0) < 0.3 * check.residual_m
    assert mended.rgb is views.rgb
    assert mended.depth_m is views.depth_m


def test_noise_of_depth_averages_out():
    noisy = make_episode(3, num_views=10, size=(96, 128), num_objects=5, depth_noise=0.008, depth_holes=0.1)
    mended, _ = mend(shaken(noisy, seed=2))
    degrees, metres = errors(mended, noisy)
    assert degrees.max() < 0.4
    assert metres.max() < 0.03


def test_corrections_have_no_common_part(room):
    views = shaken(room, seed=3)
    mended, _ = mend(views)
    turns = Rotation.from_matrix(
        mended.camera_to_world[:, :3, :3] @ views.camera_to_world[:, :3, :3].transpose(0, 2, 1)
    )
    assert np.degrees(turns.mean().magnitude()) < 0.5
    assert np.linalg.norm(np.mean(mended.camera_to_world - views.camera_to_world, axis=0)[:3, 3]) < 0.02


@pytest.mark.parametrize("config", [LabelConfig(), OFF, PAPER, RELEASED])
def test_good_poses_are_left_alone(room, config):
    same, check = mend(room, config)
    assert same is room
    assert check.warning is None
    assert check.camera_to_world is None
    assert max(check.moved_m) < 0.25 * VOXEL_M


@pytest.mark.parametrize("config", [OFF, PAPER, RELEASED])
def test_where_refining_is_off_it_is_told_and_not_done(room, config):
    views = shaken(room, seed=1)
    same, check = mend(views, config)
    assert same is views
    assert check.camera_to_world is None
    assert "--refine-poses auto would mend them" in (check.warning or "")


def test_the_warning_says_how_far_off_the_worst_view_is(room):
    poses = room.camera_to_world.copy()
    poses[4, :3, :3] = poses[4, :3, :3] @ Rotation.from_euler("y", 4.0, degrees=True).as_matrix()
    poses[4, :3, 3] += poses[4, :3, 0] * 0.1
    _, check = mend(replace(room, camera_to_world=poses))
    assert int(np.argmax(check.moved_m)) == 4 == int(np.argmax(check.view_residual_m))
    # A fifth of it or less goes to the others: what counts is how the views lie to each other.
    assert check.rotation_deg[4] == pytest.approx(4.0, abs=0.8)
    assert check.translation_m[4] == pytest.approx(0.1, abs=0.03)
    assert f"view 4 by {check.rotation_deg[4]:.1f} degrees" in (check.warning or "")


def test_poses_in_other_camera_axes_are_told_and_left(room):
    opengl = replace(room, camera_to_world=room.camera_to_world @ np.diag([1.0, -1.0, -1.0, 1.0]))
    same, check = mend(opengl)
    assert same is opengl
    assert "do not fit together under any poses nearby" in (check.warning or "")


def floor(num_views: int) -> RgbdViews:
    """Views from above on an endless grey floor: how they lie along it, nothing shows."""
    k, (height, width) = intrinsics_from_fov(96, 72, np.deg2rad(60)), (72, 96)
    poses = np.stack(
        [look_at(np.array([0.2 * n, 0.1 * n, 2.0]), np.array([0.2 * n, 0.1 * n + 0.9, 0.0])) for n in range(num_views)]
    )
    y, x = np.mgrid[0:height, 0:width]
    rays = np.stack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones(x.shape)], axis=-1)
    depth = np.stack([-pose[2, 3] / (rays @ pose[2, :3]) for pose in poses]).astype(np.float32)
    rgb = np.full((num_views, height, width, 3), 128, np.uint8)
    return RgbdViews(rgb, depth, np.repeat(k[None], num_views, axis=0), poses)


def test_what_no_view_shows_stays_put():
    true = floor(6)
    rng, lifted = np.random.default_rng(0), true.camera_to_world.copy()
    lifted[:, 2, 3] += rng.normal(0, 0.05, 6)
    mended, check = mend(replace(true, camera_to_world=lifted), ON)
    change = mended.camera_to_world - lifted
    assert check.camera_to_world is not None
    # Heights agree again; no view has slid along the floor, nor turned on it.
    heights = mended.camera_to_world[:, 2, 3]
    assert np.ptp(heights) < 0.005 < np.ptp(lifted[:, 2, 3])
    assert np.abs(change[:, :2, 3]).max() < 0.005
    assert (
        np.abs(
            Rotation.from_matrix(mended.camera_to_world[:, :3, :3] @ lifted[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
        ).max()
        < 0.003
    )


def test_noise_hardly_moves_what_no_view_shows():
    true, rng = floor(6), np.random.default_rng(1)
    lifted = true.camera_to_world.copy()
    lifted[:, 2, 3] += rng.normal(0, 0.05, 6)
    noisy = true.depth_m + rng.normal(0, 0.002, true.depth_m.shape).astype(np.float32) * true.depth_m**2
    mended, _ = mend(replace(true, camera_to_world=lifted, depth_m=noisy), ON)
    assert np.ptp(mended.camera_to_world[:, 2, 3]) < 0.005
    assert np.abs((mended.camera_to_world - lifted)[:, :2, 3]).max() < 0.02


def test_the_right_poses_of_a_floor_stay():
    views = floor(4)
    same, check = mend(views, ON)
    assert same is views
    assert check.warning is None


def test_views_that_share_nothing_are_not_compared(room):
    apart = room.camera_to_world.copy()
    apart[:, 0, 3] += 100.0 * np.arange(room.num_views)
    views = replace(room, camera_to_world=apart)
    assert with_agreeing_poses(views, VOXEL_M, LabelConfig()) == (views, None)


@pytest.mark.parametrize("depth_m", [0.0, 2.0])
def test_one_view_or_none_with_depth_is_no_error(depth_m):
    views = RgbdViews(
        np.zeros((1, 40, 60, 3), np.uint8),
        np.full((1, 40, 60), depth_m, np.float32),
        intrinsics_from_fov(60, 40, 1.0)[None],
        np.eye(4)[None],
    )
    assert with_agreeing_poses(views, VOXEL_M, ON) == (views, None)


def test_the_number_of_threads_changes_nothing(room, threads_told):
    views, found = shaken(room, seed=4), []
    for threads in (1, 3):
        threads_told(threads)
        found.append(with_agreeing_poses(views, VOXEL_M, LabelConfig()))
    assert found[0][1] == found[1][1]
    assert found[0][0].camera_to_world.tobytes() == found[1][0].camera_to_world.tobytes()


@pytest.mark.slow
def test_a_single_wrong_pose_among_many_is_mended():
    true = make_episode(3, num_views=24, size=(96, 128), num_objects=5, depth_noise=0.004)
    poses = true.camera_to_world.copy()
    poses[5, :3, 3] += [0.1, 0.0, 0.0]
    mended, check = mend(replace(true, camera_to_world=poses))
    assert int(np.argmax(check.moved_m)) == 5
    # The other 23 views hide it: all residuals together hardly fall.
    assert (check.refined_residual_m or 0.0) > 0.6 * check.residual_m
    assert "in view 5 by" in (check.warning or "")
    degrees, metres = errors(mended, true)
    assert degrees.max() < 0.25
    assert metres.max() < 0.015


@pytest.mark.slow
@pytest.mark.parametrize("bend", [0.02, 0.04])
def test_a_sensor_that_bends_walls_is_no_wrong_pose(bend):
    true = make_episode(3, num_views=24, size=(96, 128), num_objects=5)
    bent = true.depth_m * (1 + bend * np.linspace(-1, 1, 128) ** 2).astype(np.float32)
    same, check = mend(replace(true, depth_m=bent))
    assert same.camera_to_world is true.camera_to_world
    assert check.camera_to_world is None
