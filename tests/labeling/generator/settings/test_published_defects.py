from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.episode import Episode
from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.types import Detection, PseudoLabel
from labeling.generator.cloud.outliers import far_from_mean, segment_outliers
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.propagate import propagate
from labeling.generator.segment.active_points import ActivePoints
from labeling.generator.segment.crf import crf_kernels
from labeling.generator.segment.mean_field import Kernel
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.presets import PRESETS
from labeling.generator.settings.published_defects import (
    ConstantKernel,
    PublishedDefects,
    in_one_piece,
    paint_in_order,
    with_amodal_boxes,
    with_label_defects,
)
from labeling.io.label_records import EpisodeRecord, LabelRecord, MaskRecord

from ..segment.dense_mean_field import log_odds, mean_field

SIZE = (40, 60)
WALL_M, BALL_M, SCREEN_M = 4.0, 3.0, 1.5


def disc(row: float, column: float, radius: float) -> np.ndarray:
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    return (y - row) ** 2 + (x - column) ** 2 <= radius**2


def hidden_disc() -> Episode:
    """A red disc before a grey wall. View 0 sees all of it; in view 1, from the same place, a screen hides its left."""
    camera = intrinsics_from_fov(SIZE[1], SIZE[0], np.deg2rad(60))
    pose = look_at(np.zeros(3), np.array([1.0, 0, 0]))
    ball, screen = disc(20, 30, 9), np.zeros(SIZE, bool)
    screen[:, :31] = True
    depth = np.stack([np.where(ball, BALL_M, WALL_M)] * 2).astype(np.float32)
    rgb = np.where(ball[:, :, None], [200, 30, 30], [120, 120, 120]).astype(np.uint8)
    rgb = np.stack([rgb, np.where(screen[:, :, None], [30, 60, 200], rgb).astype(np.uint8)])
    depth[1][screen] = SCREEN_M
    return Episode(
        name="hidden",
        rgb=rgb,
        depth_m=depth,
        intrinsics=np.stack([camera] * 2),
        camera_to_world=np.stack([pose] * 2),
        file_names=("0", "1"),
        detections=(Detection(0, "ball", 0.95, ball),),
        ground_truth=None,
        categories=("ball",),
    )


def label(episode: Episode, config: LabelConfig) -> tuple[PseudoLabel, ...]:
    return propagate(episode, episode.detections, config).labels


def with_defects(config: LabelConfig, **defects: bool) -> LabelConfig:
    return replace(config, published=PublishedDefects(**defects))


def pseudo_label(mask: np.ndarray, category: str = "chair", view: int = 0, confidence: float = 0.7) -> PseudoLabel:
    return PseudoLabel(view, 1, category, confidence, mask, mask, 0, 0.95)


@pytest.fixture(params=["default", "paper"])
def plain(request: pytest.FixtureRequest) -> LabelConfig:
    return PRESETS[request.param]


def test_without_a_z_buffer_hidden_points_show_through(plain: LabelConfig) -> None:
    episode = hidden_disc()
    screen = np.zeros(SIZE, bool)
    screen[:, :31] = True
    hidden = disc(20, 30, 7) & screen
    (sound,) = [one.modal for one in label(episode, plain) if one.view_index == 1]
    (broken,) = [one.modal for one in label(episode, with_defects(plain, missing_z_buffer=True)) if one.view_index == 1]
    assert not sound[:, :29].any()
    assert np.mean(broken[hidden]) > 0.9


def test_the_last_object_written_wins() -> None:
    rng = np.random.default_rng(0)
    drawn = rng.random((4, 5, 6)) < 0.4
    shown = paint_in_order(drawn)
    for y, x in np.ndindex(5, 6):
        owners = np.flatnonzero(drawn[:, y, x])
        assert shown[y, x] == (owners[-1] if len(owners) else -1)


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.floats(0.5, 8.0))
def test_an_empty_kernel_is_a_prior_for_the_majority(seed: int, weight: float) -> None:
    """With all points equally near, the message to each is the weight times the majority's lead."""
    rng = np.random.default_rng(seed)
    chance = rng.random((50, 1)).astype(np.float32)
    unary = log_odds(chance)
    found = mean_field(unary, [Kernel(ConstantKernel(), weight)], iterations=1, exclusive=False)
    start = 1 / (1 + np.exp(-unary.astype(float)))
    expected = unary + weight * (2 * start.mean() - 1)
    assert log_odds(found, 1e-6) == pytest.approx(np.clip(expected, -13.8, 13.8), abs=2e-2)


def test_an_empty_kernel_does_not_care_where_points_are() -> None:
    rng = np.random.default_rng(1)
    points, colours = rng.random((60, 3)).astype(np.float32), rng.random((60, 3)).astype(np.float32)
    unary = log_odds(rng.random((60, 1)).astype(np.float32))
    counts, pixels = np.ones(60, np.int32), np.arange(60, dtype=np.int32).reshape(1, 6, 10)
    clouds = [Cloud(place, colours, counts, pixels, 0.1) for place in (points, points[::-1].copy())]
    near = ActivePoints.of(np.ones((60, 1), bool))

    def marginals(config: LabelConfig) -> list[np.ndarray]:
        return [near.marginals(unary, crf_kernels(cloud, near, 1.0, config), 5, False) for cloud in clouds]

    broken, sound = marginals(with_defects(LabelConfig(), empty_kernel=True)), marginals(LabelConfig())
    assert np.array_equal(broken[0], broken[1])
    assert not np.allclose(sound[0], sound[1], atol=1e-3)


