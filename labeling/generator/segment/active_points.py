"""The points that each object can reach, a fraction of the cloud each: the CRF runs there only."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32

from labeling.generator.segment.mean_field import Kernel, mean_field


@dataclass(frozen=True)
class ActivePoints:
    """A sparse (points, objects) table: one row per object and point, object after object, points rising."""

    shape: tuple[int, int]
    """Points and objects."""
    point: Int32[np.ndarray, "m"]
    """The point of each row."""
    block_start: Int[np.ndarray, "k1"]
    """Where the rows of each object start; the last entry is the number of rows."""

    @classmethod
    def of(cls, mask: Bool[np.ndarray, "n k"]) -> "ActivePoints":
        """Rows of the true entries."""
        points = [np.flatnonzero(mask[:, k]) for k in range(mask.shape[1])]
        start = np.cumsum([0, *(len(one) for one in points)])
        return cls((mask.shape[0], mask.shape[1]), np.concatenate([*points, []]).astype(np.int32), start)

    def rows_of(self, k: int) -> slice:
        """The rows of an object."""
        return slice(int(self.block_start[k]), int(self.block_start[k + 1]))

    def gather(self, table: Float32[np.ndarray, "n k"]) -> Float32[np.ndarray, "m"]:
        """The entries of a dense table that are rows."""
        parts = [table[self.point[self.rows_of(k)], k] for k in range(self.shape[1])]
        return np.concatenate([*parts, np.zeros(0, np.float32)])

    def scatter(self, rows: Float32[np.ndarray, "m"]) -> Float32[np.ndarray, "n k"]:
        """A dense table with the rows' values, and 0 where there is no row."""
        table = np.zeros(self.shape, np.float32)
        for k in range(self.shape[1]):
            table[self.point[self.rows_of(k)], k] = rows[self.rows_of(k)]
        return table

    def marginals(
        self, log_odds: Float32[np.ndarray, "n k"], kernels: list[Kernel], iterations: int, exclusive: bool
    ) -> Float32[np.ndarray, "n k"]:
        """Probability of every object at every point by mean field; 0 where an object cannot be.

        Args:
            log_odds: unary potentials.
            kernels: between rows, such as lattices with these blocks.
            iterations: mean-field updates.
            exclusive: whether objects compete for points.
        """
        if len(self.point) == 0:
            return np.zeros(self.shape, np.float32)
        rows = mean_field(self.gather(log_odds), self.point, kernels, iterations, exclusive=exclusive)
        return self.scatter(rows)
