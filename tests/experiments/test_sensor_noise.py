"""The experiment on noise: rows differ by their noise alone, and the page tells differences from none."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.ablations import label_comparison, sensor_noise
from experiments.ablations.sensor_noise import CLEAN, KINDS, Kind
from experiments.run import main
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.episodes import write_episode
from sbm_gym.sensors.noise_config import SensorNoise

from ..labeling.synthetic_room import make_episode


def test_the_first_row_has_no_noise_and_all_others_some_of_their_own() -> None:
    assert [kind.name for kind in KINDS if kind.noise == SensorNoise()] == [CLEAN]
    assert KINDS[0].name == CLEAN
    assert len({kind.name for kind in KINDS}) == len({kind.noise for kind in KINDS}) == len(KINDS)
    for kind in KINDS:
        kind.noise.check()
    sensors = {kind.noise.sensor for kind in KINDS}
    assert sensors == {"ideal", "kinect", "stereo", "lidar"}


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two tiny rooms in place of recorded homes, two kinds of noise, two treatments."""
    folders = [tmp_path / "rooms" / f"{index:04d}" for index in range(2)]
    for index, folder in enumerate(folders):
        room = make_episode(7 + index, 8, (48, 64), num_objects=3, confident_share=0.6)
        write_episode(folder, replace(room, metadata={"scene": f"room/{index}", "episode": index}))
    monkeypatch.setattr(label_comparison, "record", lambda pool, context: folders)
    monkeypatch.setattr(sensor_noise, "KINDS", (KINDS[0], Kind("far off", SensorNoise(pose_noise_m=3.0))))
    treatments = {"as recorded": LabelConfig(), "without votes": LabelConfig(votes=False)}
    monkeypatch.setattr(sensor_noise, "TREATMENTS", treatments)
    return tmp_path


@pytest.mark.slow
def test_noise_costs_labels_and_the_page_says_how_much(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = [f"--{name}={small / name}" for name in ("cache", "results", "docs")]
    assert main(["noise", "--workers", "1", *places]) == 0
    content = json.loads((small / "results" / "noise.json").read_text())
    assert content["pool"]["scenes"] == ["room/0", "room/1"]
    assert [kind["name"] for kind in content["kinds"]] == [CLEAN, "far off"]
    recorded, other = content["results"].values()
    assert recorded[CLEAN]["difference"]["mean_iou"]["mean"] == 0
    assert recorded["far off"]["mean"]["mean_iou"] < recorded[CLEAN]["mean"]["mean_iou"] - 0.05
    for figure in ("mean_iou", "box_ap50"):
        gap = np.mean(other[CLEAN]["per_episode"][figure]) - np.mean(recorded[CLEAN]["per_episode"][figure])
        assert other[CLEAN]["gain"][figure]["mean"] == pytest.approx(gap, abs=1e-4)
    page = (small / "docs" / "sensor-noise.md").read_text()
    for words in ("| far off |", "## As recorded", "## Without votes", "without votes, above as recorded"):
        assert words in page
    assert (small / "docs" / "pictures" / "sensor_noise.png").stat().st_size > 1000
    capsys.readouterr()
