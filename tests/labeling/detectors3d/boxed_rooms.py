"""Rooms with plain boxes in them, whose 3-D boxes are known exactly."""

import numpy as np

from labeling.core.episode import Episode
from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.types import Box3d, Detection, GroundTruth
from labeling.detectors3d.frustum_samples import FrustumSample, make_frustum_sample

from ..synthetic_room import Part, render

SIDES = {"crate": (1.0, 0.6, 0.5), "locker": (0.6, 0.4, 1.6)}
"""Length, width and height of each category."""


def upright(x: float, y: float, sides: tuple[float, float, float], yaw: float) -> Box3d:
    """A box on the floor."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Box3d(np.array([x, y, sides[2] / 2], float), np.array(sides, float), turn)


def boxed_room(seed: int, num_views: int = 6, size: tuple[int, int] = (96, 128)) -> Episode:
    """One episode around two to three boxes in the middle of a room, seen from a ring."""
    rng = np.random.default_rng(seed)
    spots = [(-0.9, 0.0), (0.7, 0.8), (0.7, -0.8)][: rng.integers(2, 4)]
    names = [str(rng.choice(list(SIDES))) for _ in spots]
    boxes = [
        upright(x + rng.uniform(-0.2, 0.2), y + rng.uniform(-0.2, 0.2), SIDES[name], rng.uniform(0, np.pi))
        for (x, y), name in zip(spots, names, strict=True)
    ]
    parts = [
        Part(
            tuple(box.centre_m.tolist()),
            tuple((box.extent_m / 2).tolist()),
            tuple(rng.uniform(0.2, 0.9, 3).tolist()),
            float(np.arctan2(box.rotation[1, 0], box.rotation[0, 0])),
            instance=number,
        )
        for number, box in enumerate(boxes, start=1)
    ]
    intrinsics = intrinsics_from_fov(size[1], size[0], np.deg2rad(80))
    rgb, depth, poses, truths = [], [], [], []
    for view in range(num_views):
        angle = 2 * np.pi * (view + rng.random()) / num_views
        pose = look_at(np.array([2.6 * np.cos(angle), 2.6 * np.sin(angle), 1.3]), np.array([0.0, 0.0, 0.5]))
        colour, depth_m, instance = render(parts, pose, intrinsics, *size)
        rgb.append(colour)
        depth.append(depth_m)
        poses.append(pose)
        truths += [
            GroundTruth(view, number, name, instance == number, None, box)
            for number, (name, box) in enumerate(zip(names, boxes, strict=True), start=1)
            if np.count_nonzero(instance == number) >= 40
        ]
    return Episode(
        name=f"boxed_{seed}",
        rgb=np.stack(rgb),
        depth_m=np.stack(depth),
        intrinsics=np.repeat(intrinsics[None], num_views, 0),
        camera_to_world=np.stack(poses),
        file_names=tuple(f"rgb/{view:03d}.png" for view in range(num_views)),
        detections=tuple(Detection(one.view_index, one.category, 0.9, one.modal) for one in truths),
        ground_truth=tuple(truths),
        categories=tuple(SIDES),
    )


def found_in(episode: Episode) -> tuple[Detection, ...]:
    """What the detector says."""
    assert episode.detections is not None
    return episode.detections


def known_of(episode: Episode) -> list[tuple[GroundTruth, Box3d]]:
    """What is true, and the boxes."""
    assert episode.ground_truth is not None
    return [(one, one.box_3d) for one in episode.ground_truth if one.box_3d is not None]


def frustum_samples_of(*seeds: int) -> list[FrustumSample]:
    """All objects in all views of some rooms."""
    found = []
    for seed in seeds:
        episode = boxed_room(seed)
        for number, (one, box) in enumerate(known_of(episode)):
            rng = np.random.default_rng([seed, number])
            sample = make_frustum_sample(episode, one.view_index, one.category, one.modal, box, 1.0, rng)
            if sample is not None:
                found.append(sample)
    return found
