"""Tables of boxes on memories: trained, scored and written, and what their page says."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import experiments.cache.episode_pool
from experiments.cache import memory_box_stages, memory_stages, moving_stages
from experiments.cache.egomotion import METHODS
from experiments.cache.memory_box_stages import SceneScores, score_scenes
from experiments.cache.object_rooms import ObjectRooms, record_boxed_rooms, record_object_rooms
from experiments.cache.stages import RunContext
from experiments.cache.worlds import SIZES, WORLDS, Size
from experiments.pages.memory.boxes import page
from experiments.run import main
from experiments.tables import label_fraction, memory_boxes, table_5_5
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.io.episodes import read_episode, write_episode
from labeling.memory.boxes.box_detector import save_box_net
from labeling.memory.boxes.box_net import BoxNet, BoxOutput
from labeling.memory.boxes.box_samples import scene_targets
from labeling.memory.boxes.labelled_scenes import true_scene
from labeling.memory.settings.box_settings import BoxSpec, TrainBoxesConfig
from labeling.memory.settings.flow_settings import TrainFlowConfig
from labeling.memory.settings.memory_spec import MemorySize
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.training.config import WEIGHTS_FILE

from ...labeling.detectors3d.boxed_rooms import SIDES, boxed_room

SIZE = MemorySize((16, 16, 8), 0.3, 8, 8, 8, (32, 32))


@pytest.mark.slow
def test_rooms_have_the_boxes_of_what_stands_in_them(tmp_path: Path):
    context = RunContext("smoke", (0,), 1, tmp_path)
    (bare,) = record_object_rooms(ObjectRooms(2, 1, views=3), context)
    (boxed,) = record_boxed_rooms(ObjectRooms(2, 1, views=3), context)
    one, other = read_episode(bare), read_episode(boxed)
    np.testing.assert_array_equal(one.rgb, other.rgb)
    assert one.ground_truth is None
    assert other.ground_truth
    assert len({truth.instance_id for truth in other.ground_truth}) == 2
    for truth in other.ground_truth:
        assert truth.box_3d is not None
        view = truth.view_index
        rows, columns = np.nonzero(truth.modal)
        rays = np.linalg.inv(other.intrinsics[view]) @ np.stack([columns, rows, np.ones_like(rows)]).astype(float)
        pose = other.camera_to_world[view]
        points = (pose[:3, :3] @ (rays * other.depth_m[view, rows, columns])).T + pose[:3, 3]
        local = np.abs((points - truth.box_3d.centre_m) @ truth.box_3d.rotation)
        assert np.all(local <= 0.5 * truth.box_3d.extent_m + 0.02)


def test_who_knows_everything_scores_everything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A network that says what is to be said: AP is 1, and objects that are hidden count in ``all`` alone."""
    folder, spec = tmp_path / "rooms" / "0000", SIZE.spec("cn3d")
    write_episode(folder, replace(boxed_room(2), name="0000"))
    names = tuple(SIDES)
    network = BoxNet(BoxSpec(names, spec))
    labelled = true_scene(read_episode(folder), spec)

    def knows(self, views) -> BoxOutput:
        targets = scene_targets(labelled, list(range(labelled.scene.num_views)), names, spec.grid)
        return BoxOutput(torch.logit(targets.heat, eps=1e-6), targets.numbers, torch.zeros_like(targets.filled))

    monkeypatch.setattr(BoxNet, "forward", knows)
    run = tmp_path / "run"
    run.mkdir()
    save_box_net(run / WEIGHTS_FILE, network, {})
    job = SceneScores("memory", str(run), (folder,), SIZE, "fixated", (1, 3), names)
    (found,) = score_scenes([job], RunContext("smoke", (0,), 1, tmp_path / "cache"))
    assert (found["scenes"], found["left_out"]) == (1, [])
    for count in ("1", "3"):
        assert found["inputs"][count]["all"]["objects"] == 3
        assert found["inputs"][count]["all"]["ap25"] == found["inputs"][count]["all"]["ap50"] == 1
        assert found["inputs"][count]["shown"]["ap50"] == 1
        assert 1 <= found["inputs"][count]["shown"]["objects"] <= 3


