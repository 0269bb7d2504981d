import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labeling.core.errors import LabelFormatError
from labeling.formats.ply import read_ply
from labeling.generate import main
from labeling.inspect import main as inspect
from labeling.io.episodes import write_episode
from labeling.io.label_set import read_label_set

from .synthetic_room import make_episode


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    for seed in (1, 2):
        episode = make_episode(seed, num_views=4, size=(48, 64), num_objects=3, confident_share=2.0)
        write_episode(folder / f"room_{seed}", episode)
    return folder


@pytest.fixture
def dataset(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "dataset"))


def run(dataset: Path, out: Path, *flags: str) -> int:
    return main([str(dataset), "--out", str(out), *flags])


def read(path: Path):
    return json.loads(path.read_text())


@pytest.mark.filterwarnings("ignore:__array__ implementation doesn't accept a copy keyword:DeprecationWarning")
def test_label_set_loads_in_pycocotools_and_refers_only_to_what_it_holds(dataset: Path, tmp_path: Path) -> None:
    from pycocotools.coco import COCO

    assert run(dataset, tmp_path / "labels") == 0
    for kind in ("modal", "amodal"):
        coco = COCO(str(tmp_path / "labels" / f"instances_{kind}.json"))
        assert len(coco.imgs) == 8
        assert len(coco.anns) > 4
        for annotation in list[Any](coco.anns.values()):
            assert annotation["image_id"] in coco.imgs
            assert annotation["category_id"] in coco.cats
            assert 0 < annotation["score"] <= 1
            if not annotation["iscrowd"]:
                assert annotation["source_image_id"] in coco.imgs
                assert 0 < annotation["source_score"] <= 1
            mask = coco.annToMask(annotation)
            assert mask.sum() == annotation["area"] > 0
            rows, columns = np.nonzero(mask)
            box = [columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1]
            assert annotation["bbox"] == box


def test_pictures_are_listed_in_order_and_can_be_opened(dataset: Path, tmp_path: Path) -> None:
    assert run(dataset, tmp_path / "labels") == 0
    images = read(tmp_path / "labels" / "instances_modal.json")["images"]
    assert [image["id"] for image in images] == list(range(1, 9))
    assert [(image["episode"], image["view"]) for image in images] == [
        (name, view) for name in ("room_1", "room_2") for view in range(4)
    ]
    assert all((dataset / image["file_name"]).is_file() for image in images)


def test_instances_are_numbered_over_the_whole_set_and_have_boxes_and_points(dataset: Path, tmp_path: Path) -> None:
    assert run(dataset, tmp_path / "labels") == 0
    content = read(tmp_path / "labels" / "instances_modal.json")
    boxes = read(tmp_path / "labels" / "boxes_3d.json")["boxes"]
    assert [box["instance_id"] for box in boxes] == list(range(1, len(boxes) + 1))
    episode_of = {image["id"]: image["episode"] for image in content["images"]}
    owner = {box["instance_id"]: box for box in boxes}
    for annotation in content["annotations"]:
        if annotation["iscrowd"]:
            continue
        box = owner[annotation["instance_id"]]
        assert box["episode"] == episode_of[annotation["image_id"]]
        assert box["category_id"] == annotation["category_id"]
    for name in ("room_1", "room_2"):
        cloud = read_ply(tmp_path / "labels" / "clouds" / f"{name}.ply")
        assert set(cloud["label"]) == {0, *range(1, sum(box["episode"] == name for box in boxes) + 1)}


def test_a_single_episode_is_a_dataset(dataset: Path, tmp_path: Path) -> None:
    assert run(dataset / "room_1", tmp_path / "labels") == 0
    images = read(tmp_path / "labels" / "instances_modal.json")["images"]
    assert [image["file_name"] for image in images] == [f"rgb/{view:03d}.png" for view in range(4)]


