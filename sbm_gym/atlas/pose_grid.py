"""The poses of a view atlas: places on a grid of the floor, and headings at each of them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from labeling.core.errors import UsageError
from sbm_gym.worlds.geometry.navigable import NavigableMap

COARSEST_GRID_M, FEWEST_HEADINGS = 0.5, 12


@dataclass(frozen=True)
class PoseGrid:
    """Places and headings of the views of an atlas."""

    places_m: Float[np.ndarray, "n 2"]
    """World x and y of each place; the robot can stand there."""
    num_headings: int
    """Headings at each place: evenly spaced, counter-clockwise, the first along +X."""

    @classmethod
    def cover(cls, navigable: NavigableMap, grid_m: float, num_headings: int) -> "PoseGrid":
        """Divides the floor into square cells and takes the free place nearest to the centre of each cell that has any.

        Args:
            navigable: where the robot can stand; only its largest connected part counts.
            grid_m: edge length of the cells, metres; at most 0.5.
            num_headings: at least 12.

        Raises:
            UsageError: if ``grid_m`` or ``num_headings`` is out of range.
        """
        if not navigable.cell_m <= grid_m <= COARSEST_GRID_M:
            raise UsageError(f"places are {navigable.cell_m:g} to {COARSEST_GRID_M:g} m apart, not {grid_m:g} m")
        if num_headings < FEWEST_HEADINGS:
            raise UsageError(f"an atlas has at least {FEWEST_HEADINGS} headings, not {num_headings}")
        cells = np.argwhere(navigable.largest_component)[:, ::-1]
        free_m = navigable.origin_m + navigable.cell_m * (cells + 0.5)
        tile = np.floor((free_m - navigable.origin_m) / grid_m).astype(np.int64)
        middle_m = navigable.origin_m + grid_m * (tile + 0.5)
        off_centre_m = np.abs(free_m - middle_m).max(axis=1)
        order = np.lexsort((off_centre_m, tile[:, 0], tile[:, 1]))
        first = np.ones(len(order), bool)
        first[1:] = (tile[order][1:] != tile[order][:-1]).any(axis=1)
        return cls(free_m[order[first]], num_headings)

    def heading_rad(self, heading: int) -> float:
        """Yaw of a heading, in (-pi, pi]."""
        yaw_rad = 2.0 * np.pi * heading / self.num_headings
        return float(yaw_rad - 2.0 * np.pi if yaw_rad > np.pi else yaw_rad)

    def nearest_heading(self, yaw_rad: float) -> int:
        """Number of the heading nearest to a yaw."""
        return round(yaw_rad / (2.0 * np.pi) * self.num_headings) % self.num_headings

    def nearest_place(self, position_m: Float[np.ndarray, "2"], navigable: NavigableMap) -> int:
        """Number of the nearest place that can be reached straight on; of the nearest one if none of nine can."""
        near = np.argsort(((self.places_m - position_m) ** 2).sum(axis=1), kind="stable")[:9]
        return int(near[max(0, navigable.first_straight(position_m, self.places_m[near]))])
