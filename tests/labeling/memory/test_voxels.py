"""Laws of unprojection, stabilisation, running mean and projection, against analytic scenes and brute force."""

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.errors import UsageError
from labeling.core.geometry import invert_rigid, look_at, project, unproject_depth
from labeling.memory.lifting.placement import (
    fixated_point,
    floor_height,
    grid_and_floor,
    grid_centre,
    place_grid,
)
from labeling.memory.lifting.projection import composite, plane_depths, project_planes
from labeling.memory.lifting.running_mean import RunningMean, mean_over_views
from labeling.memory.lifting.stabilisation import warp
from labeling.memory.lifting.unprojection import (
    depth_points,
    free_space,
    occupancy,
    scaled_intrinsics,
    unproject_features,
)
from labeling.memory.lifting.voxel_grid import invert, sample_grid, transform, voxel_centres, voxel_of
from labeling.memory.settings.grid_spec import GridSpec

from .orbits import SPEC, orbit_episode, ring, tensor


def rigid(yaw: float, pitch: float, shift: tuple[float, float, float]) -> torch.Tensor:
    c, s, d, e = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[d, 0, e], [0, 1, 0], [-e, 0, d]])
    matrix[:3, 3] = shift
    return tensor(matrix)[None]


@pytest.mark.parametrize(("shape", "voxel"), [((2, 8, 8), 0.1), ((8, 8, 8), 0.0), ((8, 8, 8), float("nan"))])
def test_grids_that_make_no_sense_are_refused(shape, voxel):
    with pytest.raises(UsageError, match="a grid has 4 to 512 voxels"):
        GridSpec(shape, voxel)


def test_every_voxel_centre_lies_in_its_voxel():
    centres = voxel_centres(SPEC).reshape(-1, 3)
    index, inside = voxel_of(SPEC, centres)
    assert inside.all()
    assert torch.equal(index, torch.arange(len(centres)))
    beyond = torch.tensor([[2.57, 0, 0], [0, -2.57, 0], [0, 0, 1.29], [torch.nan, 0, 0]])
    assert not voxel_of(SPEC, beyond)[1].any()


def test_samples_at_voxel_centres_are_the_voxels_and_in_between_trilinear():
    volume = torch.rand(2, 3, *SPEC.shape)
    centres = voxel_centres(SPEC)
    at_centres = sample_grid(volume, centres.expand(2, *centres.shape), SPEC)
    assert torch.allclose(at_centres, volume, atol=1e-5)
    point = centres[3, 4, 5] + SPEC.voxel_m * torch.tensor([0.25, 0.5, 0.75])
    expected = torch.zeros(2, 3)
    for z, y, x in itertools.product((0, 1), repeat=3):
        weight = (0.25 if x else 0.75) * 0.5 * (0.75 if z else 0.25)
        expected += weight * volume[:, :, 3 + z, 4 + y, 5 + x]
    assert torch.allclose(sample_grid(volume, point.expand(2, 1, 3), SPEC)[..., 0], expected, atol=1e-5)


# Unprojection --------------------------------------------------------------------------------------------------------


