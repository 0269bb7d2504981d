"""Titles stand on plates, and stay in the picture."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from labeling.inspection.titles import INK, PLATE, write_title


@given(st.floats(-500, 900), st.floats(-500, 900), st.sampled_from(["chair 0.93", "tv", "Stühle №5"]))
def test_a_title_can_be_read_wherever_it_is_asked_for(x, y, text):
    picture = np.full((60, 160, 3), 128, np.uint8)
    write_title(picture, text, (x, y))
    changed = np.argwhere((picture != 128).any(axis=2))
    (top, left), (bottom, right) = changed.min(axis=0), changed.max(axis=0)
    plate = picture[top : bottom + 1, left : right + 1]
    assert (picture == PLATE).all(axis=2).sum() > 0.3 * plate[..., 0].size
    assert plate.max() > 200  # ink
    assert top >= 0
    assert left >= 0
    assert max(INK) == 255
    if 80 < x < 90 and 25 < y < 35:
        assert abs((left + right) / 2 - x) < 6


def test_a_title_wider_than_its_picture_begins_at_the_left():
    picture = np.full((40, 30, 3), 128, np.uint8)
    write_title(picture, "refrigerator 0.99", (15, 20))
    assert (picture[:, 0] == 128).all(axis=1).sum() < 40
