"""Noise models of depth sensors (Kinect, stereo camera, lidar): pure functions of one true depth picture.

Constants in pixels are in pixels of the sensor; they are converted by the ratio of focal lengths, so that the models
hold for pictures of any resolution.
"""

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from sbm_gym.sensors.noise_config import Sensor

JUMP = 0.05
"""Least relative difference of depth between neighbouring pixels of two surfaces."""
KINECT_FOCAL_PX, KINECT_BASELINE_M, KINECT_RANGE_M = 580.0, 0.075, (0.4, 10.0)
KINECT_STEP_PX = 1 / 8
"""Resolution of disparities."""
KINECT_EDGE_LOSS = 0.5
"""Share of pixels beside a depth edge without a return, because the dot pattern is broken there."""
STEREO_FOCAL_PX, STEREO_BASELINE_M, STEREO_RANGE_M = 455.0, 0.05, (0.3, 10.0)
STEREO_STEP_PX, STEREO_NOISE_PX, STEREO_WINDOW_PX = 1 / 32, 0.1, 7.0
"""Resolution and standard deviation of disparities, and edge of the matching window."""
LIDAR_NOISE_M, LIDAR_REACH_M = 0.01, 20.0
"""Standard deviation of ranges, and the range at which 1/e of the pulses return from a surface at normal incidence."""
LIDAR_MIXED = 0.3
"""Share of pixels beside a depth edge whose beam meets both surfaces."""


def sense_depth(
    sensor: Sensor, depth_m: Float32[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], rng: np.random.Generator
) -> Float32[np.ndarray, "h w"]:
    """Depth as a sensor would have measured it.

    Args:
        sensor: which; "ideal" changes nothing.
        depth_m: true z-depth, metres, 0 = no return (there never is one then).
        intrinsics: K, pixels.
        rng: decides the noise.

    Returns:
        z-depth, metres, 0 where the sensor gets no return.
    """
    return depth_m if sensor == "ideal" else _SENSORS[sensor](depth_m, intrinsics, rng)


def kinect(
    depth_m: Float32[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], rng: np.random.Generator
) -> Float32[np.ndarray, "h w"]:
    """Structured light: noise that grows with the square of distance, steps of disparity, holes.

    Nothing returns from what the projector, left of the camera, does not light, from grazing surfaces, from half of the
    pixels at edges, and from beyond the sensor's range.

    Source: Nguyen, Izadi and Lovell, "Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking", 2012
    (axial and lateral noise by distance and angle).
    """
    focal_px = float(intrinsics[0, 0])
    angle_rad = np.arccos(incidence_cosine(depth_m, intrinsics))
    steepness = angle_rad / np.maximum(0.5 * np.pi - angle_rad, 1e-6)
    lateral_px = (0.8 + 0.035 * np.minimum(steepness, 10)) * focal_px / KINECT_FOCAL_PX
    measured = _moved(depth_m, lateral_px, rng) + rng.normal(size=depth_m.shape) * kinect_noise_m(depth_m, angle_rad)
    measured = quantised(measured, KINECT_STEP_PX / (KINECT_FOCAL_PX * KINECT_BASELINE_M))
    lost = jumps(depth_m) & (rng.random(depth_m.shape) < KINECT_EDGE_LOSS)
    lost |= in_shadow(depth_m, focal_px * KINECT_BASELINE_M) | (angle_rad > np.deg2rad(82))
    return _within(measured, depth_m, lost, KINECT_RANGE_M)


