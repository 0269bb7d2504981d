"""The ``state`` observation: what the robot knows, as numbers from -1 to 1."""

import math

import numpy as np
from jaxtyping import Float, Float32

from sbm_gym.env.simulation import Simulation
from sbm_gym.robot.knowledge import RobotKnowledge
from sbm_gym.robot.object_memory import KnownObject, ViewBins
from sbm_gym.robot.view_history import Candidate
from sbm_gym.scenes.profiles import ObservationScales
from sbm_gym.worlds.geometry.grid_kernels import free_steps
from sbm_gym.worlds.geometry.navigable import NavigableMap

FREE_DIRECTIONS = 16
UNSEEN_DIRECTIONS = 8
UNSEEN_STRIDES = {"near": (0.0, 3.0), "far": (3.0, 12.0)}
"""Rings around the robot in which unseen floor is counted, by direction."""
OTHERS = 4
"""So many confirmed objects beside the fixation target are told about, the nearest first."""
CANDIDATES = 3
"""So many unconfirmed ones, the most promising first."""
FAILED_LOOK_FACTOR = 0.4
"""What each look that did not confirm a candidate leaves of its score."""
MANY_OBJECTS, MANY_LOOKS = 10, 5
PLACED = 6
"""Entries about an object before those about its sectors."""
ROOM_SCALES = ObservationScales()


def state_names(bins: ViewBins) -> tuple[str, ...]:
    """What each entry of the ``state`` observation means, in order.

    ``ahead`` and ``left`` are the cosine and sine of the bearing from where the camera points; the elevation is divided
    by pi; flags and shares are 0 to 1; ranges are divided by ``ObservationScales.range_reach_m`` and clipped. Sectors
    and directions go counter-clockwise, sector 0 being the one the agent stands in, direction 0 the one that the camera
    points in.
    """
    place = ("range", "ahead", "left")
    sectors = [f"sector_{k}_{what}" for what in ("covered", "open") for k in range(bins.num_azimuths)]
    of_object = ("known", "visible", *place, "azimuths_covered", *sectors)
    return (
        *(f"target_{entry}" for entry in of_object),
        *("target_elevation", "target_confidence_now", "target_best_confidence"),
        *(f"other_{k}_{entry}" for k in range(OTHERS) for entry in of_object),
        *(f"candidate_{k}_{entry}" for k in range(CANDIDATES) for entry in ("confidence", *place, "looks")),
        *("objects_confirmed", "camera_tilt", "collided", "time_left"),
        *(f"free_space_{k}" for k in range(FREE_DIRECTIONS)),
        *(f"unseen_{ring}_{k}" for ring in UNSEEN_STRIDES for k in range(UNSEEN_DIRECTIONS)),
    )


