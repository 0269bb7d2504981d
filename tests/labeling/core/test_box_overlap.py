import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from labeling.core.box_overlap import box_iou_3d, box_iou_bev, intersection_volume
from labeling.core.types import Box3d

UNIT = Box3d(np.zeros(3), np.ones(3), np.eye(3))


def upright(x: float, y: float, z: float, sides: tuple[float, float, float], yaw: float) -> Box3d:
    return Box3d(np.array([x, y, z], float), np.array(sides, float), Rotation.from_euler("z", yaw).as_matrix())


def any_box(seed: int) -> Box3d:
    rng = np.random.default_rng(seed)
    turn = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    return Box3d(rng.uniform(-0.5, 0.5, 3), rng.uniform(0.2, 2.0, 3), turn)


@pytest.mark.parametrize(
    ("other", "iou"),
    [
        (UNIT, 1.0),
        (upright(0.5, 0, 0, (1, 1, 1), 0.0), 1 / 3),
        (upright(1.0, 0, 0, (1, 1, 1), 0.0), 0.0),  # they touch
        (upright(0, 0, 0, (0.5, 0.5, 0.5), 0.0), 0.125),  # one within the other
        (upright(0.25, 0.25, 0.25, (0.5, 0.5, 0.5), 0.0), 0.125),  # the same, with three faces in common
        (upright(0, 0, 0, (1, 1, 1), np.pi / 2), 1.0),
        (upright(0, 0, 0, (1, 1, 1), np.pi / 4), 1 / np.sqrt(2)),  # a regular octagon of 2 (sqrt 2 - 1)
        (upright(0, 0, 3, (1, 1, 1), 0.0), 0.0),
        (Box3d(np.zeros(3), np.zeros(3), np.eye(3)), 0.0),
    ],
)
def test_known_overlaps(other, iou):
    assert box_iou_3d(UNIT, other) == pytest.approx(iou, abs=1e-7)
    assert box_iou_3d(other, UNIT) == pytest.approx(iou, abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_any_orientation_agrees_with_counting_points(seed):
    a, b = any_box(seed), any_box(seed + 100)
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (400_000, 3)) * a.extent_m @ a.rotation.T + a.centre_m
    inside = np.all(np.abs((points - b.centre_m) @ b.rotation) <= 0.5 * b.extent_m, axis=1)
    volume = float(np.prod(a.extent_m))
    spread = 5 * volume * np.sqrt(inside.mean() * (1 - inside.mean()) / len(points)) + 1e-6
    assert intersection_volume(a, b) == pytest.approx(volume * inside.mean(), abs=spread)


def test_upright_boxes_agree_with_open3d():
    from open3d.ml.contrib import iou_3d_cpu, iou_bev_cpu

    rng = np.random.default_rng(0)
    sets = []
    for _ in range(2):
        sets.append(
            [(*rng.uniform(-1, 1, 3), *rng.uniform(0.3, 2.5, 3), rng.uniform(-np.pi, np.pi)) for _ in range(20)]
        )
    boxes = [[upright(x, y, z, (a, b, c), yaw) for x, y, z, a, b, c, yaw in some] for some in sets]
    # Open3D's boxes stand on the point they are told by, with -Y up: x, y, z, width, height, length, yaw about Y.
    theirs = [
        np.array([(x, -(z - c / 2), y, a, c, b, -yaw) for x, y, z, a, b, c, yaw in some], np.float32) for some in sets
    ]
    ours = np.array([[box_iou_3d(one, other) for other in boxes[1]] for one in boxes[0]])
    bird = np.array([[box_iou_bev(one, other) for other in boxes[1]] for one in boxes[0]])
    flat = [some[:, [0, 2, 3, 5, 6]] for some in theirs]
    assert np.count_nonzero(ours > 0.05) > 50
    np.testing.assert_allclose(iou_3d_cpu(*theirs), ours, atol=1e-6)
    np.testing.assert_allclose(iou_bev_cpu(*flat), bird, atol=1e-6)


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), angle=st.floats(-3, 3), shift=st.floats(-5, 5))
def test_moving_both_boxes_changes_nothing(seed, angle, shift):
    a, b = any_box(seed), any_box(seed + 1)
    turn = Rotation.from_rotvec([angle, 0.3 * angle, -angle]).as_matrix()
    moved = [Box3d(turn @ box.centre_m + shift, box.extent_m, turn @ box.rotation) for box in (a, b)]
    assert box_iou_3d(*moved) == pytest.approx(box_iou_3d(a, b), abs=1e-6)


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000))
def test_overlap_is_symmetric_and_bounded(seed):
    a, b = any_box(seed), any_box(seed + 1)
    assert box_iou_3d(a, b) == pytest.approx(box_iou_3d(b, a), abs=1e-7)
    assert 0.0 <= box_iou_3d(a, b) <= 1.0
    assert intersection_volume(a, b) <= min(np.prod(a.extent_m), np.prod(b.extent_m)) + 1e-7
    assert box_iou_3d(a, a) == pytest.approx(1.0, abs=1e-6)
