from dataclasses import replace

import numpy as np
import pytest

from labeling.core.box_overlap import box_iou_3d
from labeling.detectors3d.ldls import Ldls, LdlsConfig, diffuse, neighbour_graph, segment, sparse_points

from .boxed_rooms import boxed_room, found_in, known_of


def two_blobs(gap_m: float):
    """Two clouds of points, one before the other in the picture's left half, and the same on the right."""
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 0.5, (400, 3))
    points[200:, 0] += gap_m
    pixels = np.stack([rng.integers(0, 40, 400), np.where(np.arange(400) < 200, 10, 30)], axis=1)
    return points, pixels


def test_the_solution_is_where_diffusion_comes_to_rest():
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 1, (150, 3))
    config = LdlsConfig(pixel_weight=0.05)
    graph = neighbour_graph(points, config)
    told = config.pixel_weight * rng.integers(0, 25, (150, 3)).astype(float)
    total = np.asarray(graph.sum(axis=1)).ravel() + told.sum(axis=1)
    labels = np.zeros((150, 3))
    for _ in range(20_000):  # one step after the other, as published
        labels = (graph @ labels + told) / total[:, None]
    np.testing.assert_allclose(diffuse(graph, told, total), labels, atol=1e-6)
    np.testing.assert_allclose(labels.sum(axis=1), 1.0, atol=1e-6)


def test_a_mask_that_spills_over_keeps_to_its_own_blob():
    points, pixels = two_blobs(gap_m=3.0)
    mask = np.zeros((1, 40, 40), bool)
    mask[0, :, :20] = True
    mask[0, :6, 20:] = True  # spills over a little of the other blob
    owner, share = segment(points, pixels, mask, LdlsConfig())
    assert np.all(owner[:200] == 0)
    assert np.all(owner[200:] == -1)
    assert np.all((share > 0.5) & (share <= 1.0 + 1e-9))


def test_only_the_largest_part_stays():
    points, pixels = two_blobs(gap_m=30.0)
    mask = np.ones((1, 40, 40), bool)
    points = np.concatenate([points, points[:30] + np.array([0, 60.0, 0])])
    pixels = np.concatenate([pixels, pixels[:30]])
    owner, _ = segment(points, pixels, mask, LdlsConfig())
    assert np.count_nonzero(owner == 0) == 200


def test_boxes_of_plain_boxes_that_are_seen_well():
    """A single view sees two sides and the top: LDLS' boxes are near the truth, and never much larger."""
    episode = boxed_room(3)
    told = [one for one in found_in(episode) if one.view_index < 2]
    found = Ldls(LdlsConfig(stride=1)).lift(episode, told)
    overlaps = [
        max(box_iou_3d(one.box, box) for true, box in known_of(episode) if true.view_index == one.view_index)
        for one in found
    ]
    assert len(found) == len(told)
    assert np.median(overlaps) > 0.4
    assert all(0 < one.confidence <= 0.9 for one in found)


def test_objects_without_depth_get_no_box():
    episode = boxed_room(3)
    dark = replace(episode, depth_m=np.zeros_like(episode.depth_m))
    assert Ldls().lift(dark, found_in(episode)) == []
    assert Ldls().lift(episode, []) == []


@pytest.mark.parametrize("stride", [1, 2, 3])
def test_points_are_those_of_their_pixels(stride):
    episode = boxed_room(3)
    pose, intrinsics = episode.camera_to_world[0], episode.intrinsics[0]
    points, pixels = sparse_points(episode.depth_m[0], intrinsics, pose, stride)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    projected = local @ intrinsics.T
    np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], pixels[:, ::-1], atol=1e-6)
    assert len(points) == pytest.approx(96 * 128 / stride**2, rel=0.1)