def test_a_label_set_says_where_it_comes_from(dataset: Path, tmp_path: Path) -> None:
    assert run(dataset, tmp_path / "labels", "--seed", "5", "--confident", "0.8") == 0
    summary = read(tmp_path / "labels" / "label_set.json")
    assert (tmp_path / "labels" / summary["dataset"]).resolve() == dataset.resolve()
    assert summary["config"]["seed"] == 5
    assert summary["config"]["confident"] == 0.8
    assert [episode["status"] for episode in summary["episodes"]] == ["labelled", "labelled"]
    assert "numpy" in summary["versions"]


NOTE = "are worth has not been measured"


@pytest.mark.slow
def test_a_detector_without_a_calibration_is_told_once_for_the_whole_label_set(
    dataset: Path, tmp_path: Path, capsys
) -> None:
    def told(*flags: str) -> list[str]:
        assert run(dataset, tmp_path / "labels", *flags) == 0
        shown = capsys.readouterr()
        found = [line for line in (shown.out + shown.err).splitlines() if NOTE in line]
        assert inspect([str(tmp_path / "labels")]) == 0
        assert [line for line in capsys.readouterr().out.splitlines() if NOTE in line] == found
        return found

    def name(detector: str) -> None:
        for file in dataset.glob("*/episode.json"):
            file.write_text(json.dumps({**read(file), "detector": detector}))

    (unnamed,) = told()
    assert unnamed.startswith("note: what detections of a detector without a name")
    name("onnx:models/yolo.onnx")
    (named,) = told()
    assert "of onnx:models/yolo.onnx are" in named
    assert "python -m experiments.calibrate_labels EPISODES" in named
    assert told() == [named], "a rerun says it, too"
    assert read(tmp_path / "labels" / "label_set.json")["uncalibrated_detectors"] == ["onnx:models/yolo.onnx"]
    assert told("--preset", "paper") == [], "does not weigh detections"
    assert told("--weak", "one-view") == [], "outlines are true"
    name("compact")
    assert told() == []


