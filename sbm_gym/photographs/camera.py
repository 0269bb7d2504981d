"""Where a photographer stands: at eye level before an object, or to one side of its front."""

import numpy as np
from jaxtyping import Float

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.types import Box3d
from labeling.core.views import Camera
from sbm_gym.photographs.sets import PhotoScene
from sbm_gym.worlds.geometry.placing import Box, overlap

FRAMING = (0.2, 0.95)
"""How much of the picture's width or height its subject takes."""
MAX_ELEVATION_RAD = np.deg2rad(32.0)
"""Nobody photographs furniture from right above."""
MIN_RANGE_M = 0.6
BODY_M = 0.12
"""Half the width of a camera with the hands around it."""


def draw_azimuth(rng: np.random.Generator) -> float:
    """From where a subject is seen, 0 its front: a third from the front, half from three quarters, the rest wider."""
    kind = rng.random()
    side = 1.0 if rng.random() < 0.5 else -1.0
    if kind < 0.35:
        return float(np.deg2rad(rng.normal(0.0, 9.0)))
    if kind < 0.85:
        return float(side * np.deg2rad(rng.uniform(20.0, 60.0)))
    return float(side * np.deg2rad(rng.uniform(60.0, 95.0)))


def draw_camera(
    photo_set: PhotoScene, subject: Box3d, size_px: tuple[int, int], rng: np.random.Generator
) -> Camera | None:
    """Draws a view of a subject; None if there is no place to take it from.

    Args:
        photo_set: where the subject stands.
        subject: its box; its front looks along the box's -Y.
        size_px: height and width of the picture.
        rng: source of randomness.
    """
    height_px, width_px = size_px
    azimuth = draw_azimuth(rng)
    across = np.array([np.sin(azimuth), -np.cos(azimuth)])
    way = subject.rotation[:2, :2] @ across
    # What the subject takes across the view and in depth, on its own axes.
    wide = abs(np.cos(azimuth)) * subject.extent_m[0] + abs(np.sin(azimuth)) * subject.extent_m[1]
    deep = abs(np.sin(azimuth)) * subject.extent_m[0] + abs(np.cos(azimuth)) * subject.extent_m[1]
    share = float(rng.uniform(*FRAMING))
    fov_rad = np.deg2rad(photo_set.fov_deg)
    fov = float(rng.uniform(*fov_rad))
    # Largest of the two sides, in picture widths at one metre's distance.
    side = max(wide, subject.extent_m[2] * width_px / height_px)
    wanted = max(side / (2.0 * np.tan(fov / 2) * share) + deep / 2, deep / 2 + MIN_RANGE_M)
    free = _reach(photo_set, subject.centre_m[:2], way, wanted)
    if free < max(deep / 2 + MIN_RANGE_M, 0.45 * wanted):
        return None
    distance = min(wanted, free)
    if distance < wanted:
        # A wider field shows as much from nearer.
        fov = 2.0 * np.arctan(side / (2.0 * share * (distance - deep / 2)))
        if fov > fov_rad[1] * 1.1:
            return None
    eye_z = float(rng.uniform(*photo_set.eye_m))
    highest = subject.centre_m[2] + np.tan(MAX_ELEVATION_RAD) * distance
    eye = np.append(subject.centre_m[:2] + distance * way, min(eye_z, highest, photo_set.ceiling_m))
    intrinsics = intrinsics_from_fov(width_px, height_px, fov)
    pose = look_at(eye, subject.centre_m)
    # Off-centre as far as the subject stays in the picture; half of all pictures have it near the middle.
    spare = np.array([max(1.0 - wide / side * share, 0.0), max(1.0 - subject.extent_m[2] / side * share, 0.0)]) / 2
    aside = rng.uniform(-1.0, 1.0, 2) * spare * (0.25 if rng.random() < 0.5 else 0.9)
    turn = np.arctan2(aside * [width_px, height_px], intrinsics[0, 0])
    pose[:3, :3] = pose[:3, :3] @ _rotation(1, turn[0]) @ _rotation(0, -turn[1]) @ _rotation(2, rng.normal(0.0, 0.02))
    return Camera(intrinsics, pose, size_px)


def _rotation(axis: int, angle_rad: float) -> Float[np.ndarray, "3 3"]:
    turned = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turned[a, a] = turned[b, b] = np.cos(angle_rad)
    turned[b, a] = np.sin(angle_rad)
    turned[a, b] = -turned[b, a]
    return turned


def _reach(photo_set: PhotoScene, start, way, wanted_m: float) -> float:
    """How far from an object, up to ``wanted_m``, a camera can be: on the floor of the set and in no piece."""
    x0, y0, x1, y1 = photo_set.floor_m
    for distance in np.arange(wanted_m, 0.0, -0.1):
        x, y = start + distance * way
        if x0 <= x <= x1 and y0 <= y <= y1:
            here = Box(float(x), float(y), BODY_M, BODY_M, 0.0, photo_set.eye_m[0], photo_set.eye_m[1])
            if not any(overlap(here, solid) for solid in photo_set.pieces.solids):
                return float(distance)
    return 0.0
