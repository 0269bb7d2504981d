"""What a policy gets to see: a small picture, a small depth image, and a vector of what the agent knows."""

from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from jaxtyping import Float, Float32, UInt8

from sbm_gym.object_memory import Candidate, KnownObject, ViewBins
from sbm_gym.worlds.navigable import NavigableMap

FREE_DIRECTIONS = 8
OTHERS = 4
"""So many confirmed objects beside the fixation target are told about, the nearest first."""
OTHER_ENTRIES = ("known", "visible", "range", "bearing", "azimuths_covered", "here_covered")
"""What is told about each; ``here_covered``: whether it has been seen from the sector that the agent stands in."""
MANY_OBJECTS = 10


@dataclass(frozen=True)
class ObservationScales:
    """Lengths that observations are scaled by."""

    depth_level_m: float = 0.04
    """One level of the depth observation: 255 levels reach 10.2 m. 0 = no return; farther returns read 255."""
    free_reach_m: float = 2.0
    """How far the robot looks for free floor around it."""
    range_reach_m: float = 5.0
    """Range of objects that reads 1."""


ROOM_SCALES = ObservationScales()


def state_names(bins: ViewBins) -> tuple[str, ...]:
    """What each entry of the ``state`` observation means, in order.

    Angles are divided by pi, so +-1 is straight behind; flags and shares are 0 to 1; ranges are divided by
    ``ObservationScales.range_reach_m`` and clipped. Bearings are counter-clockwise from where the camera points;
    sectors and directions go counter-clockwise too, sector 0 being the one the agent stands in.
    """
    return (
        "target_known",
        "target_visible",
        "target_range",
        "target_bearing",
        "target_elevation",
        "target_confidence_now",
        "target_best_confidence",
        "target_azimuths_covered",
        "candidate_confidence",
        "candidate_range",
        "candidate_bearing",
        "objects_confirmed",
        "camera_tilt",
        "collided",
        "time_left",
        *(f"target_sector_{k}_covered" for k in range(bins.num_azimuths)),
        *(f"other_{k}_{entry}" for k in range(OTHERS) for entry in OTHER_ENTRIES),
        *(f"free_space_{k}" for k in range(FREE_DIRECTIONS)),
    )


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
    levels = np.clip(np.rint(depth_m / level_m), 1, 255)
    return np.where(depth_m > 0.0, levels, 0).astype(np.uint8)[..., None]


def decode_depth(
    depth: UInt8[np.ndarray, "h w 1"], level_m: float = ROOM_SCALES.depth_level_m
) -> Float32[np.ndarray, "h w"]:
    """Metres of an encoded depth image, to within half a level below 255 levels."""
    return depth[..., 0].astype(np.float32) * np.float32(level_m)


@dataclass(frozen=True)
class Situation:
    """Everything the state vector is made of."""

    position_m: Float[np.ndarray, "2"]
    yaw_rad: float
    tilt_rad: float
    camera_m: Float[np.ndarray, "3"]
    target: KnownObject | None
    target_visible: bool
    target_confidence_now: float
    candidate: Candidate | None
    others: tuple[tuple[KnownObject, bool], ...]
    """Confirmed objects beside the target, and whether the view shows them."""
    num_confirmed: int
    collided: bool
    time_left: float
    """Share of the episode's steps that remain."""


def state_vector(
    situation: Situation, bins: ViewBins, navigable: NavigableMap, scales: ObservationScales = ROOM_SCALES
) -> Float32[np.ndarray, "n"]:
    """The ``state`` observation; entries as ``state_names`` says."""
    s = situation
    known = np.zeros(8)
    sectors = np.zeros(bins.num_azimuths)
    if s.target is not None:
        range_share, bearing, elevation = _direction(s, s.target.centroid_m, scales)
        covered = s.target.azimuths
        known[:] = [
            1.0,
            float(s.target_visible),
            range_share,
            bearing,
            elevation,
            s.target_confidence_now,
            s.target.best_confidence,
            len(covered) / bins.num_azimuths,
        ]
        here = _sector_of_agent(s, s.target, bins)
        for sector in covered:
            sectors[(sector - here) % bins.num_azimuths] = 1.0
    candidate = np.zeros(3)
    if s.candidate is not None:
        range_share, bearing, _ = _direction(s, s.candidate.centroid_m, scales)
        candidate[:] = [s.candidate.confidence, range_share, bearing]
    rest = [min(s.num_confirmed / MANY_OBJECTS, 1.0), s.tilt_rad / np.pi, float(s.collided), s.time_left]
    free = free_distances_m(navigable, s.position_m, s.yaw_rad, scales.free_reach_m) / scales.free_reach_m
    parts = [known, candidate, rest, sectors, _others(s, bins, scales), free]
    return np.clip(np.concatenate(parts), -1.0, 1.0).astype(np.float32)


def _others(s: Situation, bins: ViewBins, scales: ObservationScales) -> Float[np.ndarray, "n"]:
    """Entries about the confirmed objects beside the target."""
    entries = np.zeros((OTHERS, len(OTHER_ENTRIES)))
    nearest = sorted(s.others, key=lambda other: float(np.linalg.norm((other[0].centroid_m - s.camera_m)[:2])))
    for row, (known, visible) in zip(entries, nearest, strict=False):
        range_share, bearing, _ = _direction(s, known.centroid_m, scales)
        covered = known.azimuths
        here = _sector_of_agent(s, known, bins) in covered
        row[:] = [1.0, float(visible), range_share, bearing, len(covered) / bins.num_azimuths, float(here)]
    return entries.ravel()


def _sector_of_agent(s: Situation, known: KnownObject, bins: ViewBins) -> int:
    """The azimuth sector around an object in which the agent stands."""
    away = s.camera_m - known.centroid_m
    return bins.azimuth_bin(float(np.arctan2(away[1], away[0])))


def _direction(s: Situation, point_m: Float[np.ndarray, "3"], scales: ObservationScales) -> tuple[float, float, float]:
    """Horizontal range as a share of its reach, bearing and elevation over pi."""
    offset = point_m - s.camera_m
    range_m = float(np.hypot(offset[0], offset[1]))
    bearing = (float(np.arctan2(offset[1], offset[0])) - s.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
    return min(range_m / scales.range_reach_m, 1.0), bearing / np.pi, float(np.arctan2(offset[2], range_m)) / np.pi


def free_distances_m(
    navigable: NavigableMap,
    position_m: Float[np.ndarray, "2"],
    yaw_rad: float,
    reach_m: float = ROOM_SCALES.free_reach_m,
) -> Float[np.ndarray, "directions"]:
    """How far the body could go in each of eight directions, from the map the robot navigates by.

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
    cells = np.floor((points - navigable.origin_m) / navigable.cell_m).astype(np.int64)
    rows, columns = navigable.free.shape
    inside = (cells[..., 0] >= 0) & (cells[..., 0] < columns) & (cells[..., 1] >= 0) & (cells[..., 1] < rows)
    free = np.zeros(inside.shape, bool)
    free[inside] = navigable.free[cells[..., 1][inside], cells[..., 0][inside]]
    blocked_at = np.where(free.all(axis=1), len(steps_m), np.argmin(free, axis=1))
    return np.minimum(blocked_at * navigable.cell_m, reach_m)
