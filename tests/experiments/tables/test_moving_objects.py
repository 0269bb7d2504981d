"""The table of what moves: baselines, scores, and what their page says."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import experiments.cache.episode_pool
import labeling.memory.flow.flow_detector
from experiments import box_pictures
from experiments.cache.icp_residuals import IcpSettings, icp_residuals
from experiments.cache.moving_stages import CLUSTERS, RESIDUALS, FlowJob, MovingScores, score_moving
from experiments.cache.stages import RunContext
from experiments.pages.memory.moving_objects import page
from experiments.run import main
from experiments.tables import moving_objects
from labeling.core.box_overlap import box_iou_3d
from labeling.io.episodes import read_episode, write_episode
from labeling.memory.flow.flow_evaluation import moving_truths, true_flow
from labeling.memory.flow.flow_net import FlowOutput, Remembered
from labeling.memory.flow.moving_objects import MovingObject
from labeling.memory.flow.view_pairs import view_pairs
from labeling.memory.settings.memory_spec import MemorySize

from ...labeling.memory.orbits import orbit_episode, orbit_pose
from ...labeling.memory.test_flow import BOX, box_of, moving_episode

SIZE = MemorySize((16, 16, 8), 0.3, 8, 8, 8, (32, 32))


@pytest.mark.slow
@pytest.mark.parametrize("whole", [False, True])
def test_icp_finds_what_has_moved_and_nothing_where_all_stands(whole):
    spec = MemorySize((32, 32, 16), 0.16).spec("cn3d")
    settings = IcpSettings(whole_clusters=whole)
    episode = moving_episode((0.2, 0.35), (160, 160))
    (pair,) = view_pairs(episode.name, episode, spec)
    found = icp_residuals(pair, spec.grid, settings)
    near = [one for one in found if np.linalg.norm(one.box.centre_m - BOX.centre) < 0.4]
    assert near
    if whole:
        assert box_iou_3d(near[0].box, box_of(BOX)) > 0.4
        assert np.linalg.norm(near[0].displacement_m - [0.2, 0.35, 0]) < 0.2
    assert all(0 <= one.confidence <= 1 for one in found)
    same = replace(
        pair, rgb=pair.rgb[[0, 0]], depth_m=pair.depth_m[[0, 0]], camera_to_world=pair.camera_to_world[[0, 0]]
    )
    assert icp_residuals(same, spec.grid, settings) == []


class Oracle:
    """Says what is true of every pair."""

    def __init__(self, folder: Path) -> None:
        self.episode, self.grid, self.asked = read_episode(folder), SIZE.grid, 0

    def objects(self, pair, output: FlowOutput, before: Remembered) -> list[MovingObject]:
        return [MovingObject(one.box, np.zeros(3), 0.9) for one in moving_truths(self.episode, pair, self.grid)]

    def flow(self, pair) -> tuple[FlowOutput, Remembered]:
        self.asked += 1
        truth = true_flow(self.episode, pair, self.grid)
        nothing = torch.zeros(1, 1, *self.grid.shape)
        known = Remembered(nothing, truth.known, nothing, nothing.expand(-1, 2, -1, -1, -1))
        return FlowOutput(truth.flow_m, truth.moves), known


def test_who_knows_everything_scores_everything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = tmp_path / "rooms" / "0000"
    write_episode(folder, moving_episode())
    oracle = Oracle(folder)
    monkeypatch.setattr(labeling.memory.flow.flow_detector, "load_moving_detector", lambda path: oracle)
    jobs = [MovingScores(method, (folder,), SIZE) for method in ("run", RESIDUALS, CLUSTERS)]
    known, residuals, clusters = score_moving(jobs, RunContext("smoke", (0,), 1, tmp_path / "cache"))
    assert (known["pairs"], known["objects"], known["boxes"]) == (1, 1, 1)
    assert oracle.asked == 1  # of every pair once
    assert known["ap25"] == known["ap50"] == known["bev25"] == known["bev50"] == 1
    assert known["moving_m"] == known["standing_m"] == 0
    assert known["zero_m"] == pytest.approx(np.hypot(0.25, 0.1), abs=1e-3)
    assert [one["objects"] for one in known["recall"]] == [0, 0, 1]
    assert [one["recall"] for one in known["recall"]] == [None, None, 1]
    assert "moving_m" not in residuals
    assert residuals["objects"] == clusters["objects"] == 1


def test_the_page_says_what_was_found():
    bins = [{"from_m": low, "objects": 5, "recall": 0.4} for low in (0.05, 0.15)]
    common = {"recall": bins, "pairs": 10, "objects": 10, "boxes": 5}
    rows = [
        {"name": RESIDUALS, "seed": None, **common, "ap25": 0.1, "ap50": 0.05, "bev25": 0.2, "bev50": 0.1},
        *(
            {
                "name": "flow",
                "seed": seed,
                **common,
                **dict.fromkeys(("ap25", "ap50", "bev25", "bev50"), 0.3 + 0.1 * seed),
                **dict.fromkeys(("moving_m", "zero_m", "standing_m"), 0.05),
            }
            for seed in (0, 1)
        ),
    ]
    pools = {name: {"episodes": 7, "moving": 6} for name in ("standing", "moving", "test")}
    about = {"scale": "smoke", "seeds": [0, 1], "machines": ["cpu (PyTorch 2.0)"], "settings": {"model": "cn3d"}}
    text = page({**about, "pools": pools, "rows": rows})
    assert "| ICP residuals | 10.0 | 5.0 | 20.0 | 10.0 | 0.5 |" in text
    assert "| flow | 35.0 ± 7.1 |" in text
    assert "| flow | 5.0 ± 0.0 | 5.0 ± 0.0 | 5.0 ± 0.0 |" in text
    assert "| method | 0.05 to 0.15 m (5) |" in text


def test_only_the_method_called_so_matches_features(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    jobs: list[FlowJob] = []

    def train_flows(some: list[FlowJob], context: RunContext) -> list[str]:
        jobs.extend(some)
        return [one.title for one in some]

    def record(pool, context):
        return [Path(pool.name, f"{number:04d}") for number in range(pool.episodes)]

    monkeypatch.setattr(experiments.cache.episode_pool, "record", record)
    monkeypatch.setattr(experiments.cache.episode_pool, "pool_record", lambda *_: {})
    for name, made in {
        "train_memories": lambda some, context: ["memory"] * len(some),
        "train_flows": train_flows,
        "score_moving": lambda some, context: [{} for _ in some],
        "machines": sorted,
        "machine_of": lambda run: f"machine of {run}",
    }.items():
        monkeypatch.setattr(moving_objects, name, made)
    content = moving_objects.run(RunContext("smoke", (0, 1), 1, tmp_path))
    weights = {one.title: (one.train.matching, len(one.moving), one.supervised) for one in jobs}
    assert weights == {
        moving_objects.MADE_UP: (0.0, 0, False),
        moving_objects.MATCHED: (0.1, 2, False),
        moving_objects.SUPERVISED: (0.0, 0, True),
    }
    machines = [(row["name"], row["machine"]) for row in content["rows"]]
    assert machines[:3] == [
        (RESIDUALS, None),
        (CLUSTERS, None),
        *[(moving_objects.MADE_UP, f"machine of {moving_objects.MADE_UP}")],
    ]
    made_up = jobs[0]
    jobs.clear()
    moving_objects.made_up_flow(0, RunContext("smoke", (0,), 1, tmp_path))
    assert jobs == [made_up]  # the picture is of the network of the table


@pytest.mark.nightly
def test_what_moves_is_made_from_episodes_to_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    middle = np.array([0.0, 0.0, 0.7])

    def record(pool, context):
        folders = [tmp_path / "episodes" / pool.name / f"{number:04d}" for number in range(pool.episodes)]
        for number, folder in enumerate(folders):
            poses = [orbit_pose(0.3 * view, 0.4, 2.0, middle) for view in range(4)]
            episode = moving_episode() if pool.moving else orbit_episode(number, poses)
            if not folder.exists():
                write_episode(folder, replace(episode, name=folder.name, metadata={"scene": f"room/{number}"}))
        return folders

    monkeypatch.setattr(experiments.cache.episode_pool, "record", record)
    places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    assert main(["moving_objects", "--scale", "smoke", "--workers", "1", *places]) == 0
    content = json.loads((tmp_path / "results" / "moving_objects.json").read_text())
    assert [row["name"] for row in content["rows"]] == [
        RESIDUALS,
        CLUSTERS,
        moving_objects.MADE_UP,
        moving_objects.MATCHED,
        moving_objects.SUPERVISED,
    ]
    assert all(row["objects"] == 2 for row in content["rows"])
    assert "## By speed" in (tmp_path / "docs" / "moving-objects.md").read_text()
    folders = (tmp_path / name for name in ("cache", "results", "docs"))
    box_pictures.run(box_pictures.PictureConfig("moving", "smoke", 0, 1, *folders))
    assert (tmp_path / "docs" / "pictures" / "boxes_moving.png").is_file()
    drawn = json.loads((tmp_path / "results" / "boxes_moving.json").read_text())["views"]
    assert [(one["episode"], one["view"], one["to_find"]) for one in drawn] == [("0000", [0, 1], 1)]
