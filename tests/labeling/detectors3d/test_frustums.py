import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from labeling.core.box_overlap import box_iou_3d
from labeling.core.errors import UsageError
from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.types import Box3d
from labeling.core.views import Camera
from labeling.detectors3d.config import NO_AUGMENTATION_3D, Augment3dConfig
from labeling.detectors3d.frustum_dataset import augmented, resample_points
from labeling.detectors3d.frustum_samples import make_frustum_sample
from labeling.detectors3d.frustums import make_frustum, rotation_about_z
from labeling.detectors3d.upright_boxes import decode_box, encode_box

from .boxed_rooms import boxed_room, frustum_samples_of, known_of, upright

K = intrinsics_from_fov(64, 48, 1.2)


def wall(distance_m: float) -> np.ndarray:
    return np.full((48, 64), distance_m, np.float32)


def cut(depth, pose, box_xyxy, most=10_000):
    left, top, right, bottom = map(float, box_xyxy)
    return make_frustum(depth, Camera(K, pose, depth.shape), (left, top, right, bottom), most, np.random.default_rng(0))


def test_the_middle_of_the_2d_box_lies_straight_ahead():
    pose = look_at(np.array([3.0, -2, 1.5]), np.array([0.0, 4, 0.5]))
    frustum = cut(wall(4.0), pose, (40, 10, 61, 31))
    centre = frustum.points[np.all(frustum.pixels == [50, 20], axis=1)][0]
    assert centre[1] == pytest.approx(0.0, abs=1e-5)
    assert centre[0] > 3.0
    # To the right in the picture is to the right, -Y, of the frustum; down in the picture is down.
    right = frustum.points[np.all(frustum.pixels == [58, 20], axis=1)][0]
    below = frustum.points[np.all(frustum.pixels == [50, 28], axis=1)][0]
    assert right[1] < -0.1
    assert below[2] < centre[2]


def test_only_known_depth_within_the_box_counts():
    depth = wall(2.0)
    depth[:, :32] = 0.0
    depth[20:24] = 80.0  # out of range
    pose = look_at(np.zeros(3), np.array([1.0, 0, 0]))
    pixels = cut(depth, pose, (20, 10, 44, 40)).pixels
    assert len(pixels) == (44 - 32) * (30 - 4)
    assert pixels[:, 0].min() == 32
    assert len(cut(depth, pose, (0, 0, 20, 40)).points) == 0


def test_a_box_that_reaches_out_of_the_view_is_cut_off():
    pose = look_at(np.zeros(3), np.array([1.0, 0, 0]))
    assert len(cut(wall(2.0), pose, (-30, -30, 200, 200)).points) == 48 * 64
    assert len(cut(wall(2.0), pose, (-30, -30, -5, 20)).points) == 0


@pytest.mark.parametrize("box", [(5, 5, 5, 9), (5, 9, 9, 5), (0, 0, float("nan"), 3)])
def test_no_box_is_refused(box):
    with pytest.raises(ValueError, match="a 2-D box is left, top, right, bottom"):
        cut(wall(2.0), look_at(np.zeros(3), np.array([1.0, 0, 0])), box)


@settings(max_examples=30)
@given(seed=st.integers(0, 1000), yaw=st.floats(-3, 3))
def test_boxes_go_there_and_back(seed, yaw):
    rng = np.random.default_rng(seed)
    pose = look_at(rng.uniform(-3, 3, 3), np.array([0.1, 0.2, 0.3]))
    frustum = cut(wall(2.0), pose, (10, 10, 30, 30))
    x, y, length, width, height = rng.uniform(0.3, 2, 5)
    box = upright(x, -y, (length, width, height), yaw)
    assert box_iou_3d(frustum.to_world(frustum.from_world(box)), box) == pytest.approx(1.0, abs=1e-6)


@settings(max_examples=30)
@given(angle=st.floats(-3, 3), shift=st.floats(-9, 9))
def test_turning_the_scene_about_the_vertical_leaves_the_frustum_as_it_is(angle, shift):
    rng = np.random.default_rng(0)
    depth = rng.uniform(1, 3, (48, 64)).astype(np.float32)
    pose = look_at(np.array([1.0, 2, 1.4]), np.array([0.0, 0, 0.5]))
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = rotation_about_z(angle), [shift, -shift, 0]
    before, after = cut(depth, pose, (10, 10, 30, 30), 50), cut(depth, moved @ pose, (10, 10, 30, 30), 50)
    np.testing.assert_allclose(before.points, after.points, atol=1e-4)


