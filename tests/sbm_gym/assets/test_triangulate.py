import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sbm_gym.assets.catalog.triangulate import triangulate


def area_of(points, triangles, polygon):
    a, b, c = (points[polygon[triangles[:, k]]] for k in range(3))
    return np.cross(b - a, c - a) / 2


@given(st.integers(3, 9), st.integers(0, 2**32 - 1))
def test_triangles_cover_a_star_shaped_polygon_once(corners, seed):
    """All triangles turn the polygon's way and their areas add up to it: no gap, no overlap, no flip."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    if gaps.min() < 0.02 or gaps.max() > np.pi - 0.02:
        return
    radius = rng.uniform(0.2, 1.0, corners)
    flat = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = np.concatenate([flat, np.zeros((corners, 1))], axis=1) @ turn.T
    polygon = np.arange(corners)
    vectors = area_of(points, triangulate(points, polygon[None]), polygon)
    x, y = flat.T
    shoelace = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    normal = np.linalg.det(turn) * turn[:, 2]
    assert np.all(vectors @ normal >= -1e-12)
    assert np.linalg.norm(vectors, axis=1).sum() == pytest.approx(shoelace, rel=1e-9)


def test_several_polygons_keep_their_corners_apart():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1.0], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    triangles = triangulate(points, np.array([[0, 1, 2, 3], [4, 5, 6, 7]]))
    assert len(triangles) == 4
    assert set(triangles[:2].ravel()) <= {0, 1, 2, 3}
    assert set(triangles[2:].ravel()) == {4, 5, 6, 7}
