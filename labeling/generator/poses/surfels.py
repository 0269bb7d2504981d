"""Views as coarse grids of surfels: planes fitted to the depth of cells of pixels, which averages sensor noise out."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32
from numba import njit

from labeling.core.views import RgbdViews
from labeling.runtime.threads import in_threads

SAMPLES_A_SIDE = 4
"""About how many pixels are read along a side of a cell; more do not improve the fit noticeably."""
MIN_FILLED = 0.25
"""Share of a cell's pixels that must have depth."""
MIN_SAMPLES = 6.0
"""Least number of pixels with depth in a cell."""
MAX_ROUGHNESS = 0.02
"""Largest deviation of depth from the plane (rms), as a share of the depth: beyond, the cell holds an edge."""
MAX_SLANT = 0.1
"""Smallest cosine between a plane's normal and the ray to it: planes at grazing angles are fitted too badly."""
X, Y, CENTRE, NORMAL, BRIGHTNESS, CHANGE_X, CHANGE_Y, EXISTS = 0, 1, 2, 5, 8, 9, 10, 11
"""Fields of a surfel: pixel of its centre; its centre and its normal, which looks to the camera, in the camera's
frame, metres; its brightness in [0, 1] and how that changes from pixel to pixel; 1, or 0 where a cell has no plane."""
FIELDS = 12


@dataclass(frozen=True, eq=False)
class Surfels:
    """The surfels of all views, one for each cell."""

    grids: Float32[np.ndarray, "views rows columns fields"]
    """The fields of each surfel, float32, by the indices above."""
    cell_px: int
    """Edge of a cell, pixels."""

    @property
    def median_depth_m(self) -> Float32[np.ndarray, "views"]:
        """Median depth of the surfels of each view, metres; 0 if it has none."""
        depths = (grid[..., CENTRE + 2][grid[..., EXISTS] > 0] for grid in self.grids)
        return np.array([np.median(one) if len(one) else 0 for one in depths], np.float32)


def surfels(views: RgbdViews, cells_a_side: int, max_range_m: float = np.inf) -> Surfels:
    """Fits a plane to the depth of every cell of every view.

    A plane's inverse depth is linear in the pixel, so that the fit is a linear one.

    Args:
        views: of one scene.
        cells_a_side: cells along a side of a square picture; other shapes get about as many in all.
        max_range_m: depth beyond this counts as no return, metres.
    """
    height, width = views.size
    cell_px = min(max(2, round(np.sqrt(height * width) / cells_a_side)), height, width)
    grids = np.zeros((views.num_views, height // cell_px, width // cell_px, FIELDS), np.float32)

    def fit(view: int) -> None:
        depth_m, rgb = np.ascontiguousarray(views.depth_m[view], np.float32), np.ascontiguousarray(views.rgb[view])
        _fit(depth_m, rgb, np.ascontiguousarray(views.intrinsics[view], float), cell_px, max_range_m, grids[view])

    in_threads(fit, range(views.num_views))
    return Surfels(grids, cell_px)


@njit(cache=True, nogil=True)
def _fit(depth_m, rgb, k, cell_px, max_range_m, grid):  # pragma: no cover - compiled
    """Fits the surfels of one view.

    Args:
        depth_m: (h, w) float32.
        rgb: (h, w, 3) uint8.
        k: (3, 3) float64, K.
        cell_px: edge of a cell.
        max_range_m: depth beyond this counts as none.
        grid: (rows, columns, FIELDS) float32, zeros; filled in place.
    """
    rows, columns, _ = grid.shape
    height, width = depth_m.shape
    step = max(1, cell_px // SAMPLES_A_SIDE)
    for row in range(rows):
        for column in range(columns):
            cell = grid[row, column]
            # A pixel beyond the cell on each side, since neighbours share their borders.
            top, bottom = max(0, row * cell_px - 1), min(height, (row + 1) * cell_px + 1)
            left, right = max(0, column * cell_px - 1), min(width, (column + 1) * cell_px + 1)
            x, y = (column + 0.5) * cell_px - 0.5, (row + 0.5) * cell_px - 0.5
            samples, grey, n = 0, 0.0, 0
            su, sv, suu, suv, svv, sd, sdu, sdv, sdd = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for py in range(top, bottom):
                for px in range(left + py % step, right, step):
                    samples += 1
                    grey += np.int64(rgb[py, px, 0]) + 2 * np.int64(rgb[py, px, 1]) + np.int64(rgb[py, px, 2])
                    z = depth_m[py, px]
                    if z > 0 and z <= max_range_m:
                        u, v, d = px - x, py - y, 1.0 / z
                        n += 1
                        su += u
                        sv += v
                        suu += u * u
                        suv += u * v
                        svv += v * v
                        sd += d
                        sdu += d * u
                        sdv += d * v
                        sdd += d * d
            cell[BRIGHTNESS] = grey / (4.0 * 255.0 * samples)
            if n < max(MIN_SAMPLES, MIN_FILLED * samples):
                continue
            mu, mv, md = su / n, sv / n, sd / n
            cuu, cuv, cvv = suu / n - mu * mu, suv / n - mu * mv, svv / n - mv * mv
            cdu, cdv, cdd = sdu / n - md * mu, sdv / n - md * mv, sdd / n - md * md
            determinant = cuu * cvv - cuv * cuv
            if determinant < 1e-2 * (cuu + cvv) ** 2:  # nearly collinear pixels
                continue
            a, b = (cdu * cvv - cdv * cuv) / determinant, (cdv * cuu - cdu * cuv) / determinant
            c = md - a * mu - b * mv
            if c <= 0 or cdd - a * cdu - b * cdv > (MAX_ROUGHNESS * c) ** 2:
                continue
            # 1 / z = a u + b v + c, times z, says that (nx, ny, nz) times the point is 1.
            nx, ny, nz = a * k[0, 0], b * k[1, 1], a * (k[0, 2] - x) + b * (k[1, 2] - y) + c
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            centre_x, centre_y, centre_z = (x - k[0, 2]) / k[0, 0] / c, (y - k[1, 2]) / k[1, 1] / c, 1.0 / c
            if MAX_SLANT * length * np.sqrt(centre_x**2 + centre_y**2 + centre_z**2) > 1.0:
                continue
            cell[X], cell[Y] = x, y
            cell[CENTRE], cell[CENTRE + 1], cell[CENTRE + 2] = centre_x, centre_y, centre_z
            cell[NORMAL], cell[NORMAL + 1], cell[NORMAL + 2] = -nx / length, -ny / length, -nz / length
            cell[EXISTS] = 1.0
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            across = grid[row, column + 1, BRIGHTNESS] - grid[row, column - 1, BRIGHTNESS]
            down = grid[row + 1, column, BRIGHTNESS] - grid[row - 1, column, BRIGHTNESS]
            grid[row, column, CHANGE_X] = across / (2.0 * cell_px)
            grid[row, column, CHANGE_Y] = down / (2.0 * cell_px)
