"""The thesis' tables run end to end, learn nothing from test scenes, and share what they have in common."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from experiments.ablations import label_modes
from experiments.cache.registry import experiments
from experiments.cache.stages import RunContext, Scale
from experiments.cache.worlds import SIZES, WORLDS
from experiments.figures.result_values import MEANS
from experiments.pages.results import BOXES, LOOPS, TITLES
from experiments.run import main
from experiments.tables.thesis_tables import TABLES, Row, Table, only, over_shared_categories
from experiments.tables.training_sets import (
    ANNOTATED,
    LABEL_RECIPES,
    PARTS,
    SPLITS,
    TRUTH,
    Student,
    TrainingSets,
    annotated_views,
)
from labeling.core.rle import decode_mask
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.finetune import FinetuneCommand
from labeling.io.episodes import read_episode, write_episode
from labeling.io.label_set import read_label_set
from labeling.training import loop as training_loop
from labeling.training.config import CONFIG_FILE
from sbm_gym.assets.models.classes import NOVEL_CATEGORIES
from sbm_gym.worlds.splits import INTERIORS, TOWNS, SceneNames

from ...labeling.synthetic_room import make_episode


@pytest.mark.nightly
def test_every_table_runs_resumes_and_reports(
    small_rooms: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    places = [f"--{name}={tmp_path / name}" for name in ("cache", "results", "docs")]
    assert main(["table_5_3", "--scale", "smoke", "--seeds", "1", "--workers", "1", *places]) == 0
    context = RunContext("smoke", (0,), 1, tmp_path / "cache")
    contents, taught = {}, {}
    for name, table in TABLES.items():
        before = len(small_rooms)
        contents[name] = dataclasses.replace(table, world="rooms").run(context)
        asked = [pool for pool in small_rooms[before:] if pool.name in ("rooms_learn", "rooms_choose")]
        taught[name] = {pool.split for pool in asked}
    assert json.loads((tmp_path / "results" / "table_5_3.json").read_text())["rows"] == contents["table_5_3"]["rows"]
    for name, table in TABLES.items():
        assert [row["name"] for row in contents[name]["rows"]] == [row.name for row in table.rows]
    assert taught == {name: {"endless" if table.endless else "train"} for name, table in TABLES.items()}
    assert {pool.split for pool in small_rooms if pool.name == "rooms_test"} == {"test"}
    assert contents["table_5_2"]["machines"] == []
    assert contents["table_5_1"]["machines"] == contents["table_5_3"]["machines"] != []
    # What two tables have in common is the same in both.
    rows = {name: {row["name"]: row["runs"] for row in content["rows"]} for name, content in contents.items()}
    assert rows["table_5_3"]["pre-trained"] == rows["table_a_1"]["pre-trained"]
    assert rows["table_5_3"]["SbM fine-tuned"] == rows["table_a_1"]["SbM without consistency"]
    assert rows["table_5_2"]["SbM labels"] == rows["table_5_4"]["SbM labels"]
    presets = label_modes.DETECTORS.run(context)
    assert [row["name"] for row in presets["rows"]] == [row.name for row in label_modes.DETECTORS.rows]
    found = {row["name"]: row["runs"] for row in presets["rows"]}
    assert found["fine-tuned on default"] == rows["table_5_3"]["SbM fine-tuned"]
    page = (tmp_path / "docs" / "results.md").read_text()
    assert set(TABLES) <= set(TITLES)
    assert page.count("Has not been run yet") == len({*TITLES, *LOOPS, *BOXES}) - 1
    monkeypatch.setattr(training_loop, "train_one_epoch", None)  # a second run has nothing left to do
    assert TABLES["table_5_3"].run(context) == contents["table_5_3"]
    capsys.readouterr()


def test_some_tables_fine_tune_as_the_command_does_without_options(
    small_rooms: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = FinetuneCommand(labels=(tmp_path,), out=tmp_path)
    for scale in ("quick", "standard", "full"):
        size = SIZES[scale].as_command()
        assert dataclasses.replace(size.train, replay_share=command.train.replay_share) == command.train
        assert set(size.augment.values()) == {command.augment}
        assert size.episodes == SIZES[scale].episodes
    as_command = {name for name, table in TABLES.items() if table.as_command}
    assert as_command == {"table_5_3_pooled", "table_5_3_command", "table_5_3_doubts"}
    monkeypatch.setitem(SIZES, "smoke", dataclasses.replace(SIZES["smoke"], command=FinetuneConfig(iterations=3)))
    sets = [TrainingSets("rooms", RunContext("smoke", (0,), 1, tmp_path), as_command=flag) for flag in (True, False)]
    alone, replaying = (one.train_job(TRUTH, 0) for one in sets)
    assert alone.train.iterations == 3
    assert not alone.replay, "the command has no photographs"
    assert replaying.replay
    assert sets[0].photographs()[1], "forgetting is measured"


@pytest.mark.parametrize(("world", "scenes"), [("rooms", INTERIORS), ("streets", TOWNS)])
@pytest.mark.parametrize("each", [1, 3])
@pytest.mark.parametrize("scale", SIZES)
def test_a_table_may_learn_in_scenes_of_the_endless_split_none_of_which_it_is_told_in(
    scale: Scale, each: int, world: str, scenes: SceneNames, tmp_path: Path
) -> None:
    assert {name: table.endless for name, table in TABLES.items() if table.endless} == {
        "table_a_3_homes": 1,
        "table_5_1": 4,
        "table_5_1_wide": 4,
        "table_5_1_final": 4,
    }
    sets = TrainingSets(world, RunContext(scale, (0,), 1, tmp_path), new_categories=True, endless=each)
    pools = {subset: sets.pool(subset) for subset in SPLITS}
    assert {subset for subset, pool in pools.items() if pool.split == "endless"} == {"learn", "choose", "dev"}
    assert {subset for subset, pool in pools.items() if pool.episodes_per_scene == each} >= {"learn", "choose"}
    endless, begun = scenes.of_split("endless"), {}
    for subset in ("learn", "choose", "dev"):
        pool = pools[subset]
        order = np.random.default_rng([pool.seed, 0]).permutation(len(endless))
        begun[subset] = {endless[int(order[number // pool.episodes_per_scene])] for number in range(pool.episodes)}
        assert len(begun[subset]) == -(-pool.episodes // pool.episodes_per_scene)
    assert begun["learn"].isdisjoint(begun["dev"])
    assert begun["choose"].isdisjoint(begun["learn"] | begun["dev"])


@pytest.mark.parametrize("name", TABLES)
def test_only_training_scenes_teach(name: str) -> None:
    table: Table = TABLES[name]
    names = [row.name for row in table.rows]
    assert len(set(names)) == len(names)
    assert table.world in WORLDS
    assert {row.subset for row in table.rows} <= {*SPLITS, *PARTS}
    assert not any(row.labels and row.subset in PARTS for row in table.rows), "label sets are of one subset each"
    assert {row.labels for row in table.rows} <= {None, *LABEL_RECIPES}
    assert {row.teacher for row in table.rows} <= {None, *LABEL_RECIPES, TRUTH, ANNOTATED}
    scenes = {row.name: row.subset for row in table.rows}
    for compared in (*table.gaps, *table.above):
        assert len({scenes[row] for row in compared}) == 1, "over the same scenes, and so over the same categories"
    assert experiments()[name].description == table.description
    assert set(MEANS.get(name, {})) <= set(names), "the thesis' figures stand beside rows that there are"


@pytest.mark.nightly
def test_the_second_round_labels_what_the_detector_finds_that_the_first_has_taught(
    small_rooms: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sets = TrainingSets("rooms", RunContext("smoke", (0, 1), 1, tmp_path))
    first = sets.detectors([Student("shared", seed) for seed in (0, 1)])
    made = [read_label_set(sets.labels("learn", "second round", seed)) for seed in (0, 1)]
    assert [labels.provenance["sources"]["detector"] for labels in made] == first
    second = sets.detectors([Student("second round", seed) for seed in (0, 1)])
    assert len({*first, *second}) == 4
    started_from = [json.loads((Path(folder) / CONFIG_FILE).read_text())["about"]["started_from"] for folder in second]
    assert started_from == ["compact", "compact"]
    both = sets.labels("learn", "both detectors", 0)
    sources = read_label_set(both).provenance["sources"]
    assert (sources["detector"], sources["with_recorded"]) == (first[0], True)
    capsys.readouterr()


def test_labels_of_test_scenes_are_refused_as_training_sets(tmp_path: Path) -> None:
    sets = TrainingSets("rooms", RunContext("smoke", (0,), 1, tmp_path))
    assert (SPLITS["test"], SPLITS["wide"]) == ("test", "wide")
    with pytest.raises(ValueError, match="nothing may be trained"):
        sets.training_pictures("test", "sbm", 0)
    for subset in ("wide", "pooled"):
        with pytest.raises(ValueError, match="nothing may be trained"):
            sets.training_pictures(subset, "sbm", 0)


@pytest.mark.slow
def test_pooled_scenes_are_those_of_their_parts_ranked_together(
    small_rooms: list, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    context = RunContext("smoke", (0,), 1, tmp_path)
    table = Table("all there is", "rooms", (Row("pre-trained", "pooled"),))
    sets = TrainingSets("rooms", context)
    parts = [sets.pictures(part) for part in PARTS["pooled"]]
    assert sets.pictures("pooled") == [picture for part in parts for picture in part]
    content = table.run(context)
    assert {name: pool["split"] for name, pool in content["pools"].items()} == {"test": "test", "wide": "wide"}
    (run,) = content["rows"][0]["runs"]
    assert run["instances"] == {
        category: sum(
            one.category == category and not one.ignore
            for part in parts
            for picture in part
            for one in picture.annotations
        )
        for category in run["instances"]
    }
    capsys.readouterr()


def test_annotated_views_show_each_object_once_and_say_nothing_of_the_rest(tmp_path: Path) -> None:
    room = make_episode(4, 6, (64, 64), num_objects=5)
    write_episode(tmp_path / "0000", dataclasses.replace(room, name="0000"))
    truths = read_episode(tmp_path / "0000").ground_truth or ()
    large = {one.instance_id for one in truths if not one.ignore and one.modal.sum() >= 32}
    for seed in range(3):
        pictures = annotated_views([tmp_path / "0000"], seed)
        known, places = [], set()
        for picture in pictures:
            view = int(picture.file.stem)
            there = [one for one in truths if one.view_index == view]
            assert len(picture.annotations) == len(there)
            for one in picture.annotations:
                (truth,) = [t for t in there if np.array_equal(t.modal, decode_mask(one.rle))]
                assert one.category == truth.category
                if not one.ignore:
                    known.append(truth.instance_id)
                    places.add(view)
        assert sorted(known) == sorted(large)
        assert len(places) == len(pictures)


def test_means_are_over_the_categories_that_count() -> None:
    figures = {
        "mask_ap50": 0.9,
        "per_class_ap50": {"cushion": 0.2, "shelf": 0.4, "chair": 1.0, "beanbag": None},
        "per_class_ap30": {"cushion": 0.3, "shelf": 0.5, "chair": 1.0, "beanbag": None},
        "instances": {"cushion": 3, "shelf": 4, "chair": 5, "beanbag": 0},
    }
    found = only(NOVEL_CATEGORIES, figures)
    assert found["mask_ap50"] == pytest.approx(0.3)
    assert found["mask_ap30"] == pytest.approx(0.4)
    assert set(found["instances"]) == {"cushion", "shelf", "beanbag"}
    assert not any("box" in name for name in found)  # a mean over other categories says nothing of these
    boxes = {"box_ap50": 0.9, "per_class_box_ap50": {"cushion": 0.5, "shelf": 0.7, "chair": 1.0, "beanbag": None}}
    found = only(NOVEL_CATEGORIES, {**figures, **boxes})
    assert found["mask_ap50"] == pytest.approx(0.3)
    assert found["box_ap50"] == pytest.approx(0.6)
    assert found["per_class_box_ap50"] == {"cushion": 0.5, "shelf": 0.7, "beanbag": None}
    assert only(("plant",), figures)["mask_ap50"] is None


def test_rows_are_compared_over_the_categories_they_share() -> None:
    def run(**values: float) -> dict:
        return {
            "seed": 0,
            "mask_ap50": sum(values.values()) / len(values),
            "box_ap50": 0.5,
            "photographs_ap50": 0.8,
            "per_class_ap50": values,
            "per_class_ap30": values,
            "instances": dict.fromkeys(values, 20),
        }

    rows = {"few": [run(bed=0.2, chair=0.4)], "more": [run(bed=0.4, chair=0.6, shelf=1.0)]}
    found = over_shared_categories(rows, dict.fromkeys(rows, "test"))
    assert [found[name][0]["mask_ap50"] for name in rows] == pytest.approx([0.3, 0.5])
    assert set(found["more"][0]["instances"]) == {"bed", "chair"}
    assert found["more"][0]["photographs_ap50"] == 0.8
    assert "box_ap50" not in found["more"][0]
    assert found["few"] == rows["few"], "a row that loses no category loses no figure, such as COCO's AP"
    alike = {name: [run(bed=0.2)] for name in "ab"}
    assert over_shared_categories(alike, dict.fromkeys(alike, "test")) == alike
    elsewhere = {**alike, "c": [run(bed=0.2, bus=0.0)], "d": [run(bed=0.4, bus=0.2)]}
    scenes = {"a": "dev", "b": "dev", "c": "final", "d": "final"}
    assert over_shared_categories(elsewhere, scenes) == elsewhere, "dev scenes without buses hide none of the others"
