"""Files of strangers: bad episodes, forged sizes, names that lead elsewhere. Each is one sentence, nothing is lost."""

import json
import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from labeling.core.errors import EpisodeFormatError
from labeling.detectors.data.annotated_pictures import read_coco
from labeling.evaluate import main as evaluate
from labeling.formats.pixel_limit import VARIABLE, jpeg_size
from labeling.generate import main as generate
from labeling.generator.label_jobs import fingerprint
from labeling.generator.settings.label_config import LabelConfig
from labeling.inspect import main as inspect
from labeling.io.episodes import find_episodes, write_episode
from labeling.io.recordings.pictures import read_colour

from .synthetic_room import make_episode


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    for seed in (1, 2):
        write_episode(
            folder / f"room_{seed}", make_episode(seed, num_views=4, size=(48, 64), num_objects=3, confident_share=2.0)
        )
    return folder


@pytest.fixture
def dataset(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "dataset"))


def change(file: Path, edit) -> None:
    content = json.loads(file.read_text())
    edit(content)
    file.write_text(json.dumps(content))


def far_pose(content) -> None:
    content["frames"][1]["transform_matrix"][0][3] = 1e6


def absurd_focal_length(content) -> None:
    for record in (content, *content["frames"]):
        for name in ("fl_x", "fl_y"):
            if name in record:
                record[name] = 1e9


@pytest.mark.parametrize("edit", [far_pose, absurd_focal_length])
@pytest.mark.parametrize("options", [[], ["--share-scenes"]], ids=["alone", "shared"])
def test_one_bad_episode_does_not_take_the_others_down(dataset, tmp_path, capsys, edit, options) -> None:
    change(dataset / "room_1" / "transforms.json", edit)
    code = generate([str(dataset), "--out", str(tmp_path / "labels"), *options])
    told = capsys.readouterr().err
    assert "Traceback" not in told
    summary = {one["name"]: one for one in json.loads((tmp_path / "labels" / "label_set.json").read_text())["episodes"]}
    assert summary["room_2"]["status"] == "labelled"
    assert summary["room_2"]["labels"] > 0
    bad = summary["room_1"]
    assert (code == 0) == (bad["status"] == "labelled")
    if code:
        assert code == 2
        assert "room_1" in bad["error"]


def test_focal_lengths_in_no_pixels_are_refused(dataset, tmp_path, capsys) -> None:
    change(dataset / "room_1" / "transforms.json", absurd_focal_length)
    assert generate([str(dataset), "--out", str(tmp_path / "labels")]) == 2
    assert "room_1: view 0: focal lengths of 1e+09 and 1e+09 pixels in pictures of 64x48" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (ZeroDivisionError("nothing to divide by"), "cannot be labelled (nothing to divide by); check its poses"),
        (MemoryError("9 GiB"), "cannot be labelled, as memory ran out; give fewer --workers"),
        (KeyError("chair"), "by a fault of this program (KeyError: 'chair' in fails_in_one, line "),
    ],
)
def test_an_unexpected_error_is_the_line_of_its_episode(
    dataset, tmp_path, capsys, monkeypatch, error, expected
) -> None:
    from labeling.generator import propagate as module

    real = module.propagate

    def fails_in_one(views, *arguments):
        if views.name == "room_1":
            raise error
        return real(views, *arguments)

    monkeypatch.setattr(module, "propagate", fails_in_one)
    assert generate([str(dataset), "--out", str(tmp_path / "labels")]) == 2
    told = capsys.readouterr().err
    assert "room_1: cannot be labelled" in told
    assert expected in told
    assert ("check its poses" in told) == isinstance(error, ZeroDivisionError)
    assert "Traceback" not in told
    assert "1 of 2 episodes could not be labelled" in told


def test_episodes_with_a_malformed_scene_fail_alone_where_scenes_are_shared(dataset, tmp_path, capsys) -> None:
    (dataset / "room_1" / "episode.json").write_text(json.dumps({"scene": 7}))
    assert generate([str(dataset), "--out", str(tmp_path / "labels"), "--share-scenes"]) == 2
    assert "episode.json: scene: must be a non-empty text, not 7" in capsys.readouterr().err
    episodes = json.loads((tmp_path / "labels" / "label_set.json").read_text())["episodes"]
    assert {one["name"]: one["status"] for one in episodes}["room_2"] == "labelled"


def test_two_links_to_folders_of_one_name_are_refused(recorded, tmp_path) -> None:
    for place in ("monday", "tuesday"):
        shutil.copytree(recorded / "room_1", tmp_path / place / "room")
        (tmp_path / "dataset").mkdir(exist_ok=True)
        (tmp_path / "dataset" / place).symlink_to(tmp_path / place / "room")
    with pytest.raises(EpisodeFormatError, match=r"monday and .*tuesday lead to two folders of the name room"):
        find_episodes(tmp_path / "dataset")


def test_a_link_and_what_it_leads_to_elsewhere_may_have_other_names(recorded, tmp_path) -> None:
    (tmp_path / "dataset").mkdir()
    for name in ("room_1", "room_2"):
        (tmp_path / "dataset" / f"link_{name}").symlink_to(recorded / name)
    assert len(find_episodes(tmp_path / "dataset")) == 2


def jpeg(path: Path, height: int, width: int) -> bytes:
    picture = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)
    _, encoded = cv2.imencode(".jpg", picture)
    path.write_bytes(encoded.tobytes())
    return encoded.tobytes()


