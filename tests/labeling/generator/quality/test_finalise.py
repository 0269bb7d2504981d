import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labeling.core.types import Detection, PseudoLabel
from labeling.evaluation.compare import evaluate_label_set
from labeling.generate import main
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.propagate import propagate
from labeling.generator.quality.ignore_regions import unconfirmed_regions
from labeling.generator.settings.label_config import LabelConfig
from labeling.inspection.checks import inspect_label_set
from labeling.io.episodes import write_episode
from labeling.io.label_set import read_label_set

from ...synthetic_room import make_episode


@pytest.fixture(scope="module")
def room():
    return make_episode(3, num_views=8, size=(90, 120), num_objects=4, confident_share=0.5)


def label(episode, config: LabelConfig | None = None, **changes):
    episode = replace(episode, **changes)
    return propagate(episode, episode.detections, config)


def phantom(room, view: int = 0, confidence: float = 0.97) -> Detection:
    """A blob on the wall that a detector is sure of, once."""
    free = np.ones(room.size, bool)
    for truth in room.ground_truth:
        if truth.view_index == view:
            free &= ~truth.modal
    blob = np.zeros(room.size, bool)
    blob[2:22, 2:32] = True
    return Detection(view, "fridge", confidence, blob & free)


def square(left: int, side: int = 10) -> np.ndarray:
    mask = np.zeros((40, 60), bool)
    mask[10 : 10 + side, left : left + side] = True
    return mask


def test_a_sure_detection_that_no_other_view_confirms_is_trusted_less_than_any_real_object(room) -> None:
    spoilt = (*room.detections, phantom(room))
    weighed = label(room, LabelConfig(min_confidence=0), detections=spoilt)
    ghosts = [one.instance_id for one in weighed.objects if len(one.sources) == 1 and one.category == "fridge"]
    assert len(ghosts) == 1

    visible = [one for one in weighed.labels if one.modal.any()]
    ghost = max(one.confidence for one in visible if one.instance_id == ghosts[0])
    real = float(np.median([one.confidence for one in visible if one.instance_id != ghosts[0]]))
    assert ghost < real - 0.1


def test_what_is_trusted_and_what_is_ignored_add_up(room) -> None:
    everything = label(room, LabelConfig(min_confidence=0))
    least = float(np.median([one.confidence for one in everything.labels]))
    strict = label(room, LabelConfig(min_confidence=least, ignore_unconfirmed=0.3))
    assert everything.ignored == ()
    assert all(one.confidence >= least for one in strict.labels)
    visible = [one for one in everything.labels if one.modal.any()]
    kept = {(one.view_index, one.instance_id) for one in strict.labels if one.modal.any()}
    gone = {(one.view_index, one.instance_id) for one in strict.ignored if one.instance_id is not None}
    assert kept | gone == {(one.view_index, one.instance_id) for one in visible}
    assert gone
    assert not kept & gone


def test_by_default_what_is_not_labelled_is_background(room) -> None:
    doubtful = (*room.detections, phantom(room, 1, 0.6))
    least = LabelConfig(min_confidence=0.9, min_posterior=1.0)
    asked = label(room, replace(least, ignore_unconfirmed=0.3), detections=doubtful)
    assert {one.instance_id is None for one in asked.ignored} == {True, False}
    default = label(room, least, detections=doubtful)
    assert default.ignored == ()
    assert len(default.labels) == len(asked.labels)
    assert all(np.array_equal(a.modal, b.modal) for a, b in zip(default.labels, asked.labels, strict=True))


def test_masks_are_the_same_with_and_without_calibration(room) -> None:
    with_model = label(room, LabelConfig(min_confidence=0)).labels
    without = label(room, LabelConfig(min_confidence=0, calibrate=False)).labels
    assert [one.confidence for one in with_model] != [one.confidence for one in without]
    assert all(np.array_equal(a.modal, b.modal) for a, b in zip(with_model, without, strict=True))


def test_masks_that_a_person_drew_are_not_doubted(room) -> None:
    seen: dict[int, Detection] = {}
    for truth in room.ground_truth:
        if truth.modal.sum() > 100:
            seen.setdefault(
                truth.instance_id, Detection(truth.view_index, truth.category, 1.0, truth.modal, exact=True)
            )
    labels = label(room, detections=tuple(seen.values())).labels
    assert min(one.confidence for one in labels) > 0.5


def rows_of_voxels(num_views: int) -> Cloud:
    """Every view shows the same points at the same pixels, one each."""
    numbers = np.arange(40 * 60, dtype=np.int32).reshape(40, 60)
    points = np.zeros((40 * 60, 3), np.float32)
    return Cloud(points, points, np.ones(40 * 60, np.int32), np.stack([numbers] * num_views), 0.1)


