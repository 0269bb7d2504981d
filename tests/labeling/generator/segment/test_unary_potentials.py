"""How far an object reaches, by its own size and by colour beyond the picture's border, and what votes weigh."""

from dataclasses import replace

import numpy as np

from labeling.core.types import Detection
from labeling.core.views import RgbdViews
from labeling.generator.cloud.voxel_cloud import build_cloud
from labeling.generator.objects.association import Candidate
from labeling.generator.objects.seeds import detection_seeds
from labeling.generator.propagate import propagate
from labeling.generator.segment.unary_potentials import UNREACHABLE_LOG_ODDS, object_log_odds
from labeling.generator.settings.label_config import LabelConfig

HEIGHT_PX, WIDTH_PX = 60, 80
SHIFT_M = 0.8


def wall(shift_px: int = 32) -> RgbdViews:
    """A wall 2 m away seen by two cameras side by side; a red poster on it goes on beyond the first picture."""
    intrinsics = np.array([[80.0, 0, 39.5], [0, 80.0, 29.5], [0, 0, 1]])
    poses = np.repeat(np.eye(4)[None], 2, axis=0)
    poses[1, 0, 3] = SHIFT_M
    rgb = np.full((2, HEIGHT_PX, WIDTH_PX, 3), (90, 120, 90), np.uint8)
    rgb[0, 15:45, 60:] = rgb[1, 15:45, 60 - shift_px : 90 - shift_px] = (200, 40, 40)
    rgb = np.clip(rgb + np.random.default_rng(0).normal(0, 4, rgb.shape), 0, 255).astype(np.uint8)
    return RgbdViews(rgb, np.full((2, HEIGHT_PX, WIDTH_PX), 2.0, np.float32), np.repeat(intrinsics[None], 2, 0), poses)


def box(top: int, bottom: int, left: int, right: int) -> np.ndarray:
    mask = np.zeros((HEIGHT_PX, WIDTH_PX), bool)
    mask[top:bottom, left:right] = True
    return mask


def reach_of(mask: np.ndarray, also: tuple[np.ndarray, ...] = ()) -> np.ndarray:
    """Points that the object of a mask can reach, beside objects of other masks."""
    cloud = build_cloud(wall(), 0.05)
    seeds = [detection_seeds(cloud, Detection(0, "thing", 1.0, one, True), LabelConfig()) for one in (mask, *also)]
    candidates = [Candidate.of(one, cloud.num_points) for one in seeds]
    return object_log_odds(cloud, candidates, LabelConfig())[:, 0] > UNREACHABLE_LOG_ODDS


def test_reach_follows_the_objects_own_size_whatever_else_there_is() -> None:
    small, large = box(20, 26, 30, 36), box(5, 55, 10, 60)
    alone = reach_of(small)
    np.testing.assert_array_equal(alone, reach_of(small, (large,)))
    assert np.count_nonzero(alone) < 0.1 * np.count_nonzero(reach_of(large))


def test_what_the_picture_cuts_off_goes_on_in_other_views_as_far_as_its_colour() -> None:
    outline = Detection(0, "poster", 1.0, box(15, 45, 60, 80), exact=True)
    true = box(15, 45, 28, 58)
    found = {
        share: next(one.modal for one in labels.labels if one.view_index == 1)
        for share in (0.0, 0.5)
        for labels in [propagate(wall(), [outline], replace(LabelConfig(), colour_beyond=share))]
    }
    assert np.count_nonzero(found[0.5] & true) > 0.95 * np.count_nonzero(true)
    assert np.count_nonzero(found[0.5] & ~true) < 0.1 * np.count_nonzero(true)
    assert np.count_nonzero(found[0.0] & true) < np.count_nonzero(found[0.5] & true)


def test_votes_of_unsure_detections_weigh_by_min_vote_and_sure_ones_by_their_confidence() -> None:
    cloud = build_cloud(wall(), 0.05)

    def gap(confidence: float, min_vote: float) -> float:
        """How much more likely the object is where its mask is than beside it; the classifier's share is the same."""
        config = replace(LabelConfig(), min_vote=min_vote, crop=1.0)
        seeds = detection_seeds(cloud, Detection(0, "thing", confidence, box(20, 40, 20, 40)), config)
        odds = object_log_odds(cloud, [Candidate.of(seeds, cloud.num_points)], config)[:, 0]
        beside = seeds.background[odds[seeds.background] > UNREACHABLE_LOG_ODDS]
        return float(odds[seeds.foreground].mean() - odds[beside].mean())

    unsure = [gap(0.2, min_vote) for min_vote in (0.5, 0.75, 0.9)]
    # A vote of weight .2 counts the square root of that, for and against.
    expected = 2 * np.sqrt(0.2) * np.log([1, 3, 9])
    np.testing.assert_allclose(np.array(unsure) - unsure[0], expected, rtol=1e-4)
    assert gap(0.95, 0.5) == gap(0.95, 0.99) > gap(0.85, 0.5)
