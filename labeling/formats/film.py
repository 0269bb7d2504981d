"""Films: pictures one after the other, as an animated GIF, which every browser shows."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from labeling.core.errors import SbmError
from labeling.formats.atomic import atomic_file

MAX_MB = 3
FRAME_MS, LAST_FRAME_MS = 350, 1500
COLOURS = (256, 128, 64)
"""Tried one after the other until the film is small enough."""


def write_film(
    frames: Sequence[UInt8[np.ndarray, "h w 3"]],
    path: Path,
    frame_ms: int = FRAME_MS,
    last_frame_ms: int = LAST_FRAME_MS,
) -> None:
    """Writes pictures as an animated GIF that repeats.

    Args:
        frames: at least one, all of one size.
        path: the file, written atomically.
        frame_ms: how long each is shown, milliseconds, in steps of ten.
        last_frame_ms: how long the last is.

    Raises:
        SbmError: if it would be larger than ``MAX_MB``.
    """
    from PIL import Image

    times = [frame_ms] * (len(frames) - 1) + [last_frame_ms]
    with atomic_file(path) as temporary:
        for colours in COLOURS:
            # Octrees keep the colours of thin lines; dithering would flicker and not compress.
            how = {"method": Image.Quantize.FASTOCTREE, "dither": Image.Dither.NONE}
            pictures = [Image.fromarray(frame).quantize(colours, **how) for frame in frames]
            pictures[0].save(temporary, format="GIF", save_all=True, append_images=pictures[1:], duration=times, loop=0)
            if temporary.stat().st_size <= 1e6 * MAX_MB:
                return
        megabytes = temporary.stat().st_size / 1e6
        raise SbmError(f"{path}: would have {megabytes:.1f} MB, more than {MAX_MB}; film a shorter episode")
