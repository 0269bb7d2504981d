"""How to read a recording."""

from dataclasses import dataclass
from typing import Literal

from labeling.core.errors import UsageError

LayoutName = Literal["auto", "nerfstudio", "tum", "scannet"]
Up = Literal["z", "y", "x", "-z", "-y", "-x"]


@dataclass(frozen=True)
class RecordingConfig:
    """How to read a recording.

    Example:
        >>> RecordingConfig(every=10, up="y").max_views
        200
    """

    layout: LayoutName = "auto"
    """What the folder looks like inside; ``auto`` recognises it by its files."""
    every: int = 1
    """Take every n-th frame only; neighbouring frames of a video show nothing new."""
    max_views: int = 200
    """Frames taken at most, spread evenly over the recording: bounds time and memory."""
    up: Up = "z"
    """Axis of the recording's world that points up (ARKit, so Record3D: ``--up=y``). 3-D boxes stand upright on it."""
    camera: tuple[float, float, float, float] | None = None
    """Focal lengths and principal point ``FX FY CX CY`` in pixels, for TUM folders, whose files do not tell them."""
    depth_unit_m: float | None = None
    """Metres per unit of depth; by default as the layout has it (TUM 1/5000, ScanNet 1/1000, nerfstudio: its file)."""
    max_gap_s: float = 0.02
    """TUM: colour, depth and pose at most this far apart in time belong together. Source: TUM's associate.py."""

    def check(self) -> None:
        """Refuses settings that make no sense.

        Raises:
            UsageError: naming the setting.
        """
        for name in ("every", "max_views"):
            if getattr(self, name) < 1:
                raise UsageError(f"--{name.replace('_', '-')} must be 1 or more, not {getattr(self, name)}")
        for name in ("depth_unit_m", "max_gap_s"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise UsageError(f"--{name.replace('_', '-')} must be above 0 and finite, not {value}")
        if self.camera is not None and not (
            min(self.camera[:2]) > 0 and all(abs(value) < float("inf") for value in self.camera)
        ):
            raise UsageError(f"--camera takes FX FY CX CY in pixels, finite, FX and FY above 0, not {self.camera}")
