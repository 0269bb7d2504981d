"""Shape and resolution of a voxel grid, and where it is placed."""

from dataclasses import dataclass
from typing import Literal

from labeling.core.errors import UsageError

Around = Literal["fixated", "scene"]
"""What a grid is placed around: the point that the cameras look at, or the middle of what they have seen."""


@dataclass(frozen=True)
class GridSpec:
    """Shape and resolution of a voxel grid.

    Raises:
        UsageError: on construction, if the grid is empty or too large to be meant.

    Example:
        >>> GridSpec((16, 32, 32), 0.125).extent_m
        (4.0, 4.0, 2.0)
    """

    shape: tuple[int, int, int] = (16, 32, 32)
    """Voxels along z, y, x."""
    voxel_m: float = 0.16
    """Edge of a voxel."""

    def __post_init__(self) -> None:
        if not all(4 <= side <= 512 for side in self.shape) or not 0 < self.voxel_m < 100:
            raise UsageError(
                f"a grid has 4 to 512 voxels along each axis and voxels of up to 100 m, not {self.shape} of "
                f"{self.voxel_m} m"
            )

    @property
    def extent_m(self) -> tuple[float, float, float]:
        """Full lengths along x, y, z."""
        z, y, x = self.shape
        return x * self.voxel_m, y * self.voxel_m, z * self.voxel_m

    @property
    def radius_m(self) -> float:
        """Distance from the middle to a corner."""
        return 0.5 * sum(side**2 for side in self.extent_m) ** 0.5
