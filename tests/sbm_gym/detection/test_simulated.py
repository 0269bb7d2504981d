"""The simulated detector: its statistics, and the laws that make it a fair stand-in for a network."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.masks import mask_iou
from labeling.core.rle import encode_mask
from labeling.metrics.mask_ap import MaskInstance, average_precision
from sbm_gym.detection.mask_kernels import median_depth
from sbm_gym.detection.mask_noise import corrupt_mask, phantom_mask
from sbm_gym.detection.simulated import SimulatedDetector, SimulatedDetectorConfig, SimulatedView
from sbm_gym.detection.visibility import ObservedObject
from sbm_gym.env.fixation_env import FixationEnv

from ..box_rooms import BoxRooms

EASY = ObservedObject(1, "chair", "model", "scene/1", 1.0, 0.0, 0.0, 0.2, 1.5)


@pytest.fixture(scope="module")
def views() -> list[tuple[SimulatedView, dict[int, str]]]:
    """Views of the box rooms at 84x84 from random places, looking about."""
    env = FixationEnv(BoxRooms(), split=None, gaze="free", num_views=10**6)
    found = []
    rng = np.random.default_rng(0)
    for scene in env.scene_names:
        env.reset(seed=0, options={"scene": scene})
        categories = {instance.instance_id: instance.category for instance in env.scene.world.objects}
        for _ in range(120):
            env.scene.body.place(
                env.knowledge.navigable.random_point(rng), rng.uniform(-np.pi, np.pi), rng.uniform(-0.5, 0.0)
            )
            view = env.simulation.draw(84, 84, antialias=False)
            observed = env.scene.surfaces.observe(view.instance_map, view.camera)
            seen = SimulatedView(len(found), view.instance_map, view.frame.depth_m, tuple(observed))
            found.append((seen, categories))
    return found


def detect_all(views, seed=0):
    detector = SimulatedDetector(SimulatedDetectorConfig(seed=seed))
    return [
        (detector.detect(np.random.default_rng([seed, view.view_index]), view), view, names) for view, names in views
    ]


def is_right(detection, view, names) -> bool:
    return any(
        names[instance] == detection.category and mask_iou(detection.mask, view.instance_map == instance) >= 0.5
        for instance in np.unique(view.instance_map)
        if instance
    )


@pytest.mark.slow
def test_confident_detections_are_mostly_right_and_others_less_so(views):
    confident, unsure = [], []
    for seed in range(4):
        for detections, view, names in detect_all(views, seed):
            for detection in detections:
                (confident if detection.confidence >= 0.9 else unsure).append(is_right(detection, view, names))
    assert len(confident) > 200
    assert np.mean(confident) >= 0.85
    assert np.mean(unsure) < 0.5


@pytest.mark.slow
def test_the_detector_as_a_whole_is_clearly_worse_than_perfect(views):
    figures = []
    for seed in range(4):
        predictions, truths = [], []
        for detections, view, names in detect_all(views, seed):
            for d in detections:
                predictions.append(MaskInstance(view.view_index, d.category, encode_mask(d.mask), d.confidence))
            for observed in view.objects:
                mask = view.instance_map == observed.instance_id
                if np.count_nonzero(mask) >= 8 and observed.visible_share >= 0.05:
                    name = names[observed.instance_id]
                    truths.append(MaskInstance(view.view_index, name, encode_mask(mask)))
        figures.append(average_precision(predictions, truths).mean[0.5])
    assert 0.2 < np.mean(figures) < 0.6


@pytest.mark.slow
def test_the_same_generator_gives_the_same_detections(views):
    assert [d for d, _, _ in detect_all(views[:40])] == [d for d, _, _ in detect_all(views[:40])]


@pytest.mark.slow
def test_confidences_do_not_depend_on_what_else_is_in_view(views):
    detector = SimulatedDetector(SimulatedDetectorConfig(phantoms_per_view=0.0))
    view = next(view for view, _ in views if len(view.objects) >= 2)
    both = detector.detect(np.random.default_rng(5), view)
    alone = detector.detect(np.random.default_rng(5), dataclasses.replace(view, objects=view.objects[:1]))
    assert all(detection in both for detection in alone)


@pytest.mark.parametrize(
    "harder",
    [
        {"visible_share": 0.4},
        {"truncated_share": 0.6},
        {"elevation_rad": 1.0},
    ],
)
def test_hidden_cut_off_and_seen_from_above_are_harder(harder):
    detector = SimulatedDetector()
    assert detector.logit(dataclasses.replace(EASY, **harder), 0.05) < detector.logit(EASY, 0.05) - 0.5


def test_small_is_harder_than_large_and_behind_is_harder_than_front():
    detector = SimulatedDetector(SimulatedDetectorConfig(viewpoint_sigma=0.0))
    assert detector.logit(EASY, 0.002) < detector.logit(EASY, 0.02) < detector.logit(EASY, 0.06)
    for category in ("chair", "couch", "tv", "fridge", "toilet", "bed"):
        front = dataclasses.replace(EASY, category=category)
        behind = dataclasses.replace(front, azimuth_rad=np.pi)
        assert detector.logit(behind, 0.05) < detector.logit(front, 0.05) - 1.0


@given(st.floats(-np.pi, np.pi), st.floats(0.8, 3.0))
def test_confidence_changes_smoothly_with_the_viewpoint(azimuth, range_m):
    detector = SimulatedDetector()
    here = dataclasses.replace(EASY, azimuth_rad=azimuth, range_m=range_m)
    near = dataclasses.replace(EASY, azimuth_rad=azimuth + 1e-3, range_m=range_m + 1e-3)
    assert abs(detector.logit(here, 0.05) - detector.logit(near, 0.05)) < 0.1


def test_viewpoint_noise_is_the_objects_own():
    detector = SimulatedDetector()
    other = dataclasses.replace(EASY, object_key="scene/2")
    logits = [[detector.logit(dataclasses.replace(o, azimuth_rad=a), 0.05) for a in (0, 1, 2)] for o in (EASY, other)]
    assert not np.allclose(np.diff(logits[0]), np.diff(logits[1]))


def test_an_unknown_category_is_never_named():
    detector = SimulatedDetector(SimulatedDetectorConfig(base_logit=8.0))
    strange = dataclasses.replace(EASY, category="shelf")
    instance_map = np.zeros((84, 84), np.int32)
    instance_map[20:60, 20:60] = 1
    view = SimulatedView(0, instance_map, np.full((84, 84), 2.0, np.float32), (strange,))
    names = {d.category for k in range(20) for d in detector.detect(np.random.default_rng(k), view)}
    assert names
    assert names <= set(detector.config.categories)


def test_a_detector_of_one_category_says_that_or_nothing():
    instance_map = np.zeros((84, 84), np.int32)
    instance_map[20:60, 20:60] = 1
    for category in ("chair", "shelf", "bed"):
        detector = SimulatedDetector(SimulatedDetectorConfig(base_logit=-1.0, categories=("chair",)))
        seen = dataclasses.replace(EASY, category=category)
        view = SimulatedView(0, instance_map, np.full((84, 84), 2.0, np.float32), (seen,))
        names = {d.category for k in range(60) for d in detector.detect(np.random.default_rng(k), view)}
        assert names <= {"chair"}
    with pytest.raises(ValueError, match="name at least one"):
        SimulatedDetectorConfig(categories=())


def square(size_px=100, half_px=25):
    mask = np.zeros((size_px, size_px), bool)
    mask[50 - half_px : 50 + half_px, 50 - half_px : 50 + half_px] = True
    depth = np.where(mask, 2.0, 4.0).astype(np.float32)
    return mask, depth


def test_masks_get_worse_with_error():
    mask, depth = square()
    means = []
    for error in (0.0, 0.4, 1.0):
        ious = [mask_iou(corrupt_mask(np.random.default_rng(k), mask, depth, error), mask) for k in range(60)]
        means.append(np.mean(ious))
    assert means[0] > 0.85
    assert means[0] > means[1] + 0.05 > means[2] + 0.1
    assert means[2] > 0.3


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.floats(0, 1), st.integers(1, 45))
def test_masks_stay_near_what_they_mask(seed, error, half_px):
    mask, depth = square(half_px=half_px)
    drawn = corrupt_mask(np.random.default_rng(seed), mask, depth, error)
    rows, columns = np.nonzero(drawn)
    margin = 2 + 0.4 * 2 * half_px + 1
    assert drawn.shape == mask.shape
    for values in (rows, columns):
        assert values.min(initial=50) >= 50 - half_px - margin
        assert values.max(initial=50) <= 50 + half_px + margin


def test_phantoms_lie_on_one_surface():
    depth = np.where(np.arange(80)[None, :] < 40, 1.0, 3.0) * np.ones((80, 1))
    for seed in range(40):
        mask = phantom_mask(np.random.default_rng(seed), depth.astype(np.float32))
        assert not (mask[:, :40].any() and mask[:, 40:].any())


@pytest.mark.parametrize("count", [1, 2, 3, 4, 101, 500])
def test_the_median_is_that_of_numpy_to_the_last_bit(count):
    values = np.random.default_rng(count).uniform(0.3, 30.0, count).astype(np.float32)
    mask = np.concatenate([np.ones(count, bool), np.zeros(7, bool)])[None]
    depth_m = np.concatenate([values, np.full(7, 99.0, np.float32)])[None]
    assert np.float32(median_depth(mask, depth_m)) == np.median(values)