def made_up() -> tuple[dict, dict]:
    """Results of both experiments."""

    def figures(ap: float) -> dict:
        both = {"ap25": ap, "ap50": ap / 2, "objects": 9, "per_class_ap25": {}}
        return {str(count): {"shown": both, "all": {**both, "ap25": ap - 0.1}} for count in (1, 8)}

    common = {"scale": "smoke", "seeds": [0, 1]}
    views = {
        **common,
        "settings": {"inputs": [1, 8], "memory": {"voxels": [32, 32, 16], "voxel_m": 0.16}},
        "finder": "compact",
        "pools": {name: {"episodes": 7} for name in ("learn", "choose", "wide")},
        "machines": ["cpu (PyTorch 2.0)"],
        "rows": [
            {"name": name, "labels": labels, "seed": seed, "inputs": figures(ap + 0.1 * seed)}
            for name, ap in (("F-PointNet, one view", 0.3), ("memory of views", 0.5))
            for labels in memory_boxes.LABELS
            for seed in (0, 1)
        ],
        "motion": [
            {"none": {"turn_deg": 12, "shift_cm": 30}, **{key: {"turn_deg": by, "shift_cm": 2} for key in METHODS[1:]}}
            for by in (1, 2, 6)
        ],
    }
    labels = {
        **common,
        "settings": {
            "inputs": [8],
            "shares": [0.1, 1.0],
            "scenes": {"learn": 150, "test": 24},
            "train": {"iterations": 5},
        },
        "machines": ["cpu (PyTorch 2.0)"],
        "rows": [
            {"name": "GRNN", "beginning": beginning, "share": share, "seed": seed, "inputs": figures(ap * share**0.1)}
            for beginning, ap in ((label_fraction.SCRATCH, 0.4), ("after view prediction", 0.6))
            for share in (0.1, 1.0)
            for seed in (0, 1)
        ],
    }
    return views, labels


def test_the_page_says_what_was_found_by_views_and_by_labels():
    views, labels = made_up()
    text = page(views, labels)
    assert "| AP .25: memory of views, SbM labels | 55.0 ± 7.1 | 55.0 ± 7.1 |" in text
    assert "| AP .25: memory of views, SbM labels | 45.0 ± 7.1 | 45.0 ± 7.1 |" in text
    assert "| AP .5: GRNN after view prediction | 23.8 ± 0.0 | 30.0 ± 0.0 |" in text
    assert "| AP .25: GRNN after view prediction less random weights | 15.9 ± 0.0 | 20.0 ± 0.0 |" in text
    assert "after view prediction less random weights with the next larger share | 7.7 ± 0.0 | - |" in text
    assert "within 5.1 x 5.1 m" in text
    assert "| 10 to 20° | 3 | 12.0°, 30.0 cm | 2.0°, 2.0 cm | 2.0°, 2.0 cm |" in text
    assert "From 8 views" in text
    assert "By the share of labels" not in page(views, None)
    assert "By the number of views" not in page(None, labels)


def test_rooms_are_labelled_by_seed_alone_and_more_of_them_with_a_larger_share():
    rooms = [Path(f"{number:04d}") for number in range(150)]
    few, more = (label_fraction.drawn_rooms(rooms, share, 0) for share in (0.05, 0.25))
    assert (len(few), len(more)) == (8, 38)
    assert set(few) < set(more)
    assert few == label_fraction.drawn_rooms(rooms, 0.05, 0)
    assert len({label_fraction.drawn_rooms(rooms, 0.05, seed) for seed in range(4)}) == 4
    assert label_fraction.drawn_rooms(rooms, 1.0, 3) == tuple(rooms)


def test_the_page_says_which_rooms_are_labelled():
    _, labels = made_up()
    assert "of 150 rooms so many, drawn anew for every seed, have boxes" in page(None, labels)