def kinect_noise_m(
    depth_m: Float32[np.ndarray, "h w"], angle_rad: Float[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w"]:
    """Standard deviation of a Kinect's depth, by distance and by the angle between ray and normal."""
    away = np.clip(angle_rad, 0, np.deg2rad(82))
    grazing = 0.0001 / np.sqrt(np.maximum(depth_m, 0.1)) * (away / (0.5 * np.pi - away)) ** 2
    return 0.0012 + 0.0019 * (depth_m - 0.4) ** 2 + np.where(away > np.pi / 3, grazing, 0)


def stereo(
    depth_m: Float32[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], rng: np.random.Generator
) -> Float32[np.ndarray, "h w"]:
    """Matching of windows between two cameras: noise alike within a window, objects fattened, one side of them lost.

    The standard deviation of depth is that of disparity times z²/(f b), with the focal length f and the baseline b.
    """
    focal_px = float(intrinsics[0, 0])
    window_px = max(1, round(STEREO_WINDOW_PX * focal_px / STEREO_FOCAL_PX)) | 1  # odd
    # A window that shows two surfaces is matched by the nearer one, whose disparities differ more from the rest.
    seen = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    near = cv2.erode(seen, np.ones((window_px, window_px), np.uint8), borderType=cv2.BORDER_REPLICATE)
    fattened = np.where(near < (1 - JUMP) * seen, near, depth_m)
    noise = cv2.GaussianBlur(rng.normal(size=depth_m.shape), (0, 0), 0.25 * window_px + 0.05)
    noise *= STEREO_NOISE_PX / max(float(noise.std()), 1e-9)
    per_m = STEREO_FOCAL_PX * STEREO_BASELINE_M
    measured = _depth_of(_inverse(fattened) + noise / per_m)
    measured = quantised(measured, STEREO_STEP_PX / per_m)
    return _within(measured, depth_m, in_shadow(depth_m, focal_px * STEREO_BASELINE_M), STEREO_RANGE_M)


def lidar(
    depth_m: Float32[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], rng: np.random.Generator
) -> Float32[np.ndarray, "h w"]:
    """Time of flight: constant noise along the ray, lost pulses, and mixed pixels at depth edges.

    The strength of an echo is cos(angle)/range² times exponentially distributed speckle, so a pulse returns with
    probability ``lidar_returns``.
    """
    slant = _slant(depth_m.shape, intrinsics)
    cosine = incidence_cosine(depth_m, intrinsics)
    measured = depth_m + rng.normal(size=depth_m.shape) * LIDAR_NOISE_M / slant
    near, far = _around(depth_m)
    other = np.where(far - depth_m > depth_m - near, far, near)
    mixed = jumps(depth_m) & (rng.random(depth_m.shape) < LIDAR_MIXED)
    share = rng.random(depth_m.shape)
    measured = np.where(mixed, share * measured + (1 - share) * other, measured)
    lost = rng.random(depth_m.shape) >= lidar_returns(depth_m * slant, cosine)
    return _within(measured, depth_m, lost, (0.0, np.inf))


def lidar_returns(range_m: Float[np.ndarray, "h w"], cosine: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Probability that a pulse returns, by range in metres and cosine of the angle between ray and normal."""
    return np.exp(-((range_m / LIDAR_REACH_M) ** 2) / np.maximum(cosine, 1e-3))


# Parts of the above --------------------------------------------------------------------------------------------------


def quantised(depth_m: Float[np.ndarray, "h w"], step_per_m: float) -> Float[np.ndarray, "h w"]:
    """Depth with its inverse rounded to multiples of ``step_per_m``, as disparity is; 0 steps are no return."""
    return _depth_of(np.rint(_inverse(depth_m) / step_per_m) * step_per_m)


def in_shadow(depth_m: Float32[np.ndarray, "h w"], shift_px_m: float) -> Bool[np.ndarray, "h w"]:
    """Pixels that are hidden by something nearer from a second camera, or a projector, left of the first.

    Args:
        depth_m: z-depth, 0 = no return.
        shift_px_m: focal length in pixels times the baseline: a pixel at depth z appears ``shift_px_m / z`` further
            right to the other one.
    """
    place = np.arange(depth_m.shape[1]) + shift_px_m * _inverse(depth_m)
    place[depth_m <= 0] = -np.inf
    covered = np.maximum.accumulate(place, axis=1)
    hidden = np.zeros(depth_m.shape, bool)
    hidden[:, 1:] = (place[:, 1:] < covered[:, :-1]) & (depth_m[:, 1:] > 0)
    return hidden


def jumps(depth_m: Float32[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels at depth edges: a neighbour lies on another surface.

    On a surface seen at a grazing angle the differences to both sides are alike; at a jump they are not.
    """
    near, far = _around(depth_m)
    return (depth_m > 0) & (np.abs(far + near - 2 * depth_m) > JUMP * depth_m)


def incidence_cosine(
    depth_m: Float32[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "h w"]:
    """Cosine of the angle between ray and surface normal at each pixel, in [0, 1]; 1 where there is no return."""
    rays = _rays(depth_m.shape, intrinsics)
    points = rays * depth_m[..., None]
    normal = np.cross(_along(points, 1), _along(points, 0))
    length = np.linalg.norm(normal, axis=-1) * np.linalg.norm(rays, axis=-1)
    cosine = np.abs((normal * rays).sum(-1)) / np.maximum(length, 1e-12)
    return np.where(depth_m > 0, np.clip(cosine, 0.0, 1.0), 1.0)


def _around(depth_m: Float32[np.ndarray, "h w"]) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """The nearest and the farthest return among each pixel and its neighbours."""
    square = np.ones((3, 3), np.uint8)
    seen = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    near = cv2.erode(seen, square, borderType=cv2.BORDER_REPLICATE)
    far = cv2.dilate(depth_m, square, borderType=cv2.BORDER_REPLICATE)
    return np.where(np.isfinite(near), near, 0), far


def _along(points: Float[np.ndarray, "h w 3"], axis: int) -> Float[np.ndarray, "h w 3"]:
    """The way along the surface to the neighbour on that side on which depth changes less, so never across a jump."""
    steps = np.diff(points, axis=axis)
    gap = [(0, 0)] * 3
    before, after = ([*gap[:axis], pad, *gap[axis + 1 :]] for pad in ((1, 0), (0, 1)))
    back, ahead = (np.pad(steps, pads, constant_values=np.inf) for pads in (before, after))
    chosen = np.where(np.abs(back[..., 2:]) < np.abs(ahead[..., 2:]), back, ahead)
    return np.where(np.isfinite(chosen), chosen, 0.0)


def _rays(size: tuple[int, ...], intrinsics: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "h w 3"]:
    y, x = np.mgrid[: size[0], : size[1]]
    across = (x - intrinsics[0, 2]) / intrinsics[0, 0]
    return np.stack([across, (y - intrinsics[1, 2]) / intrinsics[1, 1], np.ones_like(across)], axis=-1)


def _slant(size: tuple[int, ...], intrinsics: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "h w"]:
    """Range per z-depth at each pixel."""
    return np.linalg.norm(_rays(size, intrinsics), axis=-1)


def _moved(depth_m, sigma_px, rng: np.random.Generator) -> np.ndarray:
    """Each pixel's depth from a place beside it, by normally distributed pixels; from no return it stays its own."""
    height, width = depth_m.shape
    y, x = np.mgrid[:height, :width]
    rows, columns = (
        np.clip(np.rint(place + sigma_px * rng.normal(size=depth_m.shape)), 0, side - 1).astype(int)
        for place, side in ((y, height), (x, width))
    )
    found = depth_m[rows, columns]
    return np.where(found > 0, found, depth_m)


def _inverse(depth_m) -> np.ndarray:
    return np.divide(1.0, depth_m.astype(float), out=np.zeros(depth_m.shape), where=depth_m > 0)


def _depth_of(inverse_per_m) -> np.ndarray:
    return np.divide(1.0, inverse_per_m, out=np.zeros(inverse_per_m.shape), where=inverse_per_m > 1e-6)


def _within(measured_m, depth_m, lost, range_m: tuple[float, float]) -> Float32[np.ndarray, "h w"]:
    """What is left of a measurement: where there was something, not lost, and within the sensor's range."""
    kept = (depth_m > 0) & ~lost & (measured_m > range_m[0]) & (measured_m < range_m[1])
    return np.where(kept, measured_m, 0).astype(np.float32)


_SENSORS: dict[str, Callable[..., Float32[np.ndarray, "h w"]]] = {"kinect": kinect, "stereo": stereo, "lidar": lidar}
