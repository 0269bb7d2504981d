"""What the environment says about an episode: observations and ``info``."""

from typing import Any

import numpy as np

from sbm_gym.env.episode import Episode
from sbm_gym.env.observations import encode_depth
from sbm_gym.env.state_vector import (
    OTHERS,
    UNSEEN_DIRECTIONS,
    UNSEEN_STRIDES,
    Situation,
    free_distances_m,
    state_vector,
)
from sbm_gym.robot.object_memory import KnownObject, ViewBins
from sbm_gym.scenes.profiles import ObservationScales


def observation(episode: Episode, num_views: int, bins: ViewBins, scales: ObservationScales) -> dict[str, np.ndarray]:
    """What the robot sees and knows now, as the observation space has it.

    Args:
        episode: the robot.
        num_views: steps of the episode.
        bins: how views of an object are told apart.
        scales: lengths that the observation is scaled by.
    """
    body, target, update = episode.scene.body, episode.target, episode.update
    others = [known for known in episode.memory.objects if known is not target]
    others.sort(key=lambda known: float(np.linalg.norm((known.centroid_m - body.camera_to_world[:3, 3])[:2])))
    told = others[:OTHERS] + ([] if target is None else [target])
    situation = Situation(
        yaw_rad=body.yaw_rad,
        tilt_rad=body.tilt_rad,
        camera_m=body.camera_to_world[:3, 3],
        target=target,
        target_visible=target is not None and target.object_id in update.visible,
        target_confidence_now=0.0 if target is None else update.confidence_now.get(target.object_id, 0.0),
        others=tuple((known, known.object_id in update.visible) for known in others[:OTHERS]),
        open_sectors={known.object_id: episode.open_sectors(known) for known in told},
        candidates=tuple(episode.looked.candidates),
        num_confirmed=len(episode.memory.objects),
        collided=episode.collided,
        time_left=max(0.0, 1.0 - episode.step_index / num_views),
        free_m=free_distances_m(episode.scene.world.navigable, body.position_m, body.yaw_rad, scales.free_reach_m),
        unseen=episode.floor.unseen_around(
            body.position_m, body.yaw_rad, tuple(UNSEEN_STRIDES.values()), UNSEEN_DIRECTIONS
        ),
    )
    frame = episode.view.frame
    return {
        "rgb": frame.rgb.copy(),
        "depth": encode_depth(frame.depth_m, scales.depth_level_m),
        "state": state_vector(situation, bins, scales),
    }


def info(episode: Episode, terms: dict[str, float], num_azimuths: int) -> dict[str, Any]:
    """Everything about the robot that is not in the observation.

    Args:
        episode: the robot.
        terms: of the reward, by name.
        num_azimuths: sectors around an object.
    """
    body, target = episode.scene.body, episode.target
    known = [_describe(known, episode) for known in episode.memory.objects]
    return {
        "scene": episode.scene.name,
        "detections": list(episode.detections),
        # What the masks of detections lie over: a real detector looks at a picture of its own.
        "sight": {"depth_m": episode.sight.frame.depth_m, "intrinsics": episode.sight.intrinsics.copy()},
        "fixation_target": {} if target is None else _describe(target, episode),
        "confirmed_objects": known,
        "reward_terms": terms,
        "agent": {
            "position_m": body.position_m,
            "yaw_rad": body.yaw_rad,
            "tilt_rad": body.tilt_rad,
            "camera_to_world": body.camera_to_world,
            "intrinsics": episode.view.intrinsics.copy(),
        },
        "collided": episode.collided,
        "is_success": bool(known),
        "coverage": max((len(k.azimuths) for k in episode.memory.objects), default=0) / num_azimuths,
        "path_length_m": episode.path_m,
    }


def _describe(known: KnownObject, episode: Episode) -> dict[str, Any]:
    return {
        "object_id": known.object_id,
        "category": known.category,
        "best_confidence": known.best_confidence,
        "centroid_m": known.centroid_m.copy(),
        "extent_m": known.extent_m,
        "visible": known.object_id in episode.update.visible,
        "azimuths": sorted(known.azimuths),
    }
