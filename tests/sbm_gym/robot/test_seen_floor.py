"""The floor that a robot can see at all is the part of its map that it can get to."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import label

from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.worlds.geometry.navigable import NavigableMap


@given(st.integers(0, 2**32 - 1), st.floats(0.3, 0.8))
def test_floor_hangs_together_with_where_the_robot_stands_or_is_the_largest_part(seed, share):
    rng = np.random.default_rng(seed)
    free = rng.random((14, 17)) < share
    if not free.any():
        return
    navigable = NavigableMap(free, np.zeros(2), 0.1)
    start_m = rng.uniform(0.0, [1.7, 1.4])
    floor = SeenFloor(navigable, start_m, stride_m=0.3, reach_m=5.0)
    parts, _ = label(free, np.ones((3, 3), int))  # type: ignore[misc]
    stands = floor.cell(navigable.nearest_free(start_m))
    number = parts[stands] or 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    np.testing.assert_array_equal(floor.is_floor, parts == number)
