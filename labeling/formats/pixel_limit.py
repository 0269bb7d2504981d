"""How large a picture or mask of a file of others may be: checked before anything is decoded or made.

A few bytes can claim gigabytes: a header says how large the rest becomes.
"""

import os

DEFAULT_MAX_PIXELS = 64_000_000
VARIABLE = "SBM_MAX_PIXELS"
"""Environment variable with another limit."""


def max_pixels() -> int:
    """The limit for one picture or mask."""
    stated = os.environ.get(VARIABLE, "")
    return int(stated) if stated.isdecimal() and int(stated) > 0 else DEFAULT_MAX_PIXELS


def too_large(height_px: int, width_px: int) -> str | None:
    """Why a picture of this size is not read, for an error message; None if it is."""
    if height_px * width_px <= max_pixels():
        return None
    return f"{width_px}x{height_px} pixels are more than the {max_pixels():,} accepted ({VARIABLE} sets another limit)"


def jpeg_size(content: bytes) -> tuple[int, int] | None:
    """Height and width that the header of a JPEG states; None if it states none."""
    position = 2
    while position + 9 < len(content) and content[position] == 0xFF:
        kind = content[position + 1]
        if kind == 0xFF:  # padding
            position += 1
        elif kind in _FRAMES:
            return int.from_bytes(content[position + 5 : position + 7]), int.from_bytes(
                content[position + 7 : position + 9]
            )
        else:
            position += 2 + int.from_bytes(content[position + 2 : position + 4])
    return None


_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of a JPEG that are followed by its size: all that start a frame."""