@pytest.mark.parametrize("size", [(1, 1), (24, 32), (301, 7)], ids=str)
def test_the_size_in_the_header_of_a_jpeg_is_that_of_the_picture(tmp_path, size) -> None:
    assert jpeg_size(jpeg(tmp_path / "a.jpg", *size)) == size


def test_a_header_that_claims_much_is_refused_before_anything_is_decoded(tmp_path, monkeypatch) -> None:
    content = jpeg(tmp_path / "a.jpg", 24, 32)
    at = content.index(b"\xff\xc0") + 5
    (tmp_path / "a.jpg").write_bytes(content[:at] + (65000).to_bytes(2) + (16000).to_bytes(2) + content[at + 4 :])
    monkeypatch.setattr(cv2, "imdecode", None)
    with pytest.raises(EpisodeFormatError, match=r"a.jpg: 16000x65000 pixels are more than the 64,000,000 accepted"):
        read_colour(tmp_path / "a.jpg")


def test_the_limit_can_be_set(tmp_path, monkeypatch) -> None:
    jpeg(tmp_path / "a.jpg", 24, 32)
    monkeypatch.setenv(VARIABLE, "700")
    with pytest.raises(EpisodeFormatError, match=f"32x24 pixels are more than the 700 accepted .{VARIABLE} sets"):
        read_colour(tmp_path / "a.jpg")
    monkeypatch.setenv(VARIABLE, "768")
    assert read_colour(tmp_path / "a.jpg").shape == (24, 32, 3)


def coco(tmp_path: Path, **image) -> Path:
    record = {"id": 1, "file_name": "a.png", "width": 8, "height": 8, **image}
    (tmp_path / "a.json").write_text(json.dumps({"images": [record], "annotations": [], "categories": []}))
    return tmp_path / "a.json"


@pytest.mark.parametrize("name", ["../../x.png", "/etc/x.png", "a/../../x.png", "..\\x.png", "C:\\x.png"])
def test_pictures_outside_the_folder_are_not_read(tmp_path, name) -> None:
    with pytest.raises(EpisodeFormatError, match="file_name: must be a file below the folder"):
        read_coco(coco(tmp_path, file_name=name), tmp_path)


def test_pictures_below_the_folder_are(tmp_path) -> None:
    (found,) = read_coco(coco(tmp_path, file_name="a/./b..c/x.png"), tmp_path)
    assert found.file == tmp_path / "a" / "b..c" / "x.png"


def test_masks_of_absurd_sizes_claim_no_memory(tmp_path) -> None:
    with pytest.raises(EpisodeFormatError, match="100000x100000 pixels are more than"):
        read_coco(coco(tmp_path, width=100_000, height=100_000), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["../evil", "/evil", "..", "a\\b", "\u001b[2Jevil"])
def test_no_picture_is_written_outside_its_folder(dataset, tmp_path, capsys, name) -> None:
    assert generate([str(dataset), "--out", str(tmp_path / "labels")]) == 0
    change(tmp_path / "labels" / "label_set.json", lambda content: content["episodes"][0].update(name=name))
    for boxes in ("boxes_3d.json",):
        change(
            tmp_path / "labels" / boxes,
            lambda content: [one.update(episode=name) for one in content["boxes"] if one["episode"] == "room_1"],
        )
    before = {path for path in tmp_path.rglob("*") if path.is_file()}
    assert inspect([str(tmp_path / "labels"), "--pictures", str(tmp_path / "pictures")]) != 0
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == before
    assert "\u001b" not in "".join(capsys.readouterr())


def test_files_beside_the_views_are_never_held_in_memory(dataset, monkeypatch) -> None:
    (dataset / "room_1" / "walk.mp4").write_bytes(bytes(1000))
    read, seen = Path.read_bytes, []
    monkeypatch.setattr(Path, "read_bytes", lambda path: seen.append(path) or read(path))
    one = fingerprint(dataset / "room_1", LabelConfig())
    assert not [path for path in seen if path.suffix == ".mp4"]
    (dataset / "room_1" / "walk.mp4").write_bytes(bytes(999))
    assert fingerprint(dataset / "room_1", LabelConfig()) != one


def test_labels_of_a_dataset_with_a_bad_episode_can_be_evaluated(dataset, tmp_path, capsys) -> None:
    change(dataset / "room_1" / "transforms.json", absurd_focal_length)
    generate([str(dataset), "--out", str(tmp_path / "labels")])
    assert evaluate([str(tmp_path / "labels")]) in (0, 2)
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", ["transforms.json", "detections.json", "rgb/001.png", "depth/001.png"])
@pytest.mark.parametrize("kind", ["pipe", "link to itself", "folder"])
def test_what_is_no_file_is_refused_and_waited_for_by_nobody(dataset, tmp_path, capsys, name, kind) -> None:
    file = dataset / "room_1" / name
    file.unlink()
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "folder":
        file.mkdir()
    else:
        file.symlink_to(file.name)
    assert generate([str(dataset / "room_1"), "--out", str(tmp_path / "labels")]) == 2
    told = capsys.readouterr().err
    assert "Traceback" not in told
    assert "error:" in told
    if kind == "pipe" and name == "transforms.json":
        assert "is a pipe or a device, not a file" in told


def test_numbers_that_json_does_not_have_are_refused_in_label_sets(dataset, tmp_path, capsys) -> None:
    labels = tmp_path / "labels"
    assert generate([str(dataset), "--out", str(labels)]) == 0
    change(labels / "label_set.json", lambda content: content["config"].update(doubt_across_views=float("nan")))
    assert evaluate([str(labels)]) == 2
    assert "label_set.json: holds NaN or infinity" in capsys.readouterr().err