def test_blocks_of_an_empty_kernel_do_not_know_of_each_other() -> None:
    values = np.arange(10, dtype=np.float32).reshape(5, 2)
    found = ConstantKernel(np.array([0, 2, 2, 5])).filter(values)
    assert found.tolist() == [[2, 4], [2, 4], [18, 21], [18, 21], [18, 21]]
    assert np.array_equal(ConstantKernel().filter(values), np.broadcast_to(values.sum(0), (5, 2)))


def test_outlier_removal_by_integers_takes_the_first_two_points() -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(0, 0.1, (100, 3)).astype(np.float32)
    points[50] = 9.0
    owner = np.zeros(100, np.int32)
    owner[10:20] = -1
    for rule in ("mean", "pieces"):
        config = LabelConfig(segment_outliers=rule)
        assert np.flatnonzero(segment_outliers(points, owner, 1, 0.05, config)).tolist().count(50) == 1
        broken = with_defects(config, first_two_outliers=True)
        assert np.flatnonzero(segment_outliers(points, owner, 1, 0.05, broken)).tolist() == [0, 1]


def test_outliers_are_told_axis_by_axis_in_deviations_from_the_mean() -> None:
    rng = np.random.default_rng(3)
    points = (rng.normal(0, 1, (2000, 3)) * [1, 10, 0.1]).astype(np.float32)
    score = np.abs((points - points.mean(0)) / points.std(0))
    assert np.array_equal(far_from_mean(points, 2.0), score.max(axis=1) > 2.0)
    assert not far_from_mean(points[:3], 0.1).any()


def test_full_confidence_writes_ones(plain: LabelConfig) -> None:
    episode = hidden_disc()
    assert all(one.confidence < 1 for one in label(episode, plain))
    labels = label(episode, with_defects(plain, full_confidence=True))
    assert labels
    assert {one.confidence for one in labels} == {one.source_confidence for one in labels} == {1.0}


def test_classes_drift_by_one_for_every_mask_that_is_skipped_before() -> None:
    masks = [disc(10, 10, 4), np.zeros(SIZE, bool), disc(10, 30, 4), np.zeros(SIZE, bool), disc(30, 30, 4)]
    masks[1][5, 5:9] = True  # one row: it has no outline
    names = ["chair", "couch", "plant", "tv", "bed"]
    labels = [pseudo_label(mask, name) for mask, name in zip(masks, names, strict=True)]
    other_view = pseudo_label(masks[0], "toilet", view=1)
    broken = with_label_defects([*labels, other_view], PublishedDefects(drifting_classes=True))
    assert [one.category for one in broken] == ["chair", "couch", "plant", "toilet"]
    kept = [masks[0], masks[2], masks[4], masks[0]]
    assert all(np.array_equal(one.modal, mask) for one, mask in zip(broken, kept, strict=True))
    assert with_label_defects([*labels, other_view], PublishedDefects()) == (*labels, other_view)


def test_masks_in_two_pieces_are_dropped() -> None:
    whole, broken = disc(20, 30, 8), disc(6, 6, 3) | disc(34, 54, 3)
    labels = [pseudo_label(whole), pseudo_label(broken)]
    (left,) = with_label_defects(labels, PublishedDefects(whole_masks_only=True))
    assert left is labels[0]


@pytest.mark.parametrize(
    ("mask", "whole"),
    [
        (disc(20, 30, 8), True),
        (disc(20, 25, 8) | disc(20, 35, 8), True),
        (disc(20, 21, 8) & ~disc(20, 21, 3), True),
        (disc(6, 6, 3) | disc(34, 54, 3), False),
        (np.eye(*SIZE, dtype=bool), False),
        (np.zeros(SIZE, bool), False),
    ],
    ids=["disc", "two that touch", "ring", "far corners", "line", "nothing"],
)
def test_one_piece_is_one_polygon(mask: np.ndarray, whole: bool) -> None:
    assert in_one_piece(mask) == whole


def test_small_gaps_of_a_sparse_mask_are_bridged() -> None:
    sparse = disc(20, 30, 15)
    sparse[::2] = False
    sparse[:, ::2] = False
    assert in_one_piece(sparse)


def test_amodal_boxes_stand_beside_modal_masks() -> None:
    modal, amodal = MaskRecord({}, (3, 3, 2, 2), 4), MaskRecord({}, (1, 1, 8, 8), 64)
    both, hidden, alone = (
        LabelRecord(view, 1, "chair", 0.9, *masks, source_view=0, source_score=0.9)
        for view, masks in enumerate([(modal, amodal), (None, amodal), (modal, None)])
    )
    record = EpisodeRecord(2, "", "room", "", (), 8, 8, (), (), (), (both, hidden, alone), ())
    changed = with_amodal_boxes(record)
    assert changed.labels[0] == replace(both, modal=MaskRecord({}, (1, 1, 8, 8), 4))
    assert changed.labels[1:] == record.labels[1:]
    assert record.labels[0].modal is modal


def test_released_has_every_defect_and_paper_none() -> None:
    flags = vars(PRESETS["released"].published)
    assert len(flags) == 7
    assert all(flags.values())
    assert replace(PRESETS["released"], published=PublishedDefects()) == PRESETS["paper"]
    assert not any(vars(PRESETS["paper"].published).values())
    assert not any(vars(PRESETS["default"].published).values())
    assert all(a is not b for a, b in pairwise(PRESETS.values()))
