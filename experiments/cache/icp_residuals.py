"""What moves between two views without learning: what is left after the clouds have been aligned, in clusters.

Poses are known; ICP takes out what little error they have. Points of the first cloud with no near neighbour in the
second one are residuals, unless they lie out of the second picture; what hangs together of them is an object.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from labeling.core.boxes3d import fit_box
from labeling.core.geometry import invert_rigid, project, transform_points, unproject_depth
from labeling.memory.flow.moving_objects import FEWEST_POINTS, MovingObject
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.view_prediction.scenes import SmallScene


@dataclass(frozen=True)
class IcpSettings:
    """Of the baseline."""

    whole_clusters: bool
    """Whether the first cloud is clustered, and clusters with residuals are aligned one by one and found as a whole; or
    only residuals are clustered."""
    near_m: float = 0.08
    """A neighbour further away is none."""
    apart_m: float = 0.1
    """Points nearer to each other than this are one cluster."""
    core: int = 4
    """Points within reach that a point in the midst of a cluster has at least."""


ABOVE_FLOOR_M = 0.06
"""Lower points are of the floor."""
CELL_M = 0.03
"""Of points in one cell of this edge one is kept."""
HALF_SURE = 30.0
"""A cluster of so many points is half as sure as one of very many."""
LEAST_M, LEAST_RESIDUAL = 0.05, 0.1
"""A whole cluster moves if alignment moves it by this, and this share of its points had no near neighbour."""
LARGEST_M = 2.0
"""Larger clusters are walls, or several things."""
REACH_M = 0.4
"""How far ICP looks for the points of a cluster."""


def icp_residuals(pair: SmallScene, grid: GridSpec, settings: IcpSettings) -> list[MovingObject]:
    """What moves between the views of a pair, with boxes, the surest first.

    Args:
        pair: of two views.
        grid: in which things are to be found; points outside of it, and of the floor, are left out.
        settings: of the baseline.
    """
    import open3d as o3d

    registration = o3d.pipelines.registration
    clouds = [_cloud(_points(pair, view)).voxel_down_sample(CELL_M) for view in range(2)]
    if min(len(one.points) for one in clouds) < FEWEST_POINTS:
        return []
    first, second = clouds
    second.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(0.2, 20))
    plane = registration.TransformationEstimationPointToPlane()
    error = registration.registration_icp(first, second, settings.near_m, np.eye(4), plane).transformation
    points = np.asarray(first.points)
    aligned = _cloud(transform_points(np.asarray(error), points))
    away_m = np.asarray(aligned.compute_point_cloud_distance(second))
    local = transform_points(invert_rigid(pair.grid_to_world(0)), points)
    inside = np.all(np.abs(local) < 0.5 * np.array(grid.extent_m), axis=1)
    if pair.floor_in_grid_m is not None:
        inside &= local[:, 2] > pair.floor_in_grid_m + ABOVE_FLOOR_M
    size = pair.depth_m.shape[1:]
    pixels, depth_m = project(points, pair.depth_intrinsics[1].astype(float), pair.camera_to_world[1].astype(float))
    shown = (depth_m > 0.05) & np.all((pixels >= 0) & (pixels <= np.array(size[::-1]) - 1), axis=1)
    residual = (away_m > settings.near_m) & shown & inside
    chosen = inside if settings.whole_clusters else residual
    points, residual = points[chosen], residual[chosen]
    if len(points) < FEWEST_POINTS:
        return []
    cluster = np.asarray(_cloud(points).cluster_dbscan(settings.apart_m, settings.core))
    objects = []
    for number in range(int(cluster.max()) + 1):
        own, share = points[cluster == number], float(residual[cluster == number].mean())
        too_large = settings.whole_clusters and float(np.ptp(own, axis=0).max()) > LARGEST_M
        box = fit_box(own) if len(own) >= FEWEST_POINTS and not too_large else None
        if box is None or share < LEAST_RESIDUAL:
            continue
        step, explained = _aligned(own, second, settings.near_m)
        sure = len(own) / (len(own) + HALF_SURE)
        if settings.whole_clusters:
            if np.linalg.norm(step) < LEAST_M:
                continue
            sure *= max(0.0, explained - (1 - share))
        objects.append(MovingObject(box, step, sure))
    return sorted(objects, key=lambda one: -one.confidence)


def _points(pair: SmallScene, view: int) -> Float[np.ndarray, "n 3"]:
    pose, intrinsics = pair.camera_to_world[view].astype(float), pair.depth_intrinsics[view].astype(float)
    return unproject_depth(pair.depth_m[view], intrinsics, pose)[0]


def _aligned(own: Float[np.ndarray, "n 3"], second, near_m: float) -> tuple[Float[np.ndarray, "3"], float]:
    """How far a cluster's middle moves when it is aligned by itself, and which share of it then has a neighbour."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    found = registration.registration_icp(
        _cloud(own), second, REACH_M, np.eye(4), registration.TransformationEstimationPointToPoint()
    )
    moved = transform_points(np.asarray(found.transformation), own)
    away_m = np.asarray(_cloud(moved).compute_point_cloud_distance(second))
    return (moved - own).mean(axis=0), float(np.mean(away_m < near_m))


def _cloud(points: Float[np.ndarray, "n 3"]):
    import open3d as o3d

    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