def test_a_rerun_takes_finished_episodes_as_they_are(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import labeling.generator.propagate

    assert run(dataset, tmp_path / "labels") == 0
    before = {path: path.read_bytes() for path in (tmp_path / "labels").rglob("*") if path.is_file()}
    labelled = []
    original = labeling.generator.propagate.propagate

    def counted(*arguments):
        labelled.append(1)
        return original(*arguments)

    monkeypatch.setattr(labeling.generator.propagate, "propagate", counted)
    assert run(dataset, tmp_path / "labels") == 0
    assert labelled == []
    assert {path: path.read_bytes() for path in (tmp_path / "labels").rglob("*") if path.is_file()} == before
    detections = dataset / "room_2" / "detections.json"
    detections.write_text(json.dumps(read(detections)[:-1]))
    assert run(dataset, tmp_path / "labels") == 0
    assert len(labelled) == 1
    assert run(dataset, tmp_path / "labels", "--seed", "1") == 0
    assert len(labelled) == 3


def test_a_damaged_record_is_made_again(dataset: Path, tmp_path: Path) -> None:
    assert run(dataset, tmp_path / "labels") == 0
    before = (tmp_path / "labels" / "instances_modal.json").read_bytes()
    (tmp_path / "labels" / "episodes" / "room_1.json").write_text('{"fingerprint": ')
    (tmp_path / "labels" / "clouds" / "room_2.ply").unlink()
    assert run(dataset, tmp_path / "labels") == 0
    assert (tmp_path / "labels" / "instances_modal.json").read_bytes() == before
    assert (tmp_path / "labels" / "clouds" / "room_2.ply").is_file()


def test_a_run_stopped_between_cloud_and_record_leaves_no_cloud_that_passes_for_another_run_s(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cloud = tmp_path / "labels" / "clouds" / "room_1.ply"
    assert run(dataset / "room_1", tmp_path / "labels") == 0
    before = cloud.read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr("labeling.generator.label_jobs.write_records", full)
        assert run(dataset / "room_1", tmp_path / "labels", "--voxel-m", "0.2") == 2
    assert cloud.read_bytes() != before
    assert run(dataset / "room_1", tmp_path / "labels") == 0
    assert cloud.read_bytes() == before


def test_a_label_set_that_is_being_labelled_anew_is_not_read_as_if_it_were_done(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels = tmp_path / "labels"
    assert run(dataset, labels) == 0

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as interrupted:
        interrupted.setattr("labeling.generator.label_writer.write_label_set", stopped)
        assert run(dataset, labels) == 130
        assert len(read_label_set(labels).sizes) == 8, "nothing was labelled anew"
        assert run(dataset, labels, "--seed", "1") == 130
    assert not (labels / "label_set.json").exists()
    with pytest.raises(LabelFormatError, match="has not finished"):
        read_label_set(labels)
    assert run(dataset, labels, "--seed", "1") == 0
    assert read_label_set(labels).provenance["config"]["seed"] == 1


@pytest.mark.slow
def test_same_seed_same_files_in_another_process(dataset: Path, tmp_path: Path) -> None:
    assert run(dataset, tmp_path / "a") == 0
    command = [sys.executable, "-m", "labeling.generate", str(dataset), "--out", str(tmp_path / "b")]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2])
    assert result.returncode == 0, result.stderr
    for name in ("instances_modal.json", "instances_amodal.json", "boxes_3d.json", "clouds/room_1.ply"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_malformed_episode_does_not_stop_the_others(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (dataset / "room_1" / "rgb" / "002.png").unlink()
    assert run(dataset, tmp_path / "labels") == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if "error:" in line]
    assert len(errors) == 2
    assert "room_1" in errors[0]
    assert "002.png" in errors[0]
    assert "1 of 2 episodes" in errors[1]
    images = read(tmp_path / "labels" / "instances_modal.json")["images"]
    assert {image["episode"] for image in images} == {"room_2"}
    states = read(tmp_path / "labels" / "label_set.json")["episodes"]
    assert [state["status"] for state in states] == ["failed", "labelled"]
    assert "002.png" in states[0]["error"]


def test_an_episode_without_detections_is_told(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (dataset / "room_1" / "detections.json").unlink()
    assert run(dataset, tmp_path / "labels") == 2
    assert "detector" in capsys.readouterr().err


def test_no_confident_detection_gives_an_empty_but_valid_label_set(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(dataset, tmp_path / "labels", "--confident", "1.0", "--min-posterior", "1") == 0
    content = read(tmp_path / "labels" / "instances_modal.json")
    assert len(content["images"]) == 8
    assert all(one["iscrowd"] for one in content["annotations"])
    assert content["categories"]
    assert "--confident 1" in capsys.readouterr().out


@pytest.mark.parametrize(
    "flags",
    [("--confident", "1.5"), ("--confident", "nan"), ("--voxel-m", "0"), ("--crop", "-1"), ("--seed", "-3")],
)
def test_settings_that_make_no_sense_are_refused(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], flags: tuple[str, str]
) -> None:
    assert run(dataset, tmp_path / "labels", *flags) == 2
    captured = capsys.readouterr().err
    assert captured.startswith("error: ")
    assert flags[0] in captured
    assert not (tmp_path / "labels").exists()


def test_a_dataset_that_is_not_there_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path / "nothing", tmp_path / "labels") == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not (tmp_path / "labels").exists()


def test_labels_cannot_replace_the_dataset(dataset: Path) -> None:
    assert run(dataset, dataset) == 2


def test_labels_do_not_become_a_part_of_their_recording(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    episode = min(path.parent for path in dataset.rglob("transforms.json"))
    assert run(episode, episode / "labels") == 2
    assert "lies inside the recording" in capsys.readouterr().err
    assert not (episode / "labels").exists()


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys, labeling.generate as g\n"
        "try: g.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print('HEAVY', sorted({'numba', 'sklearn', 'scipy', 'cv2', 'open3d', 'torch'} & set(sys.modules)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]
    )
    assert "HEAVY []" in result.stdout
