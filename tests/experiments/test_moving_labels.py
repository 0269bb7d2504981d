"""The experiment on labels where things move: parts of objects are scored apart, and rows are compared in pairs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.ablations import moving_labels
from experiments.ablations.moving_labels import DETECTOR, MOVING, OURS, PARTS, STILL, THESIS, World, pools_of
from experiments.cache import episode_pool
from experiments.run import main
from labeling.core.types import ObjectMotion
from labeling.io.episodes import write_episode

from ..labeling.synthetic_room import make_episode


def test_both_pools_have_the_same_starts_and_things_and_differ_in_speed_alone() -> None:
    still, moving = pools_of("rooms", World("env", 2), "quick").values()
    assert (still.moving_speed, moving.moving_speed, moving.moving) == (0.0, 1.0, 2)
    assert replace(still, name=moving.name, moving_speed=1.0) == moving


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two tiny rooms in each of which the first object is said to move."""
    rooms = []
    for index in range(2):
        room = make_episode(7 + index, 8, (48, 64), num_objects=3, confident_share=0.6)
        first = min(room.ground_truth or (), key=lambda one: one.instance_id)
        poses = np.repeat(np.eye(4)[None], room.num_views, 0)
        motion = (ObjectMotion(first.instance_id, first.category, poses),)
        rooms.append(replace(room, motion=motion, metadata={"scene": f"room/{index}", "episode": index}))
    folders = [tmp_path / "rooms" / f"{index:04d}" for index in range(2)]
    for folder, room in zip(folders, rooms, strict=True):
        write_episode(folder, room)
    monkeypatch.setattr(episode_pool, "record", lambda pool, context: folders)
    monkeypatch.setattr(moving_labels, "WORLDS", {"rooms": World("none", 1)})
    return tmp_path


@pytest.mark.nightly
def test_parts_are_scored_apart_and_the_page_tells_what_motion_costs(
    small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = [f"--{name}={small / name}" for name in ("cache", "results", "docs")]
    assert main(["moving_labels", "--workers", "1", *places]) == 0
    world = json.loads((small / "results" / "moving_labels.json").read_text())["worlds"]["rooms"]
    assert world["movers"] == {STILL: 2, MOVING: 2}
    found = world["results"]
    assert found[STILL].keys() == {DETECTOR, THESIS, OURS}
    for part in PARTS:
        # Both pools are the same folders here, in which nothing moves in truth.
        assert found[MOVING][OURS][part]["kept"]["mean_iou"]["mean"] == 0
        assert found[MOVING][OURS][part]["gain"]["mean_iou"]["mean"] == pytest.approx(0, abs=0.02)
    # The mean over all objects lies between those of the parts.
    parts = [found[STILL][OURS][part]["pooled"]["mean_iou"] for part in PARTS]
    assert min(parts[1:]) < parts[0] < max(parts[1:])
    page = (small / "docs" / "moving-labels.md").read_text()
    for words in ("## Rooms", "| moving | detector |", "100 %"):
        assert words in page
    capsys.readouterr()
