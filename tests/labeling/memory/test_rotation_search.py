"""GRNN's search: the right bin of azimuth and elevation, on pairs of views of rooms."""

import numpy as np
import pytest
import torch

from labeling.memory.lifting.egomotion import coloured_volume
from labeling.memory.lifting.rotation_search import camera_in_gaze_grid, gaze_rotation, search_rotation
from labeling.memory.settings.grid_spec import GridSpec

from .orbits import orbit_episode, orbit_pose, tensor

SPEC = GridSpec((16, 32, 32), 0.16)
MIDDLE, DISTANCE_M = np.array([0.0, 0.0, 0.9]), 2.0
AZIMUTHS = torch.arange(18) * (2 * torch.pi / 18)
ELEVATIONS = torch.tensor([0.1, 0.35, 0.6])
WORLD_TO_GRID = torch.eye(4)
WORLD_TO_GRID[:3, 3] = -tensor(MIDDLE)


def coloured(episode, view: int, camera_to_grid: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """A batch of one."""
    volume, seen = coloured_volume(episode, view, camera_to_grid, SPEC)
    return volume[None], seen[None]


def test_a_gaze_grid_is_the_memory_turned_back():
    """Unprojection into the gaze-aligned grid, turned by the true angles, is unprojection into the memory's grid."""
    azimuth, elevation = 2.1, 0.35
    pose = orbit_pose(azimuth, elevation, DISTANCE_M, np.zeros(3))
    expected = torch.eye(4)
    expected[:3, :3] = gaze_rotation(azimuth, elevation)
    assert np.allclose((expected @ camera_in_gaze_grid(DISTANCE_M)).numpy(), pose, atol=1e-5)


@pytest.mark.slow
def test_the_right_bin_is_found_on_nine_pairs_of_ten():
    rng = np.random.default_rng(0)
    right = pairs = 0
    for seed in range(5):
        bins = [(int(rng.integers(18)), int(rng.integers(3))) for _ in range(3)]
        poses = [orbit_pose(float(AZIMUTHS[a]), float(ELEVATIONS[e]), DISTANCE_M, MIDDLE) for a, e in bins]
        episode = orbit_episode(seed, poses, (96, 96))
        memory = coloured(episode, 0, WORLD_TO_GRID @ tensor(poses[0]))
        for view in (1, 2):
            alone = coloured(episode, view, camera_in_gaze_grid(DISTANCE_M))
            found = search_rotation(*memory, *alone, AZIMUTHS, ELEVATIONS, SPEC)
            assert torch.isclose(found.probability.sum(), torch.tensor(1.0), atol=1e-4)
            assert found.correlation.abs().max() <= 1 + 1e-4
            pairs += 1
            right += found.best()[0].tolist() == list(bins[view])
    assert right >= 0.9 * pairs, f"{right} of {pairs}"


def test_the_stabilised_volume_is_that_of_the_right_bin():
    pose = orbit_pose(float(AZIMUTHS[4]), float(ELEVATIONS[1]), DISTANCE_M, MIDDLE)
    episode = orbit_episode(3, [pose], (96, 96))
    memory, seen = coloured(episode, 0, WORLD_TO_GRID @ tensor(pose))
    alone = coloured(episode, 0, camera_in_gaze_grid(DISTANCE_M))
    found = search_rotation(memory, seen, *alone, AZIMUTHS, ELEVATIONS, SPEC)
    assert found.best()[0].tolist() == [4, 1]
    assert found.probability[0, 4, 1] > 0.9
    assert torch.nn.functional.cosine_similarity(found.aligned.flatten(), memory.flatten(), dim=0) > 0.6
