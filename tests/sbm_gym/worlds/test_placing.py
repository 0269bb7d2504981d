"""Boxes on the floor plan against brute force, and layouts that take back what they put in."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sbm_gym.assets.parametric.builtin import BuiltinLibrary
from sbm_gym.worlds.geometry.placing import Box, Layout, Room, overlap

angle = st.one_of(st.sampled_from([0.0, np.pi / 2, -np.pi, 3 * np.pi / 2]), st.floats(-7, 7))
boxes = st.builds(Box, *[st.floats(-1, 1)] * 2, *[st.floats(0.05, 0.8)] * 2, angle)


def gap(a, b):
    """Distance of two convex outlines by their edges; 0 if they share a point."""
    first, second = a.corners(), b.corners()

    def inside(points, box):
        local = (points - [box.x_m, box.y_m]) @ np.array(
            [[np.cos(box.yaw_rad), -np.sin(box.yaw_rad)], [np.sin(box.yaw_rad), np.cos(box.yaw_rad)]]
        )
        return np.all(np.abs(local) <= [box.half_x_m, box.half_y_m], axis=1)

    t = np.linspace(0, 1, 60)[:, None, None]
    rim_a = (first + t * (np.roll(first, -1, 0) - first)).reshape(-1, 2)
    rim_b = (second + t * (np.roll(second, -1, 0) - second)).reshape(-1, 2)
    if inside(rim_a, b).any() or inside(rim_b, a).any():
        return 0.0
    return float(np.linalg.norm(rim_a[:, None] - rim_b[None], axis=2).min())


@given(boxes, boxes)
def test_overlap_is_what_sampled_outlines_show(a, b):
    distance = gap(a, b)
    assert overlap(a, b) == overlap(b, a)
    if distance > 0.03:
        assert not overlap(a, b)
    if distance == 0.0:
        assert overlap(a, b, 0.02)


@given(boxes)
def test_bounds_hold_the_corners_tightly(box):
    corners = box.corners()
    np.testing.assert_allclose(box.bounds(), [*corners.min(axis=0), *corners.max(axis=0)], atol=1e-9)


@given(boxes, st.integers(0, 3))
def test_shadow_is_the_extent_along_a_wall(box, index):
    wall = Room((-2.0, -1.5), (2.0, 1.5), 2.5).walls()[index]
    relative = box.corners() - wall.origin
    along, out = relative @ wall.along, relative @ wall.normal
    np.testing.assert_allclose(wall.shadow(box), [along.min(), along.max(), out.min()], atol=1e-9)


def test_boxes_at_different_heights_do_not_overlap():
    assert not overlap(Box(0, 0, 1, 1, 0, 0.0, 0.9), Box(0, 0, 1, 1, 0, 0.9, 1.5))
    assert overlap(Box(0, 0, 1, 1, 0, 0.0, 0.9), Box(0, 0, 1, 1, 0, 0.8, 1.5))


def test_undo_takes_out_pieces_and_zones_and_leaves_keep_their_floor():
    room = Room((0.0, 0.0), (4.0, 4.0), 2.5, leaves=(Box(2.0, 0.1, 0.45, 0.02, 0.0, 0.0, 2.0),))
    layout = Layout(room, np.random.default_rng(0))
    card = BuiltinLibrary(0).models("dresser")[0]
    before = layout.mark()
    assert layout.against_wall(card, walls=[0], centre_m=2.0) is None
    piece = layout.against_wall(card, walls=[2], front_m=0.5)
    assert piece is not None
    assert (len(layout.placements), len(layout.zones)) == (1, 1)
    layout.undo(before)
    assert (layout.placements, layout.zones) == ([], [])
