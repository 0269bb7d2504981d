"""How the camera has moved from one view to another, where poses are not known: volumes of both are aligned."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from labeling.core.geometry import invert_rigid, unproject_depth
from labeling.core.views import RgbdViews
from labeling.memory.lifting.placement import place_grid
from labeling.memory.lifting.rigid_alignment import align
from labeling.memory.lifting.unprojection import free_space, occupancy, unproject_features
from labeling.memory.settings.grid_spec import GridSpec

GREY = 0.45
OCCUPIED, FREE = 0.5, -0.2
"""What voxels count beside their colours."""


def coloured_volume(
    views: RgbdViews, view: int, camera_to_grid: Float[Tensor, "4 4"], spec: GridSpec
) -> tuple[Float[Tensor, "4 z y x"], Float[Tensor, "1 z y x"]]:
    """A view as a volume, before any network has learnt anything: colours about grey, and occupancy.

    Args:
        views: of a recording.
        view: which of them.
        camera_to_grid: its pose in the frame of the grid.
        spec: of the grid.

    Returns:
        The volume, and 1 where the view has seen: occupied or free.
    """
    camera = _tensor(views.intrinsics[view])[None], camera_to_grid[None].float(), spec
    depth_m = _tensor(views.depth_m[view])[None]
    rgb = _tensor(views.rgb[view]).permute(2, 0, 1)[None] / 255
    occupied = occupancy(depth_m, *camera)
    free = free_space(depth_m, *camera) * (1 - occupied)
    colours = unproject_features(rgb - GREY, *camera) * occupied
    return torch.cat([colours, OCCUPIED * occupied + FREE * free], dim=1)[0], (occupied + free)[0]


def motion_between(views: RgbdViews, first: int, second: int, spec: GridSpec) -> Float[np.ndarray, "4 4"]:
    """Where the second camera stands in the frame of the first, by C-N3D's coarse-to-fine search (``align``).

    Of the poses only the tilt of the first is used. Motions of up to about 40 degrees and 1.3 m are found, to about
    half a voxel.

    Args:
        views: of a recording.
        first: number of a view with depth.
        second: likewise.
        spec: of the grid in which both are compared; it stands in the midst of what the first view has seen.
    """
    pose = views.camera_to_world[first].astype(float)
    points, _ = unproject_depth(views.depth_m[first], views.intrinsics[first].astype(float), pose)
    grid_to_camera = invert_rigid(pose) @ place_grid(np.median(points, axis=0), pose)
    camera_to_grid = _tensor(invert_rigid(grid_to_camera))
    memory, other = (coloured_volume(views, view, camera_to_grid, spec) for view in (first, second))
    found = align(*memory, *other, spec).view_to_memory.numpy().astype(float)
    return grid_to_camera @ found @ invert_rigid(grid_to_camera)


def _tensor(array: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.float32))
