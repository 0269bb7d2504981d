"""The table of predicted views: recorded, trained, scored and written, and what its page says."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from experiments.cache import object_rooms
from experiments.cache.object_rooms import Exchanges, ObjectRooms, camera_poses, record_exchanges, record_object_rooms
from experiments.cache.stages import RunContext
from experiments.pages.memory.view_prediction import page
from experiments.run import main
from labeling.detectors.registry import choose_device
from labeling.io.episodes import read_episode
from labeling.training.loop import device_name


def test_cameras_look_at_the_middle_from_all_around():
    poses = np.stack(camera_poses(12, np.random.default_rng(3)))
    away = np.array([0, 0, object_rooms.MIDDLE_M]) - poses[:, :3, 3]
    distance = np.linalg.norm(away, axis=1)
    assert np.allclose(away / distance[:, None], poses[:, :3, 2])
    assert np.all((distance >= 1.75) & (distance <= 2.2))
    azimuths = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    assert np.diff(azimuths).max() < 2 * 2 * np.pi / 12


@pytest.mark.nightly
def test_rooms_are_recorded_once_and_the_same_whatever_their_number(tmp_path: Path):
    context = RunContext("smoke", (0,), 1, tmp_path)
    (first,) = record_object_rooms(ObjectRooms(2, 1, views=3), context)
    before = (first / "transforms.json").stat().st_mtime_ns
    again, second = record_object_rooms(ObjectRooms(2, 2, views=3), context)
    assert again == first
    assert (first / "transforms.json").stat().st_mtime_ns == before
    one, other = read_episode(first), read_episode(second)
    assert one.metadata["objects"] == 2
    assert one.num_views == 3
    assert not np.array_equal(one.rgb, other.rgb)


@pytest.mark.slow
def test_rooms_of_an_exchange_differ_in_what_stands_in_them_alone(tmp_path: Path):
    folders = record_exchanges(Exchanges(1, views=3), RunContext("smoke", (0,), 1, tmp_path))
    a, b, c, answer = (read_episode(folders[part][0]) for part in ("a", "b", "c", "answer"))
    assert [one.metadata["objects"] for one in (a, b, c, answer)] == [2, 1, 1, 2]
    assert len({one.name for one in (a, b, c, answer)}) == 1
    np.testing.assert_array_equal(a.camera_to_world, answer.camera_to_world)
    depth = [one.depth_m for one in (a, b, c, answer)]
    assert not np.allclose(depth[0], depth[3])
    # What is nearest of B and C, and of A and the answer, is nearest of all: the same three objects at their places.
    np.testing.assert_allclose(
        np.minimum(depth[0], depth[3]), np.minimum(np.minimum(*depth[:2]), np.minimum(*depth[2:]))
    )
    same = np.isclose(depth[0], depth[3]) & np.isclose(depth[0], depth[1])
    assert same.mean() > 0.3
    assert np.abs(a.rgb[same].astype(int) - answer.rgb[same]).mean() < 3  # floor and walls; but shades differ


def made_up(seeds: int = 2) -> dict:
    """Results in which GRNN errs less than the tower by .02 in every scene."""

    def figures(l1: float) -> dict:
        scenes = [{"l1": l1 + 0.001 * k, "psnr": 20.0, "ssim": 0.5, "view_r1": 0.5} for k in range(6)]
        return {"mean": {**scenes[0], "l1": l1}, "scenes": scenes}

    def features() -> dict:
        mean = {"pixel_r1": 0.1, "chance": 0.001, "view_r1": 0.9}
        return {"mean": mean, "scenes": [mean] * 6}

    def row(name: str, seed: int | None, of: dict) -> dict:
        return {"name": name, "seed": seed, "objects": {"2": {"1": of, "8": of}, "4": {"1": of, "8": of}}}

    rows = [row("depth reprojection", None, figures(0.05))]
    for seed in range(seeds):
        rows += [
            row("GRNN", seed, figures(0.06)),
            row("2-D tower", seed, figures(0.08)),
            row("C-N3D", seed, features()),
        ]
    scenes = {"learn": 9, "choose": 3, "test": 6}
    settings = {"scenes": scenes, "inputs": [1, 8], "targets": 5}
    about = {"scale": "smoke", "seeds": list(range(seeds)), "machines": ["cpu (PyTorch 2.0)"]}
    return {**about, "settings": settings, "rows": rows}


def test_the_page_says_who_errs_less_and_where_chance_is():
    text = page(made_up())
    assert "| GRNN less 2-D tower | **-0.020 [-0.020, -0.020]** | **-0.020 [-0.020, -0.020]** |" in text
    assert "| GRNN less depth reprojection | **+0.010 [+0.010, +0.010]** |" in text
    assert "chance 20." in text
    assert "| 2 objects, found | 10.00 ± 0.00 |" in text
    assert "| L1: GRNN | 0.060 ± 0.000 |" in text


def test_the_page_tells_of_arithmetic_once_it_has_been_done():
    assert "python -m experiments.run scene_arithmetic" in page(made_up())
    figures = {"mean": {"l1": 0.1, "changed_l1": 0.25, "ssim": 0.5}}
    rows = [
        {"name": name, "seed": seed, "inputs": {"1": figures}} for name in ("A as it is", "GRNN") for seed in (0, 1)
    ]
    text = page(made_up(), {"settings": {"exchanges": 7, "targets": 5, "inputs": [1]}, "rows": rows})
    assert "7 such exchanges, 5 views" in text
    assert "| L1 where A and the answer differ: GRNN | 0.250 ± 0.000 |" in text


@pytest.mark.nightly
def test_the_table_is_made_from_recording_to_page(tmp_path: Path, capsys):
    places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    assert main(["view_prediction", "--scale", "smoke", "--workers", "1", *places]) == 0
    content = json.loads((tmp_path / "results" / "view_prediction.json").read_text())
    assert [row["name"] for row in content["rows"]] == ["depth reprojection", "GRNN", "C-N3D", "2-D tower"]
    device = device_name(torch.device(choose_device()))
    assert content["machines"] == [f"{device} (PyTorch {torch.__version__})"]
    assert [row["machine"] for row in content["rows"]] == [None, *3 * content["machines"]]
    for row in content["rows"]:
        for objects in ("2", "4"):
            assert set(row["objects"][objects]) == {"1", "2"}
            assert len(row["objects"][objects]["1"]["scenes"]) == 2
    text = (tmp_path / "docs" / "view-prediction.md").read_text()
    assert "## 4 objects" in text
    assert (tmp_path / "docs" / "pictures" / "view_prediction.png").stat().st_size > 1000
    capsys.readouterr()
    assert main(["view_prediction", "--scale", "smoke", "--workers", "1", *places]) == 0
    assert main(["scene_arithmetic", "--scale", "smoke", "--workers", "1", *places]) == 0
    assert "step" not in capsys.readouterr().err  # networks are those that there are
    content = json.loads((tmp_path / "results" / "scene_arithmetic.json").read_text())
    assert [row["name"] for row in content["rows"]] == ["A as it is", "depth reprojection", "GRNN", "2-D tower"]
    assert all(row["inputs"]["2"]["mean"]["changed_l1"] > 0 for row in content["rows"])
    assert "changed" not in (tmp_path / "docs" / "view-prediction.md").read_text().split("## Scene arithmetic")[0]
