"""Normal equations of pairs of views: distances between their surfels, and derivatives by the views' motions.

Sources: Chen and Medioni, "Object modelling by registration of multiple range images" (1992), for distances from point
to plane; Blais and Levine, "Registering multiview range data to create 3D computer objects" (1995), for partners found
by projection; Park, Zhou and Koltun, "Colored Point Cloud Registration Revisited" (2017), for brightness beside depth.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int
from numba import njit

from labeling.core.geometry import invert_rigid
from labeling.generator.poses.surfels import (
    BRIGHTNESS,
    CENTRE,
    CHANGE_X,
    CHANGE_Y,
    EXISTS,
    NORMAL,
    Surfels,
    X,
    Y,
)
from labeling.runtime.threads import in_threads

MIN_ALIGNED = 0.7
"""Least cosine between the normals of two surfels of one surface."""
GATE = 3.0
"""Largest distance of a pair that enters the normal equations, in scales."""
MAX_APART = 0.25
"""Largest distance of a pair, as a share of its depth: beyond, one surface lies behind the other."""
BRIGHTNESS_SCALE = 0.05
"""Difference of brightness, in [0, 1], that weighs as much as a distance of one scale."""
ROBUST_BRIGHTNESS = 2.0
"""Scale of the robust weight of brightness, in ``BRIGHTNESS_SCALE``: gloss, exposure and shadows differ by more."""
_GRADIENT, _WEIGHT, _SQUARES, _COST, _PARTNERS = 36, 42, 43, 44, 45
"""Columns of ``PairSums.sums``; the first 36 are the Hessian."""


@dataclass(frozen=True, eq=False)
class PairSums:
    """Sums over the surfels of the first view of each pair that have a partner in the second.

    The partner of a surfel is the one whose cell its centre is projected into.
    """

    pairs: Int[np.ndarray, "pairs 2"]
    first_to_second: Float64[np.ndarray, "pairs 4 4"]
    """From camera coordinates of the first view to those of the second."""
    sums: Float64[np.ndarray, "pairs 46"]

    @property
    def hessian(self) -> Float64[np.ndarray, "pairs 6 6"]:
        """Second derivative (Gauss-Newton) of half the weighted sum of squares, by a motion (rotation vector, radians;
        translation, metres) of the first view in the frame of the second.
        """
        return self.sums[:, :_GRADIENT].reshape(-1, 6, 6)

    @property
    def gradient(self) -> Float64[np.ndarray, "pairs 6"]:
        """First derivative of the same."""
        return self.sums[:, _GRADIENT:_WEIGHT]

    @property
    def partners(self) -> Float64[np.ndarray, "pairs"]:
        """Number of surfels with a partner."""
        return self.sums[:, _PARTNERS]

    def chosen(self, kept) -> "PairSums":
        """The sums of some of the pairs; ``kept`` is any NumPy index."""
        return PairSums(self.pairs[kept], self.first_to_second[kept], self.sums[kept])

    def residual_m(self, kept=slice(None)) -> float:
        """Weighted root mean square of the distances, metres, of all pairs or some; 0 where there are none."""
        total = self.sums[kept].sum(axis=0)
        return float(np.sqrt(total[_SQUARES] / max(total[_WEIGHT], 1e-12)))

    def cost(self) -> float:
        """Mean Geman-McClure loss of the distances, in [0, 1]; partners far apart count 1."""
        total = self.sums.sum(axis=0)
        return float(total[_COST] / max(total[_PARTNERS], 1.0))


def pair_sums(
    cells: Surfels,
    intrinsics: Float[np.ndarray, "views 3 3"],
    camera_to_world: Float[np.ndarray, "views 4 4"],
    pairs: Int[np.ndarray, "pairs 2"],
    scale: float,
    held_out: bool = False,
    colour: bool = False,
) -> PairSums:
    """Compares the surfels of pairs of views.

    Args:
        cells: the views' surfels.
        intrinsics: K of each view.
        camera_to_world: their poses.
        pairs: indices of views; the surfels of the first are projected into the second.
        scale: distance at which a partner's weight has fallen to a quarter, as a share of its depth.
        held_out: compare the other half of the surfels, those that no pose was fitted to.
        colour: whether brightness counts, too.
    """
    inverse = np.stack([invert_rigid(one) for one in camera_to_world])
    moved = np.einsum("pab,pbc->pac", inverse[pairs[:, 1]], camera_to_world[pairs[:, 0]])
    cameras, sums = np.ascontiguousarray(intrinsics, float), np.zeros((len(pairs), _PARTNERS + 1))

    def compare(some) -> None:
        _compare(cells.grids, cells.cell_px, cameras, moved, pairs, some, scale, held_out, colour, sums)

    in_threads(compare, np.array_split(np.arange(len(pairs)), max(1, len(pairs) // 64)))
    return PairSums(pairs, moved, sums)


@njit(cache=True, nogil=True)
def _compare(grids, cell_px, cameras, moved, pairs, some, scale, held_out, colour, sums):  # pragma: no cover - compiled
    """Computes the sums of some pairs.

    Args:
        grids: (views, rows, columns, FIELDS) float32, of ``Surfels``.
        cell_px: edge of a cell.
        cameras: (views, 3, 3) float64, K.
        moved: (pairs, 4, 4) float64, camera coordinates of the first view to those of the second.
        pairs: (pairs, 2) int64, indices of views.
        some: (n,) int64, which pairs.
        scale: as in ``pair_sums``; likewise ``held_out`` and ``colour``.
        held_out: see scale.
        colour: see scale.
        sums: (pairs, 46) float64, zeros; the rows of these pairs are written.
    """
    _, rows, columns, _ = grids.shape
    g, gradient, hessian = np.empty(6), np.empty(6), np.empty((6, 6))
    for p in some:
        source, target, k, m, total = grids[pairs[p, 0]], grids[pairs[p, 1]], cameras[pairs[p, 1]], moved[p], sums[p]
        gradient[:], hessian[:] = 0, 0
        for row in range(rows):
            for column in range((row + held_out) % 2, columns, 2):
                a = source[row, column]
                if a[EXISTS] == 0:
                    continue
                ax, ay, az = a[CENTRE], a[CENTRE + 1], a[CENTRE + 2]
                z = m[2, 0] * ax + m[2, 1] * ay + m[2, 2] * az + m[2, 3]
                if not z > 1e-6:
                    continue
                x = m[0, 0] * ax + m[0, 1] * ay + m[0, 2] * az + m[0, 3]
                y = m[1, 0] * ax + m[1, 1] * ay + m[1, 2] * az + m[1, 3]
                u, v = k[0, 0] * x / z + k[0, 2], k[1, 1] * y / z + k[1, 2]
                across, down = np.floor((u + 0.5) / cell_px), np.floor((v + 0.5) / cell_px)
                if not (0 <= across < columns and 0 <= down < rows):
                    continue
                b = target[int(down), int(across)]
                bx, by, bz = b[NORMAL], b[NORMAL + 1], b[NORMAL + 2]
                aligned = 0.0
                for axis in range(3):
                    turned = m[axis, 0] * a[NORMAL] + m[axis, 1] * a[NORMAL + 1] + m[axis, 2] * a[NORMAL + 2]
                    aligned += turned * b[NORMAL + axis]
                if b[EXISTS] == 0 or aligned < MIN_ALIGNED:
                    continue
                distance = bx * (x - b[CENTRE]) + by * (y - b[CENTRE + 1]) + bz * (z - b[CENTRE + 2])
                limit = scale * z
                if abs(distance) > MAX_APART * z:
                    continue
                squared = (distance / limit) ** 2
                total[_COST] += squared / (1.0 + squared)
                total[_PARTNERS] += 1.0
                if squared > GATE * GATE:
                    continue
                # Geman and McClure's robust weight.
                weight = 1.0 / (1.0 + squared) ** 2
                total[_WEIGHT] += weight
                total[_SQUARES] += weight * distance * distance
                weight /= limit * limit
                g[0], g[1], g[2], g[3], g[4], g[5] = y * bz - z * by, z * bx - x * bz, x * by - y * bx, bx, by, bz
                _add(weight, distance, g, gradient, hessian)
                if not colour or (b[CHANGE_X] == 0 and b[CHANGE_Y] == 0):
                    continue
                change_x, change_y = b[CHANGE_X] * k[0, 0] / z, b[CHANGE_Y] * k[1, 1] / z
                change_z = -(change_x * x + change_y * y) / z
                brighter = b[BRIGHTNESS] + b[CHANGE_X] * (u - b[X]) + b[CHANGE_Y] * (v - b[Y]) - a[BRIGHTNESS]
                share = brighter / (ROBUST_BRIGHTNESS * BRIGHTNESS_SCALE)
                weight *= (limit / (BRIGHTNESS_SCALE * (1.0 + share * share))) ** 2
                g[0], g[1], g[2] = y * change_z - z * change_y, z * change_x - x * change_z, x * change_y - y * change_x
                g[3], g[4], g[5] = change_x, change_y, change_z
                _add(weight, brighter, g, gradient, hessian)
        for i in range(6):
            total[_GRADIENT + i] = gradient[i]
            for j in range(6):
                total[6 * i + j] = hessian[min(i, j), max(i, j)]


@njit(cache=True, inline="always")
def _add(weight, residual, g, gradient, hessian):  # pragma: no cover - compiled
    """Adds a residual with derivative ``g`` (6,) to ``gradient`` (6,) and the upper half of ``hessian`` (6, 6)."""
    for i in range(6):
        weighted = weight * g[i]
        gradient[i] += weighted * residual
        for j in range(i, 6):
            hessian[i, j] += weighted * g[j]
