"""Coarse-to-fine alignment with six degrees of freedom, against brute force and true poses."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch

from labeling.memory.lifting import rigid_alignment
from labeling.memory.lifting.egomotion import motion_between
from labeling.memory.lifting.rigid_alignment import align
from labeling.memory.lifting.voxel_grid import invert

from .orbits import orbit_episode, orbit_pose, tensor
from .test_rotation_search import MIDDLE, SPEC, WORLD_TO_GRID, coloured


def test_scores_of_shifts_are_those_of_shifting_by_brute_force():
    torch.manual_seed(0)
    shape, window = (5, 6, 7), 2
    memory, other = torch.randn(3, *shape), torch.randn(3, *shape)
    seen, other_seen = ((torch.rand(1, *shape) > 0.4).float() for _ in range(2))
    found = rigid_alignment._scores(memory * seen, seen, other * other_seen, other_seen, window)
    for z, y, x in itertools.product(range(-window, window + 1), repeat=3):
        moved, moved_seen = torch.zeros_like(other), torch.zeros_like(seen)
        for p in itertools.product(*(range(side) for side in shape)):
            q = (p[0] - z, p[1] - y, p[2] - x)
            if all(0 <= a < b for a, b in zip(q, shape, strict=True)):
                moved[:, *p], moved_seen[:, *p] = (other * other_seen)[:, *q], other_seen[:, *q]
        product = (memory * seen * moved).sum()
        energy = ((memory * seen).square() * moved_seen).sum() * (moved.square() * seen).sum()
        whole = (memory * seen).square().sum() * (other * other_seen).square().sum()
        floor = max(rigid_alignment.LEAST_ENERGY, rigid_alignment.LEAST_SHARED * float(whole.sqrt()))
        expected = product / max(float(energy.sqrt()), floor)
        assert found[z + window, y + window, x + window] == pytest.approx(float(expected), abs=1e-4)


def test_a_parabola_tells_fractions_of_a_voxel():
    z, y, x = np.mgrid[-2:3, -2:3, -2:3]
    scores = 1 - (x - 0.3) ** 2 - (y + 0.4) ** 2 - 0.5 * (z - 1.2) ** 2
    found = rigid_alignment._peak(tensor(0.01 * scores))
    assert np.allclose(found.numpy(), [0.3, -0.4, 1.2], atol=1e-4)


def apart(one: torch.Tensor, other: torch.Tensor) -> tuple[float, float]:
    """Angle in degrees and distance of two transforms."""
    turn = one[:3, :3].T @ other[:3, :3]
    return float(torch.rad2deg(torch.acos(((turn.trace() - 1) / 2).clamp(-1, 1)))), float((one - other)[:3, 3].norm())


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "between_rad"), [(0, 0.0), (1, 0.7)])
def test_a_view_is_found_within_a_voxel_and_a_few_degrees(seed, between_rad):
    """A grid that is half a metre and 20 degrees off where odometry takes it to be; the same view, and another one."""
    poses = [orbit_pose(float(azimuth), 0.4, 2.0, MIDDLE) for azimuth in (1.0, 1.0 + between_rad)]
    episode = orbit_episode(seed, poses, (96, 96))
    truth = rigid_alignment._rotation(0.35 * (-1) ** seed, 0.06, -0.08)
    truth[:3, 3] = torch.tensor([0.35, -0.3, 0.15])
    memory, memory_seen = coloured(episode, 0, WORLD_TO_GRID @ tensor(poses[0]))
    view, view_seen = coloured(episode, 1, invert(truth) @ WORLD_TO_GRID @ tensor(poses[1]))
    found = align(memory[0], memory_seen[0], view[0], view_seen[0], SPEC)
    before, after = apart(torch.eye(4), truth), apart(found.view_to_memory, truth)
    assert before[0] > 20
    assert before[1] > 0.45
    assert after[0] < 3
    assert after[1] < SPEC.voxel_m
    assert found.correlation > 0.4


@pytest.mark.slow
def test_the_motion_between_two_views_of_a_room_is_found():
    """In the frame of the first camera, from no more than pictures and depth: the second pose is made wrong."""
    poses = [orbit_pose(azimuth, 0.4, 2.0, MIDDLE) for azimuth in (1.0, 1.35)]
    episode = orbit_episode(2, poses, (96, 96))
    wrong = replace(episode, camera_to_world=np.stack([poses[0], orbit_pose(4.0, 0.1, 3.0, MIDDLE)]))
    found = tensor(motion_between(wrong, 0, 1, SPEC))
    truth = tensor(np.linalg.inv(poses[0]) @ poses[1])
    assert apart(torch.eye(4), truth)[0] > 15
    turn_deg, shift_m = apart(found, truth)
    assert turn_deg < 5
    assert shift_m < SPEC.voxel_m
