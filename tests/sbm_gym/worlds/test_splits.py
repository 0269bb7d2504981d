from typing import Any

import numpy as np
import pytest

from labeling.core.errors import UsageError
from sbm_gym.scenes.world_sources import IndoorWorlds, OutdoorWorlds
from sbm_gym.worlds.rooms.floor_plan import PROGRAMMES
from sbm_gym.worlds.splits import INTERIORS, TOWNS


def test_splits_have_the_thesis_sizes_and_share_neither_names_nor_seeds():
    assert [len(INTERIORS.of_split(split)) for split in ("train", "val", "test")] == [15, 1, 2]
    scenes = [(name, source.seed) for split in INTERIORS.named.values() for name, source in split.items()]
    assert len({name for name, _ in scenes}) == len({seed for _, seed in scenes}) == 18


def test_free_seeds_never_meet_named_scenes():
    named = {source.seed for split in INTERIORS.named.values() for source in split.values()}
    assert not named & {INTERIORS.resolve(seed)[1].seed for seed in (*range(100), 1000, 1001, 2000, 3000, 3001)}


@pytest.mark.parametrize("split", ["wide", "final"])
def test_the_large_splits_are_apart_from_all_others_and_known_to_environments(split):
    for source, size in ((IndoorWorlds(), 40), (OutdoorWorlds(), 12)):
        wide = source.scenes(split)
        assert len(set(wide)) == size
        assert not set(wide) & {*source.scenes(None), *source.scenes({"wide": "final", "final": "wide"}[split])}
        assert [source.canonical(name) for name in wide] == list(wide)
        assert source.scenes(None) == tuple(n for split in ("train", "val", "test") for n in source.scenes(split))


def test_the_endless_split_never_leads_to_a_scene_to_test_on():
    for source in (IndoorWorlds(), OutdoorWorlds()):
        endless = source.scenes("endless")
        assert len(set(endless)) == 100_000
        assert not set(endless) & {*source.scenes(None), *source.scenes("wide"), *source.scenes("final")}
        assert [source.canonical(name) for name in endless[::999]] == list(endless[::999])


def test_numbers_and_names_mean_the_same():
    assert INTERIORS.resolve(7) == INTERIORS.resolve("seed/7") == INTERIORS.resolve("seed/007")
    drawn: list[Any] = [np.int64(7), np.uint8(7)]  # what NumPy's generators give counts as int
    assert {INTERIORS.resolve(number) for number in drawn} == {INTERIORS.resolve(7)}


def test_every_kind_exists():
    assert {source.kind for split in INTERIORS.named.values() for source in split.values()} == set(PROGRAMMES)


def test_final_scenes_show_held_out_models_only_where_training_does_without_them():
    for names in (INTERIORS, TOWNS):
        for split, always in (("train", False), ("val", True), ("test", True), ("wide", False)):
            for unseen in (False, True):
                assert {names.shows_held_out(name, unseen) for name in names.of_split(split)} == {always}
        assert {names.shows_held_out(name, True) for name in names.of_split("final")} == {True}
        assert {names.shows_held_out(name, False) for name in names.of_split("final")} == {False}
        assert not names.shows_held_out(names.of_split("endless")[7], True)


@pytest.mark.parametrize("name", ["train/15", "seed/-1", "kitchen", "", -3, True, 1.5, np.True_, np.float64(3.0)])
def test_unknown_scenes_are_refused(name):
    with pytest.raises(UsageError, match="scene"):
        INTERIORS.resolve(name)


def test_unknown_splits_are_refused():
    with pytest.raises(UsageError, match="splits are train, val, test, wide, final, endless"):
        INTERIORS.of_split("dev")
