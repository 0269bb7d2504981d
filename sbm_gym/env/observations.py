"""What the environment says about an episode: observations (two small pictures and what the robot knows), ``info``."""

from typing import Any

import numpy as np
from gymnasium import spaces
from jaxtyping import Float, UInt8
from numba import njit

from sbm_gym.env.simulation import Simulation
from sbm_gym.env.state_vector import ROOM_SCALES, state_names, state_vector
from sbm_gym.robot.object_memory import KnownObject, ViewBins
from sbm_gym.scenes.profiles import ObservationScales


def observation_space(height_px: int, width_px: int, bins: ViewBins) -> spaces.Dict:
    """The observation space of an env with these picture sizes."""
    return spaces.Dict(
        {
            "rgb": spaces.Box(0, 255, (height_px, width_px, 3), np.uint8),
            "depth": spaces.Box(0, 255, (height_px, width_px, 1), np.uint8),
            "state": spaces.Box(-1.0, 1.0, (len(state_names(bins)),), np.float32),
        }
    )


def encode_depth(
    depth_m: Float[np.ndarray, "h w"], level_m: float = ROOM_SCALES.depth_level_m
) -> UInt8[np.ndarray, "h w 1"]:
    """Depth in levels of ``level_m``; a return is never encoded as 0, which stands for none."""
    levels = np.empty((*depth_m.shape, 1), np.uint8)
    _write_levels(depth_m, depth_m.dtype.type(level_m), levels)
    return levels


@njit(cache=True, nogil=True, error_model="numpy")
def _write_levels(depth_m, level_m, levels):
    """What ``encode_depth`` returns, into (h, w, 1) uint8."""
    for row in range(depth_m.shape[0]):
        for column in range(depth_m.shape[1]):
            level = min(max(np.rint(depth_m[row, column] / level_m), 1), 255)
            levels[row, column, 0] = np.uint8(level) if depth_m[row, column] > 0.0 else np.uint8(0)


def observation(simulation: Simulation, scales: ObservationScales) -> dict[str, np.ndarray]:
    """What the robot sees and knows now, as the observation space has it.

    Args:
        simulation: after its latest look.
        scales: lengths that the observation is scaled by.
    """
    frame = simulation.view.frame
    return {
        "rgb": frame.rgb.copy(),
        "depth": encode_depth(frame.depth_m, scales.depth_level_m),
        "state": state_vector(simulation, scales),
    }


def info(simulation: Simulation, terms: dict[str, float]) -> dict[str, Any]:
    """Everything about the robot that is not in the observation.

    Args:
        simulation: after its latest look.
        terms: of the reward, by name.
    """
    robot, body, target = simulation.robot, simulation.scene.body, simulation.robot.target
    sight = simulation.sight
    known = [_describe(known, simulation) for known in robot.objects]
    return {
        "scene": simulation.scene.name,
        "detections": list(simulation.detections),
        # What the masks of detections lie over: a real detector looks at a picture of its own. The robot keeps the
        # depth until its beliefs are asked for.
        "sight": {"depth_m": sight.frame.depth_m.copy(), "intrinsics": sight.camera.intrinsics.copy()},
        "fixation_target": {} if target is None else _describe(target, simulation),
        "confirmed_objects": known,
        "reward_terms": terms,
        "agent": {
            "position_m": body.position_m,
            "yaw_rad": body.yaw_rad,
            "tilt_rad": body.tilt_rad,
            "camera_to_world": body.camera_to_world,
            "intrinsics": simulation.view.camera.intrinsics.copy(),
        },
        "collided": simulation.collided,
        "is_success": bool(known),
        "coverage": max((len(k.azimuths) for k in robot.objects), default=0) / robot.view_bins.num_azimuths,
        "path_length_m": simulation.path_m,
    }


def _describe(known: KnownObject, simulation: Simulation) -> dict[str, Any]:
    return {
        "object_id": known.object_id,
        "category": known.category,
        "best_confidence": known.best_confidence,
        "centroid_m": known.centroid_m.copy(),
        "extent_m": known.extent_m,
        "visible": known.object_id in simulation.update.visible,
        "azimuths": sorted(known.azimuths),
    }
