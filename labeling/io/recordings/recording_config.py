"""How to read a recording."""

import math
from dataclasses import dataclass, fields
from typing import Annotated, Literal

from labeling.runtime.ranges import Count, Positive, Range, Settings

LayoutName = Literal["auto", "nerfstudio", "tum", "scannet"]
UP_AXES = {
    "z": (0.0, 0.0, 1.0),
    "y": (0.0, 1.0, 0.0),
    "x": (1.0, 0.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
    "-y": (0.0, -1.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
}
"""What axes are called, and where they point."""
FLOOR = "floor"
"""Up is where the floor's normal points."""


def up_direction(up: str) -> tuple[float, float, float] | None:
    """The direction that ``--up`` names, of any length above 0; None if it names none."""
    words = up.replace(",", " ").split()
    if len(words) == 1:
        return UP_AXES.get(words[0])
    try:
        x, y, z = (float(word) for word in words)
    except ValueError:
        return None
    return (x, y, z) if 1e-6 < math.hypot(x, y, z) < math.inf else None


Up = Annotated[
    str,
    Range(
        f"be an axis ({', '.join(UP_AXES)}), a direction X,Y,Z or {FLOOR}",
        lambda up: up == FLOOR or up_direction(up) is not None,
    ),
]
PinholeParameters = Annotated[
    tuple[float, float, float, float],
    Range("be FX FY CX CY, finite, FX and FY above 0", lambda v: min(v[:2]) > 0 and all(map(math.isfinite, v))),
]


@dataclass(frozen=True)
class RecordingConfig(Settings):
    """How to read a recording.

    Example:
        >>> RecordingConfig(every=10, up="y").max_views
        200
    """

    layout: LayoutName = "auto"
    """What the folder looks like inside; ``auto`` recognises it by its files."""
    every: Count = 1
    """Take every n-th frame only; neighbouring frames of a video show nothing new."""
    max_views: Count = 200
    """Frames taken at most, spread evenly over the recording: bounds time and memory."""
    up: Up = "z"
    """What points up in the recording's world: an axis (z, y, x, -z, -y, -x; ARKit, so Record3D: ``--up=y``), or, where
    gravity is tilted, a direction ``--up=X,Y,Z``, or ``--up=floor``: found from the floor. 3-D boxes stand upright on
    it."""
    camera: PinholeParameters | None = None
    """Focal lengths and principal point ``FX FY CX CY`` in pixels, for TUM folders, whose files do not tell them."""
    depth_unit_m: Positive[float] | None = None
    """Metres per unit of depth; by default as the layout has it (TUM 1/5000, ScanNet 1/1000, nerfstudio: its file)."""
    max_gap_s: Positive[float] = 0.02
    """TUM: colour, depth and pose at most this far apart in time belong together. Source: TUM's associate.py."""

    def words(self) -> tuple[str, ...]:
        """The options that differ from the defaults, as words of a command line.

        >>> RecordingConfig(every=3, up="-y", camera=(500.0, 500.0, 319.5, 239.5)).words()
        ('--every=3', '--up=-y', '--camera', '500.0', '500.0', '319.5', '239.5')
        """
        found: list[str] = []
        for option in fields(self):
            value = getattr(self, option.name)
            if value == option.default:
                continue
            name = f"--{option.name.replace('_', '-')}"
            found += [name, *map(str, value)] if isinstance(value, tuple) else [f"{name}={value}"]
        return tuple(found)
