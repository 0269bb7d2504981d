"""Which parts of space a robot has seen to be filled, from its depth images: a coarse grid of occupied cells."""

import numpy as np
from jaxtyping import Bool, Float

from labeling.core.views import Camera
from sbm_gym.robot.line_of_sight import open_sectors, unhidden
from sbm_gym.robot.view_kernels import fill_cells
from sbm_gym.worlds.geometry.navigable import NavigableMap

HEIGHT_M = 3.0
CLEAR_M = 0.2
"""Nothing closer to the eye than the body is wide can be an obstacle."""


class SeenSpace:
    """Collects the surfaces seen during an episode; what has not been seen counts as empty."""

    def __init__(self, low_m: Float[np.ndarray, "2"], high_m: Float[np.ndarray, "2"], cell_m: float = 0.1) -> None:
        """Starts with nothing seen.

        Args:
            low_m: least x and y of the floor that matters.
            high_m: greatest x and y.
            cell_m: edge length of a cell.
        """
        self._cell_m = cell_m
        self._origin_m = np.array([low_m[0], low_m[1], 0.0]) - cell_m
        size_m = np.array([high_m[0] - low_m[0], high_m[1] - low_m[1], HEIGHT_M]) + 2.0 * cell_m
        self._filled = np.zeros(tuple(np.ceil(size_m / cell_m).astype(int)), bool)

    def add(self, depth_m: Float[np.ndarray, "h w"], camera: Camera) -> None:
        """Notes the surfaces of a depth image."""
        fill_cells(depth_m, camera.intrinsics, camera.camera_to_world, self._origin_m, self._cell_m, self._filled)

    def sees(
        self, eyes_m: Float[np.ndarray, "n 3"], target_m: Float[np.ndarray, "3"], stop_short_m: float
    ) -> Bool[np.ndarray, "n"]:
        """From which places nothing known stands between the eye and a target.

        Args:
            eyes_m: places to look from.
            target_m: what to look at.
            stop_short_m: the last piece of the way that is not checked: the target itself fills it.
        """
        eyes_m, target_m = np.ascontiguousarray(eyes_m, float), np.asarray(target_m, float)
        return unhidden(*self.grid, eyes_m, target_m, float(stop_short_m), CLEAR_M)

    def open_directions(
        self,
        target_m: Float[np.ndarray, "3"],
        offsets_m: Float[np.ndarray, "distances directions 2"],
        navigable: NavigableMap,
        height_m: float,
        stop_short_m: float,
    ) -> Bool[np.ndarray, "directions"]:
        """In which directions from a target there is a free place from which it is seen, as ``sees`` has it.

        Args:
            target_m: what to look at.
            offsets_m: x and y of the places to look from, from the target.
            navigable: where one can stand.
            height_m: of the eyes.
            stop_short_m: see ``sees``.
        """
        floor = navigable.free, navigable.origin_m, navigable.cell_m
        return open_sectors(*self.grid, *floor, target_m, offsets_m, height_m, stop_short_m, CLEAR_M)

    @property
    def grid(self) -> tuple[Bool[np.ndarray, "nx ny nz"], Float[np.ndarray, "3"], float]:
        """The filled cells, the grid's lower corner and the edge length of a cell."""
        return self._filled, self._origin_m, self._cell_m
