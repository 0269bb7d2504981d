"""The ``state`` observation: what the robot knows, as numbers from -1 to 1."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Float32

from sbm_gym.robot.object_memory import KnownObject, ViewBins
from sbm_gym.robot.view_history import Candidate
from sbm_gym.scenes.profiles import ObservationScales
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
ROOM_SCALES = ObservationScales()


@dataclass(frozen=True)
class StateInputs:
    """Everything the state vector is made of."""

    yaw_rad: float = 0.0
    tilt_rad: float = 0.0
    camera_m: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    target: KnownObject | None = None
    target_visible: bool = False
    target_confidence_now: float = 0.0
    others: tuple[tuple[KnownObject, bool], ...] = ()
    """Confirmed objects beside the target, the nearest first, and whether the view shows them."""
    open_sectors: Mapping[int, Bool[np.ndarray, "sectors"]] = field(default_factory=dict)
    """By id of the target and the others: the sectors from which it could be seen, see ``RobotState.open_sectors``."""
    candidates: tuple[Candidate, ...] = ()
    num_confirmed: int = 0
    collided: bool = False
    time_left: float = 1.0
    """Share of the episode's steps that remain."""
    free_m: Float[np.ndarray, "directions"] = field(default_factory=lambda: np.zeros(FREE_DIRECTIONS))
    """From ``free_distances_m``."""
    unseen: Float[np.ndarray, "rings directions"] = field(
        default_factory=lambda: np.zeros((len(UNSEEN_STRIDES), UNSEEN_DIRECTIONS))
    )
    """Share of each piece of the rings ``UNSEEN_STRIDES`` that is floor the robot could stand on and has not seen;
    directions as those of free floor."""


def state_names(bins: ViewBins) -> tuple[str, ...]:
    """What each entry of the ``state`` observation means, in order.

    ``ahead`` and ``left`` are the cosine and sine of the bearing from where the camera points; the elevation is divided
    by pi; flags and shares are 0 to 1; ranges are divided by ``ObservationScales.range_reach_m`` and clipped. Sectors
    and directions go counter-clockwise, sector 0 being the one the agent stands in, direction 0 the one that the camera
    points in.
    """
    return tuple(_entries(StateInputs(), bins, ROOM_SCALES))


def state_vector(
    situation: StateInputs, bins: ViewBins, scales: ObservationScales = ROOM_SCALES
) -> Float32[np.ndarray, "n"]:
    """The ``state`` observation; entries as ``state_names`` says."""
    return np.clip(list(_entries(situation, bins, scales).values()), -1.0, 1.0).astype(np.float32)


def confirmation_score(candidate: Candidate) -> float:
    """How likely another look confirms a candidate: its confidence, less for each view that did not."""
    return candidate.confidence * FAILED_LOOK_FACTOR ** len(candidate.looks)


def _entries(s: StateInputs, bins: ViewBins, scales: ObservationScales) -> dict[str, float]:
    """All entries by name, in order."""
    found = _of_object("target", s, s.target, s.target_visible, bins, scales)
    found["target_elevation"] = 0.0
    if s.target is not None:
        offset = s.target.centroid_m - s.camera_m
        found["target_elevation"] = float(np.arctan2(offset[2], np.hypot(offset[0], offset[1]))) / np.pi
    found["target_confidence_now"] = s.target_confidence_now
    found["target_best_confidence"] = 0.0 if s.target is None else s.target.best_confidence
    for k in range(OTHERS):
        known, visible = s.others[k] if k < len(s.others) else (None, False)
        found |= _of_object(f"other_{k}", s, known, visible, bins, scales)
    likely = sorted(s.candidates, key=confirmation_score, reverse=True)
    for k in range(CANDIDATES):
        found |= _of_candidate(f"candidate_{k}", s, likely[k] if k < len(likely) else None, scales)
    found["objects_confirmed"] = s.num_confirmed / MANY_OBJECTS
    found["camera_tilt"] = s.tilt_rad / np.pi
    found["collided"] = float(s.collided)
    found["time_left"] = s.time_left
    for k, free_m in enumerate(s.free_m):
        found[f"free_space_{k}"] = float(free_m) / scales.free_reach_m
    for ring, shares in zip(UNSEEN_STRIDES, s.unseen, strict=True):
        found |= {f"unseen_{ring}_{k}": float(share) for k, share in enumerate(shares)}
    return found


def _of_object(
    name: str, s: StateInputs, known: KnownObject | None, visible: bool, bins: ViewBins, scales: ObservationScales
) -> dict[str, float]:
    """What is told about a confirmed object; zeros if there is none."""
    here, covered, is_open = 0, set(), np.zeros(bins.num_azimuths)
    if known is not None:
        away = s.camera_m - known.centroid_m
        here = int(bins.azimuth_bin(float(np.arctan2(away[1], away[0]))))
        covered, is_open = known.azimuths, s.open_sectors[known.object_id]
    sectors = [(here + k) % bins.num_azimuths for k in range(bins.num_azimuths)]
    entries = {
        "known": float(known is not None),
        "visible": float(visible),
        **_place(s, None if known is None else known.centroid_m, scales),
        "azimuths_covered": len(covered) / bins.num_azimuths,
    }
    entries |= {f"sector_{k}_covered": float(sector in covered) for k, sector in enumerate(sectors)}
    entries |= {f"sector_{k}_open": float(is_open[sector]) for k, sector in enumerate(sectors)}
    return {f"{name}_{entry}": value for entry, value in entries.items()}


def _of_candidate(name: str, s: StateInputs, one: Candidate | None, scales: ObservationScales) -> dict[str, float]:
    """What is told about an unconfirmed object; zeros if there is none."""
    entries = {
        "confidence": 0.0 if one is None else one.confidence,
        **_place(s, None if one is None else one.centroid_m, scales),
        "looks": 0.0 if one is None else len(one.looks) / MANY_LOOKS,
    }
    return {f"{name}_{entry}": value for entry, value in entries.items()}


def _place(s: StateInputs, point_m: Float[np.ndarray, "3"] | None, scales: ObservationScales) -> dict[str, float]:
    """Horizontal range as a share of its reach, and the direction."""
    if point_m is None:
        return {"range": 0.0, "ahead": 0.0, "left": 0.0}
    offset = point_m - s.camera_m
    bearing_rad = float(np.arctan2(offset[1], offset[0])) - s.yaw_rad
    range_m = float(np.hypot(offset[0], offset[1]))
    return {
        "range": min(range_m / scales.range_reach_m, 1.0),
        "ahead": float(np.cos(bearing_rad)),
        "left": float(np.sin(bearing_rad)),
    }


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
    steps_m = np.arange(1, int(reach_m / navigable.cell_m) + 1) * navigable.cell_m
    angles = yaw_rad + np.arange(FREE_DIRECTIONS) * (2.0 * np.pi / FREE_DIRECTIONS)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = position_m + steps_m[None, :, None] * directions[:, None, :]
    free = navigable.are_free(points)
    blocked_at = np.where(free.all(axis=1), len(steps_m), np.argmin(free, axis=1))
    return np.minimum(blocked_at * navigable.cell_m, reach_m)
