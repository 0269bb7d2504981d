"""From 2-D features and depth to voxels: what depth says is occupied, and the features seen there.

Source: Tung et al. 2019 (GRNN), "Unprojection", and Harley et al. 2020 (C-N3D), section 3.1; thesis 2.1.1. A voxel is
occupied if a point that depth measured lies in it. GRNN compares the depth of a voxel's centre with the picture's
instead, which leaves holes in floors seen at a shallow angle.
"""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from labeling.memory.lifting.voxel_grid import invert, transform, voxel_centres, voxel_of
from labeling.memory.settings.grid_spec import GridSpec

NEAR_M = 0.05
"""Nearer to the camera nothing is projected."""


def scaled_intrinsics(intrinsics: Float[Tensor, "*b 3 3"], scale_x: float, scale_y: float) -> Float[Tensor, "*b 3 3"]:
    """K of a picture that is resized: ``scale`` is new size / old size; pixel centres lie at integer coordinates."""
    scaled = intrinsics.clone()
    for row, scale in enumerate((scale_x, scale_y)):
        scaled[..., row, row] = intrinsics[..., row, row] * scale
        scaled[..., row, 2] = (intrinsics[..., row, 2] + 0.5) * scale - 0.5
    return scaled


def pixel_rays(intrinsics: Float[Tensor, "b 3 3"], height: int, width: int) -> Float[Tensor, "b {height} {width} 3"]:
    """Rays of all pixels in the camera's frame, of z-depth 1."""
    device, dtype = intrinsics.device, intrinsics.dtype
    y, x = torch.meshgrid(
        torch.arange(height, device=device, dtype=dtype), torch.arange(width, device=device, dtype=dtype), indexing="ij"
    )
    fx, fy, cx, cy = (intrinsics[:, i, j][:, None, None] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    ray_x, ray_y = (x - cx) / fx, (y - cy) / fy
    return torch.stack([ray_x, ray_y, torch.ones_like(ray_x)], dim=-1)


def depth_points(
    depth_m: Float[Tensor, "b h w"], intrinsics: Float[Tensor, "b 3 3"], camera_to_grid: Float[Tensor, "b 4 4"]
) -> Float[Tensor, "b h w 3"]:
    """Points that depth measured, in the frame of the grid, metres; NaN where there is no return."""
    rays = pixel_rays(intrinsics, *depth_m.shape[1:])
    points = transform(camera_to_grid, rays * depth_m[..., None])
    return torch.where(depth_m[..., None] > 0, points, points.new_full((), torch.nan))


def occupancy(
    depth_m: Float[Tensor, "b h w"],
    intrinsics: Float[Tensor, "b 3 3"],
    camera_to_grid: Float[Tensor, "b 4 4"],
    spec: GridSpec,
) -> Float[Tensor, "b 1 z y x"]:
    """1 for voxels in which depth measured a point, else 0.

    Args:
        depth_m: z-depth, metres, 0 = no return. Of enough pixels that neighbours are not further apart than a voxel.
        intrinsics: K of the depth images, pixels.
        camera_to_grid: pose in the frame of the grid, OpenCV camera axes.
        spec: of the grid.
    """
    index, inside = voxel_of(spec, depth_points(depth_m, intrinsics, camera_to_grid).flatten(1, 2))
    flat = depth_m.new_zeros(len(depth_m), spec.shape[0] * spec.shape[1] * spec.shape[2])
    flat.scatter_reduce_(1, index, inside.to(depth_m.dtype), "amax")
    return flat.reshape(len(depth_m), 1, *spec.shape)


def project_centres(
    intrinsics: Float[Tensor, "b 3 3"], camera_to_grid: Float[Tensor, "b 4 4"], spec: GridSpec
) -> tuple[Float[Tensor, "b z y x 2"], Float[Tensor, "b z y x"]]:
    """Pixels (x, y) and z-depths of all voxel centres; pixels of what lies nearer than ``NEAR_M`` are far outside."""
    centres = voxel_centres(spec, intrinsics.device).to(intrinsics.dtype)
    in_camera = transform(invert(camera_to_grid), centres.expand(len(intrinsics), *centres.shape))
    depth_m = in_camera[..., 2]
    focal = torch.stack([intrinsics[:, 0, 0], intrinsics[:, 1, 1]], -1)[:, None, None, None]
    pixels = in_camera[..., :2] / depth_m.clamp(min=NEAR_M)[..., None] * focal
    pixels = pixels + intrinsics[:, None, None, None, :2, 2]
    return torch.where((depth_m > NEAR_M)[..., None], pixels, pixels.new_full((), -1e6)), depth_m


def _sample(picture: Float[Tensor, "b c h w"], pixels: Float[Tensor, "b z y x 2"], mode: str) -> Tensor:
    """(b, c, z, y, x): samples of a picture at pixels, 0 outside."""
    size = pixels.new_tensor([picture.shape[3], picture.shape[2]])
    normalised = ((2 * pixels + 1) / size - 1).clamp(-1e4, 1e4)
    flat = normalised.reshape(len(pixels), -1, 1, 2)
    found = functional.grid_sample(picture, flat, mode=mode, padding_mode="zeros", align_corners=False)
    return found.reshape(*picture.shape[:2], *pixels.shape[1:4])


def free_space(
    depth_m: Float[Tensor, "b h w"],
    intrinsics: Float[Tensor, "b 3 3"],
    camera_to_grid: Float[Tensor, "b 4 4"],
    spec: GridSpec,
) -> Float[Tensor, "b 1 z y x"]:
    """1 for voxels whose centre the camera sees through: it lies a voxel or more before what depth measured there."""
    pixels, centre_m = project_centres(intrinsics, camera_to_grid, spec)
    there_m = _sample(depth_m[:, None], pixels, "nearest")
    return ((there_m > 0) & (centre_m[:, None] < there_m - spec.voxel_m)).to(depth_m.dtype)


def unproject_features(
    features: Float[Tensor, "b c h w"],
    intrinsics: Float[Tensor, "b 3 3"],
    camera_to_grid: Float[Tensor, "b 4 4"],
    spec: GridSpec,
) -> Float[Tensor, "b c z y x"]:
    """Features along all rays: at each voxel the bilinear sample where its centre projects to; 0 out of view.

    Args:
        features: of pictures.
        intrinsics: K of the feature maps (``scaled_intrinsics``).
        camera_to_grid: pose in the frame of the grid.
        spec: of the grid.
    """
    pixels, _ = project_centres(intrinsics, camera_to_grid, spec)
    return _sample(features, pixels, "bilinear")