@settings(max_examples=60)
@given(
    sides=st.tuples(*[st.floats(0.1, 5)] * 3),
    yaw=st.floats(-7, 7),
    turn=st.sampled_from(["", "x", "y"]),
)
def test_upright_boxes_are_the_same_box_as_their_numbers(sides, yaw, turn):
    # Whichever of its axes points up.
    rotation = Rotation.from_euler("z", yaw).as_matrix()
    if turn:
        rotation = rotation @ Rotation.from_euler(turn, np.pi / 2).as_matrix()
    box = Box3d(np.array([1.0, -2, 0.5]), np.array(sides), rotation)
    numbers = encode_box(box)
    assert box_iou_3d(decode_box(numbers), box) == pytest.approx(1.0, abs=1e-5)
    assert numbers[3] >= numbers[4] > 0
    assert 0 <= numbers[6] < np.pi


@pytest.mark.parametrize(
    ("box", "why"),
    [
        (Box3d(np.zeros(3), np.array([1.0, 0, 1]), np.eye(3)), "must be above 0"),
        (Box3d(np.zeros(3), np.array([1.0, np.nan, 1]), np.eye(3)), "finite"),
        (Box3d(np.zeros(3), np.ones(3), 2 * np.eye(3)), "must be a rotation"),
        (Box3d(np.zeros(3), np.ones(3), np.diag([1.0, 1, -1])), "must be a rotation"),
        (Box3d(np.zeros(3), np.ones(3), Rotation.from_euler("x", 0.3).as_matrix()), "tilted"),
    ],
)
def test_what_is_no_upright_box_is_refused(box, why):
    with pytest.raises(UsageError, match=why):
        encode_box(box)


def test_the_points_of_an_object_lie_in_its_box_and_others_do_not():
    for sample in frustum_samples_of(3):
        frustum, foreground = sample.crop(sample.box_xyxy)
        box = frustum.from_world(sample.box)
        depth_in = 0.5 * box.extent_m - np.abs((frustum.points - box.centre_m) @ box.rotation)
        assert np.all(depth_in[foreground] > -1e-3)
        assert np.all(depth_in[~foreground].min(axis=1) < 1e-3)
        assert 0.3 < foreground.mean() < 1.0


def test_an_edge_on_a_column_of_pixels_takes_the_same_points_in_every_precision():
    for sample in frustum_samples_of(3):
        left, top, right, bottom = sample.box_xyxy
        just_after_a_column = np.float64(round(right - 2) + 1e-9)
        frustum, foreground = sample.crop((left, top, just_after_a_column, bottom))
        assert len(foreground) == len(frustum.points) > 0


@pytest.mark.parametrize("seed", range(5))
def test_augmentation_moves_points_and_box_together(seed):
    config = Augment3dConfig(flip=0.5, box_shift=0.1, box_scale=0.1, range_shift=0.2)
    for sample in frustum_samples_of(3):
        points, foreground, numbers = augmented(sample, config, np.random.default_rng(seed))
        box = decode_box(numbers)
        depth_in = 0.5 * box.extent_m - np.abs((points[foreground] - box.centre_m) @ box.rotation)
        assert np.all(depth_in > -2e-3)


def test_a_mirrored_sample_is_the_mirror_image():
    sample = frustum_samples_of(3)[0]
    plain = augmented(sample, NO_AUGMENTATION_3D, np.random.default_rng(0))
    mirrored = augmented(sample, Augment3dConfig(1.0, 0.0, 0.0, 0.0), np.random.default_rng(0))
    np.testing.assert_allclose(mirrored[0], plain[0] * [1, -1, 1])
    assert np.sin(mirrored[2][6] + plain[2][6]) == pytest.approx(0, abs=1e-5)


@settings(max_examples=40)
@given(available=st.integers(1, 60), wanted=st.integers(1, 60))
def test_points_are_repeated_only_where_there_are_too_few(available, wanted):
    chosen = resample_points(available, wanted, np.random.default_rng(0))
    assert len(chosen) == wanted
    assert len(set(chosen)) == min(available, wanted)


def test_little_seen_teaches_nothing():
    episode = boxed_room(3)
    one, box = known_of(episode)[0]
    speck = np.zeros_like(one.modal)
    speck[0, :5] = True
    assert make_frustum_sample(episode, 0, "crate", speck, box, 1.0, np.random.default_rng(0)) is None