def plane_view(height_m: float, size: int = 256) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Depth (1, h, w), K and pose in the grid of a camera that looks down at a level plane."""
    pose = look_at(np.array([-1.7, 0.2, 1.1]), np.array([0.3, 0.0, height_m]))
    intrinsics = np.array([[size * 0.7, 0, (size - 1) / 2], [0, size * 0.7, (size - 1) / 2], [0, 0, 1.0]])
    y, x = np.mgrid[:size, :size]
    rays = np.stack([(x - intrinsics[0, 2]) / intrinsics[0, 0], (y - intrinsics[1, 2]) / intrinsics[1, 1]], -1)
    down = np.concatenate([rays, np.ones_like(rays[..., :1])], -1) @ pose[2, :3]
    with np.errstate(divide="ignore"):
        depth = np.where(down < -1e-6, (height_m - pose[2, 3]) / down, 0.0)
    return tensor(depth)[None], tensor(intrinsics)[None], tensor(pose)[None]


def test_occupancy_of_a_plane_is_exactly_the_layer_of_voxels_that_it_passes_through():
    height_m = -0.45
    depth, intrinsics, pose = plane_view(height_m)
    found = occupancy(depth, intrinsics, pose, SPEC)[0, 0]
    layer = int((height_m + SPEC.extent_m[2] / 2) / SPEC.voxel_m)
    assert found.sum() == found[layer].sum() > 50
    centres = voxel_centres(SPEC)[layer].reshape(-1, 3).double().numpy()
    centres[:, 2] = height_m
    pixels, depth_m = project(centres, intrinsics[0].double().numpy(), pose[0].double().numpy())
    visible = (depth_m > 0) & np.all((pixels > 0) & (pixels < 255), axis=1)
    assert found[layer].reshape(-1)[torch.from_numpy(visible)].min() == 1


def test_features_on_a_plane_are_exact():
    """The picture is affine in pixels, so that bilinear samples of it are exact."""
    _, intrinsics, pose = plane_view(-0.48, size=64)  # a layer of voxel centres
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    features = torch.stack([2 * x - y, 0.5 * y + 3])[None]
    found = unproject_features(features, intrinsics, pose, SPEC)[0]
    pixels, depth_m = project(
        voxel_centres(SPEC).reshape(-1, 3).double().numpy(), intrinsics[0].double().numpy(), pose[0].double().numpy()
    )
    inside = (depth_m > 0.1) & np.all((pixels >= 0) & (pixels <= 63), axis=1)
    expected = np.stack([2 * pixels[:, 0] - pixels[:, 1], 0.5 * pixels[:, 1] + 3])[:, inside]
    assert np.abs(found.reshape(2, -1)[:, inside].numpy() - expected).max() < 1e-2
    outside = (depth_m < 0) | np.any((pixels < -1) | (pixels > 64), axis=1)
    assert found.reshape(2, -1)[:, outside].abs().max() == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_occupied_voxels_lie_within_a_voxel_of_the_surface(seed):
    """Brute force: the distance of every occupied voxel's centre to the nearest point of a far denser depth image."""
    poses = ring(seed, 3)
    coarse, fine = orbit_episode(seed, poses), orbit_episode(seed, poses, (256, 256))
    for view in range(3):
        camera = coarse.camera(view)
        found = occupancy(
            tensor(coarse.depth_m[view])[None],
            tensor(camera.intrinsics)[None],
            tensor(camera.camera_to_world)[None],
            SPEC,
        )
        occupied = voxel_centres(SPEC)[found[0, 0] > 0].numpy()
        surface, _ = unproject_depth(fine.depth_m[view], fine.intrinsics[view], fine.camera_to_world[view])
        nearest = [np.linalg.norm(surface - centre, axis=1).min() for centre in occupied]
        assert len(nearest) > 30
        assert np.mean(np.array(nearest) <= SPEC.voxel_m) >= 0.95


def test_free_voxels_lie_before_the_surface():
    """Their centres, seen in a far denser depth image."""
    poses = ring(5, 4)
    coarse, fine = orbit_episode(5, poses), orbit_episode(5, poses, (256, 256))
    found = free_space(tensor(coarse.depth_m), tensor(coarse.intrinsics), tensor(coarse.camera_to_world), SPEC)
    for view in range(4):
        centres = voxel_centres(SPEC)[found[view, 0] > 0].double().numpy()
        assert len(centres) > 30
        pixels, depth_m = project(centres, fine.intrinsics[view], fine.camera_to_world[view])
        x, y = np.clip(np.rint(pixels).astype(int), 0, 255).T
        assert np.mean(depth_m < fine.depth_m[view][y, x]) > 0.97


def test_gradients_reach_the_features_of_the_picture():
    episode = orbit_episode(1, ring(1, 2))
    features = torch.rand(2, 4, 32, 32, requires_grad=True)
    half = scaled_intrinsics(tensor(episode.intrinsics), 0.5, 0.5)
    pose = tensor(episode.camera_to_world)
    mask = occupancy(tensor(episode.depth_m), tensor(episode.intrinsics), pose, SPEC)
    (unproject_features(features, half, pose, SPEC) * mask).sum().backward()
    assert features.grad is not None
    assert (features.grad != 0).float().mean() > 0.2


def test_scaled_intrinsics_see_the_same_points():
    """A point at pixel x of the large picture lies at the same share of the small one."""
    intrinsics = torch.tensor([[[100.0, 0, 40], [0, 90.0, 33], [0, 0, 1]]])
    half = scaled_intrinsics(intrinsics, 0.5, 0.25)[0]
    for large, small, scale in ((intrinsics[0, 0], half[0], 0.5), (intrinsics[0, 1], half[1], 0.25)):
        axis = 0 if scale == 0.5 else 1
        at = large[axis] * 0.3 + large[2], small[axis] * 0.3 + small[2]
        assert torch.isclose((at[0] + 0.5) * scale, at[1] + 0.5)


def test_points_of_depth_are_those_of_the_numpy_geometry():
    episode = orbit_episode(2, ring(2, 1))
    points = depth_points(tensor(episode.depth_m), tensor(episode.intrinsics), tensor(episode.camera_to_world))
    expected, _ = unproject_depth(episode.depth_m[0], episode.intrinsics[0], episode.camera_to_world[0])
    assert np.abs(points[0].reshape(-1, 3).numpy() - expected).max() < 1e-4


# Stabilisation -------------------------------------------------------------------------------------------------------


