"""3-D boxes a second: the frustum PointNet beside LDLS, on the same detections of the same views."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from experiments.benchmarks.rows import Row, log, median_seconds

if TYPE_CHECKING:
    from labeling.core.episode import Episode

OBJECTS = 6
"""In the view."""
SIZE = (256, 256)
CATEGORIES = ("chair", "couch", "table")


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row, per frame of a room with six detections; nothing depends on what the networks have learnt.

    Args:
        quick: few repetitions.
    """
    import torch

    from labeling.detectors3d.frustum_detector import FrustumDetector
    from labeling.detectors3d.frustum_pointnet import FrustumNet, FrustumSpec
    from labeling.detectors3d.ldls import Ldls, LdlsConfig

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
    rough = Ldls(LdlsConfig(tolerance=0.9))
    seconds = median_seconds(lambda: rough.lift(frame, detections), 1 if quick else 3)
    yield Row("LDLS, a rough solution (residual .9)", "LDLS to convergence", seconds, baseline)


def view_of_boxes() -> "Episode":
    """One view of blocks that stand on a floor before a wall, and a detection of each."""
    from labeling.core.episode import Episode
    from labeling.core.geometry import intrinsics_from_fov, look_at
    from labeling.core.types import Detection

    height, width = SIZE
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
        mask = np.zeros(SIZE, bool)
        mask[120:190, left : left + 30] = True
        depth[mask] = np.minimum(depth[mask], 2.0 + 0.2 * number)
        found.append(Detection(0, CATEGORIES[number % len(CATEGORIES)], 0.9, mask))
    return Episode(
        name="bench",
        rgb=np.zeros((1, *SIZE, 3), np.uint8),
        depth_m=depth[None].astype(np.float32),
        intrinsics=intrinsics[None],
        camera_to_world=pose[None],
        file_names=("rgb/000.png",),
        detections=tuple(found),
    )
