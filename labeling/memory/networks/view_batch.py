"""What networks are given: posed RGB-D views in the frame of the memory's grid, and cameras to imagine views from."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from labeling.memory.lifting.unprojection import scaled_intrinsics


@dataclass(frozen=True)
class Cameras:
    """Cameras of a batch of scenes, a few in each.

    Example:
        >>> cameras = Cameras(torch.eye(3).expand(2, 5, 3, 3), torch.eye(4).expand(2, 5, 4, 4), (48, 64))
        >>> cameras.resized((24, 32)).shape
        torch.Size([2, 5, 3, 3])
    """

    intrinsics: Float[Tensor, "b v 3 3"]
    """K, pixels of a picture of ``size``."""
    camera_to_grid: Float[Tensor, "b v 4 4"]
    """Poses in the frame of the grid, OpenCV camera axes."""
    size: tuple[int, int]
    """Height and width of pictures."""

    def resized(self, size: tuple[int, int]) -> Float[Tensor, "b v 3 3"]:
        """K of maps of another size."""
        return scaled_intrinsics(self.intrinsics, size[1] / self.size[1], size[0] / self.size[0])


@dataclass(frozen=True)
class Views(Cameras):
    """Pictures and depth of such cameras."""

    rgb: Float[Tensor, "b v 3 h w"]
    """In [0, 1]."""
    depth_m: Float[Tensor, "b v hd wd"]
    """z-depth, metres, 0 = no return; of a size of its own, to fill voxels without holes."""
    depth_intrinsics: Float[Tensor, "b v 3 3"]
    """K of it."""

    def to(self, device: torch.device | str) -> "Views":
        """On another device."""
        return Views(
            self.intrinsics.to(device),
            self.camera_to_grid.to(device),
            self.size,
            self.rgb.to(device),
            self.depth_m.to(device),
            self.depth_intrinsics.to(device),
        )