def smooth_volume(waves: float = 1.2) -> torch.Tensor:
    centres = voxel_centres(SPEC)
    return torch.stack([torch.sin(waves * centres[..., 0]), torch.cos(waves * (centres[..., 1] + centres[..., 2]))])[
        None
    ]


@settings(max_examples=25)
@given(
    st.floats(-3.1, 3.1),
    st.floats(-0.3, 0.3),
    st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-0.2, 0.2)),
)
def test_a_warp_and_its_inverse_are_the_identity_inside_the_common_volume(yaw, pitch, shift):
    volume, matrix = smooth_volume(), rigid(yaw, pitch, shift)
    there_and_back = warp(warp(volume, matrix, SPEC), invert(matrix), SPEC)
    reach = warp(warp(torch.ones(1, 1, *SPEC.shape), matrix, SPEC), invert(matrix), SPEC)
    common = reach[0, 0] > 0.999
    assert common.sum() > 50
    assert (there_and_back - volume)[0][:, common].abs().max() < 0.1  # two trilinear samplings of a wave


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_warps_by_quarter_turns_and_whole_voxels_move_voxels(quarter):
    volume = torch.rand(1, 2, *SPEC.shape)
    turned = warp(volume, rigid(quarter * np.pi / 2, 0.0, (0, 0, 0)), SPEC)
    # new(p) = old(R p), of integer coordinates in half voxels from the middle.
    y, x = np.mgrid[-15:16:2, -15:16:2]
    for _ in range(quarter):
        x, y = -y, x
    assert torch.allclose(turned, volume[:, :, :, (y + 15) // 2, (x + 15) // 2], atol=1e-4)
    moved = warp(volume, rigid(0.0, 0.0, (2 * SPEC.voxel_m, 0, 0)), SPEC)
    assert torch.allclose(moved[..., :-2], volume[..., 2:], atol=1e-4)
    assert moved[..., -2:].abs().max() < 1e-4


def test_occupancy_seen_from_a_moved_grid_is_the_warped_one():
    """Stabilisation agrees with unprojecting into the moved grid, as far as voxels can."""
    episode = orbit_episode(3, ring(3, 1), (128, 128))
    pose, new_to_old = tensor(episode.camera_to_world), rigid(0.5, 0.0, (0.3, -0.2, 0.1))
    arguments = tensor(episode.depth_m), tensor(episode.intrinsics)
    warped = warp(occupancy(*arguments, pose, SPEC), new_to_old, SPEC)
    direct = occupancy(*arguments, invert(new_to_old) @ pose, SPEC)
    reached = warp(torch.ones(1, 1, *SPEC.shape), new_to_old, SPEC) > 0.999
    seen = warped[(direct > 0) & reached]
    assert (seen > 0.05).float().mean() > 0.9
    assert torch.allclose(
        transform(invert(new_to_old), transform(new_to_old, torch.ones(1, 5, 3))), torch.ones(1, 5, 3)
    )


# Memory, projection --------------------------------------------------------------------------------------------------


@settings(max_examples=10)
@given(st.permutations(range(4)))
def test_the_mean_does_not_depend_on_the_order_and_ignores_what_was_not_seen(order):
    generator = torch.Generator().manual_seed(1)
    volumes = torch.rand(2, 4, 3, 4, 5, 6, generator=generator)
    weights = (torch.rand(2, 4, 1, 4, 5, 6, generator=generator) > 0.5).float()
    mean = mean_over_views(volumes, weights)
    memory = RunningMean.of(volumes[:, order[0]], weights[:, order[0]])
    for view in order[1:]:
        memory = memory.updated(volumes[:, view], weights[:, view])
    assert torch.allclose(memory.mean(), mean, atol=1e-5)
    for b, z, y, x in itertools.product(range(2), range(4), range(5), range(6)):
        seen = [volumes[b, v, :, z, y, x] for v in range(4) if weights[b, v, 0, z, y, x]]
        expected = torch.stack(seen).mean(dim=0) if seen else torch.zeros(3)
        assert torch.allclose(mean[b, :, z, y, x], expected, atol=1e-5)


def test_planes_sample_the_memory_where_the_view_looks():
    pose = tensor(look_at(np.array([-2.0, 0.5, 0.8]), np.zeros(3)))[None]
    intrinsics = torch.tensor([[[8.0, 0, 7.5], [0, 8.0, 7.5], [0, 0, 1]]])
    depths = plane_depths(pose, SPEC, 10)
    assert torch.all(depths[:, 1:] > depths[:, :-1])
    volume = torch.rand(1, 2, *SPEC.shape)
    planes = project_planes(volume, intrinsics, pose, (16, 16), depths, SPEC)
    assert planes.shape == (1, 2, 10, 16, 16)
    in_camera = torch.tensor([(5 - 7.5) / 8, (9 - 7.5) / 8, 1.0]) * depths[0, 6]
    point = pose[0, :3, :3] @ in_camera + pose[0, :3, 3]
    assert torch.allclose(planes[0, :, 6, 9, 5], sample_grid(volume, point.view(1, 1, 3), SPEC)[0, :, 0], atol=1e-5)


def test_what_was_unprojected_is_projected_back_into_the_view():
    """Colours of a room, put into voxels and seen from where they were seen, correlate with the picture."""
    episode = orbit_episode(4, ring(4, 1))
    spec = GridSpec((32, 64, 64), 0.08)
    rgb, pose, intrinsics = (
        tensor(episode.rgb).permute(0, 3, 1, 2) / 255,
        tensor(episode.camera_to_world),
        tensor(episode.intrinsics),
    )
    pose = pose.clone()
    pose[:, 2, 3] -= 1.0  # the grid's middle, a metre above the floor
    mask = occupancy(tensor(episode.depth_m), intrinsics, pose, spec)
    coloured = torch.cat([unproject_features(rgb, intrinsics, pose, spec) * mask, mask], dim=1)
    planes = project_planes(coloured, intrinsics, pose, (64, 64), plane_depths(pose, spec, 96), spec)
    seen, weights = composite(planes[:, :3] / planes[:, 3:].clamp(min=1e-3), (4 * planes[:, 3:]).clamp(max=1))
    covered = weights.sum(dim=1)[0] > 0.9
    assert covered.float().mean() > 0.5
    assert (seen - rgb)[0][:, covered].abs().mean() < 0.08


def test_the_nearest_opaque_plane_hides_those_behind():
    planes, alpha = torch.rand(1, 3, 4, 2, 2), torch.zeros(1, 1, 4, 2, 2)
    alpha[:, :, 1] = 1.0
    alpha[:, :, 3] = 1.0
    seen, weights = composite(planes, alpha)
    assert torch.allclose(seen, planes[:, :, 1])
    assert torch.equal(weights.sum(dim=1), torch.ones(1, 2, 2))
    alpha[:, :, 1] = 0.25
    seen, _ = composite(planes, alpha)
    assert torch.allclose(seen, 0.25 * planes[:, :, 1] + 0.75 * planes[:, :, 3])


# Placement -----------------------------------------------------------------------------------------------------------


def test_the_fixated_point_is_found_though_some_views_look_elsewhere():
    poses = [
        *ring(0, 10),
        look_at(np.array([1.0, 1, 1.5]), np.array([2.0, 2, 1])),
        look_at(np.array([1.0, 1, 1.5]), np.array([0, 3.0, 1])),
    ]
    found = fixated_point(orbit_episode(0, poses, (8, 8)))
    assert found is not None
    assert np.linalg.norm(found - [0, 0, 0.7]) < 0.05
    assert fixated_point(orbit_episode(0, poses[:1], (8, 8))) is None


def test_a_grid_begins_below_the_floor_and_has_the_first_view_along_x():
    episode = orbit_episode(0, ring(0, 6))
    centre = grid_centre(episode, SPEC)
    assert np.linalg.norm(centre[:2]) < 0.05
    assert centre[2] - SPEC.extent_m[2] / 2 == pytest.approx(-SPEC.voxel_m, abs=0.02)
    grid_to_world = place_grid(centre, episode.camera_to_world[2])
    camera_to_grid = invert_rigid(grid_to_world) @ episode.camera_to_world[2]
    assert camera_to_grid[1, 2] == pytest.approx(0, abs=1e-9)
    assert camera_to_grid[0, 2] > 0
    assert np.allclose(grid_to_world[:3, 2], [0, 0, 1])
    down = np.eye(4)
    down[:3, :3] = np.diag([1.0, -1, -1])
    assert np.allclose(place_grid(centre, down)[:2, 0], [0, 1])
    around_scene = grid_centre(episode, SPEC, "scene")
    assert np.all(np.abs(around_scene[:2]) < 1.5)


def test_the_floor_is_known_where_the_grid_begins_below_it_and_else_not():
    episode = orbit_episode(0, ring(0, 6))
    centre, floor_m = grid_and_floor(episode, SPEC)
    assert floor_m is not None
    assert floor_m == pytest.approx(0, abs=0.02)
    assert centre[2] == pytest.approx(floor_m - SPEC.voxel_m + SPEC.extent_m[2] / 2)
    low = GridSpec((4, 16, 16), 0.1)  # ends below the point that the cameras look at
    centre, floor_m = grid_and_floor(episode, low)
    assert floor_m is None
    assert centre[2] == pytest.approx(0.7, abs=0.05)
    assert floor_height(np.array([[9.0, 9.0, 0.0]]), np.zeros(3), SPEC) is None
