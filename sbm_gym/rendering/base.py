"""What a renderer is: something that draws an ``MjModel`` as colour, depth and geom ids from any camera.

All renderers agree on what is where. Geoms of groups 0 to 2 are drawn, from both sides; planes from their front. Depth
and ids report the first surface that is neither glass (opacity below 0.995) nor a hole that a texture leaves open: what
a detector would name behind a window is what the ids say. Colour shows the glass. (``mujoco.Renderer`` differs: its
segmentation and depth report the glass.)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, UInt8

from labeling.core.views import Camera


@dataclass(frozen=True)
class Frame:
    """One picture of a scene, all three images from the same rays."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth_m: Float32[np.ndarray, "h w"]
    """z-depth of the pixel centre, metres, 0 where nothing was hit."""
    geom_id: Int32[np.ndarray, "h w"]
    """Geom at the pixel centre, -1 where nothing was hit."""


class Renderer(Protocol):
    """Draws one compiled model, from any camera and in any size."""

    def render(self, data: mujoco.MjData, camera: Camera, *, antialias: bool = True, colours: bool = True) -> Frame:
        """Draws the scene as it stands in ``data``.

        Args:
            data: state of the scene; ``mj_forward`` (or ``mj_kinematics``) has been called on it.
            camera: where the picture is taken from, and its size.
            antialias: smooth edges in ``rgb``; depth and ids always belong to the pixel centre.
            colours: whether ``rgb`` is drawn; without, it is black, depth and ids are the same to the last bit, and no
                time is spent on light, shadows, textures and sky.

        Raises:
            ValueError: if the picture has no pixels, camera numbers are not finite, or the renderer cannot draw what
                the camera sees.
        """
        ...

    def amodal_mask(self, data: mujoco.MjData, geom_ids: Sequence[int], camera: Camera) -> Bool[np.ndarray, "h w"]:
        """Pixels whose centre would show one of these geoms if nothing else were there; glass shows nothing.

        Raises:
            ValueError: as in ``render``; also for geoms that the model does not have.
        """
        ...

    def close(self) -> None:
        """Gives back what the renderer holds outside its own memory; a later picture takes it again."""
        ...


def check_camera(camera: Camera) -> None:
    """Checks that a camera can take a picture.

    Raises:
        ValueError: if the picture has no pixels, or camera numbers are not finite.
    """
    height_px, width_px = camera.size
    if height_px < 1 or width_px < 1:
        raise ValueError(f"a picture needs at least one pixel each way, not {width_px} x {height_px}")
    intrinsics, camera_to_world = np.asarray(camera.intrinsics), np.asarray(camera.camera_to_world)
    if intrinsics.shape != (3, 3) or camera_to_world.shape != (4, 4):
        raise ValueError(
            f"intrinsics must be (3, 3) and camera_to_world (4, 4), not {intrinsics.shape} and {camera_to_world.shape}"
        )
    if not (np.isfinite(intrinsics).all() and np.isfinite(camera_to_world).all()) or intrinsics[0, 0] <= 0:
        raise ValueError("camera numbers must be finite and the focal length positive")


def pixel_to_world(camera: Camera) -> Float[np.ndarray, "3 3"]:
    """Matrix that turns (x, y, 1) of a pixel into a world direction of z-depth one."""
    return np.asarray(camera.camera_to_world, float)[:3, :3] @ np.linalg.inv(camera.intrinsics)


def check_geoms(model: mujoco.MjModel, geom_ids: Sequence[int]) -> set[int]:
    """The geoms, if the model has them all.

    Raises:
        ValueError: if not.
    """
    geoms = {int(geom) for geom in geom_ids}
    if any(not 0 <= geom < model.ngeom for geom in geoms):
        raise ValueError(f"geom ids must lie in 0..{model.ngeom - 1}, but are {sorted(geoms)}")
    return geoms
