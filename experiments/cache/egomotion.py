"""How well motion of the camera is estimated, and episodes whose poses are; outcomes are kept."""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from experiments.cache.stages import RunContext, cached, digest
from labeling.core.geometry import invert_rigid, unproject_depth
from labeling.core.views import RgbdViews
from labeling.memory.settings.grid_spec import Around
from labeling.memory.settings.memory_spec import MemorySize
from labeling.runtime.code_digest import code_digest

if TYPE_CHECKING:
    from labeling.core.episode import Episode

CELL_M, NORMALS_M = 0.05, 0.25
"""Of points in one cell of this edge one is kept; how far neighbours lie that tell a point's normal."""
REACHES_M = (1.0, 0.5, 0.25, 0.12)
"""How far neighbours are looked for, coarse to fine."""
Cloud = Any
"""``open3d.geometry.PointCloud``, of which type checkers know nothing."""
METHODS = ("none", "alignment", "ICP")
"""The camera stands still; C-N3D's alignment of volumes; point-to-plane ICP of clouds."""


@dataclass(frozen=True)
class PairsToAlign:
    """Of one episode: pairs of views one after the other, spread over those that look at the grid."""

    episode: Path
    size: MemorySize
    around: Around
    pairs: int
    """At most."""


def motion_errors(jobs: Sequence[PairsToAlign], context: RunContext) -> list[dict[str, Any]]:
    """Errors of the motion between views, against the recorded poses.

    Returns:
        Of each pair of all jobs, by method, ``turn_deg`` and ``shift_cm``: error of rotation and of translation; those
        of ``none`` are the motion itself.
    """
    code = code_digest(_motion_errors)
    keyed = []
    for job in jobs:
        episode = f"{job.episode.parent.name}/{job.episode.name}"
        keyed.append((digest(episode, asdict(job.size), job.around, job.pairs, code), job))
    found = cached(
        "motion_errors", _motion_errors, keyed, context, "aligning views", reads=lambda job: [job.episode], gpus=False
    )
    return [pair for of_episode in found for pair in of_episode["pairs"]]


def _motion_errors(job: PairsToAlign) -> dict[str, Any]:
    from labeling.core.errors import EpisodeFormatError
    from labeling.io.episodes import read_episode
    from labeling.memory.boxes.box_evaluation import spread_views
    from labeling.memory.lifting.egomotion import motion_between
    from labeling.memory.view_prediction.scenes import small_scene

    views, grid = read_episode(job.episode, ground_truth=False), job.size.grid
    try:
        looking = small_scene(job.episode.name, views, job.size, job.around).view_index
    except EpisodeFormatError:  # too few views look at the grid
        return {"pairs": []}
    following = [(one, other) for one, other in itertools.pairwise(looking) if other == one + 1]
    pairs = []
    for number in spread_views(len(following), job.pairs):
        first, second = following[number]
        poses = views.camera_to_world[[first, second]].astype(float)
        true = invert_rigid(poses[0]) @ poses[1]
        clouds = [cloud(views, view) for view in (first, second)]
        estimates = (np.eye(4), motion_between(views, first, second, grid), icp_motion(*clouds))
        pairs.append({name: error(found, true) for name, found in zip(METHODS, estimates, strict=True)})
    return {"pairs": pairs}


def error(found: Float[np.ndarray, "4 4"], true: Float[np.ndarray, "4 4"]) -> dict[str, float]:
    """Angle and distance between two rigid transforms, degrees and centimetres."""
    turn = found[:3, :3].T @ true[:3, :3]
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    return {
        "turn_deg": float(np.rad2deg(angle)),
        "shift_cm": 100 * float(np.linalg.norm(found[:3, 3] - true[:3, 3])),
    }


def cloud(views: RgbdViews, view: int) -> Cloud:
    """What a view has measured, in the frame of its camera, thinned out and with normals."""
    import open3d as o3d

    points, _ = unproject_depth(views.depth_m[view], views.intrinsics[view].astype(float), np.eye(4))
    thin = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(CELL_M)
    thin.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(NORMALS_M, 30))
    return thin


def icp_motion(first: Cloud, second: Cloud) -> Float[np.ndarray, "4 4"]:
    """Where the second camera stands in the frame of the first: point-to-plane ICP, begun where it has not moved."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    found = np.eye(4)
    for reach_m in REACHES_M:
        how = registration.TransformationEstimationPointToPlane(registration.TukeyLoss(0.5 * reach_m))
        found = registration.registration_icp(second, first, reach_m, found, how).transformation
    return np.asarray(found)


def with_icp_poses(episode: "Episode", views: Sequence[int], anchor: int) -> "Episode":
    """Some views of an episode, in order of time, with poses of a chain of ICP from each to the next.

    Args:
        episode: its poses are not used but for the anchor's.
        views: which of its views, in order.
        anchor: the view, one of these, whose pose is as recorded.
    """
    clouds = [cloud(episode, view) for view in views]
    poses = [np.eye(4)]
    for first, second in itertools.pairwise(clouds):
        poses.append(poses[-1] @ icp_motion(first, second))
    at = list(views).index(anchor)
    begin = episode.camera_to_world[anchor].astype(float) @ invert_rigid(poses[at])
    chosen = list(views)
    return replace(
        episode,
        rgb=episode.rgb[chosen],
        depth_m=episode.depth_m[chosen],
        intrinsics=episode.intrinsics[chosen],
        camera_to_world=(begin @ np.stack(poses)).astype(episode.camera_to_world.dtype),
        file_names=tuple(episode.file_names[view] for view in chosen),
        detections=None,
        ground_truth=None,
        motion=None,
    )