def test_networks_of_another_machine_are_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Arms of one table are trained on one machine."""
    context, stages = RunContext("smoke", (0,), 1, tmp_path), (memory_stages, memory_box_stages, moving_stages)
    episode = tmp_path / "rooms" / "0000"
    episode.mkdir(parents=True)
    memory = memory_stages.MemoryJob("grnn", (episode,), (), SIZE, TrainMemoryConfig(), 0)
    boxes = memory_box_stages.BoxJob("grnn", (episode,), (), SIZE, TrainBoxesConfig(), 0, "title")
    flow = moving_stages.FlowJob("run", (episode,), (), (), TrainFlowConfig(), 0, "title")
    found = []
    for machine in ("cpu", "some GPU", "cpu"):
        for stage in stages:
            monkeypatch.setattr(stage, "training_machine", lambda where, name=machine: name)
            monkeypatch.setattr(stage, "cached", lambda *_, **__: [])
        found.append(
            (
                *memory_stages.train_memories([memory], context),
                *memory_box_stages.train_box_nets([boxes], context),
                *moving_stages.train_flows([flow], context),
            )
        )
    assert found[0] == found[2]
    assert not set(found[0]) & set(found[1])


@pytest.fixture
def boxed_rooms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rooms with plain boxes in place of recorded worlds."""

    def record(pool, context):
        folder = tmp_path / "episodes" / pool.name / "0000"
        if not folder.exists():
            room = boxed_room(len(pool.name) + pool.seed, 4)
            write_episode(folder, replace(room, name=folder.name, metadata={"scene": "room/0"}))
        return [folder]

    monkeypatch.setitem(SIZES, "smoke", Size(dict.fromkeys(WORLDS, (1, 1, 1)), (1, 1), FinetuneConfig()))
    monkeypatch.setattr(experiments.cache.episode_pool, "record", record)
    for module in (memory_boxes, table_5_5):
        monkeypatch.setattr(module, "known_categories", lambda: tuple(SIDES))


@pytest.mark.nightly
def test_boxes_by_views_are_made_from_labels_to_page(boxed_rooms: None, tmp_path: Path, capsys):
    places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    command = ["memory_boxes", "--scale", "smoke", "--workers", "1", *places]
    assert main(command) == 0
    content = json.loads((tmp_path / "results" / "memory_boxes.json").read_text())
    assert [(row["name"], row["labels"]) for row in content["rows"]] == [
        (name, labels) for name in memory_boxes.LOOKS.values() for labels in memory_boxes.LABELS
    ]
    for row in content["rows"]:
        assert [row["machine"]] == content["machines"]
        assert set(row["inputs"]) == {"1", "2"}
        assert row["inputs"]["2"]["all"] == row["inputs"]["2"]["shown"]
        assert row["inputs"]["1"]["all"]["objects"] >= row["inputs"]["1"]["shown"]["objects"] > 0
    single, fused = content["rows"][0], content["rows"][2]
    assert single["inputs"]["1"] == fused["inputs"]["1"]
    assert (tmp_path / "docs" / "pictures" / "memory_boxes.png").stat().st_size > 1000
    assert "## By the number of views" in (tmp_path / "docs" / "memory-boxes.md").read_text()
    capsys.readouterr()
    assert main(command) == 0
    assert "step" not in capsys.readouterr().err  # networks are those that there are


@pytest.mark.nightly
def test_boxes_by_labels_are_made_from_rooms_to_page(tmp_path: Path):
    places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    assert main(["label_fraction", "--scale", "smoke", "--workers", "1", *places]) == 0
    content = json.loads((tmp_path / "results" / "label_fraction.json").read_text())
    assert [(row["name"], row["beginning"], row["labelled"]) for row in content["rows"]] == [
        (name, beginning, labelled)
        for name, after in label_fraction.PRETRAINED.items()
        for beginning in (label_fraction.SCRATCH, after)
        for labelled in (1, 3)
    ]
    assert all([row["machine"]] == content["machines"] for row in content["rows"])
    assert all(row["scenes"] == 2 and row["inputs"]["2"]["shown"]["objects"] > 0 for row in content["rows"])
    assert (tmp_path / "docs" / "pictures" / "label_fraction.png").stat().st_size > 1000
    assert "From 2 views" in (tmp_path / "docs" / "memory-boxes.md").read_text()
