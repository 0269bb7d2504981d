"""Datasets for FiftyOne and Hugging Face: read as their documents say they are read, they say what the labels say."""

import base64
import io
import json
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.convert import main
from labeling.core.errors import UsageError
from labeling.core.views import Camera
from labeling.exports.fiftyone import write_fiftyone
from labeling.exports.hugging_face import write_hugging_face
from labeling.io.labelled_views import LabelledView, ViewLabel, categories_of


@pytest.fixture(scope="module")
def fiftyone(labels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("fiftyone") / "out"
    assert main([str(labels), "--to", "fiftyone", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def hugging_face(labels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("hugging_face") / "out"
    assert main([str(labels), "--to", "hugging-face", "--out", str(out)]) == 0
    return out


def unpacked(mask: dict) -> np.ndarray:
    """An array as FiftyOne's extended JSON has it."""
    assert mask["$binary"]["subType"] == "00"
    return np.load(io.BytesIO(zlib.decompress(base64.b64decode(mask["$binary"]["base64"]))), allow_pickle=False)


def rows_of(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "train" / "metadata.jsonl").read_text().splitlines()]


def assert_shows(path: Path, view: LabelledView) -> None:
    picture = cv2.imread(str(path))
    assert picture is not None
    np.testing.assert_array_equal(picture[..., ::-1], view.rgb)


def test_samples_of_fiftyone_hold_masks_in_boxes(fiftyone: Path, labels: Path, views: list[LabelledView]) -> None:
    metadata = json.loads((fiftyone / "metadata.json").read_text())
    # A version would say that the file is a dump of FiftyOne's database, which the importer then takes it for.
    assert "version" not in metadata
    assert metadata["info"]["classes"] == list(categories_of(labels))
    samples = json.loads((fiftyone / "samples.json").read_text())["samples"]
    for sample, view in zip(samples, views, strict=True):
        assert (sample["episode"], sample["view"]) == (view.episode, view.index)
        assert not Path(sample["filepath"]).is_absolute()
        assert_shows(fiftyone / sample["filepath"], view)
        rows, columns = view.rgb.shape[:2]
        assert (sample["metadata"]["width"], sample["metadata"]["height"]) == (columns, rows)
        assert sample["metadata"]["size_bytes"] == (fiftyone / sample["filepath"]).stat().st_size
        field = sample["pseudo_labels"]
        assert field["_cls"] == "Detections"
        for one, label in zip(field["detections"], view.labels, strict=True):
            assert (one["_cls"], one["label"], one["index"]) == ("Detection", label.category, label.instance_id)
            assert one["confidence"] == label.confidence
            mask = unpacked(one["mask"])
            left, top, width, height = np.array(one["bounding_box"]) * [columns, rows, columns, rows]
            assert (height, width) == pytest.approx(mask.shape)
            whole = np.zeros((rows, columns), bool)
            whole[round(top) : round(top) + mask.shape[0], round(left) : round(left) + mask.shape[1]] = mask
            np.testing.assert_array_equal(whole, label.mask)


def test_boxes_of_fiftyone_are_those_of_its_samples(fiftyone: Path, views: list[LabelledView]) -> None:
    content = json.loads((fiftyone / "labels.json").read_text())
    samples = json.loads((fiftyone / "samples.json").read_text())["samples"]
    assert content["labels"].keys() == {path.stem for path in (fiftyone / "data").iterdir()}
    for sample, view in zip(samples, views, strict=True):
        boxes = content["labels"][view.name]
        detections = sample["pseudo_labels"]["detections"]
        assert [one["bounding_box"] for one in boxes] == [one["bounding_box"] for one in detections]
        assert [content["classes"][one["label"]] for one in boxes] == [label.category for label in view.labels]
        assert [one["confidence"] for one in boxes] == [label.confidence for label in view.labels]
        # instance_id is a word that FiftyOne keeps for itself, and refuses.
        assert [one["attributes"] for one in boxes] == [{"index": label.instance_id} for label in view.labels]


def test_rows_of_hugging_face_hold_objects_and_cameras(
    hugging_face: Path, labels: Path, views: list[LabelledView]
) -> None:
    rows, names = rows_of(hugging_face), categories_of(labels)
    # pyarrow makes one table of all rows.
    assert len({tuple(row) for row in rows}) == 1
    for row, view in zip(rows, views, strict=True):
        assert_shows(hugging_face / "train" / row["file_name"], view)
        assert (row["episode"], row["view"]) == (view.episode, view.index)
        np.testing.assert_array_equal(row["intrinsics"], view.camera.intrinsics)
        np.testing.assert_array_equal(row["camera_to_world"], view.camera.camera_to_world)
        objects = row["objects"]
        assert {len(values) for values in objects.values()} == {len(view.labels)}
        instances = cv2.imread(str(hugging_face / "train" / row["instances_file_name"]), cv2.IMREAD_UNCHANGED)
        assert instances is not None
        assert instances.dtype == np.uint16
        free = np.ones(instances.shape, bool)
        for index, label in reversed(list(enumerate(view.labels))):
            number, category = objects["id"][index], objects["category"][index]
            assert (number, names[category]) == (label.instance_id, label.category)
            assert objects["category_name"][index] == label.category
            assert objects["confidence"][index] == label.confidence
            assert objects["area"][index] == np.count_nonzero(label.mask)
            there = np.nonzero(label.mask)
            left, top, width, height = objects["bbox"][index]
            assert (left, top) == (there[1].min(), there[0].min())
            assert (left + width, top + height) == (there[1].max() + 1, there[0].max() + 1)
            np.testing.assert_array_equal(instances[label.mask & free], number)
            free &= ~label.mask
        assert not instances[free].any()


def test_every_picture_of_hugging_face_has_a_row(hugging_face: Path) -> None:
    named = {row[key] for row in rows_of(hugging_face) for key in ("file_name", "instances_file_name")}
    folder = hugging_face / "train"
    assert {str(path.relative_to(folder)) for path in folder.rglob("*.png")} == named


def view_of(number: int, category: str) -> LabelledView:
    mask = np.zeros((6, 8), bool)
    mask[1:4, 2:5] = True
    label = ViewLabel(number, category, 0.5, mask, None)
    return LabelledView("room", 0, np.zeros((6, 8, 3), np.uint8), Camera.from_fov(np.eye(4), (6, 8), 1.0), (label,))


@given(st.text(st.characters(exclude_categories=("Cs",)), min_size=1))
@settings(max_examples=15)
def test_any_name_of_a_category_comes_back(tmp_path_factory: pytest.TempPathFactory, category: str) -> None:
    out = tmp_path_factory.mktemp("out")
    for name, write in (("fiftyone", write_fiftyone), ("hugging_face", write_hugging_face)):
        (out / name).mkdir()
        assert write(out / name, [view_of(3, category)], ["other", category]) == 1
    (sample,) = json.loads((out / "fiftyone" / "samples.json").read_text())["samples"]
    assert sample["pseudo_labels"]["detections"][0]["label"] == category
    (row,) = rows_of(out / "hugging_face")
    assert row["objects"]["category_name"] == [category]
    assert row["objects"]["category"] == [["other", category].index(category)]


def test_ids_that_no_picture_can_hold_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="room for instance ids from 1 to 65535, not 65536"):
        write_hugging_face(tmp_path, [view_of(65536, "chair")], ["chair"])


@pytest.mark.parametrize("to", ["fiftyone", "hugging-face", "openlabel"])
def test_a_malformed_label_set_is_refused_in_one_line_and_nothing_is_left(
    labels: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], to: str
) -> None:
    broken = tmp_path / "labels"
    broken.mkdir()
    for file in labels.glob("*.json"):
        content = json.loads(file.read_text())
        for one in content.get("annotations", [])[-1:]:
            one["score"] = 7
        (broken / file.name).write_text(json.dumps(content))
    assert main([str(broken), "--to", to, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert "a score lies in [0, 1], not 7" in said[0]
    assert [path.name for path in tmp_path.iterdir()] == ["labels"]
