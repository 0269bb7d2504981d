import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.types import Detection
from labeling.core.views import RgbdViews
from labeling.generator.cloud.object_scale import measure_scale, voxel_edge_m
from labeling.generator.cloud.voxel_cloud import build_cloud
from labeling.generator.objects.seeds import detection_seeds, far_from_median, mask_trimap, trimap_widths
from labeling.generator.settings.label_config import LabelConfig


def views_of(depth: np.ndarray, intrinsics: np.ndarray) -> RgbdViews:
    return RgbdViews(np.zeros((*depth.shape, 3), np.uint8), depth, intrinsics, np.eye(4)[None])


@settings(max_examples=40)
@given(st.integers(0, 10_000), st.floats(0, 0.1), st.floats(0, 0.2))
def test_parts_of_a_mask_do_not_overlap(seed: int, erode: float, dilate: float) -> None:
    rng = np.random.default_rng(seed)
    top, left = rng.integers(0, 20, 2)
    mask = np.zeros((30, 40), bool)
    mask[top : top + rng.integers(1, 25), left : left + rng.integers(1, 25)] = True
    front, back, rim = mask_trimap(mask, erode, dilate).over(mask.shape)
    assert front.any()
    assert not np.any(front & ~mask)
    assert not np.any(back & mask)
    assert not np.any(rim & ~back)


def test_safe_parts_keep_their_distance_from_the_outline() -> None:
    mask = np.zeros((60, 60), bool)
    mask[20:40, 20:40] = True
    front, back, _ = mask_trimap(mask, 0.1, 0.2).over(mask.shape)
    assert front[22:38, 22:38].all()
    assert not front[20:22].any()
    assert not back[17:43, 20:40].any()
    assert not back[20:40, 17:43].any()
    assert back[:15].all()


def test_a_mask_is_not_eroded_at_the_border_of_the_picture() -> None:
    mask = np.zeros((40, 40), bool)
    mask[:, :20] = True
    front, _, _ = mask_trimap(mask, 0.1, 0.1).over(mask.shape)
    assert front[:, :17].all()
    assert not front[:, 18:].any()


def test_a_mask_thinner_than_the_rim_is_its_own_foreground() -> None:
    mask = np.zeros((40, 40), bool)
    mask[10, 5:35] = True
    assert np.array_equal(mask_trimap(mask, 0.015, 0.05).over(mask.shape)[0], mask)


def test_a_full_mask_has_no_background() -> None:
    front, back, rim = mask_trimap(np.ones((20, 20), bool), 0.01, 0.05).over((20, 20))
    assert front.all()
    assert not back.any()
    assert not rim.any()


def test_the_rim_is_wider_the_less_sure_a_detection_is() -> None:
    config = LabelConfig(erode=0.01, dilate=0.02, erode_doubt=0.1, dilate_doubt=0.2)
    assert trimap_widths(1.0, config) == pytest.approx((0.01, 0.02))
    assert trimap_widths(0.5, config) == pytest.approx((0.06, 0.12))
    plain = LabelConfig(erode_doubt=0, dilate_doubt=0)
    assert trimap_widths(0.1, plain) == (plain.erode, plain.dilate)


def test_outliers_are_the_points_far_away() -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal(0, 0.2, (500, 3)), rng.normal(6, 0.2, (40, 3))]).astype(np.float32)
    far = far_from_median(points)
    assert far[500:].all()
    assert far[:500].mean() < 0.05


def test_the_wall_behind_an_outline_is_not_foreground() -> None:
    """A mask that reaches over the edge of a box at 2 m onto a wall at 6 m."""
    depth = np.full((1, 60, 80), 6.0, np.float32)
    depth[0, 10:50, 20:60] = 2.0
    rgb = np.zeros((1, 60, 80, 3), np.uint8)
    intrinsics, pose = intrinsics_from_fov(80, 60, 1.2), look_at(np.zeros(3), np.array([1.0, 0, 0]))
    cloud = build_cloud(RgbdViews(rgb, depth, intrinsics[None], pose[None]), 0.05)
    mask = np.zeros((60, 80), bool)
    mask[10:50, 16:60] = True
    seeds = detection_seeds(cloud, Detection(0, "box", 0.9, mask), LabelConfig())
    assert len(seeds.foreground) > 0
    assert np.all(cloud.points[seeds.foreground, 0] < 3)
    assert not set(seeds.foreground) & set(seeds.background)
    assert len(seeds.hard_negatives) > 0


def test_scale_is_the_size_of_the_objects() -> None:
    depth = np.full((1, 60, 80), 3.0, np.float32)
    intrinsics = intrinsics_from_fov(80, 60, 1.2)[None]
    mask = np.zeros((60, 80), bool)
    mask[20:40, 30:50] = True
    scale = measure_scale([Detection(0, "box", 0.9, mask)], views_of(depth, intrinsics))
    assert scale is not None
    np.testing.assert_allclose(scale.pixel_m, 3.0 / intrinsics[0, 0, 0])
    np.testing.assert_allclose(scale.object_m, 20 * scale.pixel_m)
    assert voxel_edge_m(scale, LabelConfig(voxel_m=0.123)) == 0.123


def test_scale_is_unknown_without_depth_or_detections() -> None:
    depth = np.zeros((1, 6, 8), np.float32)
    intrinsics = intrinsics_from_fov(8, 6, 1.2)[None]
    assert measure_scale([Detection(0, "box", 0.9, np.ones((6, 8), bool))], views_of(depth, intrinsics)) is None
    assert measure_scale([], views_of(depth, intrinsics)) is None


@pytest.mark.parametrize("seed", range(4))
def test_parts_are_those_that_distances_over_the_whole_picture_give(seed: int) -> None:
    import cv2

    rng = np.random.default_rng(seed)
    mask = np.zeros((120, 160), bool)
    top, left = rng.integers(-10, 90), rng.integers(-10, 120)
    mask[max(0, top) : top + 30, max(0, left) : left + 45] = True
    foreground, background, rim = mask_trimap(mask, 0.05, 0.1).over(mask.shape)
    size = np.sqrt(mask.sum())
    framed = np.pad(mask.astype(np.uint8), 1, mode="edge")
    inside = cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1]
    outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    outer = max(2.0, 0.1 * size)
    np.testing.assert_array_equal(foreground, inside > max(1.0, 0.05 * size))
    np.testing.assert_array_equal(background, outside > outer)
    np.testing.assert_array_equal(rim, (outside > outer) & (outside <= outer + 0.25 * size + 2))
