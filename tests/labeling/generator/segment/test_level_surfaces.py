"""Level surfaces of objects. Oracles: shapes made of points, and rendered tables whose pixels are known."""

import numpy as np
import pytest

from labeling.core.types import Detection
from labeling.generator.cloud.ground import Ground
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.propagate import propagate
from labeling.generator.segment.level_surfaces import complete_level_surfaces
from labeling.generator.settings.label_config import LabelConfig

from .test_thin_parts import TABLE, block, found, labelled, scene, table

VOXEL_M = 0.04
WIDE, DEEP = 24, 15


def sheet(height_m: float, columns: int = WIDE, rows: int = DEEP, first: int = 0) -> np.ndarray:
    """Points in the middle of voxels, one for each column."""
    x, y = np.meshgrid(np.arange(first, first + columns), np.arange(rows), indexing="ij")
    flat = np.stack([x.ravel() + 0.5, y.ravel() + 0.5], axis=1) * VOXEL_M
    return np.concatenate([flat, np.full((len(flat), 1), height_m)], axis=1).astype(np.float32)


def completed(points: np.ndarray, owner: np.ndarray, num_objects: int = 1, beside=None) -> np.ndarray:
    count = len(points)
    cloud = Cloud(points, np.zeros_like(points), np.ones(count, np.int32), np.full((1, 1, 1), -1, np.int32), VOXEL_M)
    ground = Ground(np.zeros(count, np.float32), 0.005, np.ones(count, np.int32))
    return complete_level_surfaces(cloud, owner.astype(np.int32), num_objects, ground, beside)


@pytest.mark.parametrize("share", [0.5, 0.6, 0.9])
def test_what_is_missing_of_the_greater_part_is_added(share: float) -> None:
    points = sheet(0.74)
    owner = np.where(points[:, 0] < share * WIDE * VOXEL_M, 0, -1)
    np.testing.assert_array_equal(completed(points, owner), np.where(owner < 0, 0, -1))


def test_a_smaller_part_brings_nothing() -> None:
    points = sheet(0.74)
    owner = np.where(points[:, 0] < 0.4 * WIDE * VOXEL_M, 0, -1)
    assert np.all(completed(points, owner) == -1)


@pytest.mark.parametrize("other_m", [0.75, 0.7, 0.06])
def test_steps_end_a_surface_and_the_ground_is_none(other_m: float) -> None:
    points = np.concatenate([sheet(0.74), sheet(other_m, 8, first=WIDE)])
    owner = np.repeat([0, -1], [WIDE * DEEP, 8 * DEEP])
    assert np.all(completed(points, owner) == -1)
    low = sheet(0.06)
    assert np.all(completed(low, np.where(low[:, 0] < 0.6, 0, -1)) == -1)


def test_a_wall_ends_a_surface() -> None:
    """A wall is as high as the surface somewhere, too, and so is what goes on behind it."""
    wall = np.concatenate([sheet(0.74 + VOXEL_M * k, 1, first=WIDE) for k in range(-5, 20)])
    points = np.concatenate([sheet(0.74), wall, sheet(0.74, 10, first=WIDE + 1)])
    owner = np.repeat([0, -1, -1], [WIDE * DEEP, len(wall), 10 * DEEP])
    added = completed(points, owner)
    assert not np.any(added[-10 * DEEP :] >= 0)
    assert np.count_nonzero(added >= 0) <= DEEP


def test_points_of_others_stay_and_a_persons_outline_is_kept() -> None:
    points = sheet(0.74)
    place = np.floor(points[:, 0] / VOXEL_M)
    owner = np.select([place < 14, place < 18, place < 20], [0, -1, -2], 1)
    added = completed(points, owner, 2)
    np.testing.assert_array_equal(np.flatnonzero(added >= 0), np.flatnonzero(owner == -1))
    outlined = {0: np.where(place >= 16, 1, 0).astype(np.float32)}
    np.testing.assert_array_equal(completed(points, owner, 2, outlined) >= 0, (place >= 14) & (place < 16))


def test_a_table_that_detections_cut_short_at_the_wall_is_labelled_whole() -> None:
    """Detections show the front part of a top that touches a wall."""
    wall = block((-2.5, 0.35, 0), (2.5, 0.42, 2.0), (0.8, 0.8, 0.75), 0)
    tabletop = [*table(0, 0), wall]
    views, truth, _ = scene(tabletop)
    front = [block((-0.5, -0.35, 0.72), (0.5, 0.1, 0.76), (0.75, 0.6, 0.4), TABLE), wall]
    _, shown, _ = scene(front)
    sees = [v for v, one in enumerate(truth) if np.count_nonzero(one == TABLE) > 200]
    masks = [(v, (shown[v] == TABLE) & (truth[v] == TABLE)) for v in sees]
    detections = [Detection(v, "table", 0.95, mask) for v, mask in masks if np.count_nonzero(mask) > 40]
    whole = labelled(propagate(views, detections), "table")
    cut = labelled(propagate(views, detections, LabelConfig(level_surfaces=False)), "table")
    assert found(whole, truth == TABLE) > found(cut, truth == TABLE) + 0.05
    assert found(whole, truth == TABLE) > 0.85
    assert np.count_nonzero(whole & (truth == 0)) < 0.03 * np.count_nonzero(whole)
