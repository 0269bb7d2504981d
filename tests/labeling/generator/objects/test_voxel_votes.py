import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.generator.objects.voxel_votes import split_voxels


@settings(max_examples=50)
@given(st.integers(0, 10_000), st.integers(1, 60))
def test_voxels_go_where_most_of_their_pixels_are(seed: int, num_voxels: int) -> None:
    rng = np.random.default_rng(seed)
    voxels = rng.integers(-1, num_voxels, (13, 17)).astype(np.int32)
    side = rng.integers(0, 3, voxels.shape)
    rim = (side == 2) & (rng.random(voxels.shape) < 0.2)
    top, bottom = sorted(rng.integers(0, 14, 2))
    left, right = sorted(rng.integers(0, 18, 2))
    window = slice(top, bottom), slice(left, right)
    outside = np.ones(voxels.shape, bool)
    outside[window] = False
    side[outside], rim[outside] = 2, False
    pixels = np.bincount(voxels[voxels >= 0], minlength=num_voxels).astype(np.int32)
    front, back, near = split_voxels(voxels[window], (side + 4 * rim)[window].astype(np.uint8), pixels)
    for found, inside in ((front, side == 1), (back, side == 2)):
        expected = [v for v in range(num_voxels) if 2 * np.sum(inside[voxels == v]) > np.sum(voxels == v)]
        assert found.tolist() == expected
    assert near.tolist() == sorted(set(voxels[rim & (voxels >= 0)].tolist()))


def test_masks_of_any_memory_order_are_read() -> None:
    rng = np.random.default_rng(0)
    voxels = rng.integers(0, 20, (12, 12)).astype(np.int32)
    mask = rng.random((12, 12)) < 0.5
    rim = ~mask & (rng.random((12, 12)) < 0.3)
    pixels = np.bincount(voxels.ravel(), minlength=20).astype(np.int32)
    side = (mask + 2 * ~mask + 4 * rim).astype(np.uint8)
    plain = split_voxels(voxels, side, pixels)
    turned = split_voxels(voxels, np.asfortranarray(side), pixels)
    for a, b in zip(plain, turned, strict=True):
        np.testing.assert_array_equal(a, b)
