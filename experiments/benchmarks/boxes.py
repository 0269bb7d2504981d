"""3-D boxes per second: the frustum PointNet beside LDLS, on the same detections of the same views."""

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from experiments.benchmarks.rows import Row, log, median_seconds

if TYPE_CHECKING:
    from labeling.core.episode import Episode
    from labeling.detectors3d.ldls import LdlsConfig

OBJECTS = 6
"""In the view."""
SIZE = (256, 256)
TOWN = "town/train/00"
"""Where the street picture is taken: the robot's first view there."""
STREET_DETECTORS = ("simulated", "compact")
"""Whose detections are lifted: the first finds few objects, the second many, most of them at low confidence."""
CATEGORIES = ("chair", "couch", "table")


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row, per frame of a room with six detections; nothing depends on what the networks have learnt.

    Args:
        quick: few repetitions.
    """
    import torch

    from labeling.detectors3d.frustum_detector import FrustumDetector
    from labeling.detectors3d.frustum_pointnet import FrustumNet, FrustumSpec
    from labeling.detectors3d.ldls import Ldls, LdlsConfig, diffuse

    log(f"torch {torch.__version__}, {torch.get_num_threads()} threads")
    repeats = 1 if quick else 7
    frame = view_of_boxes()
    detections = frame.detections or ()
    baseline = median_seconds(lambda: Ldls().lift(frame, detections), 1 if quick else 3)
    for width, points in ((1.0, 1024), (0.5, 512)):
        torch.manual_seed(0)
        spec = FrustumSpec(CATEGORIES, ((1.0, 1.0, 1.0),) * len(CATEGORIES), width, points)
        detector = FrustumDetector(FrustumNet(spec), "bench")
        seconds = median_seconds(lambda which=detector: which.lift(frame, detections), repeats)
        what = f"frustum PointNet, {points} points, width {width:g}, {SIZE[1]}x{SIZE[0]}, {len(detections)} detections"
        yield Row(what, "LDLS to convergence, every second pixel", seconds, baseline)
    config = LdlsConfig()
    for detector in STREET_DETECTORS:
        street = street_view(detector)
        problem = diffusion_of(street, config)
        height, width = street.size
        what = f"{width}x{height}, {len(street.detections or ())} detections ({detector})"
        yield Row(
            f"LDLS' diffusion in a street picture, {what}, one factorisation",
            "bi-conjugate gradients, object after object (residual 1e-4)",
            median_seconds(lambda given=problem: diffuse(*given), 1 if quick else 3),
            median_seconds(lambda given=problem: diffuse_iteratively(*given), 1 if quick else 3),
        )
        whole = median_seconds(lambda seen=street: Ldls(config).lift(seen, seen.detections or ()), 1 if quick else 3)
        yield Row(
            f"LDLS, a street picture as a whole, {what}",
            "",
            whole,
            None,
            target="<= 2 s",
            holds=whole <= 2.0,
        )


def diffusion_of(frame: "Episode", config: "LdlsConfig") -> tuple[Any, ...]:
    """What ``labeling.detectors3d.ldls.diffuse`` is asked for in a view of one episode."""
    from labeling.detectors3d.ldls import diffusion_problem, sparse_points

    points, pixels = sparse_points(frame.depth_m[0], frame.intrinsics[0], frame.camera_to_world[0], config.stride)
    return diffusion_problem(points, pixels, np.stack([one.mask for one in frame.detections or ()]), config)


def diffuse_iteratively(graph: Any, pixel_labels: Any, total: Any, tolerance: float = 1e-4) -> list[Any]:
    """The same solution by an iterative solver: for each object in turn."""
    from scipy import sparse
    from scipy.sparse.linalg import bicgstab

    scale = sparse.diags(1 / np.sqrt(total))
    system = scale @ (sparse.diags(total) - graph) @ scale
    return [scale @ bicgstab(system, scale @ one, rtol=tolerance, maxiter=2000)[0] for one in pixel_labels.T[1:]]


def street_view(detector: str) -> "Episode":
    """One view of a town as an agent captures it."""
    from agents.rollouts.environments import inner_env
    from sbm_gym.env.recording import episode_of_captures

    with contextlib.closing(gym.make("sbm_gym:sbm_gym/Outdoor-v0", detector=detector)) as env:
        env.reset(seed=0, options={"scene": TOWN})
        capture = inner_env(env).capture()
    return episode_of_captures([capture], (), {"scene": TOWN}, "street")


def view_of_boxes() -> "Episode":
    """One view of blocks that stand on a floor before a wall, and a detection of each."""
    from labeling.core.episode import Episode
    from labeling.core.geometry import intrinsics_from_fov, look_at
    from labeling.core.types import Detection

    height, width = size = SIZE
    intrinsics = intrinsics_from_fov(width, height, 0.5 * np.pi)
    pose = look_at(np.array([0.0, 0.0, 1.5]), np.array([1.0, 0.0, 1.2]))
    rows_, columns = np.mgrid[:height, :width]
    rays = np.stack([columns, rows_, np.ones_like(rows_)], axis=-1) @ np.linalg.inv(intrinsics).T @ pose[:3, :3].T
    with np.errstate(divide="ignore"):
        depth = np.minimum(
            np.where(rays[..., 2] < 0, -1.5 / rays[..., 2], np.inf), 5.0 / np.maximum(rays[..., 0], 1e-6)
        )
    found = []
    for number in range(OBJECTS):
        left = 8 + number * (width - 16) // OBJECTS
        mask = np.zeros(size, bool)
        mask[height * 15 // 32 : height * 3 // 4, left : left + 30] = True
        depth[mask] = np.minimum(depth[mask], 2.0 + 0.2 * number)
        found.append(Detection(0, CATEGORIES[number % len(CATEGORIES)], 0.9, mask))
    return Episode(
        name="bench",
        rgb=np.zeros((1, *size, 3), np.uint8),
        depth_m=depth[None].astype(np.float32),
        intrinsics=intrinsics[None],
        camera_to_world=pose[None],
        file_names=("rgb/000.png",),
        detections=tuple(found),
    )
