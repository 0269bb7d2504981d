"""How much moves in a scene."""

from dataclasses import dataclass

from labeling.core.errors import UsageError


@dataclass(frozen=True)
class MotionConfig:
    """What moves in an episode: nothing unless asked for."""

    moving: int = 0
    """Things that move while the robot does, at most: vehicles that drive, furniture that is carried."""
    shifted: int = 0
    """Pieces of furniture that stand elsewhere than in the last episode in their scene, at most. In towns two vehicles
    do so in any case."""
    speed: float = 1.0
    """Factor of the speed of what moves; with 0 the same things stand still where they would have set out."""

    def __post_init__(self) -> None:
        for name, value in (("moving", self.moving), ("shifted", self.shifted)):
            if isinstance(value, bool) or not isinstance(value, int) or value < 0:
                raise UsageError(f"{name} must be a whole number of at least 0, not {value!r}")
        if not 0.0 <= self.speed < 100.0:
            raise UsageError(f"moving_speed must be at least 0 and below 100, not {self.speed}")

    @property
    def is_any(self) -> bool:
        """Whether anything moves."""
        return self.moving > 0 or self.shifted > 0


STILL = MotionConfig()
"""Nothing moves."""
