"""Surfels of a plane lie in it, whatever its slant; edges and holes have none."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from labeling.core.geometry import intrinsics_from_fov
from labeling.core.views import RgbdViews
from labeling.generator.poses.surfels import BRIGHTNESS, CENTRE, EXISTS, NORMAL, X, Y, surfels

K = intrinsics_from_fov(64, 48, 1.0)


def seen(depth_m, rgb=None) -> RgbdViews:
    rgb = np.full((48, 64, 3), 200, np.uint8) if rgb is None else rgb
    return RgbdViews(rgb[None], depth_m[None].astype(np.float32), K[None], np.eye(4)[None])


def plane(normal, distance_m):
    """z-depth of a plane: normal . point = distance."""
    y, x = np.mgrid[0:48, 0:64]
    return distance_m / (np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(x.shape)], -1) @ normal)


@given(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(0.2, 8.0))
def test_a_plane_is_found_exactly(slant_x, slant_y, distance_m):
    normal = np.array([slant_x, slant_y, 1.5])
    normal /= np.linalg.norm(normal)
    grid = surfels(seen(plane(normal, distance_m)), cells_a_side=10).grids[0]
    assert np.all(grid[..., EXISTS] == 1)
    assert np.allclose(grid[..., NORMAL : NORMAL + 3], -normal, atol=1e-3)
    assert np.allclose(grid[..., CENTRE : CENTRE + 3] @ normal, distance_m, rtol=1e-4)
    rays = grid[..., CENTRE : CENTRE + 2] / grid[..., CENTRE + 2, None]
    assert np.allclose(rays * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]], grid[..., [X, Y]], atol=1e-3)


def test_edges_and_holes_have_no_surfel():
    depth_m = np.full((48, 64), 2.0)
    depth_m[:, 32:] = 3.0
    depth_m[:12] = 0
    cells = surfels(seen(depth_m), cells_a_side=14)
    there, edge = cells.grids[0][..., EXISTS] > 0, 32 // cells.cell_px
    assert cells.cell_px == 4
    assert not there[:3].any()
    assert not there[:, edge - 1 : edge + 1].any()
    assert there[4:, : edge - 1].all()
    assert there[4:, edge + 1 :].all()


def test_depth_beyond_range_is_none_and_brightness_needs_no_depth():
    cells = surfels(seen(np.full((48, 64), 9.0)), cells_a_side=10, max_range_m=5.0).grids[0]
    assert not cells[..., EXISTS].any()
    assert np.allclose(cells[..., BRIGHTNESS], 200 / 255)
