"""Weak supervision: one true view per object, whole and certain, under any name."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from labeling.core.episode import Episode
from labeling.core.masks import mask_iou
from labeling.core.rle import encode_mask
from labeling.core.types import Detection, GroundTruth
from labeling.generate import main
from labeling.generator.cloud.voxel_cloud import build_cloud
from labeling.generator.objects.seeds import detection_seeds
from labeling.generator.objects.weak_supervision import one_view_per_object
from labeling.generator.propagate import propagate
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.episodes import read_episode, write_episode
from labeling.metrics.mask_ap import average_precision
from labeling.metrics.matching import MaskInstance

from ...synthetic_room import make_episode


@pytest.fixture(scope="module")
def room() -> Episode:
    return make_episode(3, num_views=8, size=(90, 120), num_objects=4, confident_share=0.5)


def choose(room: Episode, seed: int, truths=None) -> tuple[Detection, ...]:
    return one_view_per_object(truths or room.ground_truth or (), room.depth_m, 32, seed, room.name)


def test_each_object_is_drawn_once_and_as_it_is(room):
    truths = room.ground_truth or ()
    chosen = choose(room, 0)
    large = {t.instance_id for t in truths if t.modal.sum() >= 32}
    assert len(chosen) == len(large)
    for detection, instance_id in zip(chosen, sorted(large), strict=True):
        own = [t for t in truths if t.instance_id == instance_id and t.view_index == detection.view_index]
        assert np.array_equal(detection.mask, own[0].modal)
        assert (detection.category, detection.confidence, detection.exact) == (own[0].category, 1.0, True)


def test_the_seed_decides_and_every_view_has_its_turn(room):
    assert choose(room, 5) == choose(room, 5)
    truths = room.ground_truth or ()
    first = min(t.instance_id for t in truths)
    possible = {t.view_index for t in truths if t.instance_id == first and t.modal.sum() >= 32}
    drawn = {choose(room, seed)[0].view_index for seed in range(60)}
    assert drawn == possible


def test_what_is_ignored_tiny_or_without_depth_is_never_drawn(room):
    truths = room.ground_truth or ()
    ignored = tuple(replace(t, ignore=t.view_index != 3) for t in truths)
    assert {d.view_index for d in choose(room, 0, ignored)} <= {3}
    tiny = np.zeros(room.size, bool)
    tiny[0, :31] = True
    assert choose(room, 0, (GroundTruth(0, 1, "chair", tiny),)) == ()
    blind = room.depth_m.copy()
    blind[::2] = 0
    chosen = one_view_per_object(truths, blind, 32, 0)
    seen = {t.instance_id for t in truths if t.view_index % 2 and t.modal.sum() >= 32}
    assert sum(d.view_index % 2 for d in chosen) >= len(seen)


def test_a_persons_mask_is_not_eroded(room):
    cloud = build_cloud(room, 0.02)
    truth = max(room.ground_truth or (), key=lambda t: t.modal.sum())
    seeds = [
        len(
            detection_seeds(
                cloud, Detection(truth.view_index, "chair", 1.0, truth.modal, exact), LabelConfig()
            ).foreground
        )
        for exact in (False, True)
    ]
    assert seeds[1] > seeds[0]


def test_one_view_of_each_object_labels_all_others(room):
    labels = propagate(room, choose(room, 1)).labels
    best = [
        max(
            (mask_iou(x.modal, t.modal) for x in labels if (x.view_index, x.category) == (t.view_index, t.category)),
            default=0,
        )
        for t in room.ground_truth or ()
    ]
    assert np.mean(best) > 0.75
    assert all(label.source_confidence == 1.0 for label in labels)


def polygons_of(mask: np.ndarray) -> list[list[float]]:
    """What an annotation tool would save: outlines through pixel corners, here on a picture enlarged fourfold."""
    large = np.kron(mask.astype(np.uint8), np.ones((4, 4), np.uint8))
    outlines, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return [((outline[:, 0] + 0.5) / 4).ravel().tolist() for outline in outlines if len(outline) >= 3]


@pytest.fixture
def recorded(room, tmp_path) -> Path:
    write_episode(tmp_path / "room", replace(room, detections=None))
    return tmp_path / "room"


def test_weak_labels_from_ground_truth_say_so(recorded, tmp_path):
    out = tmp_path / "labels"
    assert main([str(recorded), "--out", str(out), "--weak", "one-view", "--seed", "4"]) == 0
    summary = json.loads((out / "label_set.json").read_text())
    assert summary["sources"]["weak"] == "one-view"
    assert summary["episodes"][0]["sources"] == "weak: one random view per object of ground_truth.json, seed 4"
    boxes = json.loads((out / "boxes_3d.json").read_text())["boxes"]
    assert boxes
    assert all(source["confidence"] == 1.0 for box in boxes for source in box["sources"])
    coco = json.loads((out / "instances_modal.json").read_text())
    assert {one["source_score"] for one in coco["annotations"]} == {1.0}


@pytest.mark.parametrize("kind", ["polygons", "rle"])
def test_a_persons_coco_file_labels_novel_categories(recorded, room, tmp_path, kind):
    chosen = choose(room, 1)
    names = [f"novel thing {number}" for number in range(len(chosen))]
    content = {
        "images": [{"id": 40 + view, "file_name": f"./rgb/{view:03d}.png"} for view in range(room.num_views)],
        "categories": [{"id": 100 + number, "name": name} for number, name in enumerate(names)],
        "annotations": [
            {
                "id": number,
                "image_id": 40 + one.view_index,
                "category_id": 100 + number,
                "iscrowd": 0,
                "segmentation": encode_mask(one.mask) if kind == "rle" else polygons_of(one.mask),
            }
            for number, one in enumerate(chosen)
        ],
    }
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(content))
    shutil.move(recorded / "ground_truth.json", tmp_path / "truth.json")
    out = tmp_path / "labels"
    assert main([str(recorded), "--out", str(out), "--annotations", str(file)]) == 0
    coco = json.loads((out / "instances_modal.json").read_text())
    assert {one["name"] for one in coco["categories"]} >= set(names)
    assert len({one["instance_id"] for one in coco["annotations"]}) == len(names)
    assert json.loads((out / "label_set.json").read_text())["episodes"][0]["sources"] == f"weak: {file}"


def test_annotations_of_other_pictures_are_one_clear_error(recorded, tmp_path, capsys):
    file = tmp_path / "mine.json"
    file.write_text(
        json.dumps({"images": [{"id": 1, "file_name": "holiday.jpg"}], "categories": [], "annotations": []})
    )
    assert main([str(recorded), "--out", str(tmp_path / "labels"), "--annotations", str(file)]) == 2
    assert "none of its 1 pictures is a frame of room" in capsys.readouterr().err


def test_weak_mode_without_ground_truth_asks_for_annotations(recorded, tmp_path, capsys):
    (recorded / "ground_truth.json").unlink()
    assert main([str(recorded), "--out", str(tmp_path / "labels"), "--weak", "one-view"]) == 2
    assert "--annotations FILE" in capsys.readouterr().err


@pytest.mark.slow
def test_the_real_capture_is_labelled_well_from_one_view_per_object(apc_shelf):
    episode = read_episode(apc_shelf)
    chosen = one_view_per_object(episode.ground_truth or (), episode.depth_m, 32, 1, episode.name)
    labels = propagate(episode, chosen).labels
    found = [
        MaskInstance(("shelf", one.view_index), one.category, encode_mask(one.modal), one.confidence)
        for one in labels
        if one.modal.any()
    ]
    truths = [
        MaskInstance(("shelf", t.view_index), t.category, encode_mask(t.modal)) for t in episode.ground_truth or ()
    ]
    assert (average_precision(found, truths).mean[0.5] or 0) >= 0.8
