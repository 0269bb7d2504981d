"""What errors of labels cost: runs, resumes, never looks at test scenes, and its page says what its figures say."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.cache.origin import MADE_ON
from experiments.cache.worlds import SIZES
from experiments.pages.fine_tuning import gap_closed
from experiments.run import main
from experiments.tables import policies
from experiments.tables.fine_tuning import ALONE, INTERPOLATED, LABELS, TEACHERS, mended
from experiments.tables.label_errors import count_errors
from experiments.tables.training_sets import TRUTH
from labeling.core.rle import encode_mask
from labeling.detectors.data.annotated_pictures import AnnotatedPicture, Annotation
from labeling.training import loop as training_loop


@pytest.mark.nightly
def test_the_experiment_runs_resumes_and_reports(
    small_rooms: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run() -> int:
        places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
        return main(["fine_tuning", "--scale", "smoke", "--seeds", "1", "--workers", "1", *places])

    assert run() == 0
    written = tmp_path / "results" / "fine_tuning.json"
    content = json.loads(written.read_text())
    assert [(one["teacher"], one["seed"]) for one in content["runs"]] == [
        (teacher, 0) for teacher in (*TEACHERS, *ALONE.values(), *INTERPOLATED.values())
    ]
    assert set(content["before"]) == {"dev", "photographs"}
    pools = {pool.name: pool for pool in small_rooms if pool.name.startswith("rooms")}
    assert {name: pool.split for name, pool in pools.items()} == {
        "rooms_learn": "train",
        "rooms_dev": "endless",
    }
    assert {pool.detector for pool in pools.values()} == {"compact"}
    page = (tmp_path / "docs" / "fine-tuning.md").read_text()
    for category, counts in content["labels"][0]["categories"].items():
        assert "| " + " | ".join([category, *map(str, counts.values())]) + " |" in page
    assert (tmp_path / "docs" / "pictures" / "fine_tuning.png").stat().st_size > 1000
    monkeypatch.setattr(training_loop, "train_one_epoch", None)  # a second run has nothing left to do
    assert run() == 0
    assert {**json.loads(written.read_text()), MADE_ON: ""} == {**content, MADE_ON: ""}
    capsys.readouterr()


def square(left: int, side: int, category: str, weight: float = 1.0, ignore: bool = False) -> Annotation:
    mask = np.zeros((20, 40), bool)
    mask[2 : 2 + side, left : left + side] = True
    return Annotation(category, encode_mask(mask), weight, ignore)


def test_labels_are_mended_in_one_respect_after_the_other() -> None:
    file = Path("data/0001/rgb/000.png")
    chair, far = square(0, 10, "chair"), square(25, 6, "chair")
    truth = AnnotatedPicture(file, (20, 40), (chair, far, square(12, 8, "table")))
    near_chair, twice = square(0, 9, "chair", 0.8), square(0, 8, "chair", 0.2)
    wrong_name, unknown = square(12, 8, "chair", 0.6), square(32, 4, "chair", ignore=True)
    labels = AnnotatedPicture(file, (20, 40), (near_chair, twice, wrong_name, unknown))
    (without,) = mended([labels], [truth], true_masks=False)
    assert without.annotations == (unknown, near_chair)
    (exact,) = mended([labels], [truth], true_masks=True)
    assert exact.annotations == (unknown, replace(near_chair, rle=chair.rle))
    errors = count_errors([labels], [truth])
    assert errors["categories"] == {"chair": {"labels": 3, "false": 2, "objects": 2, "missing": 1}}
    assert errors["false_weight"] == pytest.approx(0.8 / 1.6)
    table = {"labels": 0, "false": 0, "objects": 1, "missing": 1}  # never labelled, but asked for
    assert count_errors([labels], [truth], ["table"]) == {**errors, "categories": {"table": table}}


def test_a_label_of_what_is_to_be_ignored_is_neither_right_nor_false() -> None:
    file = Path("data/0001/rgb/000.png")
    chair, sliver = square(0, 10, "chair"), square(25, 6, "chair", ignore=True)
    right, of_sliver = square(0, 9, "chair", 0.8), square(25, 5, "chair", 0.7)
    named_otherwise = square(25, 5, "table", 0.4)
    labels = AnnotatedPicture(file, (20, 40), (right, of_sliver, named_otherwise))
    truth = AnnotatedPicture(file, (20, 40), (chair, sliver))
    errors = count_errors([labels], [truth])
    assert errors["categories"]["chair"] == {"labels": 1, "false": 0, "objects": 1, "missing": 0}
    assert errors["categories"]["table"] == {"labels": 1, "false": 1, "objects": 0, "missing": 0}
    assert errors["false_weight"] == pytest.approx(0.4 / 1.2)
    (without,) = mended([labels], [truth], true_masks=False)
    assert without.annotations == (replace(of_sliver, ignore=True), right)


@pytest.mark.nightly
def test_every_policy_teaches_from_as_many_episodes_of_its_own(
    small_rooms: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(policies, "POLICIES", ("ring", "random"))
    places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    assert main(["policies", "--scale", "smoke", "--seeds", "2", "--workers", "1", *places]) == 0
    room = json.loads((tmp_path / "results" / "policies.json").read_text())["worlds"]["rooms"]
    assert [(one["policy"], one["seed"], one["teacher"]) for one in room["runs"]] == [
        (policy, seed, teacher) for policy in ("ring", "random") for seed in (0, 1) for teacher in ("labels", "truth")
    ]
    asked = {(pool.policy, pool.name, pool.seed): pool for pool in small_rooms if pool.name != "photographs"}
    assert set(asked) == {
        (policy, f"rooms_{part}", seed)
        for policy in ("ring", "random")
        for part, seed in (("learn", 0), ("learn", 100), ("dev", 20))
    }
    assert all(one.keys() >= {"views of ring", "views of random"} for one in (room["before"], *room["runs"]))
    assert asked["ring", "rooms_learn", 100] == replace(asked["random", "rooms_learn", 100], policy="ring")
    for one in room["labels"]:
        assert 0 <= one["errors"]["false_weight"] <= 1
        assert all(counts["false"] <= counts["labels"] for counts in one["errors"]["categories"].values())
    page = (tmp_path / "docs" / "policies-results.md").read_text()
    assert "False labels, those that lie on no object of their category" in page
    assert page.index("after labels of `random`") < page.index("after ground truth of the views of `random`")
    capsys.readouterr()


@pytest.mark.parametrize(
    ("policy", "seed", "moves"),
    [
        ("ring", 1, "ring"),
        ("ppo", 0, "ppo"),
        ("ppo", 2, "ppo_seed_2"),
        ("ppo_evidence", 1, "ppo_evidence_seed_1"),
        ("ppo", 99, "ppo"),
    ],
)
def test_a_policy_of_several_trainings_moves_as_the_one_from_the_same_seed(policy: str, seed: int, moves: str) -> None:
    assert policies.training_from_seed(policy, seed, "sbm_gym/Indoor-v0") == moves


def test_the_share_of_the_gap_is_that_of_means_over_seeds() -> None:
    def scored(ap50: float) -> dict:
        return {"dev": {"mask_ap50": ap50}}

    runs = [(LABELS, 0.4), (LABELS, 0.5), (TRUTH, 0.7), (TRUTH, 0.8), (ALONE[LABELS], 0.4), (ALONE[TRUTH], 0.5)]
    content = {"before": scored(0.3), "runs": [{"teacher": name, **scored(ap50)} for name, ap50 in runs]}
    assert gap_closed(content) == pytest.approx(0.15 / 0.45)
    assert gap_closed(content, names=ALONE) == pytest.approx(0.1 / 0.2)
    content["before"] = scored(0.9)
    assert gap_closed(content) is None


def test_every_scale_learns_and_chooses_on_something() -> None:
    for size in SIZES.values():
        assert all(min(counts) >= 1 for counts in size.episodes.values())
        size.train.check()
        assert set(size.episodes) <= set(size.augment)
        for augmentation in size.augment.values():
            augmentation.check()
