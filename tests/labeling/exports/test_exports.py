"""What is exported says, read back by other means, what the label set says."""

import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labeling.convert import main
from labeling.core.geometry import look_at, project
from labeling.core.masks import mask_iou
from labeling.exports.kitti import level_frame
from labeling.exports.yolo import polygon_of
from labeling.io.labelled_views import LabelledView, categories_of


def export(labels: Path, out: Path, to: str, *flags: str) -> Path:
    assert main([str(labels), "--to", to, "--out", str(out), *flags]) == 0
    return out


def yolo_lines(out: Path, view: LabelledView) -> list[tuple[str, np.ndarray]]:
    """Category and numbers of each line, as Ultralytics splits them."""
    names = dict(re.findall(r'^  (\d+): "(.*)"$', (out / "data.yaml").read_text(), re.MULTILINE))
    lines = (out / "labels" / "train" / f"{view.name}.txt").read_text().splitlines()
    return [(names[line.split()[0]], np.array(line.split()[1:], float)) for line in lines]


def test_yolo_boxes_are_those_of_the_masks(labels: Path, views: list[LabelledView], tmp_path: Path) -> None:
    out = export(labels, tmp_path / "yolo", "yolo-detect")
    for view in views:
        read = yolo_lines(out, view)
        assert [category for category, _ in read] == [label.category for label in view.labels]
        for (_, (x, y, width, height)), label in zip(read, view.labels, strict=True):
            rows, columns = np.nonzero(label.mask)
            corners = np.array([x - width / 2, y - height / 2, x + width / 2, y + height / 2]) * [64, 48, 64, 48]
            expected = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            np.testing.assert_allclose(corners, expected, atol=1e-3)
        picture = cv2.imread(str(out / "images" / "train" / f"{view.name}.png"))
        assert picture is not None
        np.testing.assert_array_equal(picture[..., ::-1], view.rgb)


def test_yolo_polygons_fill_to_the_masks(labels: Path, views: list[LabelledView], tmp_path: Path) -> None:
    out = export(labels, tmp_path / "yolo", "yolo-segment")
    for view in views:
        for (_, numbers), label in zip(yolo_lines(out, view), view.labels, strict=True):
            assert len(numbers) >= 6
            assert numbers.min() >= 0
            assert numbers.max() <= 1
            assert mask_iou(filled(numbers.reshape(-1, 2), label.mask.shape), without_holes(label.mask)) > 0.8


def filled(polygon: np.ndarray, shape: tuple[int, ...], scale: int = 8) -> np.ndarray:
    """The pixels whose centres lie in a polygon of shares, drawn at a larger scale."""
    canvas = np.zeros((shape[0] * scale, shape[1] * scale), np.uint8)
    corners = np.rint(polygon * np.array(shape[::-1]) * scale).astype(np.int32)
    cv2.fillPoly(canvas, [corners], 1)
    return canvas[scale // 2 :: scale, scale // 2 :: scale] > 0


def without_holes(mask: np.ndarray) -> np.ndarray:
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(np.zeros(mask.shape, np.uint8), contours, -1, 1, cv2.FILLED) > 0


@settings(max_examples=40)
@given(hnp.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))).filter(np.any))
def test_a_polygon_holds_every_pixel_of_any_mask(mask: np.ndarray) -> None:
    polygon = polygon_of(mask)
    assert len(polygon) >= 3
    assert polygon.min() >= 0
    assert polygon.max() <= 1
    assert filled(polygon, mask.shape)[mask].all()


def test_masks_show_the_surest_instance_of_every_pixel(labels: Path, views: list[LabelledView], tmp_path: Path) -> None:
    out = export(labels, tmp_path / "masks", "masks")
    about = json.loads((out / "masks.json").read_text())
    for view in views:
        instances, classes = (
            cv2.imread(str(out / kind / f"{view.name}.png"), cv2.IMREAD_UNCHANGED) for kind in ("instances", "classes")
        )
        assert instances is not None
        assert classes is not None
        assert (instances.dtype, classes.dtype) == (np.uint16, np.uint8)
        free = np.ones(instances.shape, bool)
        for label in reversed(view.labels):
            np.testing.assert_array_equal(instances[label.mask & free], label.instance_id)
            named = about["categories"][classes[label.mask & free][0] - 1] if (label.mask & free).any() else None
            assert named in (label.category, None)
            assert about["category_of_instance"][str(label.instance_id)] == label.category
            free &= ~label.mask
        assert not instances[free].any()
        assert not classes[free].any()


