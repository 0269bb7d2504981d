"""Recorded cameras as viser wants them, and flights of a browser's eye to them."""

import time
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from labeling.core.views import Camera

FLIGHT_S, FLIGHT_STEPS = 0.6, 20


def fly(client: Any, camera_to_world: Float[np.ndarray, "4 4"], origin_m: Float[np.ndarray, "3"], fov: float) -> None:
    """Moves the eye of a browser to a camera in ``FLIGHT_S``: places in a line, directions on the shortest turn."""
    camera = client.camera
    start, end = np.array(camera.position), camera_to_world[:3, 3] - origin_m
    turns = Rotation.concatenate(
        [Rotation.from_quat(camera.wxyz, scalar_first=True), Rotation.from_matrix(camera_to_world[:3, :3])]
    )
    between = Slerp([0.0, 1.0], turns)
    for step in range(1, FLIGHT_STEPS + 1):
        share = step / FLIGHT_STEPS
        with client.atomic():
            camera.wxyz = between(share).as_quat(scalar_first=True)
            camera.position = start + share * (end - start)
        client.flush()
        time.sleep(FLIGHT_S / FLIGHT_STEPS)
    camera.fov = fov


def vertical_fov_rad(camera: Camera) -> float:
    """What a camera sees from top to bottom."""
    return 2 * float(np.arctan(0.5 * camera.size[0] / camera.intrinsics[1, 1]))


def aspect(camera: Camera) -> float:
    """Width by height of what a camera sees at one depth: of pixels that need not be square."""
    height_px, width_px = camera.size
    return float((width_px / camera.intrinsics[0, 0]) / (height_px / camera.intrinsics[1, 1]))


def wxyz(pose: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4"]:
    """The rotation of a pose as a quaternion, the real part first."""
    return Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True)