def test_detections_that_labels_explain_need_no_region() -> None:
    known = PseudoLabel(0, 1, "chair", 0.9, square(5), square(5), 0, 0.9)
    detections = [
        Detection(0, "chair", 0.5, square(6)),  # nearly the label
        Detection(0, "bed", 0.5, square(12)),  # mostly beside it
        Detection(1, "chair", 0.5, square(5)),  # in another view
        Detection(1, "chair", 0.2, square(30)),  # below the threshold
    ]
    no_points = replace(rows_of_voxels(2), voxel_of_pixel=np.full((2, 40, 60), -1, np.int32))
    config = LabelConfig(ignore_unconfirmed=0.3)
    regions = unconfirmed_regions(no_points, detections, [known], config)
    assert [(one.view_index, one.category) for one in regions] == [(0, "bed"), (1, "chair")]
    assert not np.any(regions[0].mask & known.modal)
    assert unconfirmed_regions(no_points, detections, [known], replace(config, min_mask_px=1000)) == []


def test_unexplained_detections_add_up_over_views_and_are_ignored_in_all_of_them() -> None:
    cloud = rows_of_voxels(4)
    detections = [
        Detection(0, "chair", 0.12, square(5)),
        Detection(1, "chair", 0.12, square(5)),
        Detection(2, "couch", 0.08, square(5)),
        Detection(2, "chair", 0.04, square(5)),  # below the least confidence
        Detection(0, "bed", 0.2, square(40)),  # alone
    ]
    config = LabelConfig(ignore_unconfirmed=0.3)
    regions = unconfirmed_regions(cloud, detections, [], config)
    assert [(one.view_index, one.category) for one in regions] == [(view, "chair") for view in range(4)]
    assert all(np.array_equal(one.mask, square(5)) for one in regions)
    assert all(one.confidence == pytest.approx(0.32) for one in regions)
    assert unconfirmed_regions(cloud, detections, [], replace(config, ignore_unconfirmed=0.33)) == []
    assert unconfirmed_regions(cloud, detections, [], replace(config, doubt_across_views=False)) == []


def test_one_view_counts_once_however_many_detections_it_has() -> None:
    twice = [Detection(0, name, 0.2, square(5)) for name in ("chair", "couch", "chair")]
    assert unconfirmed_regions(rows_of_voxels(2), twice, [], LabelConfig(ignore_unconfirmed=0.3)) == []


def test_regions_leave_out_what_is_labelled_and_are_connected() -> None:
    known = PseudoLabel(1, 1, "table", 0.9, square(8, 4), square(8, 4), 0, 0.9)
    wide = np.zeros((40, 60), bool)
    wide[10:14, 4:20] = True  # the label cuts it in two in the second view
    wide[30:36, 50:58] = True
    config = LabelConfig(ignore_unconfirmed=0.3, min_mask_px=10)
    regions = unconfirmed_regions(rows_of_voxels(2), [Detection(0, "couch", 0.4, wide)], [known], config)
    assert [one.view_index for one in regions] == [0, 0, 1, 1, 1]
    assert not any(np.any(one.mask & known.modal) for one in regions if one.view_index == 1)
    assert np.array_equal(np.any([one.mask for one in regions if one.view_index == 0], axis=0), wide)


@pytest.mark.slow
def test_ignored_regions_reach_the_files_and_count_neither_for_nor_against(room, tmp_path: Path) -> None:
    doubtful = (*room.detections, phantom(room, 1, 0.6))
    write_episode(tmp_path / "data" / "room", replace(room, detections=doubtful))
    figures = {}
    for name, flags in (("plain", ["--ignore-unconfirmed", "1"]), ("ignoring", ["--ignore-unconfirmed", "0.5"])):
        assert main([str(tmp_path / "data"), "--out", str(tmp_path / name), "--min-posterior", "1", *flags]) == 0
        assert inspect_label_set(tmp_path / name) == []
        figures[name] = evaluate_label_set(tmp_path / name).metrics["pseudo_labels"]
    assert figures["plain"] == figures["ignoring"]
    plain, ignoring = read_label_set(tmp_path / "plain"), read_label_set(tmp_path / "ignoring")
    assert [one.rle for one in plain.modal] == [one.rle for one in ignoring.modal]
    assert len(ignoring.ignored) > len(plain.ignored)
    records = json.loads((tmp_path / "ignoring" / "instances_modal.json").read_text())["annotations"]
    crowds = [one for one in records if one["iscrowd"] == 1]
    assert len(crowds) == len(ignoring.ignored)
    assert all(one["ignore"] == 1 for one in crowds)
    assert any("instance_id" not in one for one in crowds)


def test_inspection_finds_a_region_that_contradicts_itself(room, tmp_path: Path) -> None:
    write_episode(tmp_path / "data" / "room", replace(room, detections=(*room.detections, phantom(room, 1, 0.6))))
    flags = ["--min-posterior", "1", "--ignore-unconfirmed", "0.3"]
    assert main([str(tmp_path / "data"), "--out", str(tmp_path / "labels"), *flags]) == 0
    file = tmp_path / "labels" / "instances_modal.json"
    content = json.loads(file.read_text())
    region = next(one for one in content["annotations"] if one["iscrowd"] == 1)
    region.setdefault("instance_id", 1)
    region["iscrowd"] = 0
    file.write_text(json.dumps(content))
    problems = inspect_label_set(tmp_path / "labels")
    assert any("iscrowd is 0" in problem for problem in problems)
