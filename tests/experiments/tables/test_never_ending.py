"""The never-ending loop: every round starts from the detector of the one before, and collapses are told from labels."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.run import main
from experiments.tables import never_ending
from experiments.tables.never_ending import SIZES, collapse_reason, label_statistics
from experiments.tables.never_ending import LabelStatistics as Statistics
from labeling.detectors.data.annotated_pictures import AnnotatedPicture, Annotation
from labeling.io.label_set import read_label_set
from labeling.training import loop as training_loop
from labeling.training.config import CONFIG_FILE

STEADY = Statistics(3.0, 0.7, {"chair": 0.6, "table": 0.4})


@pytest.mark.nightly
def test_rounds_begin_elsewhere_with_the_detector_of_the_round_before(
    small_rooms: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(never_ending, "collapse_reason", lambda rounds: None)
    places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    assert main(["never_ending", "--scale", "smoke", "--seeds", "2", "--workers", "1", *places]) == 0
    content = json.loads((tmp_path / "results" / "never_ending.json").read_text())
    for seed, loop in enumerate(content["loops"]):
        assert (loop["seed"], loop["stopped"]) == (seed, None)
        assert [one["round"] for one in loop["rounds"]] == [1, 2]
        assert all(0 <= one["test"]["mask_ap50"] <= 1 for one in loop["rounds"])
    pools = [pool for pool in small_rooms if "round" in pool.name]
    assert {pool.split for pool in pools} == {"endless"}
    assert len({(pool.name, pool.seed) for pool in pools}) == len(pools) == 2 * 2 * 2
    detectors = [pool.detector for pool in pools if pool.name.endswith("learn")]
    assert detectors[:2] == ["compact", "compact"]  # rounds of all seeds go side by side
    assert len({*detectors[2:], "compact"}) == 3
    runs = [json.loads(file.read_text()) for file in (tmp_path / "cache" / "detectors").glob(f"*/{CONFIG_FILE}")]
    started = {one["about"]["started_from"] for one in runs}
    assert len(runs) == 4
    assert started == {"compact", *detectors[2:]}  # a network goes on from round to round
    sets = [read_label_set(file.parent) for file in (tmp_path / "cache" / "labels").glob("*/label_set.json")]
    assert len(sets) == 2  # one of each seed, which grows
    sources = [one.provenance["sources"] for one in sets]
    assert [(one["detector"], one["with_recorded"]) for one in sources] == [("compact", False)] * 2  # the teacher stays
    assert {pool.episodes_per_scene for pool in pools} == {3}
    gathered = [path for path in (tmp_path / "cache" / "episodes").iterdir() if "_loop-" in path.name]
    kinds = [sorted(folder.name[:8] for folder in path.iterdir()) for path in gathered]
    assert kinds == [["01-choos", "01-learn", "02-choos", "02-learn"]] * 2  # a second round labels the first's, too
    page = (tmp_path / "docs" / "results.md").read_text()
    assert "| 2 |" in page
    monkeypatch.setattr(training_loop, "train_one_epoch", None)  # a second run has nothing left to do
    assert main(["never_ending", "--scale", "smoke", "--seeds", "2", "--workers", "1", *places]) == 0
    assert json.loads((tmp_path / "results" / "never_ending.json").read_text())["loops"] == content["loops"]
    capsys.readouterr()


@pytest.mark.slow
def test_a_collapse_ends_the_loop_before_anything_is_learnt_from_it(
    small_rooms: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(never_ending, "label_statistics", lambda pictures: Statistics(0.0, 0.0, {}))
    monkeypatch.setattr(training_loop, "train_one_epoch", None)
    places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    assert main(["never_ending", "--scale", "smoke", "--seeds", "1", "--workers", "1", *places]) == 0
    (loop,) = json.loads((tmp_path / "results" / "never_ending.json").read_text())["loops"]
    assert loop["stopped"] == "there are no labels"
    assert [set(one) for one in loop["rounds"]] == [{"round", "labels", "signs"}]
    assert "there are no labels" in (tmp_path / "docs" / "results.md").read_text()
    capsys.readouterr()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: Statistics(0.0, 0.0, {}), "no labels"),
        (lambda s: Statistics(1.4, s.confidence, s.shares), "from 3.00 to 1.40"),
        (lambda s: Statistics(s.labels_per_view, 0.5, s.shares), "from 0.70 to 0.50"),
        (
            lambda s: Statistics(s.labels_per_view, s.confidence, {"chair": 0.9, "table": 0.1}),
            "90% of all labels are chair",
        ),
    ],
)
def test_each_way_to_collapse_is_named(change: Callable[[Statistics], Statistics], says: str) -> None:
    said = collapse_reason([STEADY, STEADY, change(STEADY)])
    assert said is not None
    assert says in said


def test_what_was_one_sided_from_the_start_is_no_collapse() -> None:
    streets = Statistics(3.0, 0.7, {"car": 0.95, "bus": 0.05})
    assert collapse_reason([streets, streets]) is None


@given(st.lists(st.floats(0.5, 5.0), min_size=1, max_size=6), st.floats(0.0, 1.0))
def test_rounds_that_only_get_better_never_collapse(counts: list[float], confidence: float) -> None:
    rounds = [Statistics(count, confidence, STEADY.shares) for count in sorted(counts)]
    assert collapse_reason(rounds) is None


def picture(*labels: tuple[str, float, bool]) -> AnnotatedPicture:
    """Labels by category, weight, and whether they are regions to ignore."""
    annotations = tuple(Annotation(name, {}, weight, ignore) for name, weight, ignore in labels)
    return AnnotatedPicture(Path("view.png"), (4, 4), annotations)


def test_label_statistics_count_labels_and_leave_out_regions_to_ignore() -> None:
    found = label_statistics([picture(("chair", 0.8, False), ("table", 0.4, False), ("couch", 0.9, True)), picture()])
    assert found.labels_per_view == pytest.approx(1.0)
    assert found.confidence == pytest.approx(0.6)
    assert found.shares == {"chair": pytest.approx(0.5), "table": pytest.approx(0.5)}


def test_the_loop_goes_round_at_least_five_times() -> None:
    assert SIZES["quick"].rounds >= 5
    assert SIZES["full"].rounds >= 5
