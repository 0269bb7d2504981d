"""Scenes to learn from and scenes to compare in never meet."""

import pytest

from agents.rollouts.scene_shares import LEARNT_FROM, scenes_to_compare_in
from sbm_gym.worlds.splits import INTERIORS, TOWNS


@pytest.mark.parametrize("names", [INTERIORS, TOWNS])
def test_there_are_hundreds_to_compare_in_which_nothing_else_is_done_in(names):
    scenes = names.of_split("endless")
    compared = set(scenes_to_compare_in("endless", scenes))
    assert len(compared) == 500
    assert set(scenes[:LEARNT_FROM]) == set(scenes) - compared
    assert not any(compared & set(names.of_split(split)) for split in ("train", "val", "test", "wide"))


@pytest.mark.parametrize(("count", "compared"), [(1, 1), (4, 1), (11, 2), (2000, 500), (2100, 500)])
def test_of_few_scenes_the_last_quarter_is_for_comparing(count, compared):
    names = tuple(map(str, range(count)))
    assert scenes_to_compare_in("endless", names) == names[count - compared :]


def test_other_splits_are_for_one_thing_already():
    assert scenes_to_compare_in("val", ["a", "b"]) == ("a", "b")
