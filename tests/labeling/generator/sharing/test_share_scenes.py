"""What one episode has found is labelled in the other episodes of its scene: rooms cast ray by ray are the oracle."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.episode import Episode
from labeling.core.geometry import intrinsics_from_fov, look_at, unproject_depth
from labeling.core.masks import mask_iou
from labeling.core.rle import decode_mask
from labeling.core.types import Box3d
from labeling.core.views import Camera
from labeling.generate import main
from labeling.generator.sharing.scene_objects import (
    ObjectObservation,
    SceneObject,
    associate_observations,
    project_objects,
)
from labeling.inspection.checks import inspect_label_set
from labeling.io.episodes import write_episode
from labeling.io.label_records import ObjectRecord

from ...synthetic_room import Part, make_episode, pick, render

K = intrinsics_from_fov(160, 120, np.deg2rad(80))
FRIDGE = Part((1.0, 0.2, 0.85), (0.3, 0.35, 0.85), (0.8, 0.8, 0.8), 0.4, instance=1)
SCREEN = Part((0.2, 0.2, 0.9), (0.05, 1.2, 0.9), (0.2, 0.5, 0.3), instance=2)
NEAR = [
    look_at(np.array([1.0 + 1.4 * np.cos(a), 0.2 + 1.4 * np.sin(a), 1.4]), np.array([1.0, 0.2, 0.7])) for a in (0, 2, 4)
]
FAR = look_at(np.array([-2.8, 0.2, 1.5]), np.array([1.0, 0.2, 0.8]))


def shot(parts, pose):
    """Depth and the mask of the fridge."""
    _, depth_m, instance = render(parts, pose, K, 120, 160)
    return depth_m, instance == 1


def visited(parts=(FRIDGE,), episode: str = "near", confidence: float = 0.9) -> ObjectObservation:
    """The fridge, walked around."""
    points = []
    for pose in NEAR:
        depth_m, mask = shot(list(parts), pose)
        seen, flat = unproject_depth(depth_m.astype(float), K, pose)
        points.append(seen[mask.ravel()[flat]])
    cells = np.unique(np.round(np.concatenate(points) / 0.04).astype(int), axis=0) * 0.04
    turn = np.array([[np.cos(0.4), -np.sin(0.4), 0], [np.sin(0.4), np.cos(0.4), 0], [0, 0, 1]])
    box = Box3d(np.array(FRIDGE.centre), 2 * np.array(FRIDGE.half), turn)
    return ObjectObservation(episode, 1, "fridge", confidence, box, cells.astype(np.float32), 0, 0.95)


def known() -> SceneObject:
    (one,) = associate_observations([visited()])
    return one


def test_a_view_from_afar_shows_the_object_where_rays_hit_it() -> None:
    depth_m, truth = shot([FRIDGE], FAR)
    (found,) = project_objects([known()], depth_m, Camera(K, FAR, (120, 160)))
    assert found is not None
    assert mask_iou(found.modal, truth) > 0.8
    np.testing.assert_array_equal(found.amodal, found.modal)  # nothing hides it


def test_what_is_half_hidden_is_labelled_as_far_as_it_is_seen() -> None:
    half = replace(SCREEN, centre=(0.2, 0.9, 0.9), half=(0.05, 0.7, 0.9))
    depth_m, truth = shot([FRIDGE, half], FAR)
    _, whole = shot([FRIDGE], FAR)
    assert 0.2 * whole.sum() < truth.sum() < 0.8 * whole.sum()
    (found,) = project_objects([known()], depth_m, Camera(K, FAR, (120, 160)))
    assert found is not None
    assert mask_iou(found.modal, truth) > 0.75
    assert mask_iou(found.amodal, whole) > 0.75


@pytest.mark.parametrize(
    "parts", [[], [SCREEN], [replace(FRIDGE, centre=(1.0, -1.2, 0.85))]], ids=["gone", "hidden", "moved"]
)
def test_what_is_gone_or_hidden_is_not_labelled(parts) -> None:
    depth_m, _ = shot(parts, FAR)
    assert project_objects([known()], depth_m, Camera(K, FAR, (120, 160))) == [None]


def test_a_lamp_post_where_a_car_was_is_no_car() -> None:
    post = Part(FRIDGE.centre, (0.04, 0.04, 1.2), (0.1, 0.1, 0.1))
    depth_m, _ = shot([post], FAR)
    assert project_objects([known()], depth_m, Camera(K, FAR, (120, 160))) == [None]


@settings(max_examples=15)
@given(st.floats(-3, 3), st.floats(-20, 20), st.floats(-20, 20))
def test_turning_the_world_with_its_cameras_changes_no_mask(angle: float, x: float, y: float) -> None:
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    turn[:2, 3] = x, y
    observation = visited()
    box = observation.box_3d
    moved = replace(
        observation,
        points=(observation.points @ turn[:3, :3].T + turn[:3, 3]).astype(np.float32),
        box_3d=Box3d(turn[:3, :3] @ box.centre_m + turn[:3, 3], box.extent_m, turn[:3, :3] @ box.rotation),
    )
    depth_m, _ = shot([FRIDGE], FAR)
    (before,) = project_objects(associate_observations([observation]), depth_m, Camera(K, FAR, (120, 160)))
    (after,) = project_objects(associate_observations([moved]), depth_m, Camera(K, turn @ FAR, (120, 160)))
    assert before is not None
    assert after is not None
    assert mask_iou(before.modal, after.modal) > 0.97


def test_in_coordinates_of_a_map_masks_are_the_same() -> None:
    by_m, observation = np.array([500123.0, 5412345.0, 217.0]), visited()
    box = observation.box_3d
    there = replace(
        observation, points=observation.points + by_m, box_3d=Box3d(box.centre_m + by_m, box.extent_m, box.rotation)
    )
    depth_m, _ = shot([FRIDGE], FAR)
    pose = FAR.copy()
    pose[:3, 3] += by_m
    (here,) = project_objects(associate_observations([observation]), depth_m, Camera(K, FAR, (120, 160)))
    (found,) = project_objects(associate_observations([there]), depth_m, Camera(K, pose, (120, 160)))
    assert here is not None
    assert found is not None
    assert mask_iou(here.modal, found.modal) > 0.99
    assert mask_iou(here.amodal, found.amodal) > 0.99


def test_segments_that_fill_the_same_space_are_one_object_and_others_are_not() -> None:
    first, again = visited(), visited(episode="later", confidence=0.95)
    half = replace(again, points=again.points[again.points[:, 0] < 1.0])
    beside = replace(again, points=again.points + np.array([1.0, 0.0, 0.0], np.float32), instance_id=2)
    objects = associate_observations([first, half, beside])
    assert sorted(len(one.observations) for one in objects) == [1, 2]
    (both,) = (one for one in objects if len(one.observations) == 2)
    assert both.best.episode == "later"
    assert both.is_found_in(["elsewhere", "near"])
    assert not both.is_found_in(["elsewhere"])


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A room visited three times; the detector found nothing the second time, and the third was in another scene."""
    folder = tmp_path_factory.mktemp("observations")
    whole = make_episode(3, num_views=12, size=(90, 120), num_objects=4, confident_share=2.0, wrong_class=0.0)

    def part(first: int, scene: str, **changes) -> Episode:
        every_other = pick(whole, list(range(first, 12, 2)))
        return replace(every_other, metadata={"world": "rooms", "scene": scene}, **changes)

    for name, episode in {
        "found": part(0, "room_3"),
        "missed": part(1, "room_3", detections=()),
        "other": part(1, "room_4", detections=()),
    }.items():
        write_episode(folder / name, episode)
    return folder


