from dataclasses import replace

import numba
import numpy as np
import pytest

from labeling.core.episode import Episode
from labeling.core.masks import mask_iou
from labeling.core.types import Detection
from labeling.generator.propagate import EpisodeLabels, propagate
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.episodes import read_episode

from ..synthetic_room import make_episode


@pytest.fixture(scope="module")
def room() -> Episode:
    return make_episode(3, num_views=8, size=(90, 120), num_objects=4, confident_share=0.5)


def label(episode: Episode, config: LabelConfig | None = None, **changes) -> EpisodeLabels:
    episode = replace(episode, **changes)
    assert episode.detections is not None
    return propagate(episode, episode.detections, config)


def mean_iou(episode: Episode, labels, kind: str = "modal") -> float:
    best = [
        max(
            (
                mask_iou(getattr(one, kind) if hasattr(one, kind) else one.mask, getattr(truth, kind))
                for one in labels
                if one.view_index == truth.view_index and one.category == truth.category
            ),
            default=0.0,
        )
        for truth in episode.ground_truth or ()
    ]
    return float(np.mean(best))


def true_sources(episode: Episode, share: int = 3) -> tuple[Detection, ...]:
    """One perfect detection of every object in every third view it is seen in."""
    seen: dict[int, int] = {}
    found = []
    for truth in episode.ground_truth or ():
        seen[truth.instance_id] = seen.get(truth.instance_id, -1) + 1
        if seen[truth.instance_id] % share == 0:
            found.append(Detection(truth.view_index, truth.category, 0.95, truth.modal))
    return tuple(found)


def test_labels_beat_the_detector_by_far(room: Episode) -> None:
    labels = label(room).labels
    assert mean_iou(room, labels) > 0.85
    assert mean_iou(room, labels) > mean_iou(room, room.detections) + 0.25


def test_amodal_masks_hold_the_modal_ones_and_what_is_hidden(room: Episode) -> None:
    labels = label(room).labels
    assert all(not np.any(one.modal & ~one.amodal) for one in labels)
    assert mean_iou(room, labels, "amodal") > 0.75


def test_amodal_masks_reach_only_behind_what_is_nearer(room: Episode) -> None:
    holes = room.depth_m.copy()
    holes[:, 20:30, 40:60] = 0
    for depth_m in (room.depth_m, holes):
        found = label(room, depth_m=depth_m)
        assert found.scale is not None
        spacing_m = 2.0 * found.scale.pixel_m
        for one in found.labels:
            own = found.cloud.points[found.cloud.instance_id == one.instance_id]
            towards = room.camera(one.view_index).world_to_camera[2]
            farthest_m = (own @ towards[:3] + towards[3]).max()
            assert np.all(depth_m[one.view_index][one.amodal & ~one.modal] < farthest_m + spacing_m)
        beyond = [
            np.count_nonzero(one.amodal & ~truth.modal) / np.count_nonzero(truth.modal)
            for truth in room.ground_truth or ()
            for one in found.labels
            if truth.amodal is not None
            and np.array_equal(truth.modal, truth.amodal)
            and (one.view_index, one.category) == (truth.view_index, truth.category)
            and mask_iou(one.modal, truth.modal) > 0.5
        ]
        assert beyond
        assert np.mean(beyond) < 0.05  # nothing hides these


def test_modal_masks_of_a_view_do_not_overlap(room: Episode) -> None:
    labels = label(room).labels
    for view in range(room.num_views):
        masks = [one.modal for one in labels if one.view_index == view]
        if masks:
            assert np.sum(masks, axis=0).max() <= 1


def test_every_object_is_found_once(room: Episode) -> None:
    objects = label(room).objects
    truth = {t.instance_id: t.category for t in room.ground_truth or () if t.instance_id}
    assert sorted(one.category for one in objects) == sorted(truth.values())
    assert [one.instance_id for one in objects] == list(range(1, len(objects) + 1))


def test_confidences_are_honest_probabilities(room: Episode) -> None:
    found = label(room)
    confidence = np.array([one.confidence for one in found.labels])
    assert np.all((confidence > 0) & (confidence <= 1))
    # They are of labels, not of objects: of six objects, not every one is worth the same in all views.
    crowded = label(make_episode(3, num_views=8, size=(90, 120), num_objects=6, confident_share=0.5))
    assert len(np.unique([round(one.confidence, 4) for one in crowded.labels])) > len(crowded.objects)
    # What they promise is kept.
    truths = {(one.view_index, one.category): one.modal for one in room.ground_truth or ()}
    assert len(truths) == len(room.ground_truth or ()), "one object of each category"
    nothing = np.zeros(room.size, bool)
    iou = [mask_iou(one.modal, truths.get((one.view_index, one.category), nothing)) for one in found.labels]
    assert np.mean(confidence) == pytest.approx(np.mean(iou), abs=0.1)


def test_duplicates_of_a_detection_change_identity_nowhere(room: Episode) -> None:
    doubled = tuple(d for d in room.detections or () for _ in range(2))
    assert len(label(room, detections=doubled).objects) == len(label(room).objects)


