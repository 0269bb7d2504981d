"""Posed RGB-D views: what every recording comes down to, and all that the label generator needs to know of one."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt8

from labeling.core.geometry import intrinsics_from_fov, invert_rigid


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with a pose.

    Example:
        >>> camera = Camera(np.diag([60.0, 60.0, 1.0]), np.eye(4), size=(48, 64))
        >>> np.allclose(camera.world_to_camera @ camera.camera_to_world, np.eye(4))
        True
    """

    intrinsics: Float[np.ndarray, "3 3"]
    """K, pixels."""
    camera_to_world: Float[np.ndarray, "4 4"]
    """OpenCV axes: +X right, +Y down, +Z forward."""
    size: tuple[int, int]
    """Picture height and width, pixels."""

    @classmethod
    def from_fov(cls, camera_to_world: Float[np.ndarray, "4 4"], size: tuple[int, int], fov_x_rad: float) -> "Camera":
        """An ideal camera; see ``intrinsics_from_fov``."""
        return cls(intrinsics_from_fov(size[1], size[0], fov_x_rad), camera_to_world, size)

    @property
    def world_to_camera(self) -> Float[np.ndarray, "4 4"]:
        """The inverse pose."""
        return invert_rigid(self.camera_to_world)


@dataclass(frozen=True, eq=False)
class RgbdViews:
    """Colour and depth of several views of one scene, all of one size, with intrinsics and poses.

    Raises:
        ValueError: on construction, if the arrays do not belong together.

    Example:
        >>> rgb, depth_m = np.zeros((2, 48, 64, 3), np.uint8), np.ones((2, 48, 64), np.float32)
        >>> views = RgbdViews(rgb, depth_m, np.stack([np.diag([60.0, 60.0, 1.0])] * 2), np.stack([np.eye(4)] * 2))
        >>> views.num_views, views.size
        (2, (48, 64))
    """

    rgb: UInt8[np.ndarray, "views h w 3"]
    depth_m: Float32[np.ndarray, "views h w"]
    """z-depth, metres, 0 where there is no return; may be sparse."""
    intrinsics: Float[np.ndarray, "views 3 3"]
    """K of each view, pixels."""
    camera_to_world: Float[np.ndarray, "views 4 4"]
    """Pose of each view, OpenCV camera axes (+X right, +Y down, +Z forward)."""

    def __post_init__(self) -> None:
        views, *size = self.rgb.shape[:3] if self.rgb.ndim == 4 else (0,)
        if views == 0 or self.rgb.shape[3] != 3:
            raise ValueError(f"rgb must be (views, height, width, 3) with at least one view, not {self.rgb.shape}")
        if self.depth_m.shape != (views, *size):
            raise ValueError(f"depth_m must be {(views, *size)} as rgb is, not {self.depth_m.shape}")
        if self.intrinsics.shape != (views, 3, 3) or self.camera_to_world.shape != (views, 4, 4):
            raise ValueError(
                f"expected {views} intrinsics (3, 3) and poses (4, 4), not {self.intrinsics.shape} and "
                f"{self.camera_to_world.shape}"
            )

    @property
    def num_views(self) -> int:
        """How many views there are."""
        return len(self.rgb)

    @property
    def size(self) -> tuple[int, int]:
        """Picture height and width in pixels."""
        return self.rgb.shape[1], self.rgb.shape[2]

    def camera(self, view: int) -> Camera:
        """Intrinsics and pose of one view."""
        return Camera(self.intrinsics[view], self.camera_to_world[view], self.size)
