"""The never-ending loop: every round goes on with the networks of the one before, on what all rounds have seen."""

import json
from pathlib import Path
from typing import Any

import pytest

from experiments.cache.worlds import SIZES as TRAIN_SIZES
from experiments.loops import loop_parts, rounds
from experiments.loops.rounds import SIZES
from experiments.loops.signs import LabelStatistics
from experiments.run import main
from experiments.tables.training_sets import known_categories
from labeling.io.episodes import read_episode
from labeling.io.label_set import read_label_set
from labeling.training import loop as training_loop
from labeling.training.config import CONFIG_FILE


def run(tmp_path: Path, name: str, seeds: int, *more: str) -> dict[str, Any]:
    places = [f"--{place}={tmp_path / place}" for place in ("cache", "results", "docs")]
    assert main([name, "--scale", "smoke", "--seeds", str(seeds), "--workers", "1", *places, *more]) == 0
    return json.loads((tmp_path / "results" / f"{name}.json").read_text())


def trained(tmp_path: Path) -> list[dict[str, Any]]:
    """What is kept of each fine-tuning."""
    return [json.loads(file.read_text()) for file in (tmp_path / "cache" / "detectors").glob(f"*/{CONFIG_FILE}")]


@pytest.fixture
def never_collapses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rounds, "collapse_reason", lambda signs: None)


