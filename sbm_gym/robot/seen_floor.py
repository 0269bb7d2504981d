"""Which part of the floor depth has shown."""

import numpy as np
from jaxtyping import Bool, Float, Int

from labeling.core.views import Camera
from sbm_gym.robot.view_kernels import count_unseen, note_floor, note_near
from sbm_gym.worlds.geometry.navigable import NavigableMap


class SeenFloor:
    """The places where the robot can stand, and when each was seen last."""

    def __init__(self, navigable: NavigableMap, start_m: Float[np.ndarray, "2"], stride_m: float, reach_m: float):
        """Starts with nothing seen but the floor under the robot.

        Args:
            navigable: the map; floor that the robot cannot get to is left out.
            start_m: where it stands.
            stride_m: its longest move; the scale of everything here.
            reach_m: floor farther from the camera than this does not count as seen.
        """
        factor = max(1, round(0.3 * stride_m / navigable.cell_m))
        self.cell_m = factor * navigable.cell_m
        """Edge length of a cell."""
        self.stride_m = stride_m
        """The robot's longest move."""
        self._origin_m, self._reach_m = navigable.origin_m, reach_m
        self.is_floor = _reachable(_coarse(navigable.free, factor), self.cell(navigable.nearest_free(start_m)))
        """The cells that can be seen at all: where the robot can get to."""
        self._cells = np.argwhere(self.is_floor)
        self._centres_m = self._origin_m + self.cell_m * (self._cells[:, ::-1] + 0.5)
        self._seen_at = np.full(self.is_floor.shape, -1, np.int32)
        self.num_views = 0
        """Depth images added so far."""
        self._pass_by(start_m, 0.75 * stride_m)

    @property
    def origin_m(self) -> Float[np.ndarray, "2"]:
        """World (x, y) of the outer corner of cell (0, 0)."""
        return self._origin_m

    @property
    def seen_at(self) -> Int[np.ndarray, "my mx"]:
        """The number of the latest view of every cell, counted from 1; 0 for the start, -1 where it was never seen."""
        return self._seen_at

    def unseen(self, since: int = 0) -> Bool[np.ndarray, "my mx"]:
        """The cells of the floor that have not been seen.

        Args:
            since: only views from this one on count.
        """
        return self.is_floor & (self._seen_at < since)

    def was_seen(self, places_m: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Which places lie in cells of the floor that have been seen."""
        return NavigableMap(self._seen_at >= 0, self._origin_m, self.cell_m).are_free(places_m)

    def add(self, depth_m: Float[np.ndarray, "h w"], camera: Camera) -> None:
        """Notes the floor that a depth image shows: where it says nothing nearer stands before a place."""
        self.num_views += 1
        self._pass_by(camera.camera_to_world[:2, 3], self._blind_m(camera))
        note_floor(
            self._centres_m,
            self._cells,
            depth_m,
            camera.intrinsics,
            camera.camera_to_world,
            self._reach_m,
            0.5 * self.cell_m,
            self.num_views,
            self._seen_at,
        )

    def unseen_around(
        self,
        place_m: Float[np.ndarray, "2"],
        yaw_rad: float,
        rings_strides: tuple[tuple[float, float], ...],
        num_directions: int,
    ) -> Float[np.ndarray, "rings directions"]:
        """How much unseen floor lies around a place.

        Args:
            place_m: the place.
            yaw_rad: the middle of the first direction; the others follow counter-clockwise.
            rings_strides: least and greatest distance of each ring, strides.
            num_directions: pieces that each ring is cut into.

        Returns:
            For each piece of each ring, the share of its area that is unseen floor.
        """
        counts = count_unseen(
            self._centres_m,
            self._cells,
            self._seen_at,
            float(place_m[0]),
            float(place_m[1]),
            yaw_rad,
            self.stride_m,
            rings_strides,
            num_directions,
        )
        cell = (self.cell_m / self.stride_m) ** 2
        areas = np.array([[np.pi * (high**2 - low**2) / num_directions] for low, high in rings_strides])
        return np.minimum(counts * cell / areas, 1.0)

    def cells_near(self, place_m: Float[np.ndarray, "2"], radius_m: float) -> Int[np.ndarray, "n 2"]:
        """Row and column of the cells of the floor whose middle is so near to a place."""
        return self._cells[np.linalg.norm(self._centres_m - place_m, axis=1) < radius_m]

    def cell(self, place_m: Float[np.ndarray, "2"]) -> tuple[int, int]:
        """Row and column of the cell that a place lies in."""
        column, row = np.floor((np.asarray(place_m) - self._origin_m) / self.cell_m).astype(int)
        return int(row), int(column)

    def centre_m(self, cells: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """The middle of cells given by row and column."""
        return self._origin_m + self.cell_m * (cells[:, ::-1] + 0.5)

    def _blind_m(self, camera: Camera) -> float:
        """How far away the floor begins in the picture, two strides at most."""
        up, height_m = camera.camera_to_world[2, 2:]
        down_rad = np.arctan(0.5 * camera.size[0] / camera.intrinsics[1, 1]) - np.arcsin(np.clip(up, -1.0, 1.0))
        most_m = 2.0 * self.stride_m
        return most_m if down_rad <= 0.0 else min(most_m, height_m / float(np.tan(min(down_rad, 1.5))))

    def _pass_by(self, place_m: Float[np.ndarray, "2"], radius_m: float) -> None:
        """Counts the floor around the robot's feet, which its camera cannot show, as seen."""
        x, y = float(place_m[0]), float(place_m[1])
        note_near(self._centres_m, self._cells, x, y, radius_m, self.num_views, self._seen_at)


def _coarse(free: Bool[np.ndarray, "ny nx"], factor: int) -> Bool[np.ndarray, "my mx"]:
    """The grid in larger cells, free where the middle of the cell is."""
    ny, nx = (-(-side // factor) * factor for side in free.shape)
    padded = np.pad(free, ((0, ny - free.shape[0]), (0, nx - free.shape[1])))
    return padded[factor // 2 :: factor, factor // 2 :: factor]


def _reachable(free: Bool[np.ndarray, "ny nx"], start: tuple[int, int]) -> Bool[np.ndarray, "ny nx"]:
    """The part of the grid that hangs together with a cell, or the largest one if that cell is not free; of several as
    large as each other the first one, row by row.
    """
    # Not scipy.ndimage, whose import takes as long as an episode.
    import cv2

    count, labels = cv2.connectedComponents(np.ascontiguousarray(free).view(np.uint8), connectivity=8)
    if count == 1:
        return free
    mine = labels[start]
    if mine == 0:
        flat = np.asarray(labels[free], int)
        cells = np.bincount(flat)
        mine = flat[int(np.argmax(cells[flat]))]
    return labels == mine
