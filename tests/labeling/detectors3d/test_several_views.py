"""Boxes found more than once: suppressed against brute force, fused against what is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.box_overlap import box_iou_3d
from labeling.detectors3d.base import Detection3d
from labeling.detectors3d.several_views import fuse_views, mean_box, suppress_3d

from .boxed_rooms import upright

BOX = st.builds(
    lambda x, y, sides, yaw: upright(x, y, sides, yaw),
    st.floats(-1, 1),
    st.floats(-1, 1),
    st.tuples(*[st.floats(0.4, 1.5)] * 3),
    st.floats(0, 3),
)


@settings(max_examples=40)
@given(st.lists(st.tuples(BOX, st.sampled_from([0.1, 0.4, 0.4, 0.9]), st.sampled_from("ab")), max_size=9))
def test_suppression_is_that_of_brute_force(found):
    boxes, scores, names = ([one[part] for one in found] for part in range(3))
    left, expected = sorted(range(len(found)), key=lambda number: (-scores[number], number)), []
    while left:
        best = left.pop(0)
        expected.append(best)
        left = [one for one in left if names[one] != names[best] or box_iou_3d(boxes[one], boxes[best]) < 0.25]
    assert suppress_3d(boxes, scores, names) == expected


def test_the_mean_of_a_box_under_all_of_its_names_is_that_box():
    true = upright(0.3, -0.2, (1.1, 0.9, 0.5), 0.05)
    names = [
        true,
        upright(0.3, -0.2, (0.9, 1.1, 0.5), 0.05 + np.pi / 2),
        upright(0.3, -0.2, (1.1, 0.9, 0.5), 0.05 - np.pi),
    ]
    assert box_iou_3d(mean_box(names, np.array([1.0, 2.0, 3.0])), true) > 0.999
    # One whose sides were exchanged by mistake counts as the nearly square box that it is.
    mistaken = upright(0.3, -0.2, (1.1, 0.9, 0.5), 0.05 + np.pi / 2)
    assert box_iou_3d(mean_box([true, mistaken], np.ones(2)), upright(0.3, -0.2, (1.0, 1.0, 0.5), 0.05)) > 0.99


def test_views_that_agree_make_one_sure_box():
    true = upright(0, 0, (1, 0.6, 0.5), 0.4)
    found = [
        Detection3d(view, "crate", 0.8, upright(away, 0, (1, 0.6, 0.5), 0.4)) for view, away in ((0, 0.05), (2, -0.05))
    ]
    found += [Detection3d(1, "crate", 0.9, upright(3, 0, (1, 0.6, 0.5), 0)), Detection3d(1, "locker", 0.5, true)]
    by = {(one.category, one.views): one for one in fuse_views(found, 4)}
    assert len(by) == 3
    assert by["crate", (0, 2)].confidence == pytest.approx(0.4)
    assert by["crate", (1,)].confidence == pytest.approx(0.225)
    np.testing.assert_allclose(by["crate", (0, 2)].box.centre_m, true.centre_m, atol=1e-9)
    assert by["locker", (1,)].confidence == pytest.approx(0.125)
