import numpy as np
import pytest

from labeling.generator.draw.view_masks import MIN_WEIGHT, OTHER_VIEW_WEIGHT, ViewChances, point_owners, view_chances

from .filled import edge_aware_fill


def view(seed: int, holes: float = 0.0):
    """A picture of three voxel patches and their objects' probabilities; the last object is out of view."""
    rng = np.random.default_rng(seed)
    voxels = np.zeros((90, 120), np.int32)
    voxels[20:50, 30:60], voxels[40:80, 70:100] = 1, 2
    rgb = np.array([[90, 90, 90], [200, 80, 70], [60, 90, 190]], np.uint8)[voxels]
    rgb = np.clip(rgb.astype(int) + rng.integers(-8, 9, rgb.shape), 0, 255).astype(np.uint8)
    voxels[rng.random(voxels.shape) < holes] = -1
    probability = np.array([[0, 0, 0, 0], [0.9, 0.05, 0, 0], [0, 0.1, 0.8, 0], [0, 0, 0, 1]], np.float32)
    return rgb, voxels, probability


@pytest.mark.parametrize(("holes", "reach"), [(0.0, 2.0), (0.6, 4.0)])
def test_filling_around_objects_is_filling_the_whole_picture(holes: float, reach: float) -> None:
    rgb, voxels, probability = view(0, holes)
    chances = view_chances(rgb, voxels, None, probability, reach, 0.3)
    chance, known = chances.dense(), chances.known
    values = np.where((voxels >= 0)[:, :, None], probability[np.maximum(voxels, 0)], 0).astype(np.float32)
    filled, total = edge_aware_fill(values, (voxels >= 0).astype(np.float32), rgb, reach, 0.3)
    np.testing.assert_array_equal(known, total > MIN_WEIGHT)
    np.testing.assert_allclose(chance[known], filled[known], atol=0.01)
    assert not chance[:, :, 3].any()


def test_what_other_views_show_counts_less() -> None:
    rgb, voxels, probability = view(1)
    hole = np.zeros(voxels.shape, bool)
    hole[25:45, 35:55] = True
    borrowed = np.where(hole, np.int32(0), np.int32(-1))
    own = np.where(hole, np.int32(-1), voxels)
    chances = view_chances(rgb, own, borrowed, probability, 3.0, 0.3)
    chance = chances.dense()
    assert chances.known.all()
    values = np.where(hole[:, :, None], probability[0], probability[voxels]).astype(np.float32)
    trust = np.where(hole, OTHER_VIEW_WEIGHT, np.float32(1))
    np.testing.assert_allclose(chance, edge_aware_fill(values, trust, rgb, 3.0, 0.3)[0], atol=0.01)


def chances_in_windows(seed: int) -> ViewChances:
    """Four objects, of which the third is out of view."""
    rng = np.random.default_rng(seed)
    windows = np.array([[0, 30, 0, 25], [5, 20, 10, 40], [0, 0, 0, 0], [12, 30, 8, 33]])
    sizes = (windows[:, 1] - windows[:, 0]) * (windows[:, 3] - windows[:, 2])
    dense = rng.dirichlet([0.4] * 5, (30, 40)).astype(np.float32)
    parts = [dense[t:b, left:r, k].ravel() for k, (t, b, left, r) in enumerate(windows)]
    known = rng.random((30, 40)) < 0.9
    return ViewChances((30, 40), windows, np.cumsum([0, *sizes]), np.concatenate(parts), known)


@pytest.mark.parametrize("exclusive", [True, False])
def test_pixels_go_to_the_likeliest_object_or_the_background(exclusive: bool) -> None:
    chances = chances_in_windows(2)
    probability, known = chances.dense(), chances.known
    shown, pixels, means = chances.masks(exclusive)
    for y in range(30):
        for x in range(40):
            p = probability[y, x]
            background = 1 - p.sum() if exclusive else 1 - p.max()
            assert shown[y, x] == (int(p.argmax()) if known[y, x] and p.max() > background else -1)
    for k in range(4):
        own = probability[:, :, k][shown == k]
        assert pixels[k] == len(own)
        assert means[k] == pytest.approx(own.mean() if len(own) else 0)


@pytest.mark.parametrize("exclusive", [True, False])
def test_points_are_decided_as_pixels_are(exclusive: bool) -> None:
    probability = np.random.default_rng(3).dirichlet([0.4] * 4, 200).astype(np.float32)[:, :3]
    for p, owner in zip(probability, point_owners(probability, exclusive), strict=True):
        assert owner == (int(p.argmax()) if p.max() > 1 - (p.sum() if exclusive else p.max()) else -1)


def test_without_objects_there_is_background_only() -> None:
    rgb, voxels = np.zeros((4, 5, 3), np.uint8), np.zeros((4, 5), np.int32)
    shown, pixels, means = view_chances(rgb, voxels, None, np.zeros((1, 0), np.float32), 2.0, 0.3).masks(True)
    assert shown.shape == (4, 5)
    assert np.all(shown == -1)
    assert len(pixels) == len(means) == 0
    assert np.all(point_owners(np.zeros((3, 0), np.float32), True) == -1)
