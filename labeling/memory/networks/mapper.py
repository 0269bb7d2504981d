"""From each view to a volume of features: 2-D U-Net, unprojection times occupancy, 3-D U-Net.

Source: Tung et al. 2019, Harley et al. 2020; thesis 2.1.1, 2.3.1.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from labeling.memory.lifting.unprojection import free_space, occupancy, scaled_intrinsics, unproject_features
from labeling.memory.networks.blocks import UNet2d, UNet3d
from labeling.memory.networks.view_batch import Views
from labeling.memory.settings.grid_spec import GridSpec

GEOMETRY = 2
"""Channels beside features: occupied, free."""


@dataclass(frozen=True)
class MappedViews:
    """Volumes of every view, in the frame of the memory."""

    features: Float[Tensor, "b v c z y x"]
    occupied: Float[Tensor, "b v 1 z y x"]
    free: Float[Tensor, "b v 1 z y x"]

    @property
    def seen(self) -> Float[Tensor, "b v 1 z y x"]:
        """1 where the view knows whether there is something."""
        return (self.occupied + self.free).clamp(max=1)


class ViewMapper(nn.Module):
    """Posed RGB-D views to volumes. Poses are known, so that each view is unprojected into the memory's own grid, which
    stabilises it without resampling a volume.
    """

    def __init__(self, grid: GridSpec, channels: int) -> None:
        super().__init__()
        self.grid = grid
        self.pictures = UNet2d(3, channels, channels)
        self.volumes = UNet3d(channels + 3 + GEOMETRY, channels)

    def forward(self, views: Views) -> MappedViews:
        """Volumes of all views of all scenes; each depends on its own view only."""
        batch = views.rgb.shape[:2]
        rgb = views.rgb.flatten(0, 1) - 0.5
        intrinsics, pose = views.intrinsics.flatten(0, 1), views.camera_to_grid.flatten(0, 1)
        depth_m, depth_intrinsics = views.depth_m.flatten(0, 1), views.depth_intrinsics.flatten(0, 1)
        found = self.pictures(rgb)
        scale_y, scale_x = found.shape[2] / rgb.shape[2], found.shape[3] / rgb.shape[3]
        occupied = occupancy(depth_m, depth_intrinsics, pose, self.grid)
        free = free_space(depth_m, depth_intrinsics, pose, self.grid) * (1 - occupied)
        features = unproject_features(found, scaled_intrinsics(intrinsics, scale_x, scale_y), pose, self.grid)
        # Colours themselves go along: what the memory is to give back in the end.
        colours = unproject_features(rgb, intrinsics, pose, self.grid)
        lifted = torch.cat([features * occupied, colours * occupied, occupied, free], dim=1)
        volumes = self.volumes(lifted)
        return MappedViews(*(one.unflatten(0, batch) for one in (volumes, occupied, free)))
