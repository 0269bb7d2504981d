from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csgraph, csr_array

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.types import Detection
from labeling.core.views import RgbdViews
from labeling.generator.cloud.connected_components import label_cells
from labeling.generator.propagate import propagate
from labeling.generator.segment.thin_parts import ThinParts, _covariances, _is_thin
from labeling.generator.settings.label_config import LabelConfig

from ...synthetic_room import Part, render

SIZE, NUM_VIEWS = (120, 160), 8
TABLE, CHAIR = 1, 2


def block(low, high, colour, instance: int) -> Part:
    low, high = np.array(low), np.array(high)
    return Part(tuple(0.5 * (low + high)), tuple(0.5 * (high - low)), colour, instance=instance)


def table(x: float, y: float, height: float = 0.72, leg: float = 0.03, instance: int = TABLE) -> list[Part]:
    """A top of 1.0 x 0.7 m, and legs."""
    colour, dark = (0.75, 0.6, 0.4), (0.3, 0.22, 0.15)
    legs = [
        block((x + a - leg / 2, y + b - leg / 2, 0), (x + a + leg / 2, y + b + leg / 2, height), dark, instance)
        for a in (-0.45, 0.45)
        for b in (-0.3, 0.3)
    ]
    return [block((x - 0.5, y - 0.35, height), (x + 0.5, y + 0.35, height + 0.04), colour, instance), *legs]


def chair(x: float, y: float, instance: int = CHAIR) -> list[Part]:
    """A seat with a back on its far side from the origin, and legs."""
    colour, dark = (0.2, 0.35, 0.7), (0.25, 0.25, 0.25)
    legs = [
        block((x + a - 0.0175, y + b - 0.0175, 0), (x + a + 0.0175, y + b + 0.0175, 0.43), dark, instance)
        for a in (-0.18, 0.18)
        for b in (-0.18, 0.18)
    ]
    seat = block((x - 0.2, y - 0.2, 0.43), (x + 0.2, y + 0.2, 0.47), colour, instance)
    return [seat, block((x - 0.2, y + 0.16, 0.47), (x + 0.2, y + 0.2, 0.9), colour, instance), *legs]


def scene(parts: list[Part], noise_m: float = 0.0):
    """Views around some things, and where each shows them; and their tops alone: what a detector finds of them."""
    rng = np.random.default_rng(0)
    intrinsics = intrinsics_from_fov(SIZE[1], SIZE[0], np.deg2rad(70))
    tops = [replace(one, instance=0) if one.half[0] < 0.02 else one for one in parts]
    rgb, depth, poses, instances, seen = [], [], [], [], []
    for view in range(NUM_VIEWS):
        angle = 2 * np.pi * view / NUM_VIEWS
        pose = look_at(np.array([1.9 * np.cos(angle), 1.9 * np.sin(angle), 1.4]), np.array([0, 0, 0.35]))
        colour, depth_m, instance = render(parts, pose, intrinsics, *SIZE)
        rgb.append(colour)
        depth.append(depth_m + rng.normal(0, noise_m, SIZE).astype(np.float32))
        poses.append(pose)
        instances.append(instance)
        seen.append(render(tops, pose, intrinsics, *SIZE)[2])
    views = RgbdViews(np.stack(rgb), np.stack(depth), np.repeat(intrinsics[None], NUM_VIEWS, 0), np.stack(poses))
    return views, np.stack(instances), np.stack(seen)


def detections(seen, **names: int) -> list[Detection]:
    return [
        Detection(view, name, 0.95, mask == number)
        for view, mask in enumerate(seen)
        for name, number in names.items()
        if np.count_nonzero(mask == number) > 40
    ]


def labelled(labels, name: str):
    """What is labelled in every view."""
    masks = np.zeros((NUM_VIEWS, *SIZE), bool)
    for one in labels.labels:
        if one.category == name:
            masks[one.view_index] |= one.modal
    return masks


def found(masks, pixels) -> float:
    return np.count_nonzero(masks & pixels) / np.count_nonzero(pixels)


@pytest.fixture(scope="module")
def pair():
    """A table and a chair beside it, both detected without their legs."""
    views, truth, seen = scene([*table(-0.3, 0), *chair(0.62, 0.1)])
    return views, truth, seen, propagate(views, detections(seen, table=TABLE, chair=CHAIR))


def test_legs_that_no_detection_shows_are_labelled(pair) -> None:
    views, truth, seen, labels = pair
    without = propagate(views, detections(seen, table=TABLE, chair=CHAIR), LabelConfig(thin_parts=False))
    for name, number in (("table", TABLE), ("chair", CHAIR)):
        legs = (truth == number) & (seen != number)
        assert found(labelled(without, name), legs) < 0.25
        assert found(labelled(labels, name), legs) > 0.9