def test_a_confusion_is_outvoted(room: Episode) -> None:
    truths = [t for t in room.ground_truth or () if t.modal.sum() > 100]
    target = max({t.instance_id for t in truths}, key=lambda i: sum(t.instance_id == i for t in truths))
    views = [t for t in truths if t.instance_id == target][:3]
    names = ["submarine", views[0].category, views[0].category]
    sources = tuple(Detection(t.view_index, n, 0.95, t.modal) for t, n in zip(views, names, strict=True))
    objects = label(room, LabelConfig(calibrate=False, class_sizes=False), detections=sources).objects
    assert [one.category for one in objects] == [views[0].category]
    assert len(objects[0].sources) == 3
    assert objects[0].confidence < 0.7


def test_many_weak_votes_correct_a_confident_wrong_name(room: Episode) -> None:
    truths = [t for t in room.ground_truth or () if t.modal.sum() > 100]
    target = max({t.instance_id for t in truths}, key=lambda i: sum(t.instance_id == i for t in truths))
    views = [t for t in truths if t.instance_id == target]
    wrong = Detection(views[0].view_index, "submarine", 0.95, views[0].modal)
    weak = tuple(Detection(t.view_index, t.category, 0.6, t.modal) for t in views[1:])
    assert label(room, detections=(wrong, *weak)).objects[0].category == views[0].category
    plain = LabelConfig(weak_evidence=False, min_posterior=1)
    assert label(room, plain, detections=(wrong, *weak)).objects[0].category == "submarine"


def test_settings_scale_with_the_scene(room: Episode) -> None:
    """A doll's house: everything twenty times smaller gives the same masks."""
    poses = room.camera_to_world.copy()
    poses[:, :3, 3] /= 20
    small = label(room, depth_m=(room.depth_m / 20).astype(np.float32), camera_to_world=poses)
    full = label(room)
    assert small.scale is not None
    assert full.scale is not None
    assert small.scale.object_m == pytest.approx(full.scale.object_m / 20, rel=1e-5)
    assert mean_iou(room, small.labels) == pytest.approx(mean_iou(room, full.labels), abs=0.05)


def test_holes_in_depth_are_filled(room: Episode) -> None:
    rng = np.random.default_rng(0)
    depth = np.where(rng.random(room.depth_m.shape) < 0.5, room.depth_m, 0).astype(np.float32)
    depth[::2, 30:50, 40:60] = 0
    assert mean_iou(room, label(room, depth_m=depth).labels) > 0.75


def test_results_are_the_same_bit_for_bit_on_any_number_of_threads(room: Episode) -> None:
    before, results = numba.get_num_threads(), []
    try:
        for threads in (1, before):
            numba.set_num_threads(threads)
            results.append(label(room))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(results[0].cloud.probability, results[1].cloud.probability)
    for a, b in zip(results[0].labels, results[1].labels, strict=True):
        assert a.confidence == b.confidence
        assert np.array_equal(a.modal, b.modal)
        assert np.array_equal(a.amodal, b.amodal)


def test_labels_do_not_depend_on_whether_memory_is_given_back_in_between(room: Episode, monkeypatch) -> None:
    kept = label(room)
    monkeypatch.setattr("labeling.generator.propagate.MANY_PX", 0)
    trimmed = label(room)
    assert kept.objects
    assert [one.sources for one in kept.objects] == [one.sources for one in trimmed.objects]
    for ours, theirs in zip((*kept.labels, *kept.ignored), (*trimmed.labels, *trimmed.ignored), strict=True):
        assert ours.confidence == theirs.confidence
    for ours, theirs in zip(kept.labels, trimmed.labels, strict=True):
        assert np.array_equal(ours.modal, theirs.modal)
        assert np.array_equal(ours.amodal, theirs.amodal)


def test_without_a_confident_detection_there_are_no_labels_if_the_unsure_are_left_out(room: Episode) -> None:
    labels = label(room, LabelConfig(confident=0.999, min_posterior=1))
    assert labels.objects == ()
    assert labels.labels == ()
    assert len(labels.cloud.confidence) == len(labels.cloud.points) == 0


def test_views_that_agree_make_up_for_confidence(room: Episode) -> None:
    unsure = tuple(replace(d, confidence=0.7) for d in true_sources(room, share=2))
    several = {d.category for d in unsure if sum(other.category == d.category for other in unsure) > 1}
    assert several <= {one.category for one in label(room, detections=unsure).objects}
    assert label(room, LabelConfig(min_posterior=1), detections=unsure).objects == ()


def test_detections_on_pixels_without_depth_are_passed_over(room: Episode) -> None:
    blind = np.zeros_like(room.depth_m)
    assert label(room, depth_m=blind).labels == ()
    source = next(d for d in room.detections or () if d.confidence >= 0.9)
    depth = room.depth_m.copy()
    depth[source.view_index] = 0
    lone = label(room, depth_m=depth, detections=(source,))
    assert lone.objects == ()


