"""The table of predicted views: recorded, trained, scored and written, and what its page says."""

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.cache import object_rooms
from experiments.cache.object_rooms import ObjectRooms, camera_poses, record_object_rooms
from experiments.cache.stages import RunContext
from experiments.pages.view_prediction import page
from experiments.run import main
from labeling.io.episodes import read_episode


def test_cameras_look_at_the_middle_from_all_around():
    poses = np.stack(camera_poses(12, np.random.default_rng(3)))
    away = np.array([0, 0, object_rooms.MIDDLE_M]) - poses[:, :3, 3]
    distance = np.linalg.norm(away, axis=1)
    assert np.allclose(away / distance[:, None], poses[:, :3, 2])
    assert np.all((distance >= 1.75) & (distance <= 2.2))
    azimuths = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    assert np.diff(azimuths).max() < 2 * 2 * np.pi / 12


@pytest.mark.slow
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
    return {"scale": "smoke", "seeds": list(range(seeds)), "settings": settings, "rows": rows}


def test_the_page_says_who_errs_less_and_where_chance_is():
    text = page(made_up())
    assert "| GRNN less 2-D tower | **-0.020 [-0.020, -0.020]** | **-0.020 [-0.020, -0.020]** |" in text
    assert "| GRNN less depth reprojection | **+0.010 [+0.010, +0.010]** |" in text
    assert "chance 20." in text
    assert "| 2 objects, found | 10.00 ± 0.00 |" in text
    assert "| L1: GRNN | 0.060 ± 0.000 |" in text


@pytest.mark.slow
def test_the_table_is_made_from_recording_to_page(tmp_path: Path, capsys):
    places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    assert main(["view_prediction", "--scale", "smoke", "--workers", "1", *places]) == 0
    content = json.loads((tmp_path / "results" / "view_prediction.json").read_text())
    assert [row["name"] for row in content["rows"]] == ["depth reprojection", "GRNN", "C-N3D", "2-D tower"]
    for row in content["rows"]:
        for objects in ("2", "4"):
            assert set(row["objects"][objects]) == {"1", "2"}
            assert len(row["objects"][objects]["1"]["scenes"]) == 2
    text = (tmp_path / "docs" / "view-prediction.md").read_text()
    assert "## 4 objects" in text
    assert (tmp_path / "docs" / "pictures" / "view_prediction.png").stat().st_size > 1000
    capsys.readouterr()
    assert main(["view_prediction", "--scale", "smoke", "--workers", "1", *places]) == 0
    assert "step" not in capsys.readouterr().err
