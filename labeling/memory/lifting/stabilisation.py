"""Stabilisation by egomotion: a volume seen from one pose, resampled into the frame of another.

Source: thesis 2.1.1, "Egomotion and Stabilisation"; Harley et al. 2020, section 3.1.
"""

from jaxtyping import Float
from torch import Tensor

from labeling.memory.lifting.voxel_grid import sample_grid, transform, voxel_centres
from labeling.memory.settings.grid_spec import GridSpec


def warp(
    volume: Float[Tensor, "b c z y x"], new_to_old: Float[Tensor, "b 4 4"], spec: GridSpec
) -> Float[Tensor, "b c z y x"]:
    """Resamples a volume into another frame by a rigid transform with 6 degrees of freedom.

    Args:
        volume: in the old frame.
        new_to_old: takes points of the new frame to the old one, metres.
        spec: of both grids.

    Returns:
        In the new frame; 0 where the old grid does not reach.
    """
    centres = voxel_centres(spec, volume.device).to(volume.dtype)
    return sample_grid(volume, transform(new_to_old, centres.expand(len(volume), *centres.shape)), spec)
