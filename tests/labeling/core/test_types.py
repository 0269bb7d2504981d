import numpy as np

from labeling.core.types import Box3d


def test_box_3d_corners_stand_at_half_extents_along_its_axes():
    quarter_turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    corners = Box3d(np.array([10.0, 0, 0]), np.array([2.0, 4, 6]), quarter_turn).corners()
    np.testing.assert_allclose(corners.min(axis=0), [8, -1, -3])
    np.testing.assert_allclose(corners.max(axis=0), [12, 1, 3])
    assert len(np.unique(corners.round(6), axis=0)) == 8
