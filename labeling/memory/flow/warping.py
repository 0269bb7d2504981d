"""Volumes moved along a flow field.

A flow field says of every voxel of one time by how far what is there has moved at another time, in the frame of the
grid, which stands still in the world: egomotion is not in it. Source: Harley et al. 2020, section 3.3; thesis 2.3.3.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from labeling.memory.lifting.voxel_grid import sample_grid
from labeling.memory.settings.grid_spec import GridSpec


def warp_back(
    later: Float[Tensor, "b c z y x"], flow_m: Float[Tensor, "b 3 z y x"], spec: GridSpec
) -> Float[Tensor, "b c z y x"]:
    """A volume of the later time as it was before: every voxel takes what lies where its flow ends.

    Args:
        later: volume of the later time; of the grid, or of coarser voxels that fill it.
        flow_m: from the earlier time to the later one; x, y, z, metres.
        spec: of the grid.

    Returns:
        Trilinear samples; 0 where the flow leads out of the grid.
    """
    z, y, x = (
        edge_m * ((torch.arange(count, device=flow_m.device, dtype=flow_m.dtype) + 0.5) / count - 0.5)
        for edge_m, count in zip(reversed(spec.extent_m), flow_m.shape[2:], strict=True)
    )
    grid_z, grid_y, grid_x = torch.meshgrid(z, y, x, indexing="ij")
    return sample_grid(later, torch.stack([grid_x, grid_y, grid_z], dim=-1) + flow_m.movedim(1, -1), spec)
