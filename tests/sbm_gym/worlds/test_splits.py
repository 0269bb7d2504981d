import pytest

from labeling.core.errors import UsageError
from sbm_gym.scenes.world_sources import IndoorWorlds, OutdoorWorlds
from sbm_gym.worlds.rooms.floor_plan import PROGRAMMES
from sbm_gym.worlds.splits import INTERIORS


def test_splits_have_the_thesis_sizes_and_share_neither_names_nor_seeds():
    assert [len(INTERIORS.of_split(split)) for split in ("train", "val", "test")] == [15, 1, 2]
    scenes = [(name, source.seed) for split in INTERIORS.named.values() for name, source in split.items()]
    assert len({name for name, _ in scenes}) == len({seed for _, seed in scenes}) == 18


def test_free_seeds_never_meet_named_scenes():
    named = {source.seed for split in INTERIORS.named.values() for source in split.values()}
    assert not named & {INTERIORS.resolve(seed)[1].seed for seed in (*range(100), 1000, 1001, 2000, 3000, 3001)}


def test_the_wide_split_is_apart_from_the_thesis_and_known_to_environments():
    for source, size in ((IndoorWorlds(), 40), (OutdoorWorlds(), 12)):
        wide = source.scenes("wide")
        assert len(set(wide)) == size
        assert not set(wide) & set(source.scenes(None))
        assert [source.canonical(name) for name in wide] == list(wide)
        assert source.scenes(None) == tuple(n for split in ("train", "val", "test") for n in source.scenes(split))


def test_the_endless_split_never_leads_to_a_scene_to_test_on():
    for source in (IndoorWorlds(), OutdoorWorlds()):
        endless = source.scenes("endless")
        assert len(set(endless)) == 100_000
        assert not set(endless) & {*source.scenes(None), *source.scenes("wide")}
        assert [source.canonical(name) for name in endless[::999]] == list(endless[::999])


def test_numbers_and_names_mean_the_same():
    assert INTERIORS.resolve(7) == INTERIORS.resolve("seed/7") == INTERIORS.resolve("seed/007")


def test_every_kind_exists():
    assert {source.kind for split in INTERIORS.named.values() for source in split.values()} == set(PROGRAMMES)


@pytest.mark.parametrize("name", ["train/15", "seed/-1", "kitchen", "", -3, True, 1.5])
def test_unknown_scenes_are_refused(name):
    with pytest.raises(UsageError, match="scene"):
        INTERIORS.resolve(name)


def test_unknown_splits_are_refused():
    with pytest.raises(UsageError, match="splits are train, val, test, wide, endless"):
        INTERIORS.of_split("dev")