@pytest.mark.nightly
@pytest.mark.usefixtures("never_collapses")
def test_rounds_begin_elsewhere_with_the_networks_of_the_round_before(
    small_rooms: list,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    content = run(tmp_path, "never_ending", 2)
    for seed, loop in enumerate(content["loops"]):
        assert (loop["seed"], loop["stopped"]) == (seed, None)
        assert [one["round"] for one in loop["rounds"]] == [1, 2]
        assert all(0 <= one[scores]["mask_ap50"] <= 1 for one in loop["rounds"] for scores in ("test", "ceiling"))
    pools = [pool for pool in small_rooms if "round" in pool.name]
    assert {pool.split for pool in pools} == {"endless"}
    assert len({(pool.name, pool.seed) for pool in pools}) == len(pools) == 2 * 2
    assert {pool.episodes_per_scene for pool in pools} == {3}
    detectors = [pool.detector for pool in pools]
    assert detectors[:2] == ["compact", "compact"]  # rounds of all seeds go side by side
    assert len({*detectors[2:], "compact"}) == 3
    about = [one["about"] for one in trained(tmp_path)]
    started = {kind: {one["started_from"] for one in about if kind in one["labels"]} for kind in ("labels", "truth")}
    assert len(about) == 2 * 2 * 2
    assert started["labels"] == {"compact", *detectors[2:]}  # a network goes on from round to round
    assert len(started["truth"]) == 3  # and so does the one that is taught by truth,
    assert started["labels"] & started["truth"] == {"compact"}  # apart from it, and no robot goes by it
    page = (tmp_path / "docs" / "results.md").read_text()
    assert "| 2 |" in page
    monkeypatch.setattr(training_loop, "train_one_epoch", None)  # a second run has nothing left to do
    assert run(tmp_path, "never_ending", 2)["loops"] == content["loops"]
    capsys.readouterr()


@pytest.mark.slow
@pytest.mark.usefixtures("never_collapses")
@pytest.mark.parametrize("comes_back", [False, True])
def test_scenes_are_labelled_with_all_that_has_been_seen_of_them(
    comes_back: bool,
    small_rooms: list,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if not comes_back:
        others = iter("ab")
        monkeypatch.setattr(rounds, "_scene", lambda episode: next(others))
    learnt: list[Any] = []

    def train(jobs, context):
        learnt.extend(jobs)
        return ["compact"] * len(jobs)

    monkeypatch.setattr("experiments.cache.detector_stages.train_detectors", train)
    monkeypatch.setattr("experiments.loops.never_ending.machines", lambda names: [])
    run(tmp_path, "never_ending", 1)
    gathered = [path for path in (tmp_path / "cache" / "episodes").iterdir() if "_loop-" in path.name]
    kinds = sorted(sorted(folder.name[:2] for folder in path.iterdir()) for path in gathered)
    first, second = ["01"], ["02"]
    if comes_back:  # what the first round has seen is labelled by what the second has seen, too
        assert kinds == [first, first + second]
    else:
        assert kinds == [first, second]
    sets = [read_label_set(file.parent) for file in tmp_path.glob("cache/labels/*/label_set.json")]
    sources = [one.provenance["sources"] for one in sets]
    assert {(one["detector"], one["with_recorded"]) for one in sources} == {("compact", False)}  # the teacher stays
    for labels, truth in zip(learnt[::2], learnt[1::2], strict=True):
        assert [one.file.resolve() for one in labels.learn] == [one.file.resolve() for one in truth.learn]
        assert [one.annotations for one in labels.learn] != [one.annotations for one in truth.learn]
        assert (labels.train, labels.seed, labels.augment) == (truth.train, truth.seed, truth.augment)
    episodes = [sorted({one.file.parent.parent.name[:2] for one in job.learn}) for job in learnt[::2]]
    assert episodes == [["01"], ["01", "02"]]
    for picture in learnt[-1].learn:
        episode = read_episode(picture.file.parent.parent)
        view = episode.file_names.index(f"rgb/{picture.file.name}")
        true = [one for one in episode.ground_truth or () if one.view_index == view]
        assert sorted(one.category for one in picture.annotations) == sorted(one.category for one in true)
    capsys.readouterr()


@pytest.mark.slow
@pytest.mark.usefixtures("never_collapses")
def test_a_loop_goes_further_from_where_it_was(
    small_rooms: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    learnt: list[list[Any]] = []

    def train(jobs, context):
        learnt.append(list(jobs))
        return ["compact"] * len(jobs)

    monkeypatch.setattr("experiments.cache.detector_stages.train_detectors", train)
    monkeypatch.setattr("experiments.loops.never_ending.machines", lambda names: [])
    shorter = run(tmp_path, "never_ending", 1)
    files = set((tmp_path / "cache").rglob("*"))
    longer = run(tmp_path, "never_ending", 1, "--rounds", str(SIZES["smoke"].rounds + 1))
    for content, rounds_gone in ((shorter, SIZES["smoke"].rounds), (longer, SIZES["smoke"].rounds + 1)):
        assert content["size"]["rounds"] == len(content["loops"][0]["rounds"]) == rounds_gone
    assert longer["loops"][0]["rounds"][:-1] == shorter["loops"][0]["rounds"]
    assert learnt[: SIZES["smoke"].rounds] == learnt[SIZES["smoke"].rounds : -1]  # no training is another one for it
    assert files < set((tmp_path / "cache").rglob("*"))
    page = (tmp_path / "docs" / "results.md").read_text()
    assert "| 3 |" in page
    capsys.readouterr()


@pytest.mark.nightly
@pytest.mark.usefixtures("never_collapses")
def test_parts_of_a_loop_are_taught_in_as_many_batches(
    small_rooms: list, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = run(tmp_path, "never_ending_parts", 1)
    assert [row["name"] for row in content["rows"]] == [
        loop_parts.BEFORE,
        loop_parts.THE_LOOP,
        loop_parts.AT_ONCE,
        loop_parts.FIRST_HOMES,
        loop_parts.TRUE_AT_ONCE,
        loop_parts.TRUE_LOOP,
    ]
    assert all(0 <= run["mask_ap50"] <= 1 for row in content["rows"] for run in row["runs"])
    of_round = TRAIN_SIZES["smoke"].train.iterations
    once = {loop_parts.AT_ONCE, loop_parts.FIRST_HOMES, loop_parts.TRUE_AT_ONCE}
    found = {one["about"]["labels"]: one for one in trained(tmp_path)}
    assert {found[name]["about"]["started_from"] for name in once} == {"compact"}
    assert {found[name]["train"]["iterations"] for name in once} == {SIZES["smoke"].rounds * of_round}
    capsys.readouterr()


@pytest.mark.slow
def test_a_collapse_ends_the_loop_before_anything_is_learnt_from_it(
    small_rooms: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rounds, "label_statistics", lambda pictures: LabelStatistics(0.0, 0.0, {}))
    monkeypatch.setattr(training_loop, "train_one_epoch", None)
    (loop,) = run(tmp_path, "never_ending", 1)["loops"]
    assert loop["stopped"] == "there are no labels"
    assert [set(one) for one in loop["rounds"]] == [{"round", "labels", "errors", "signs"}]
    counts = loop["rounds"][0]["errors"]["categories"]
    assert set(counts) == set(known_categories())  # also those that no label is of
    assert all(one["false"] <= one["labels"] and one["missing"] <= one["objects"] for one in counts.values())
    assert any(one["objects"] for one in counts.values())
    assert "there are no labels" in (tmp_path / "docs" / "results.md").read_text()
    capsys.readouterr()


def test_the_loop_goes_round_at_least_five_times() -> None:
    assert SIZES["quick"].rounds >= 5
    assert SIZES["full"].rounds >= 5