def test_the_ground_is_not(pair) -> None:
    _, truth, _, labels = pair
    for name, number in (("table", TABLE), ("chair", CHAIR)):
        masks = labelled(labels, name)
        assert np.count_nonzero(masks & (truth == 0)) < 0.03 * np.count_nonzero(masks)
        assert np.count_nonzero(masks & (truth == number)) > 0.95 * np.count_nonzero(truth == number)


def test_legs_belong_to_what_they_carry(pair) -> None:
    _, truth, _, labels = pair
    assert not np.any(labelled(labels, "table") & (truth == CHAIR))
    assert not np.any(labelled(labels, "chair") & (truth == TABLE))


def test_cloud_and_boxes_reach_down_to_the_ground(pair) -> None:
    *_, labels = pair
    for one in labels.objects:
        points = labels.cloud.points[labels.cloud.instance_id == one.instance_id]
        assert np.quantile(points[:, 2], 0.02) < 0.1
        assert one.box_3d.centre_m[2] - 0.5 * one.box_3d.extent_m[2] == pytest.approx(0, abs=0.04)
    assert np.all(labels.cloud.probability.sum(axis=1) < 1 + 1e-4)


@pytest.mark.parametrize("place", [(0.62, 0.1), (-0.3, 0.35)])
def test_what_stands_beside_or_half_under_an_object_is_none_of_it(place: tuple[float, float]) -> None:
    views, truth, seen = scene([*table(-0.3, 0), *chair(*place)])
    labels = propagate(views, detections(seen, table=TABLE))
    assert found(labelled(labels, "table"), truth == CHAIR) < 0.02
    assert found(labelled(labels, "table"), (truth == TABLE) & (seen != TABLE)) > 0.75


def test_a_box_under_a_table_is_no_leg_of_it() -> None:
    bin_ = block((-0.42, -0.12, 0), (-0.18, 0.12, 0.3), (0.5, 0.2, 0.2), 3)
    views, truth, seen = scene([*table(-0.3, 0), bin_])
    labels = propagate(views, detections(seen, table=TABLE))
    assert not np.any(labelled(labels, "table") & (truth == 3))


def test_what_lies_beside_an_outline_drawn_by_a_person_is_no_part() -> None:
    box = block((-0.25, -0.2, 0.5), (0.25, 0.2, 0.8), (0.2, 0.5, 0.7), 3)
    stand = block((-0.24, -0.19, 0), (0.24, 0.19, 0.5), (0.5, 0.45, 0.4), 4)
    views, truth, _ = scene([box, stand])
    stands = truth == 4
    detected = [Detection(v, "box", 0.95, one == 3) for v, one in enumerate(truth)]
    outlined = [replace(detected[view], confidence=1.0, exact=True) for view in (0, 4)]
    assert found(labelled(propagate(views, detected), "box"), stands) > 0.5
    labels = labelled(propagate(views, outlined), "box")
    assert found(labels, stands) < 0.05
    assert found(labels, truth == 3) > 0.9


def test_an_outline_with_legs_keeps_those_that_it_does_not_show() -> None:
    views, truth, _ = scene([*table(0, 0)])
    outlined = [Detection(0, "table", 1.0, truth[0] == TABLE, exact=True)]
    assert found(labelled(propagate(views, outlined), "table"), truth == TABLE) > 0.95


def swivel_chair() -> list[Part]:
    """A seat with a back; 16 cm below it, as if the stem were hidden there, a stem and a foot wider than the seat."""
    colour, dark = (0.2, 0.35, 0.7), (0.25, 0.25, 0.25)
    seat = block((-0.2, -0.2, 0.36), (0.2, 0.2, 0.44), colour, CHAIR)
    back = block((-0.2, 0.16, 0.44), (0.2, 0.2, 0.9), colour, CHAIR)
    stem = block((-0.018, -0.018, 0.0), (0.018, 0.018, 0.2), dark, CHAIR)
    bars = [
        block((-0.24, -0.015, 0), (0.24, 0.015, 0.03), dark, CHAIR),
        block((-0.015, -0.24, 0), (0.015, 0.24, 0.03), dark, CHAIR),
    ]
    return [seat, back, stem, *bars]


