"""Which part of the floor depth has shown, and the frontiers of what it has not."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from labeling.geometry import project
from sbm_gym.worlds.navigable import NavigableMap

MIN_FRONTIER_STRIDES2 = 0.5
"""Smaller unseen patches, in squares of a stride, are not worth a step."""
MAX_VAIN_LOOKS = 2
NEIGHBOURHOOD_STRIDES = 4.0
"""A frontier promises the unseen floor so near to it; farther in, walls will hide it."""


@dataclass(frozen=True)
class Frontier:
    """A place on the floor where what has been seen ends."""

    place_m: Float[np.ndarray, "2"]
    """An unseen place beside seen ones, where the robot could stand."""
    unseen_m2: float
    """Unseen floor around it."""


class SeenFloor:
    """The places where the robot can stand, each seen or not. Source of the frontiers: Yamauchi 1997."""

    def __init__(self, navigable: NavigableMap, start_m: Float[np.ndarray, "2"], stride_m: float, reach_m: float):
        """Starts with nothing seen but the floor under the robot.

        Args:
            navigable: the map; floor that the robot cannot get to is left out.
            start_m: where it stands.
            stride_m: its longest move; the scale of everything here.
            reach_m: floor farther from the camera than this does not count as seen.
        """
        self._factor = max(1, round(0.3 * stride_m / navigable.cell_m))
        self._cell_m = self._factor * navigable.cell_m
        self._origin_m, self._stride_m, self._reach_m = navigable.origin_m, stride_m, reach_m
        self._open = _reachable(_coarse(navigable.free, self._factor), self._cell(navigable.nearest_free(start_m)))
        self._cells = np.argwhere(self._open)
        self._centres_m = self._origin_m + self._cell_m * (self._cells[:, ::-1] + 0.5)
        self._seen = np.zeros_like(self._open)
        self._given_up = np.zeros_like(self._open)
        self._vain_looks = np.zeros(self._open.shape, np.int32)
        self._pass_by(start_m, 0.75 * stride_m)

    @property
    def seen_share(self) -> float:
        """Share of the floor that has been seen."""
        return float(np.count_nonzero(self._seen & self._open) / max(1, len(self._cells)))

    def add(
        self,
        depth_m: Float[np.ndarray, "h w"],
        intrinsics: Float[np.ndarray, "3 3"],
        camera_to_world: Float[np.ndarray, "4 4"],
    ) -> None:
        """Notes the floor that a depth image shows: where it says nothing nearer stands before a place."""
        self._pass_by(camera_to_world[:2, 3], self._blind_m(len(depth_m), intrinsics, camera_to_world))
        points = np.concatenate([self._centres_m, np.zeros((len(self._centres_m), 1))], axis=1)
        pixels, floor_m = project(points, intrinsics, camera_to_world)
        height_px, width_px = depth_m.shape
        shown = (floor_m > 0.05) & (floor_m < self._reach_m)
        x = np.rint(np.where(shown, pixels[:, 0], -1.0)).astype(np.int64)
        y = np.rint(np.where(shown, pixels[:, 1], -1.0)).astype(np.int64)
        shown &= (x >= 0) & (x < width_px) & (y >= 0) & (y < height_px)
        x, y, floor_m = x[shown], y[shown], floor_m[shown]
        # The floor runs away from grazing eyes: one pixel up it is so much farther.
        slope_m = floor_m**2 / (intrinsics[1, 1] * camera_to_world[2, 3])
        returned = depth_m[y, x] > 0.0
        visible = returned & (floor_m - depth_m[y, x] < 0.5 * self._cell_m + slope_m)
        rows, columns = self._cells[np.flatnonzero(shown)[visible]].T
        self._seen[rows, columns] = True

    def give_up(self, place_m: Float[np.ndarray, "2"]) -> None:
        """Leaves out unseen floor near a place: it has been looked for in vain."""
        near = np.linalg.norm(self._centres_m - place_m, axis=1) < self._stride_m
        rows, columns = self._cells[near].T
        self._given_up[rows, columns] = True

    def look_in_vain(self, place_m: Float[np.ndarray, "2"]) -> None:
        """Notes that a frontier ought to have been seen and was not; after ``MAX_VAIN_LOOKS`` it is given up."""
        cell = self._cell(place_m)
        self._vain_looks[cell] += 1
        if self._vain_looks[cell] >= MAX_VAIN_LOOKS:
            self.give_up(place_m)

    def forget(self) -> None:
        """Nothing has been seen any more: for going round again."""
        self._seen[:], self._given_up[:], self._vain_looks[:] = False, False, 0

    def is_unseen(self, place_m: Float[np.ndarray, "2"]) -> bool:
        """Whether a frontier's place is still one to be seen."""
        row, column = self._cell(place_m)
        return not (self._seen[row, column] or self._given_up[row, column])

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
        unseen = ~(self._seen | self._given_up)[self._cells[:, 0], self._cells[:, 1]]
        offsets = self._centres_m[unseen] - place_m
        distances = np.hypot(offsets[:, 0], offsets[:, 1]) / self._stride_m
        turns = (np.arctan2(offsets[:, 1], offsets[:, 0]) - yaw_rad) / (2.0 * np.pi) + 0.5 / num_directions
        directions = np.minimum((turns % 1.0 * num_directions).astype(np.int64), num_directions - 1)
        cell = (self._cell_m / self._stride_m) ** 2
        shares = np.zeros((len(rings_strides), num_directions))
        for ring, (low, high) in enumerate(rings_strides):
            within = (distances >= low) & (distances < high)
            area = np.pi * (high**2 - low**2) / num_directions
            shares[ring] = np.bincount(directions[within], minlength=num_directions) * cell / area
        return np.minimum(shares, 1.0)

    def frontiers(self) -> list[Frontier]:
        """The patches of unseen floor that touch seen floor, each by its place nearest to the patch's rim's middle."""
        from scipy.ndimage import binary_dilation, label

        unseen = self._open & ~self._seen & ~self._given_up
        rim = unseen & np.asarray(binary_dilation(self._open & ~unseen, np.ones((3, 3), bool)), bool)
        patches, count = label(rim, np.ones((3, 3), int))  # type: ignore[misc]
        found = []
        unseen_m = self._centre(np.argwhere(unseen))
        for patch in range(1, count + 1):
            cells = np.argwhere(patches == patch)
            middle = cells[int(np.argmin(np.sum((cells - cells.mean(axis=0)) ** 2, axis=1)))]
            place_m = self._centre(middle[None])[0]
            near = np.linalg.norm(unseen_m - place_m, axis=1) < NEIGHBOURHOOD_STRIDES * self._stride_m
            unseen_m2 = float(np.count_nonzero(near) * self._cell_m**2)
            if unseen_m2 >= MIN_FRONTIER_STRIDES2 * self._stride_m**2:
                found.append(Frontier(place_m, unseen_m2))
        return found

    def _blind_m(self, height_px: int, intrinsics, camera_to_world) -> float:
        """How far away the floor begins in the picture, two strides at most."""
        down_rad = np.arctan(0.5 * height_px / intrinsics[1, 1]) - np.arcsin(np.clip(camera_to_world[2, 2], -1.0, 1.0))
        most_m = 2.0 * self._stride_m
        return most_m if down_rad <= 0.0 else min(most_m, camera_to_world[2, 3] / float(np.tan(min(down_rad, 1.5))))

    def _pass_by(self, place_m: Float[np.ndarray, "2"], radius_m: float) -> None:
        """Counts the floor around the robot's feet, which its camera cannot show, as seen."""
        near = np.linalg.norm(self._centres_m - place_m, axis=1) < radius_m
        rows, columns = self._cells[near].T
        self._seen[rows, columns] = True

    def _cell(self, place_m: Float[np.ndarray, "2"]) -> tuple[int, int]:
        column, row = np.floor((np.asarray(place_m) - self._origin_m) / self._cell_m).astype(int)
        return int(row), int(column)

    def _centre(self, cells: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        return self._origin_m + self._cell_m * (cells[:, ::-1] + 0.5)


def _coarse(free: Bool[np.ndarray, "ny nx"], factor: int) -> Bool[np.ndarray, "my mx"]:
    """The grid in larger cells, free where the middle of the cell is."""
    ny, nx = (-(-side // factor) * factor for side in free.shape)
    padded = np.pad(free, ((0, ny - free.shape[0]), (0, nx - free.shape[1])))
    return padded[factor // 2 :: factor, factor // 2 :: factor]


def _reachable(free: Bool[np.ndarray, "ny nx"], start: tuple[int, int]) -> Bool[np.ndarray, "ny nx"]:
    """The part of the grid that hangs together with a cell, or the largest one if that cell is not free."""
    from scipy.ndimage import label

    labels, count = label(free, np.ones((3, 3), int))  # type: ignore[misc]
    if count == 0:
        return free
    mine = labels[start] or 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    return labels == mine
