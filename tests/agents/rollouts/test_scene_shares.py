"""Scenes to learn from, to choose by and to compare in never meet."""

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.rollouts.scene_shares import Purpose, scenes_for
from sbm_gym.worlds.splits import INTERIORS, TOWNS

PURPOSES = get_args(Purpose)


@given(st.integers(0, 4000))
def test_shares_are_all_scenes_each_once_and_in_order(count):
    names = tuple(map(str, range(count)))
    shares = [scenes_for(purpose, "endless", names) for purpose in PURPOSES]
    assert tuple(name for share in shares for name in share) == names
    assert len(shares[1]) == len(shares[2]) <= len(shares[0])


@pytest.mark.parametrize("names", [INTERIORS, TOWNS])
def test_there_are_hundreds_to_choose_by_and_to_compare_in_and_none_is_of_another_split(names):
    scenes = names.of_split("endless")
    for purpose in ("choosing", "comparing"):
        share = scenes_for(purpose, "endless", scenes)
        assert len(share) == 500
        assert not set(share) & set(scenes[:99_000])
        assert not any(set(share) & set(names.of_split(split)) for split in ("train", "val", "test", "wide"))


@pytest.mark.parametrize("purpose", PURPOSES)
def test_other_splits_are_for_one_thing_already(purpose):
    assert scenes_for(purpose, "val", ["a", "b"]) == ("a", "b")
