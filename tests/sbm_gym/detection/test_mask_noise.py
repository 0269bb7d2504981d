"""Compiled loops over masks do what plain NumPy does, pixel by pixel."""

import cv2
import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from sbm_gym.detection.mask_noise import corrupt_mask, phantom_mask, smooth_field

SEEDS = st.integers(0, 2**32 - 1)


def random_mask(rng):
    """A mask of a few boxes, and smooth depth with holes."""
    height, width = int(rng.integers(8, 90)), int(rng.integers(8, 90))
    depth_m = rng.uniform(1.0, 4.0) + cv2.resize(rng.normal(size=(4, 4)).astype(np.float32), (width, height))
    depth_m = depth_m.astype(np.float32)
    depth_m[rng.random((height, width)) < 0.02] = 0.0
    mask = np.zeros((height, width), bool)
    for _ in range(int(rng.integers(1, 4))):
        y, x = rng.integers(height), rng.integers(width)
        mask[y : y + rng.integers(1, 50), x : x + rng.integers(1, 50)] = True
    return mask, depth_m


def plain_corrupt_mask(rng, mask, depth_m, error):
    size_px = float(np.sqrt(np.count_nonzero(mask)))
    margin_px = int(np.ceil(2.0 + 0.4 * size_px))
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    window = tuple(
        slice(max(0, first - margin_px), first + size + margin_px) for first, size in ((top, height), (left, width))
    )
    true, depth = mask[window], depth_m[window]
    inside_px = cv2.distanceTransform(true.astype(np.uint8), cv2.DIST_L2, 3)
    outside_px = cv2.distanceTransform((~true).astype(np.uint8), cv2.DIST_L2, 3)
    signed_px = np.where(true, inside_px - 0.5, 0.5 - outside_px)
    wobble_px = smooth_field(rng, true.shape, cells=5) * (0.35 + (0.015 + 0.11 * error) * size_px)
    bias_px = rng.normal(0.0, 0.02 + 0.05 * error) * size_px
    drawn = signed_px + wobble_px + bias_px > 0.0
    foreign = ~true & (np.abs(depth - np.median(depth[true])) > 0.75)
    drawn &= ~foreign | (signed_px > -1.0 - 0.04 * size_px)
    if rng.random() < 0.1 + 0.6 * error:
        drawn = plain_cut(rng, drawn, float(rng.uniform(0.05, 0.15 + 0.45 * error)))
    if rng.random() < 0.1 + 0.6 * error:
        drawn = plain_leak(rng, drawn, true, depth, size_px * float(rng.uniform(0.15, 0.3 + 0.5 * error)))
    result = np.zeros(mask.shape, bool)
    result[window] = drawn
    return result


def plain_cut(rng, drawn, share):
    y, x = np.nonzero(drawn)
    if len(x) == 0:
        return drawn
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = x * np.cos(angle) + y * np.sin(angle)
    wavy = along + 0.1 * np.ptp(along) * smooth_field(rng, drawn.shape, cells=4)[y, x]
    far = wavy > np.quantile(wavy, 1.0 - share)
    result = drawn.copy()
    result[y[far], x[far]] = False
    return result


def plain_leak(rng, drawn, true, depth, radius_px):
    rim_y, rim_x = np.nonzero(true & ~cv2.erode(true.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool))
    if len(rim_x) == 0:
        return drawn
    start = int(rng.integers(len(rim_x)))
    y, x = rim_y[start], rim_x[start]
    rows, columns = np.ogrid[: drawn.shape[0], : drawn.shape[1]]
    near = np.hypot(rows - y, columns - x) < radius_px * (1.0 + 0.3 * smooth_field(rng, drawn.shape, cells=5))
    return drawn | (near & (depth > 0.0) & (np.abs(depth - depth[y, x]) < 0.25))


def plain_phantom_mask(rng, depth_m):
    height_px, width_px = depth_m.shape
    y, x = int(rng.integers(height_px)), int(rng.integers(width_px))
    radii_px = 0.5 * width_px * rng.uniform(0.05, 0.35, 2)
    rows, columns = np.ogrid[:height_px, :width_px]
    distance = np.hypot((rows - y) / radii_px[0], (columns - x) / radii_px[1])
    blob = distance < 1.0 + 0.25 * smooth_field(rng, depth_m.shape, cells=6)
    return blob & (depth_m > 0.0) & (np.abs(depth_m - depth_m[y, x]) < 0.4)


@given(SEEDS, st.floats(0.0, 1.0))
def test_a_corrupted_mask_is_that_of_the_definition(seed, error):
    scene = np.random.default_rng(seed)
    mask, depth_m = random_mask(scene)
    assume(mask.any())
    one, other = (np.random.default_rng([seed, 1]) for _ in range(2))
    drawn = corrupt_mask(one, mask, depth_m, error)
    np.testing.assert_array_equal(drawn, plain_corrupt_mask(other, mask, depth_m, error))
    # And it has drawn as many random numbers.
    assert one.random() == other.random()


@given(SEEDS)
def test_a_phantom_is_that_of_the_definition(seed):
    _, depth_m = random_mask(np.random.default_rng(seed))
    one, other = (np.random.default_rng([seed, 1]) for _ in range(2))
    np.testing.assert_array_equal(phantom_mask(one, depth_m), plain_phantom_mask(other, depth_m))
    assert one.random() == other.random()
