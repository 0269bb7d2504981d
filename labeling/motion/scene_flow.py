"""Scene flow: how far the surface that each pixel of a view shows has moved when another view is taken."""

import numpy as np
from jaxtyping import Bool, Float32

from labeling.core.episode import Episode
from labeling.core.errors import UsageError
from labeling.core.geometry import invert_rigid, transform_points, unproject_depth


def scene_flow(episode: Episode, view: int, other: int) -> tuple[Float32[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    """The motion of every pixel's surface from the time of one view to that of another.

    It follows exactly from the rigid motion of the objects: a point X that belongs to an object with poses P (object
    to world) moves from X to P' P^-1 X. All else stands still. The motion of the camera is not in it.

    Args:
        episode: with ground truth of masks and of motion.
        view: whose pixels.
        other: at the time of which view.

    Returns:
        Displacements in the world, metres, 0 where nothing moves; and where they are known: where there is depth.

    Raises:
        UsageError: if the episode has no ground truth of masks or motion, or no such view.

    Source: Vedula et al., Three-Dimensional Scene Flow, 1999.
    """
    if episode.motion is None or episode.ground_truth is None:
        missing = "motion.json" if episode.motion is None else "ground_truth.json"
        raise UsageError(f"episode {episode.name!r} has no {missing}: its scene flow is not known")
    for one in (view, other):
        if not 0 <= one < episode.num_views:
            raise UsageError(f"there is no view {one}: the episode has {episode.num_views}, counted from 0")
    depth_m = episode.depth_m[view]
    flow = np.zeros((*depth_m.shape, 3), np.float32)
    masks = {one.instance_id: one.modal for one in episode.ground_truth if one.view_index == view}
    for motion in episode.motion:
        shown = masks.get(motion.instance_id)
        if shown is None or not motion.moves:
            continue
        pose = np.asarray(episode.camera_to_world[view], float)
        points, pixels = unproject_depth(np.where(shown, depth_m, np.float32(0)), episode.intrinsics[view], pose)
        before, after = motion.object_to_world[view], motion.object_to_world[other]
        moved = transform_points(after @ invert_rigid(before), points)
        flow.reshape(-1, 3)[pixels] = moved - points
    return flow, depth_m > 0
