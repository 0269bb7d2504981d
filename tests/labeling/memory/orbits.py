"""Views of rooms from around their middle, drawn by the tests' own ray caster, and boxes as analytic scenes."""

import numpy as np
import torch

from labeling.core.episode import Episode
from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.memory.settings.grid_spec import GridSpec

from ..synthetic_room import Part, render

SPEC = GridSpec((8, 16, 16), 0.32)


def toys(seed: int, count: int = 3) -> list[Part]:
    """Boxes and ellipsoids around the middle of a room, of strong colours."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        angle = 2 * np.pi * (number + rng.random() * 0.5) / count
        half = rng.uniform(0.2, 0.5, 3)
        spot = rng.uniform(0.5, 1.1) * np.array([np.cos(angle), np.sin(angle)])
        colour = tuple(rng.permutation([0.95, rng.uniform(0.1, 0.9), 0.05]).tolist())
        round_one = bool(rng.random() < 0.4)
        found.append(Part((*spot, half[2]), tuple(half), colour, rng.uniform(0, 3), round_one, number + 1))
    return found


def orbit_pose(azimuth_rad: float, elevation_rad: float, distance_m: float, middle: np.ndarray) -> np.ndarray:
    """A camera whose gaze has that heading, looks down by that elevation, and has the middle at that distance."""
    level = np.cos(elevation_rad)
    gaze = np.array([level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), -np.sin(elevation_rad)])
    return look_at(middle - distance_m * gaze, middle)


def orbit_episode(
    seed: int,
    poses: list[np.ndarray],
    size: tuple[int, int] = (64, 64),
    count: int = 3,
    standing: tuple[int, ...] | None = None,
) -> Episode:
    """One episode of ``toys`` from some poses; of these by their numbers, or of all."""
    intrinsics = intrinsics_from_fov(size[1], size[0], np.deg2rad(80))
    parts = toys(seed, count)
    shown = parts if standing is None else [parts[number] for number in standing]
    drawn = [render(shown, pose, intrinsics, *size, room_m=5.6) for pose in poses]
    return Episode(
        name=f"toys_{seed}",
        rgb=np.stack([rgb for rgb, _, _ in drawn]),
        depth_m=np.stack([depth for _, depth, _ in drawn]),
        intrinsics=np.repeat(intrinsics[None], len(poses), 0),
        camera_to_world=np.stack(poses),
        file_names=tuple(f"rgb/{view:03d}.png" for view in range(len(poses))),
    )


def ring(seed: int, views: int = 8, middle: tuple[float, float, float] = (0.0, 0.0, 0.7)) -> list[np.ndarray]:
    """Poses all around."""
    rng = np.random.default_rng(seed)
    return [
        orbit_pose(2 * np.pi * (v + rng.random()) / views, rng.uniform(0.2, 0.6), 2.0, np.array(middle))
        for v in range(views)
    ]


def tensor(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.asarray(array, np.float32))
