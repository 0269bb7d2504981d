"""Estimated motion of the camera: against poses that are known, in a room drawn by the tests' own ray caster."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.cache.egomotion import METHODS, PairsToAlign, error, motion_errors, with_icp_poses
from experiments.cache.stages import RunContext
from labeling.io.episodes import write_episode
from labeling.memory.settings.memory_spec import MemorySize

from ...labeling.memory.orbits import orbit_episode, orbit_pose

POSES = [orbit_pose(azimuth, 0.4, 2.0, np.array([0.0, 0.0, 0.7])) for azimuth in (0.5, 0.7, 0.9, 1.1)]


def test_errors_are_those_of_transforms_made_by_hand() -> None:
    true = np.eye(4)
    turned = np.array([[0.0, -1, 0, 0.3], [1, 0, 0, 0], [0, 0, 1, 0.4], [0, 0, 0, 1]])
    assert error(true, true) == {"turn_deg": 0, "shift_cm": 0}
    assert error(turned, true) == pytest.approx({"turn_deg": 90, "shift_cm": 50})


@pytest.mark.slow
def test_a_chain_of_icp_gives_back_the_poses() -> None:
    """Of the views that are asked for, in the frame of the one whose pose is known; the other poses are not read."""
    episode = orbit_episode(1, POSES, (96, 96))
    lost = [np.full((4, 4), np.nan)] * 2
    blind = replace(episode, camera_to_world=np.stack([*lost, POSES[2], lost[0]]))
    found = with_icp_poses(blind, [1, 2, 3], anchor=2)
    assert found.file_names == episode.file_names[1:]
    assert np.array_equal(found.depth_m, episode.depth_m[1:])
    for pose, true in zip(found.camera_to_world, POSES[1:], strict=True):
        apart = error(pose, true)
        assert apart["turn_deg"] < 1
        assert apart["shift_cm"] < 3


@pytest.mark.slow
def test_errors_of_pairs_of_an_episode(tmp_path: Path) -> None:
    folder = tmp_path / "rooms" / "0000"
    write_episode(folder, replace(orbit_episode(1, POSES, (96, 96)), name="0000"))
    job = PairsToAlign(folder, MemorySize(), "fixated", pairs=1)
    pairs = motion_errors([job], RunContext("smoke", (0,), 1, tmp_path / "cache"))
    (pair,) = pairs
    assert set(pair) == set(METHODS)
    assert pair["none"]["turn_deg"] == pytest.approx(11, abs=2)
    assert pair["ICP"]["turn_deg"] < pair["alignment"]["turn_deg"] < pair["none"]["turn_deg"]
