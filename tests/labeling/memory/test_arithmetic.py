"""Scene arithmetic on rooms of boxes: points exchanged in space, memories exchanged in features."""

import numpy as np
import pytest
import torch

from labeling.memory.networks.grnn import Grnn
from labeling.memory.networks.tower import Tower
from labeling.memory.view_prediction.arithmetic import Exchange, combine_points, combiner, score_arithmetic
from labeling.memory.view_prediction.reprojection import reproject_views
from labeling.memory.view_prediction.scenes import SmallScene, small_scene

from .orbits import orbit_episode, ring
from .test_networks import TINY, built


def room(seed: int, standing: tuple[int, ...]) -> SmallScene:
    return small_scene(f"toys_{seed}", orbit_episode(seed, ring(seed, 9), (128, 128), standing=standing), TINY)


def exchange(seed: int) -> Exchange:
    return Exchange(room(seed, (0, 1)), room(seed, (1,)), room(seed, (2,)), room(seed, (0, 2)))


def test_points_of_what_stands_in_b_go_and_those_of_c_come() -> None:
    exchanges = [exchange(seed) for seed in (1, 2)]
    nothing, points = (score_arithmetic(one, exchanges, 5, 3) for one in (None, combine_points))
    assert np.mean(points["changed_l1"]) < 0.5 * np.mean(nothing["changed_l1"])


def test_only_pixels_that_change_count_as_changed() -> None:
    one = exchange(3)
    same = Exchange(one.a, one.b, one.b, one.a)
    found = score_arithmetic(None, [same], 2, 4)
    assert found["l1"] == [0.0] * 4
    assert found["changed_l1"] == []
    everywhere = score_arithmetic(None, [one], 2, 4)
    assert 0 < len(everywhere["changed_l1"]) <= 4
    assert np.mean(everywhere["changed_l1"]) > 0.1 / 3  # each has changed by more than .1 in one colour of three
    assert np.mean(everywhere["l1"]) < np.mean(everywhere["changed_l1"])


def test_a_room_less_itself_with_another_is_the_other() -> None:
    one = exchange(4)
    a, c, asked = (scene.views([0, 2, 4, 6], 0) for scene in (one.a, one.c, one.answer))
    assert torch.equal(combine_points(a, a, c, asked), reproject_views(c, asked))


@pytest.mark.parametrize("model", ["grnn", "tower"])
def test_memories_are_subtracted_and_added(model: str) -> None:
    """Of the tower's sum of maps A - B + B is A; a 3-D memory besides has what B shows, where A has nothing."""
    network, one = built(model), exchange(5)
    a, b, asked = (scene.views([0, 3], 0) for scene in (one.a, one.b, one.answer))
    assert isinstance(network, Grnn | Tower)
    combine = combiner(network)
    with torch.inference_mode():
        plain = network(a, asked)[0].sigmoid()
    torch.testing.assert_close(combine(a, a, a, asked), plain, atol=1e-4, rtol=1e-4)
    if model == "tower":
        torch.testing.assert_close(combine(a, b, b, asked), plain, atol=1e-4, rtol=1e-4)
    assert not torch.allclose(combine(a, b, one.c.views([0, 3], 0), asked), plain, atol=1e-4)