def test_kitti_boxes_project_to_where_the_boxes_of_the_label_set_do(
    labels: Path, views: list[LabelledView], tmp_path: Path
) -> None:
    out = export(labels, tmp_path / "kitti", "kitti")
    names = dict(line.split() for line in (out / "names.txt").read_text().splitlines())
    for number, name in names.items():
        (view,) = (one for one in views if one.name == name)
        calibration = {
            key: np.array(values.split(), float).reshape(3, -1)
            for key, values in (line.split(": ") for line in (out / "calib" / f"{number}.txt").read_text().splitlines())
        }
        lines = (out / "label_2" / f"{number}.txt").read_text().splitlines()
        with_box = [label for label in view.labels if label.box_3d is not None]
        for line, label in zip(lines, with_box, strict=True):
            kind, *rest = line.split()
            assert (kind, len(rest)) == (label.category, 15)
            *_, left, top, right, bottom, height, width, length, x, y, z, rotation_y, score = map(float, rest)
            assert score == pytest.approx(label.confidence, abs=1e-4)
            rows, columns = np.nonzero(label.mask)
            assert [left, top, right, bottom] == [columns.min(), rows.min(), columns.max(), rows.max()]
            # As KITTI's development kit computes the corners.
            turn = np.array(
                [[np.cos(rotation_y), 0, np.sin(rotation_y)], [0, 1, 0], [-np.sin(rotation_y), 0, np.cos(rotation_y)]]
            )
            half = np.array([[dx, dy, dz] for dx in (-0.5, 0.5) for dy in (-1, 0) for dz in (-0.5, 0.5)])
            corners = (half * [length, height, width]) @ turn.T + [x, y, z]
            pixels = np.c_[corners, np.ones(8)] @ calibration["P2"].T
            assert label.box_3d is not None
            expected, depth_m = project(label.box_3d.corners(), view.camera.intrinsics, view.camera.camera_to_world)
            before = depth_m > 0.3
            ours, theirs = (pixels[:, :2] / pixels[:, 2:])[pixels[:, 2] > 0.3], expected[before]
            assert ours.shape == theirs.shape
            apart = np.linalg.norm(ours[:, None] - theirs[None], axis=-1)
            assert apart.min(axis=0).max(initial=0) < 0.2  # pixels, of numbers with four digits
            in_level = np.c_[label.box_3d.corners(), np.ones(8)] @ calibration["Tr_velo_to_cam"].T
            np.testing.assert_allclose(in_level.mean(axis=0), [x, y - height / 2, z], atol=1e-3)


@pytest.mark.parametrize("ahead", [(1.0, 0.5, -0.6), (0.0, 1e-9, -1.0), (-1.0, 0.0, 0.8)])
def test_a_level_frame_stands_upright_at_the_camera(ahead: tuple[float, float, float]) -> None:
    place = np.array([1.0, 2.0, 3.0])
    camera_to_world = look_at(place, place + np.array(ahead) + [1e-7, 0, 0])
    level = level_frame(camera_to_world)
    np.testing.assert_allclose(level[:3, :3].T @ level[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(level[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(level[:3, 1], [0, 0, -1])
    np.testing.assert_array_equal(level[:3, 3], place)


def test_gltf_holds_clouds_and_boxes(labels: Path, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    from labeling.inspection.scene import read_scenes

    out = export(labels, tmp_path / "gltf", "gltf")
    for scene in read_scenes(labels):
        read = trimesh.load(out / f"{scene.name}.glb")
        clouds = [one for one in read.geometry.values() if isinstance(one, trimesh.PointCloud)]
        paths = [one for one in read.geometry.values() if not isinstance(one, trimesh.PointCloud)]
        assert len(clouds) == 1
        np.testing.assert_allclose(clouds[0].vertices + scene.points.mean(axis=0), scene.points, atol=1e-5)
        np.testing.assert_array_equal(np.asarray(clouds[0].colors)[:, :3], scene.colours)
        assert len(paths) == len(scene.objects)
        low, high = read.bounds
        assert (high - low)[1] == pytest.approx(np.ptp(scene.points[:, 2]), abs=0.5)  # +Y is up


def test_yolo_folders_are_those_beside_the_file(labels: Path, tmp_path: Path) -> None:
    content = yaml.safe_load((export(labels, tmp_path / "yolo", "yolo-detect") / "data.yaml").read_text())
    assert "path" not in content  # Ultralytics takes the folder of the file then
    assert {content["train"], content["val"]} == {"images/train"}


@pytest.mark.parametrize("to", ["yolo-detect", "masks", "fiftyone", "hugging-face"])
def test_categories_that_are_not_declared_are_called_by_their_ids(labels: Path, tmp_path: Path, to: str) -> None:
    copy = tmp_path / "labels"
    shutil.copytree(labels, copy)
    for name in ("instances_modal.json", "instances_amodal.json"):
        content = json.loads((copy / name).read_text())
        del content["categories"]
        (copy / name).write_text(json.dumps(content))
    used = {one["category_id"] for one in json.loads((copy / "instances_modal.json").read_text())["annotations"]}
    assert categories_of(copy) == tuple(f"category_{number}" for number in sorted(used))
    export(copy, tmp_path / "out", to, "--dataset", str(labels.parent / "dataset"))


def test_confidence_leaves_labels_out(labels: Path, views: list[LabelledView], tmp_path: Path) -> None:
    scores = [label.confidence for view in views for label in view.labels]
    limit = float(np.median(scores))
    out = export(labels, tmp_path / "yolo", "yolo-detect", "--min-confidence", str(limit))
    lines = [line for path in (out / "labels" / "train").iterdir() for line in path.read_text().splitlines()]
    assert len(lines) == sum(score >= limit for score in scores)
    assert categories_of(labels)


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (["--to", "yolo-detect", "--undistort"], "these options have no place"),
        (["--to", "masks", "--min-confidence", "2"], "--min-confidence must lie"),
        (["--to", "gltf", "--min-confidence", "0.5"], "glTF is written of clouds"),
        (["--min-confidence", "0.5"], "are for label sets"),
        (["--to", "kitti", "--dataset", "nowhere"], "nowhere"),
    ],
)
def test_what_cannot_be_meant_is_one_sentence(
    labels: Path, tmp_path: Path, capsys, flags: list[str], expected: str
) -> None:
    assert main([str(labels), "--out", str(tmp_path / "out"), *flags]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_recording_is_no_label_set(labels: Path, tmp_path: Path, capsys) -> None:
    recording = labels.parent / "dataset" / "room_1"
    assert main([str(recording), "--to", "masks", "--out", str(tmp_path / "out")]) == 2
    assert "instances_modal.json" in capsys.readouterr().err
