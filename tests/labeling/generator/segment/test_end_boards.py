"""Boards at the ends of objects. Oracles: shapes made of points, and rendered beds whose pixels are known."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from labeling.core.types import Detection
from labeling.generator.cloud.ground import Ground
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.propagate import propagate
from labeling.generator.segment.end_boards import complete_end_boards
from labeling.generator.settings.label_config import LabelConfig

from .test_thin_parts import block, found, labelled, scene

VOXEL_M = 0.04
LONG, WIDE, HIGH = 48, 34, 12
"""Of a mattress, in voxels."""


def places(x, y, z) -> np.ndarray:
    """Points (n, 3) of a grid, in voxels."""
    return np.stack([one.ravel() for one in np.meshgrid(x, y, z, indexing="ij")], axis=1).astype(np.float64)


def mattress() -> np.ndarray:
    x, y, z = np.arange(LONG), np.arange(WIDE), np.arange(HIGH)
    top = places(x, y, [HIGH - 1])
    sides = [places(x, [0, WIDE - 1], z[:-1]), places([0, LONG - 1], y[1:-1], z[:-1])]
    return np.concatenate([top, *sides])


def board(out: float = 2, first: int = 0, last: int = WIDE, top: int = 18) -> np.ndarray:
    """An upright layer beyond the end of the mattress, from the ground up to ``top``."""
    return places([LONG - 1 + out], np.arange(first, last), np.arange(top))


WALL = board(out=4, first=-12, last=WIDE + 12, top=40)


def completed(
    own: np.ndarray, others: list[np.ndarray], turn: float = 0.0, owners: tuple[int, ...] = (), beside=None
) -> list[np.ndarray]:
    """What of each of ``others`` (which belong to no object, or to ``owners``) is added to the object ``own``."""
    owners = owners or (-1,) * len(others)
    owner = np.concatenate([np.zeros(len(own)), *(np.full(len(one), k) for k, one in zip(owners, others, strict=True))])
    cos, sin = np.cos(turn), np.sin(turn)
    turned = np.concatenate([own, *others]) @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]])
    points, count = ((turned + 0.5) * VOXEL_M).astype(np.float32), len(turned)
    cloud = Cloud(points, np.zeros_like(points), np.ones(count, np.int32), np.full((1, 1, 1), -1, np.int32), VOXEL_M)
    ground = Ground(np.zeros(count, np.float32), 0.005, np.full(count, 2, np.int32))
    added = complete_end_boards(cloud, owner.astype(np.int32), 2, ground, beside and {0: beside(len(own), count)})
    assert set(np.unique(added)) <= {-1, 0}
    assert np.all(owner[added >= 0] == -1)
    return np.split(added >= 0, np.cumsum([len(own), *map(len, others)]))[1:-1]


@settings(max_examples=25, deadline=None)
@given(st.floats(0, 2 * np.pi), st.floats(0.2, 3), st.integers(15, 18))
@example(0.0, 2.0, 18)
def test_a_head_before_a_wall_is_added_however_the_bed_stands(turn: float, out: float, top: int) -> None:
    head, wall = completed(mattress(), [board(out, top=top), WALL], turn)
    assert head.all()
    assert not wall.any()


@pytest.mark.parametrize(
    "layer",
    [
        pytest.param(WALL, id="a wall"),
        pytest.param(board(first=-12, last=WIDE + 12), id="a low wall"),
        pytest.param(board(top=40), id="a wall no wider than the bed"),
        pytest.param(board(first=0, last=WIDE // 2), id="something narrow"),
        pytest.param(board(top=2), id="a step"),
        pytest.param(board(out=9), id="what stands further off"),
        pytest.param(board()[::4], id="scattered points"),
    ],
)
def test_what_is_no_board_is_not_added(layer: np.ndarray) -> None:
    behind = board(out=5, first=-12, last=WIDE + 12, top=48)
    assert not np.any(np.concatenate(completed(mattress(), [layer, behind])))


def test_what_has_nothing_above_it_may_be_a_wall_of_which_no_more_was_seen() -> None:
    (layer,) = completed(mattress(), [board()])
    assert not layer.any()


def test_what_is_large_beside_the_object_is_something_else() -> None:
    own = mattress()
    few = own[own[:, 2] >= 6]
    head, _ = completed(few, [board(top=20), WALL])
    assert not head.any()


def test_points_of_others_stay_and_a_persons_outline_is_kept() -> None:
    whole = board()
    low, high = whole[whole[:, 2] < 9], whole[whole[:, 2] >= 9]
    for owner in (1, -2):
        lower, upper, _ = completed(mattress(), [low, high, WALL], owners=(owner, -1, -1))
        assert not lower.any()
        assert upper.all()
    outlined = completed(mattress(), [board(), WALL], beside=lambda own, count: (np.arange(count) >= own).astype("f4"))
    assert not np.any(np.concatenate(outlined))


BED = 1


def bed() -> list:
    """A mattress with a head of the same width."""
    return [
        block((-0.9, -0.5, 0), (0.9, 0.5, 0.45), (0.8, 0.75, 0.9), BED),
        block((0.9, -0.5, 0), (0.94, 0.5, 0.75), (0.45, 0.3, 0.2), BED),
    ]


def test_a_bed_that_detections_leave_the_head_of_is_labelled_whole() -> None:
    wall = block((1.0, -2.5, 0), (1.06, 2.5, 2.2), (0.8, 0.8, 0.75), 0)
    views, truth, _ = scene([*bed(), wall])
    _, shown, _ = scene([bed()[0], wall])
    masks = [(v, (shown[v] == BED) & (truth[v] == BED)) for v in range(len(truth))]
    detections = [Detection(v, "bed", 0.95, mask) for v, mask in masks if np.count_nonzero(mask) > 40]
    whole = labelled(propagate(views, detections), "bed")
    cut = labelled(propagate(views, detections, LabelConfig(end_boards=False)), "bed")
    assert found(whole, truth == BED) > found(cut, truth == BED) + 0.02
    assert found(whole, truth == BED) > 0.95
    assert np.count_nonzero(whole & (truth == 0)) < 0.03 * np.count_nonzero(whole)
