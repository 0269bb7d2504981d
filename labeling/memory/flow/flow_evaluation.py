"""What there is to find in pairs of views in which things move, and how far flow is from the truth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from labeling.core.episode import Episode
from labeling.core.geometry import invert_rigid, transform_points, unproject_depth
from labeling.core.types import Box3d
from labeling.memory.flow.flow_net import FlowOutput
from labeling.memory.flow.flow_samples import FlowSample
from labeling.memory.flow.moved_pieces import FlowTruth, voxel_truth
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.view_prediction.scenes import SmallScene
from labeling.motion.scene_flow import scene_flow

LEAST_MOVED_M = 0.05
"""An object whose middle has moved by less between two views is not to be found, nor a mistake if it is."""
SEEN_SHARE = 0.002
"""Of a picture's pixels, from which on a view shows an object."""


@dataclass(frozen=True)
class MovingTruth:
    """An object that moves between two views."""

    instance_id: int
    box: Box3d
    """In the first view."""
    moved_m: float
    ignore: bool
    """Neither to be found nor to be missed: one of the views hardly shows it, it hardly moves, or its middle lies
    outside of the grid."""


def moving_truths(episode: Episode, pair: SmallScene, grid: GridSpec) -> list[MovingTruth]:
    """Objects that move between the views of a pair.

    Args:
        episode: with ground truth of boxes; without one of motion nothing moves.
        pair: of two of its views.
        grid: of the memory.
    """
    first, second = pair.view_index
    known = {(one.view_index, one.instance_id): one for one in episode.ground_truth or ()}
    world_to_grid = invert_rigid(pair.grid_to_world(0))
    found = []
    for motion in episode.motion or ():
        one, other = (known.get((view, motion.instance_id)) for view in (first, second))
        if one is None or one.box_3d is None:
            continue
        before, after = motion.object_to_world[first], motion.object_to_world[second]
        centre = one.box_3d.centre_m
        moved = transform_points(after @ invert_rigid(before), centre[None])[0] - centre
        moved_m = float(np.linalg.norm(moved))
        if moved_m < 1e-3:
            continue
        middle = transform_points(world_to_grid, centre[None])[0]
        shown = other is not None and min(one.modal.mean(), other.modal.mean()) >= SEEN_SHARE
        inside = bool(np.all(np.abs(middle) < 0.5 * np.array(grid.extent_m)))
        ignore = not (shown and inside and moved_m >= LEAST_MOVED_M)
        found.append(MovingTruth(motion.instance_id, one.box_3d, moved_m, ignore))
    return found


def true_flow(episode: Episode, pair: SmallScene, grid: GridSpec) -> FlowTruth:
    """Flow of the voxels of a pair's first view, from scene flow.

    Raises:
        UsageError: if the episode has no ground truth of masks or motion.
    """
    first, second = pair.view_index
    flow, known = scene_flow(episode, first, second)
    depth_m = np.where(known, episode.depth_m[first], 0).astype(np.float32)
    pose = episode.camera_to_world[first].astype(float)
    points, pixels = unproject_depth(depth_m, episode.intrinsics[first].astype(float), pose)
    steps = flow.reshape(-1, 3)[pixels].astype(float)
    world_to_grid = invert_rigid(pair.grid_to_world(0))
    before, after = (transform_points(world_to_grid, one) for one in (points, points + steps))
    return voxel_truth(before, after, np.linalg.norm(steps, axis=1) > 1e-3, grid)


def endpoint_errors(
    flow_m: Float[torch.Tensor, "b 3 z y x"], truth: FlowTruth, occupied: Float[torch.Tensor, "b 1 z y x"]
) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of errors of flow, metres: of voxels that move, and of those that stand.

    Args:
        flow_m: what is said.
        truth: what is true.
        occupied: of the earlier time; other voxels do not count.
    """
    error = (flow_m - truth.flow_m).norm(dim=1, keepdim=True)
    here = (truth.known > 0) & (occupied > 0)
    moving: Bool[torch.Tensor, "..."] = here & (truth.moves >= 0.5)
    return error[moving].cpu().numpy(), error[here & ~moving].cpu().numpy()


@dataclass
class VoxelCounts:
    """How many voxels are said to move rightly."""

    said: int = 0
    true: int = 0
    right: int = 0
    """Said to move, moving, and with a flow that errs by less than half a voxel."""

    def add(self, output: FlowOutput, sample: FlowSample, occupied: torch.Tensor, grid: GridSpec) -> None:
        """Counts those of a batch."""
        truth = sample.truth
        here = (truth.known > 0) & (occupied > 0)
        said, moves = here & (output.moves > 0), here & (truth.moves >= 0.5)
        near = (output.flow_m - truth.flow_m).norm(dim=1, keepdim=True) < 0.5 * grid.voxel_m
        self.said += int(said.sum())
        self.true += int(moves.sum())
        self.right += int((said & moves & near).sum())

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        return 2 * self.right / max(1, self.said + self.true)


def mean_or_zero(parts: Sequence[np.ndarray]) -> float:
    """Mean of all values; 0 if there are none."""
    values = np.concatenate([np.zeros(0), *parts])
    return float(values.mean()) if len(values) else 0.0