def read(labels: Path, name: str = "instances_modal.json"):
    return json.loads((labels / name).read_text())


@pytest.fixture(scope="module")
def shared(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("labels")
    assert main([str(dataset), "--out", str(out), "--share-scenes", "--no-label-together"]) == 0
    return out


def test_what_one_visit_found_is_labelled_in_the_other(dataset: Path, shared: Path) -> None:
    content, truths = read(shared), json.loads((dataset / "missed" / "ground_truth.json").read_text())
    names = {one["id"]: one["name"] for one in content["categories"]}
    true_names = {one["id"]: one["name"] for one in truths["categories"]}
    images = {one["id"]: one for one in content["images"]}
    ious = []
    for one in content["annotations"]:
        if images[one["image_id"]]["episode"] != "missed":
            continue
        assert images[one["source_image_id"]]["episode"] == "found"
        mask, view = decode_mask(one["segmentation"]), images[one["image_id"]]["view"]
        ious.append(
            max(
                mask_iou(mask, decode_mask(true["segmentation"]))
                for true in truths["annotations"]
                if true["image_id"] == view and true_names[true["category_id"]] == names[one["category_id"]]
            )
        )
    assert len(ious) > 0.6 * sum(truth["iscrowd"] == 0 for truth in truths["annotations"])
    assert np.median(ious) > 0.7


def test_the_label_set_is_sound_and_says_what_was_shared(shared: Path) -> None:
    assert inspect_label_set(shared, []) == []
    assert read(shared, "label_set.json")["share_scenes"] is True
    borrowed = [one for one in read(shared, "boxes_3d.json")["boxes"] if one["episode"] == "missed"]
    assert borrowed
    assert {one["shared_from"]["episode"] for one in borrowed} == {"found"}


def test_nothing_is_shared_with_another_scene_nor_with_whoever_found_it(
    shared: Path, dataset: Path, tmp_path: Path
) -> None:
    assert main([str(dataset), "--out", str(tmp_path)]) == 0
    for labels, episodes in ((shared, {"found", "missed"}), (tmp_path, {"found"})):
        images = {one["id"]: one["episode"] for one in read(labels)["images"]}
        assert {images[one["image_id"]] for one in read(labels)["annotations"]} == episodes
    own = [[one for one in read(labels)["annotations"] if one["image_id"] <= 6] for labels in (shared, tmp_path)]
    assert own[0] == own[1]


def test_what_stands_in_one_episode_only_is_not_shared(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = ObjectRecord.of
    monkeypatch.setattr(ObjectRecord, "of", lambda *args, **more: replace(plain(*args, **more), only_here=True))
    assert main([str(dataset), "--out", str(tmp_path), "--share-scenes", "--no-label-together"]) == 0
    images = {one["id"]: one["episode"] for one in read(tmp_path)["images"]}
    assert {images[one["image_id"]] for one in read(tmp_path)["annotations"]} == {"found"}


def test_episodes_that_name_no_scene_keep_what_they_found(dataset: Path, tmp_path: Path) -> None:
    nameless = Path(shutil.copytree(dataset, tmp_path / "nameless"))
    for file in nameless.glob("*/episode.json"):
        content = json.loads(file.read_text())
        del content["scene"]
        file.write_text(json.dumps(content))
    assert main([str(nameless), "--out", str(tmp_path / "labels"), "--share-scenes"]) == 0
    images = {one["id"]: one["episode"] for one in read(tmp_path / "labels")["images"]}
    assert {images[one["image_id"]] for one in read(tmp_path / "labels")["annotations"]} == {"found"}


def test_a_scene_that_is_no_text_is_refused(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = Path(shutil.copytree(dataset, tmp_path / "broken"))
    content = json.loads((broken / "found" / "episode.json").read_text())
    (broken / "found" / "episode.json").write_text(json.dumps({**content, "scene": 7}))
    assert main([str(broken), "--out", str(tmp_path / "labels"), "--share-scenes"]) == 2
    assert "episode.json: scene" in capsys.readouterr().err


def test_a_damaged_cloud_is_refused(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(dataset), "--out", str(tmp_path)]) == 0
    cloud = tmp_path / "clouds" / "found.ply"
    cloud.write_bytes(cloud.read_bytes()[:-5])
    assert main([str(dataset), "--out", str(tmp_path), "--share-scenes", "--no-label-together"]) == 2
    assert "found.ply: truncated" in capsys.readouterr().err
