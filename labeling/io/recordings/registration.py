"""Whether depth lies where colour lies: how far edges of depth are from edges of colour, over many views.

Where depth jumps, one thing ends and another begins, and mostly the colour changes, too. So the two pictures of edges
correlate most at the shift by which they are apart; in depth that is registered to colour that is none.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from labeling.core.views import RgbdViews
from labeling.io.recordings.frames import load
from labeling.io.recordings.layouts import frames_of
from labeling.io.recordings.recording_config import RecordingConfig

MAX_VIEWS, WIDTH_PX = 8, 192
"""Views that are looked at, spread evenly, and the width that they are brought to."""
REACH = 0.12
"""Shifts that are looked for, as a share of the width."""
TOLERANCE = 0.01
"""A shift by less than this share of the width is none: edges of depth are that ragged."""
LEAD, LEAST_FIT = 1.15, 0.02
"""Factor by which edges must fit better at the shift than where they are, and the least that they must fit there, as a
coefficient of correlation: with less there is nothing to tell by."""


@dataclass(frozen=True)
class DepthOffset:
    """Where edges of depth lie."""

    right_px: float
    """Right of those of colour, pixels of the recording's pictures."""
    down_px: float
    """Below those of colour."""

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
    return (
        f"edges of depth lie {offset} of edges of colour: depth is not registered to colour, so labels will lie beside "
        'their objects; align it, or tell of its camera (docs/your-own-recordings.md, "Depth from a camera of its own")'
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
        The shift; None if there is none beyond ``TOLERANCE``, or if there are too few edges to tell.
    """
    chosen = np.unique(np.rint(np.linspace(0, views.num_views - 1, MAX_VIEWS)).astype(int))
    factor = max(1, round(views.size[1] / WIDTH_PX))
    size = views.size[0] // factor, views.size[1] // factor
    fits = np.stack([_fit(views.rgb[view], views.depth_m[view], factor, size) for view in chosen])
    peaks = [_peak(part.sum(axis=0)) for part in (fits, fits[::2], fits[1::2])]
    total = fits.sum(axis=0)
    middle = np.array(total.shape) // 2
    shift = peaks[0] - middle
    tolerance_px = max(2.0, TOLERANCE * size[1])
    agree = all(np.abs(one - peaks[0]).max() <= tolerance_px for one in peaks[1:])
    near = total[tuple(slice(place - 1, place + 2) for place in middle)].max()
    least = max(LEAD * near, LEAST_FIT * len(chosen))
    if len(chosen) < 2 or not agree or np.hypot(*shift) <= tolerance_px or total[tuple(peaks[0])] < least:
        return None
    return DepthOffset(float(factor * shift[1]), float(factor * shift[0]))


def _fit(
    rgb: UInt8[np.ndarray, "h w 3"], depth_m: Float32[np.ndarray, "h w"], factor: int, size: tuple[int, int]
) -> Float[np.ndarray, "rows columns"]:
    """How well edges fit at each shift of depth: down by rows, right by columns, none in the middle."""
    small = cv2.resize(rgb, (factor * size[1], factor * size[0]), interpolation=cv2.INTER_NEAREST)
    colour = colour_edges(cv2.resize(small, (size[1], size[0]), interpolation=cv2.INTER_AREA))
    half = factor // 2
    depth = depth_edges(depth_m[half::factor, half::factor][: size[0], : size[1]])
    padded = [cv2.getOptimalDFTSize(2 * side) for side in size]
    spectra = [np.fft.rfft2(edges - edges.mean(), padded) for edges in (depth, colour)]
    # The value at a shift s is the sum over places of depth(x + s) * colour(x).
    fit = np.fft.irfft2(spectra[0] * np.conj(spectra[1]), padded)
    reach = max(3, round(REACH * size[1]))
    fit = np.roll(fit, (reach, reach), axis=(0, 1))[: 2 * reach + 1, : 2 * reach + 1]
    return fit / max(float(np.linalg.norm(depth) * np.linalg.norm(colour)), 1e-9)


def colour_edges(rgb: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
    """Strength of edges in [0, 1], by contrast with what is around."""
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 0.8)
    strength = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    around = cv2.blur(strength, (31, 31)) + 8.0
    return np.clip(strength / (4 * around), 0.0, 1.0).astype(float)


def depth_edges(depth_m: Float32[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Strength of jumps in [0, 1]; 0 on planes, however tilted, whose inverse depth is linear in the picture.

    Nothing is said where a neighbour has no depth.
    """
    known = depth_m > 0
    inverse = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=known)
    strength = np.zeros(depth_m.shape)
    for axis in (0, 1):
        before, here, after = (
            np.take(inverse, np.arange(start, start + depth_m.shape[axis] - 2), axis) for start in (0, 1, 2)
        )
        bend = np.abs(before + after - 2 * here) / np.maximum(here, 1e-9)
        sides = [[slice(None)] * 2 for _ in range(3)]
        for start, side in enumerate(sides):
            side[axis] = slice(start, depth_m.shape[axis] - 2 + start)
        valid = known[tuple(sides[0])] & known[tuple(sides[1])] & known[tuple(sides[2])]
        place = tuple(sides[1])
        strength[place] = np.maximum(strength[place], np.where(valid, bend, 0.0))
    return np.clip((strength - 0.03) / 0.2, 0.0, 1.0)


def _peak(fit: Float[np.ndarray, "rows columns"]) -> np.ndarray:
    return np.array(np.unravel_index(int(fit.argmax()), fit.shape))
