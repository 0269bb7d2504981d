"""Detecting depth that is not registered to colour, by correlating edges of depth with edges of colour.

Where depth jumps, one object ends and another begins, and mostly the colour changes as well. So the two edge pictures
correlate most at the offset between them and at the ratio of the cameras' focal lengths; if depth is registered, the
offset is 0 and the ratio 1.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import scipy.fft
from jaxtyping import Complex, Float, Float32, UInt8
from numba import njit

from labeling.core.views import RgbdViews
from labeling.io.recordings.frames import load
from labeling.io.recordings.layouts import frames_of
from labeling.io.recordings.recording_config import RecordingConfig

MAX_VIEWS, WIDTH_PX = 8, 192
"""Number of views that are compared, spread evenly, and the width that they are reduced to, pixels."""
REACH = 0.12
"""Largest offset that is searched, as a share of the width."""
TOLERANCE = 0.01
"""Largest offset of registered depth, as a share of the width: edges of depth are ragged."""
SCALES = (1.0, 0.84, 0.88, 0.92, 0.96, 1.04, 1.08, 1.12, 1.16)
"""Factors by which depth is drawn larger or smaller, to see whether its edges fit better then: a depth camera's field
of view differs by up to as much from that of the colour camera beside it."""
LEAD, LEAST_FIT = 1.15, 0.02
"""Factor by which edges must fit better at the shift than where they are, and at a scale than at their own, and the
least that they must fit there, as a coefficient of correlation: with less there is nothing to tell by."""
CHANCE = 5.0
"""Standard deviations of what noise fits by chance that edges must fit better: small pictures fit somewhere always."""


@dataclass(frozen=True)
class DepthOffset:
    """Where edges of depth lie."""

    right_px: float
    """Right of those of colour in the middle of the picture, pixels of the recording's pictures."""
    down_px: float
    """Below those of colour."""
    scale: float = 1.0
    """Size of things in depth, as a multiple of their size in colour: the ratio of both focal lengths."""

    def __str__(self) -> str:
        """Such as "25 pixels to the left and 3 up"."""
        across = f"{abs(self.right_px):.0f} pixels to the {'right' if self.right_px > 0 else 'left'}"
        along = f"{abs(self.down_px):.0f} {'down' if self.down_px > 0 else 'up'}"
        return f"{across} and {along}"


def offset_note(views: RgbdViews) -> str | None:
    """One sentence, if depth lies beside colour; None if it does not, or if that cannot be told."""
    offset = depth_offset(views)
    if offset is None:
        return None
    size = "" if offset.scale == 1.0 else f", and depth draws things {offset.scale:.2f} times as large as colour does"
    return (
        f"edges of depth lie {offset} of edges of colour{size}: depth is not registered to colour, so labels will lie "
        "beside their objects; align it, or tell of its camera "
        '(docs/your-own-recordings.md, "Depth from a camera of its own")'
    )


def registration_problem(folder: Path, config: RecordingConfig) -> str | None:
    """``offset_note`` of a recording, of which no more views are read than are looked at.

    Raises:
        EpisodeFormatError: naming the file, if it is malformed.
    """
    frames = frames_of(folder, config).frames
    chosen = np.unique(np.rint(np.linspace(0, len(frames) - 1, MAX_VIEWS)).astype(int))
    views, _, _ = load([frames[index] for index in chosen], undistort=True)
    return offset_note(views)


def depth_offset(views: RgbdViews) -> DepthOffset | None:
    """How far depth lies beside colour.

    Args:
        views: of one recording. ``MAX_VIEWS`` of them are looked at; those with odd numbers among them must agree with
            the others.

    Returns:
        Shift and scale; None if there is none beyond ``TOLERANCE`` and the steps of ``SCALES``, or if there are too few
        edges to tell.
    """
    chosen = np.unique(np.rint(np.linspace(0, views.num_views - 1, MAX_VIEWS)).astype(int))
    if len(chosen) < 2:
        return None
    factor = max(1, round(views.size[1] / WIDTH_PX))
    size = views.size[0] // factor, views.size[1] // factor
    reach_px = max(3, round(REACH * size[1]))
    colours = [_colour_spectrum(views.rgb[view], factor, size, reach_px) for view in chosen]
    tolerance_px = max(2.0, TOLERANCE * size[1])
    fits = []
    for scale in SCALES:
        depths = [_depth_spectrum(_scaled(views.depth_m[view], scale), factor, size, reach_px) for view in chosen]
        products = [depth * np.conj(colour) for depth, colour in zip(depths, colours, strict=True)]
        halves = [_correlation(np.sum(products[half::2], axis=0), size, reach_px) for half in (0, 1)]
        fits.append(_best_fit(np.stack(halves), scale, tolerance_px))
    own, best = fits[0], max((fit for fit in fits if fit.agree), key=lambda fit: fit.height, default=fits[0])
    if best.height < LEAD * own.height:
        best = own
    registered = best.scale == 1.0 and np.hypot(*best.shift) <= tolerance_px
    by_chance = np.sqrt(len(chosen) / (size[0] * size[1]))
    least = max(LEAD * own.unshifted, LEAST_FIT * len(chosen), CHANCE * by_chance)
    if not best.agree or registered or best.height < least:
        return None
    return DepthOffset(float(factor * best.shift[1]), float(factor * best.shift[0]), 1.0 / best.scale)


@dataclass(frozen=True)
class _Fit:
    """The best correlation of edges of several views at one scale."""

    scale: float
    height: float
    """Sum over views of the correlation at the best shift."""
    unshifted: float
    """Sum over views of the correlation without a shift."""
    shift: np.ndarray
    """The best shift: rows, columns; pixels of the reduced pictures."""
    agree: bool
    """Whether both halves of the views have about this shift."""