def state_vector(simulation: Simulation, scales: ObservationScales) -> Float32[np.ndarray, "n"]:
    """The ``state`` observation; entries as ``state_names`` says.

    Args:
        simulation: after its latest look.
        scales: lengths that the observation is scaled by.
    """
    robot, body, update = simulation.robot, simulation.scene.body, simulation.update
    camera_m, target, count = body.camera_to_world[:3, 3], robot.target, robot.view_bins.num_azimuths
    position_m, yaw_rad = body.position_m, body.yaw_rad

    def place(point_m) -> tuple[float, float, float]:
        x, y = point_m[:2] - camera_m[:2]
        bearing_rad = np.arctan2(y, x) - yaw_rad
        return np.hypot(x, y) / scales.range_reach_m, np.cos(bearing_rad), np.sin(bearing_rad)

    def tell_object(known: KnownObject, entries: Float[np.ndarray, "m"]) -> None:
        away = camera_m - known.centroid_m
        here = int(robot.view_bins.azimuth_bin(np.arctan2(away[1], away[0])))
        azimuths, is_open = known.azimuths, robot.open_sectors(known)
        visible = known.object_id in update.visible
        entries[:PLACED] = (1.0, visible, *place(known.centroid_m), len(azimuths) / count)
        covered, seen = entries[PLACED : PLACED + count], entries[PLACED + count :]
        for azimuth in azimuths:
            covered[(azimuth - here) % count] = 1.0
        seen[: count - here], seen[count - here :] = is_open[here:], is_open[:here]

    # Zeros stand for what there is nothing of.
    of_object, of_candidate = PLACED + 2 * count, 5
    others, candidates = of_object + 3, of_object + 3 + OTHERS * of_object
    episode = candidates + CANDIDATES * of_candidate
    entries = np.zeros(episode + 4)
    if target is not None:
        tell_object(target, entries[:of_object])
        x, y, z = target.centroid_m - camera_m
        confidence_now = update.confidence_now.get(target.object_id, 0.0)
        about = np.arctan2(z, np.hypot(x, y)) / np.pi, confidence_now, target.best_confidence
        entries[of_object:others] = about
    for k, known in enumerate(nearest_others(robot, camera_m)[:OTHERS]):
        tell_object(known, entries[others + k * of_object :][:of_object])
    for k, one in enumerate(likely_candidates(robot)[:CANDIDATES]):
        told = one.confidence, *place(one.centroid_m), len(one.looks) / MANY_LOOKS
        entries[candidates + k * of_candidate :][:of_candidate] = told
    time_left = max(0.0, 1.0 - simulation.step_index / simulation.num_views)
    entries[episode:] = len(robot.objects) / MANY_OBJECTS, body.tilt_rad / np.pi, simulation.collided, time_left
    free_m = free_distances_m(robot.navigable, position_m, yaw_rad, scales.free_reach_m)
    unseen = robot.seen_floor.unseen_around(position_m, yaw_rad, tuple(UNSEEN_STRIDES.values()), UNSEEN_DIRECTIONS)
    columns = entries, free_m / scales.free_reach_m, unseen.ravel()
    return np.concatenate(columns).clip(-1.0, 1.0).astype(np.float32)


def nearest_others(robot: RobotKnowledge, camera_m: Float[np.ndarray, "3"]) -> list[KnownObject]:
    """The confirmed objects beside the fixation target in the order that observations have them: nearest first."""
    target, here_m = robot.target, camera_m[:2].tolist()
    others = [known for known in robot.objects if known is not target]
    return sorted(others, key=lambda known: math.dist(known.centroid_m[:2].tolist(), here_m))


def likely_candidates(robot: RobotKnowledge) -> list[Candidate]:
    """The unconfirmed ones in the order that observations have them: the most promising first."""
    return sorted(robot.view_history.candidates, key=confirmation_score, reverse=True)


def confirmation_score(candidate: Candidate) -> float:
    """How likely another look confirms a candidate: its confidence, less for each view that did not."""
    return candidate.confidence * FAILED_LOOK_FACTOR ** len(candidate.looks)


def free_distances_m(
    navigable: NavigableMap,
    position_m: Float[np.ndarray, "2"],
    yaw_rad: float,
    reach_m: float = ROOM_SCALES.free_reach_m,
) -> Float[np.ndarray, "directions"]:
    """How far the body could go in each of ``FREE_DIRECTIONS``, from the map the robot navigates by.

    Args:
        navigable: where the body's centre may be.
        position_m: where it is.
        yaw_rad: the first direction; the others follow counter-clockwise.
        reach_m: how far to look.

    Returns:
        Metres, at most ``reach_m``.
    """
    angles = yaw_rad + np.arange(FREE_DIRECTIONS) * (2.0 * np.pi / FREE_DIRECTIONS)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    x, y, most = float(position_m[0]), float(position_m[1]), int(reach_m / navigable.cell_m)
    steps = free_steps(navigable.free, navigable.origin_m, navigable.cell_m, x, y, directions, most)
    return np.minimum(steps * navigable.cell_m, reach_m)
