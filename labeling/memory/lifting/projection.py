"""From a memory to any view: samples along planes of depth, and what of them is in front.

Source: Tung et al. 2019, "Projection and decoding"; thesis 2.1.1.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from labeling.memory.lifting.unprojection import pixel_rays
from labeling.memory.lifting.voxel_grid import sample_grid, transform
from labeling.memory.settings.grid_spec import GridSpec

NEAREST_PLANE_M = 0.25


def plane_depths(camera_to_grid: Float[Tensor, "b 4 4"], spec: GridSpec, planes: int) -> Float[Tensor, "b {planes}"]:
    """z-depths, uniform over the part of the grid that may lie before each camera, metres.

    From where the grid's horizontal circle begins, or ``NEAREST_PLANE_M`` inside of it, to where it ends.
    """
    radius = 0.5 * max(spec.extent_m[:2])
    distance = camera_to_grid[:, :3, 3].norm(dim=1)
    near, far = (distance - radius).clamp(min=NEAREST_PLANE_M), distance + radius
    share = (torch.arange(planes, device=near.device, dtype=near.dtype) + 0.5) / planes
    return near[:, None] + (far - near)[:, None] * share


def project_planes(
    volume: Float[Tensor, "b c z y x"],
    intrinsics: Float[Tensor, "b 3 3"],
    camera_to_grid: Float[Tensor, "b 4 4"],
    size: tuple[int, int],
    depths_m: Float[Tensor, "b p"],
    spec: GridSpec,
) -> Float[Tensor, "b c p h w"]:
    """Samples of a memory at every pixel of a view, on planes of depth.

    Args:
        volume: the memory.
        intrinsics: K of the map to be made, pixels.
        camera_to_grid: pose of the view, in the frame of the grid.
        size: height and width of the map.
        depths_m: z-depths of the planes, near to far.
        spec: of the grid.
    """
    rays = pixel_rays(intrinsics, *size)
    points = rays[:, None] * depths_m[:, :, None, None, None]
    return sample_grid(volume, transform(camera_to_grid, points), spec)


def composite(
    planes: Float[Tensor, "b c p h w"], alpha: Float[Tensor, "b 1 p h w"]
) -> tuple[Float[Tensor, "b c h w"], Float[Tensor, "b p h w"]]:
    """What is seen of planes, the nearest in front.

    Args:
        planes: features, near to far.
        alpha: opacity in [0, 1].

    Returns:
        Features, weighted by what of each plane is seen; and these weights, which sum up to 1 where something opaque
        is met. Source: alpha compositing, Porter and Duff 1984; learnt through planes as in Mildenhall et al. 2020.
    """
    through = torch.cumprod(1 - alpha[:, 0], dim=1)
    arriving = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)
    weights = alpha[:, 0] * arriving
    return (planes * weights[:, None]).sum(dim=2), weights