def _best_fit(fits: Float[np.ndarray, "halves rows columns"], scale: float, tolerance_px: float) -> _Fit:
    middle, total = np.array(fits.shape[1:]) // 2, fits.sum(axis=0)
    shift, *halves = (_peak(part) - middle for part in (total, *fits))
    unshifted = total[tuple(slice(place - 1, place + 2) for place in middle)].max()
    agree = all(np.abs(one - shift).max() <= tolerance_px for one in halves)
    return _Fit(scale, float(total.max()), float(unshifted), shift, agree)


def _scaled(depth_m: Float32[np.ndarray, "h w"], scale: float) -> Float32[np.ndarray, "h w"]:
    """Depth enlarged by a factor about the middle of the picture."""
    if scale == 1.0:
        return depth_m
    height, width = depth_m.shape
    about = np.array([[scale, 0, (1 - scale) * (width - 1) / 2], [0, scale, (1 - scale) * (height - 1) / 2]])
    return cv2.warpAffine(depth_m, about, (width, height), flags=cv2.INTER_NEAREST)


def _colour_spectrum(
    rgb: UInt8[np.ndarray, "h w 3"], factor: int, size: tuple[int, int], reach_px: int
) -> Complex[np.ndarray, "rows frequencies"]:
    small = cv2.resize(rgb, (factor * size[1], factor * size[0]), interpolation=cv2.INTER_NEAREST)
    return _spectrum(colour_edges(cv2.resize(small, (size[1], size[0]), interpolation=cv2.INTER_AREA)), reach_px)


def _depth_spectrum(
    depth_m: Float32[np.ndarray, "h w"], factor: int, size: tuple[int, int], reach_px: int
) -> Complex[np.ndarray, "rows frequencies"]:
    half = factor // 2
    return _spectrum(depth_edges(depth_m[half::factor, half::factor][: size[0], : size[1]]), reach_px)


def _spectrum(edges: Float[np.ndarray, "h w"], reach_px: int) -> Complex[np.ndarray, "rows frequencies"]:
    """Fourier spectrum of edges without their mean, padded with zeros, divided by the Euclidean norm of the edges."""
    # Not by BLAS, which wakes threads for so many numbers and waits for them.
    length = max(float(np.sqrt(np.square(edges).sum())), 1e-5)
    normed = ((edges - edges.mean()) / length).astype(np.float32)
    return np.asarray(scipy.fft.rfft2(normed, _padded(edges.shape, reach_px)))


def _correlation(
    product: Complex[np.ndarray, "rows frequencies"], size: tuple[int, int], reach_px: int
) -> Float[np.ndarray, "rows columns"]:
    """Correlation by the shift of depth: rows down, columns right, 0 in the middle, at most ``reach_px``.

    Args:
        product: the spectrum of depth edges times the conjugate spectrum of colour edges. The value at a shift s is the
            sum over places of depth(x + s) * colour(x); those of several views are added up.
        size: height and width of the edge pictures.
        reach_px: the largest shift.
    """
    fit = np.asarray(scipy.fft.irfft2(product, _padded(size, reach_px)))
    shifts = np.arange(-reach_px, reach_px + 1)
    return fit[np.ix_(shifts, shifts)].astype(float)


def _padded(size: tuple[int, ...], reach_px: int) -> list[int]:
    """Sides of a picture that no shift of at most ``reach_px`` brings round to its other end."""
    return [cv2.getOptimalDFTSize(side + reach_px) for side in size]


def colour_edges(rgb: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
    """Strength of colour edges in [0, 1], relative to the contrast around them."""
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 0.8)
    strength = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    around = cv2.blur(strength, (31, 31)) + 8.0
    return np.clip(strength / (4 * around), 0.0, 1.0).astype(float)


def depth_edges(depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Strength of depth edges in [0, 1]; 0 on planes of any tilt, whose inverse depth is linear in the picture.

    Nothing is said where a neighbour has no depth.
    """
    strength = np.zeros(depth_m.shape, np.float32)
    _measure_bends(np.ascontiguousarray(depth_m, np.float32), strength)
    return strength


@njit(cache=True, nogil=True, error_model="numpy")
def _measure_bends(depth_m, strength):
    """Writes what ``depth_edges`` returns into zeros, in loops that compilers turn into operations on many pixels."""
    height, width = depth_m.shape
    inverse = np.empty((height, width), np.float32)
    for row in range(height):
        for column in range(width):
            known = depth_m[row, column] > 0
            inverse[row, column] = np.float32(1.0) / depth_m[row, column] if known else np.float32(-1.0)
    none, two = np.float32(0.0), np.float32(2.0)
    for row in range(1, height - 1):
        for column in range(width):
            before, here, after = inverse[row - 1, column], inverse[row, column], inverse[row + 1, column]
            bend = abs(before + after - two * here) / here
            strength[row, column] = bend if (before > none) & (here > none) & (after > none) else none
    for row in range(height):
        for column in range(1, width - 1):
            before, here, after = inverse[row, column - 1], inverse[row, column], inverse[row, column + 1]
            bend = abs(before + after - two * here) / here
            bend = bend if (before > none) & (here > none) & (after > none) else none
            strength[row, column] = max(strength[row, column], bend)
    least, span, one = np.float32(0.03), np.float32(0.2), np.float32(1.0)
    for row in range(height):
        for column in range(width):
            strength[row, column] = min(max((strength[row, column] - least) / span, none), one)


def _peak(fit: Float[np.ndarray, "rows columns"]) -> np.ndarray:
    return np.array(np.unravel_index(int(fit.argmax()), fit.shape))