def test_feet_that_spread_around_a_hidden_stem_are_parts() -> None:
    views, truth, _ = scene(swivel_chair())
    seat = np.stack(
        [
            render(swivel_chair()[:2], pose, k, *SIZE)[2]
            for pose, k in zip(views.camera_to_world, views.intrinsics, strict=True)
        ]
    )
    feet = (truth == CHAIR) & (seat != CHAIR)
    masks = labelled(propagate(views, detections(np.where(feet, 0, truth), chair=CHAIR)), "chair")
    assert found(masks, feet) > 0.9
    assert np.count_nonzero(masks & (truth == 0)) < 0.03 * np.count_nonzero(masks)


def test_ground_in_masks_is_not_labelled() -> None:
    """Masks that show a table and the floor below it, as if its top were of glass."""
    views, truth, _ = scene([*table(0, 0)])
    reaching = detections(truth, table=TABLE)
    for one in reaching:
        rows, columns = np.nonzero(one.mask)
        one.mask[rows.min() : rows.max(), columns.min() : columns.max()] = True
    with_floor = labelled(propagate(views, reaching, LabelConfig(clear_ground=False)), "table")
    masks = labelled(propagate(views, reaching), "table")
    floor = np.count_nonzero(with_floor & (truth == 0))
    assert floor > 0.3 * np.count_nonzero(truth == TABLE)
    assert np.count_nonzero(masks & (truth == 0)) < 0.2 * floor
    assert found(masks, truth == TABLE) > 0.95


def test_a_rug_is_labelled_though_it_lies_in_the_ground() -> None:
    rug = block((-0.6, -0.4, 0), (0.6, 0.4, 0.004), (0.7, 0.1, 0.1), 3)
    views, truth, _ = scene([rug])
    masks = labelled(propagate(views, detections(truth, rug=3)), "rug")
    assert found(masks, truth == 3) > 0.9


def test_noise_loses_feet_but_swallows_no_ground() -> None:
    views, truth, seen = scene([*table(0, 0)], noise_m=0.01)
    masks = labelled(propagate(views, detections(seen, table=TABLE)), "table")
    assert found(masks, (truth == TABLE) & (seen != TABLE)) > 0.6
    assert np.count_nonzero(masks & (truth == 0)) < 0.05 * np.count_nonzero(masks)


def test_what_hangs_on_a_wall_has_no_parts() -> None:
    picture = block((-0.4, 1.6, 1.0), (0.4, 1.63, 1.5), (0.2, 0.6, 0.3), 1)
    wall = block((-2.5, 1.63, 0), (2.5, 1.7, 2.5), (0.8, 0.8, 0.75), 0)
    views, truth, _ = scene([picture, wall])
    shown = [Detection(v, "picture", 0.95, one == 1) for v, one in enumerate(truth) if np.count_nonzero(one == 1) > 40]
    on, off = (labelled(propagate(views, shown, LabelConfig(thin_parts=one)), "picture") for one in (True, False))
    np.testing.assert_array_equal(on, off)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_pieces_are_the_components_of_the_graph_of_neighbouring_cells(seed: int, count: int) -> None:
    cell = np.unique(np.random.default_rng(seed).integers(0, 7, (count, 3)), axis=0).astype(np.int32)
    piece, number = label_cells(cell)
    touching = np.abs(cell[:, None] - cell[None]).max(axis=2) <= 1
    total, expected = csgraph.connected_components(csr_array(touching), directed=False)
    assert number == total
    pairs = np.unique(np.stack([piece, expected]), axis=1)
    assert pairs.shape[1] == total == len(np.unique(pairs[0]))


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_covariances_are_those_of_balls(seed: int) -> None:
    cell = np.unique(np.random.default_rng(seed).integers(0, 8, (50, 3)), axis=0).astype(np.int32)
    for one, matrix in zip(cell, _covariances(cell, 3.5), strict=True):
        near = cell[np.linalg.norm(cell - one, axis=1) <= 3.5]
        np.testing.assert_allclose(matrix, np.cov(near.T, ddof=0), atol=1e-9)


def test_lines_are_thin_and_surfaces_are_not() -> None:
    line = np.argwhere(np.ones((1, 1, 20))).astype(np.int32)
    thick_line = np.argwhere(np.ones((2, 2, 20))).astype(np.int32)
    plane = np.argwhere(np.ones((12, 12, 1))).astype(np.int32)
    assert _is_thin(line)
    assert _is_thin(thick_line)
    assert not _is_thin(plane)


def test_parts_are_numbered_as_the_objects_that_are_left() -> None:
    parts = ThinParts(np.array([2, -1, 0, 1], np.int32), np.zeros(4, np.float32), np.zeros((1, 4)))
    np.testing.assert_array_equal(parts.of_objects(np.array([0, 2])).owner, [1, -1, 0, -1])
    np.testing.assert_array_equal(parts.of_objects(np.zeros(0, int)).owner, [-1, -1, -1, -1])