def test_a_sure_detection_without_depth_takes_nothing_from_the_others(room: Episode) -> None:
    unsure = tuple(replace(one, confidence=0.7) for one in true_sources(room, share=2))
    window = np.zeros(room.size, bool)
    window[2:14, 2:14] = True
    depth_m = room.depth_m.copy()
    depth_m[0][window] = 0
    alone = label(room, depth_m=depth_m, detections=unsure)
    beside = label(room, depth_m=depth_m, detections=(*unsure, Detection(0, "tv", 0.95, window)))
    assert alone.objects
    assert [one.category for one in beside.objects] == [one.category for one in alone.objects]


def test_detections_beyond_range_are_passed_over(room: Episode) -> None:
    assert label(room, LabelConfig(max_range_m=0.2)).labels == ()


def test_a_single_view_is_enough(room: Episode) -> None:
    view = max(range(room.num_views), key=lambda v: sum(t.view_index == v for t in room.ground_truth or ()))
    truths = tuple(replace(t, view_index=0) for t in room.ground_truth or () if t.view_index == view)
    one = replace(
        room,
        rgb=room.rgb[[view]],
        depth_m=room.depth_m[[view]],
        intrinsics=room.intrinsics[[view]],
        camera_to_world=room.camera_to_world[[view]],
        ground_truth=truths,
        detections=tuple(Detection(0, t.category, 0.95, t.modal) for t in truths),
    )
    assert mean_iou(one, label(one).labels) > 0.8


def test_one_true_view_in_three_labels_the_others(room: Episode) -> None:
    labels = label(room, detections=true_sources(room)).labels
    assert mean_iou(room, labels) > 0.85


def test_masks_that_fill_the_picture_do_no_harm(room: Episode) -> None:
    full = Detection(0, "chair", 0.95, np.ones(room.size, bool))
    assert isinstance(label(room, detections=(full,)), EpisodeLabels)
    both = label(room, detections=(*(room.detections or ()), full))
    assert len(both.objects) >= 1


def test_boxes_hold_their_objects(room: Episode) -> None:
    labels = label(room)
    for one in labels.objects:
        assert one.box_3d is not None
        own = labels.cloud.points[labels.cloud.instance_id == one.instance_id]
        local = (own - one.box_3d.centre_m) @ one.box_3d.rotation
        assert np.mean(np.all(np.abs(local) <= 0.5 * one.box_3d.extent_m + 1e-6, axis=1)) > 0.9


@pytest.mark.parametrize("exclusive", [True, False])
@pytest.mark.parametrize("weak_evidence", [True, False])
def test_every_mode_labels_the_room(room: Episode, exclusive: bool, weak_evidence: bool) -> None:
    config = LabelConfig(exclusive=exclusive, weak_evidence=weak_evidence)
    assert mean_iou(room, label(room, config).labels) > 0.8


def test_arrays_that_do_not_belong_together_are_refused(room: Episode) -> None:
    with pytest.raises(ValueError, match="depth_m"):
        label(room, depth_m=room.depth_m[:, :-1])
    with pytest.raises(ValueError, match="poses"):
        label(room, camera_to_world=room.camera_to_world[:-1])
    with pytest.raises(ValueError, match="view 99"):
        label(room, detections=(Detection(99, "chair", 0.9, np.ones(room.size, bool)),))
    with pytest.raises(ValueError, match="does not belong"):
        label(room, detections=(Detection(0, "chair", 0.9, np.ones((3, 3), bool)),))


def test_arrays_of_other_kinds_are_refused(room: Episode) -> None:
    """Colours of 0 to 1, millimetres, probabilities for masks and lost poses would give labels that look like some."""
    with pytest.raises(TypeError, match="uint8"):
        label(room, rgb=room.rgb / np.float32(255))
    with pytest.raises(TypeError, match="in metres, not uint8 and uint16"):
        label(room, depth_m=(1000 * room.depth_m).astype(np.uint16))
    lost = room.camera_to_world.copy()
    lost[2] = np.nan
    with pytest.raises(ValueError, match="camera_to_world of view 2 must be finite"):
        label(room, camera_to_world=lost)
    soft = Detection(0, "chair", 0.9, np.ones(room.size, bool))
    object.__setattr__(soft, "mask", np.ones(room.size, np.float32))  # in tests the constructor refuses it itself
    with pytest.raises(TypeError, match="must be bool, not float32"):
        label(room, detections=(soft,))
    for confidence in (95.0, -0.1, float("nan")):
        with pytest.raises(ValueError, match=r"in \[0, 1\]"):
            label(room, detections=(Detection(0, "chair", confidence, np.ones(room.size, bool)),))


@pytest.mark.slow
def test_a_real_capture_is_labelled_better_than_its_network_saw_it(apc_shelf) -> None:
    episode = read_episode(apc_shelf)
    labels = label(episode, LabelConfig(confident=0.6))
    assert mean_iou(episode, labels.labels) > 0.5
    ranked = sorted(labels.objects, key=lambda one: -one.confidence)
    right, unsure = ranked[:4], ranked[4:]
    assert {one.category for one in right} == {truth.category for truth in episode.ground_truth or ()}
    assert all(one.confidence < 0.5 * right[-1].confidence for one in unsure), "phantoms never pass for objects"
    assert len(label(episode, LabelConfig(confident=0.6, min_posterior=1)).objects) == 4
