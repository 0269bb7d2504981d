"""The baseline without learning: coloured points of all views, drawn into another one."""

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8

from labeling.core.geometry import transform_points, unproject_depth
from labeling.core.splatting import splat
from labeling.core.views import Camera
from labeling.memory.networks.view_batch import Cameras, Views

INPAINT_PX = 3
"""Radius over which holes are filled from their rims."""


def reproject_views(views: Views, cameras: Cameras) -> Float[torch.Tensor, "t 3 h w"]:
    """Pictures that cameras would take of the points that the views have seen.

    Args:
        views: of one scene.
        cameras: of the same scene.

    Returns:
        Colours in [0, 1]. Where no point is drawn, colours of the holes' rims grow inwards (Telea 2004).

    Raises:
        ValueError: if there are several scenes.
    """
    if len(views.rgb) != 1:
        raise ValueError(f"one scene at a time, not {len(views.rgb)}")
    return draw_points(*coloured_points(views), cameras)


def draw_points(
    points: Float[np.ndarray, "n 3"],
    colours: UInt8[np.ndarray, "n 3"],
    sizes: Float[np.ndarray, "n"],
    cameras: Cameras,
) -> Float[torch.Tensor, "t 3 h w"]:
    """Pictures that cameras of one scene would take of coloured points; see ``coloured_points`` for these."""
    drawn = []
    for view in range(cameras.camera_to_grid.shape[1]):
        pose = cameras.camera_to_grid[0, view].double().numpy()
        camera = Camera(cameras.intrinsics[0, view].double().numpy(), pose, cameras.size)
        index = splat(points, camera, sizes)
        picture = colours[np.maximum(index, 0)]
        holes = (index < 0).astype(np.uint8)
        drawn.append(
            cv2.inpaint(picture, holes, INPAINT_PX, cv2.INPAINT_TELEA) if not holes.all() else picture * 0 + 128
        )
    return torch.from_numpy(np.stack(drawn)).permute(0, 3, 1, 2).float() / 255


def coloured_points(
    views: Views,
) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
    """Points of all views in the frame of the grid, their colours, and the edge of a pixel at their depth, metres."""
    points, colours, sizes = [], [], []
    for view in range(views.rgb.shape[1]):
        depth_m = views.depth_m[0, view].numpy()
        rgb = (views.rgb[0, view].permute(1, 2, 0) * 255).round().byte().numpy()
        large = cv2.resize(rgb, depth_m.shape[::-1], interpolation=cv2.INTER_LINEAR)
        intrinsics = views.depth_intrinsics[0, view].double().numpy()
        found, flat = unproject_depth(depth_m, intrinsics, np.eye(4))
        sizes.append(found[:, 2] / intrinsics[0, 0])
        points.append(transform_points(views.camera_to_grid[0, view].double().numpy(), found))
        colours.append(large.reshape(-1, 3)[flat])
    return np.concatenate(points), np.concatenate(colours), np.concatenate(sizes)
