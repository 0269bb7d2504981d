"""Views before and after are chosen by a rule that counts what was found rightly and what was not."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.figures.before_after import ViewChange, draw, most_changed, net_true_positives
from labeling.core.types import Detection, GroundTruth


def square(left: int) -> np.ndarray:
    mask = np.zeros((10, 40), bool)
    mask[2:8, left : left + 6] = True
    return mask


def truth(number: int, left: int, category: str = "chair", ignore: bool = False) -> GroundTruth:
    return GroundTruth(0, number, category, square(left), ignore=ignore)


def seen(left: int, category: str = "chair", confidence: float = 0.8) -> Detection:
    return Detection(0, category, confidence, square(left))


TRUTHS = [truth(1, 0), truth(2, 10), truth(3, 20, "table"), truth(4, 30, ignore=True)]


@pytest.mark.parametrize(
    ("detections", "expected"),
    [
        ([], 0),
        ([seen(0)], 1),
        ([seen(1)], 1),
        ([seen(5)], -1),
        ([seen(0), seen(0, confidence=0.6)], 0),
        ([seen(0, "table")], -1),
        ([seen(30)], 0),
        ([seen(0), seen(10), seen(20, "table"), seen(30)], 3),
    ],
)
def test_an_object_counts_once_and_what_is_no_object_counts_against(detections: list, expected: int) -> None:
    assert net_true_positives(detections, TRUTHS) == expected


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(-4, 4)), min_size=1, max_size=30), st.integers(1, 4))
def test_the_views_shown_are_the_best_of_different_episodes_and_the_worst(views: list, best: int) -> None:
    pairs = [ViewChange(Path(str(episode)), view, gain, (), ()) for view, (episode, gain) in enumerate(views)]
    chosen = most_changed(pairs, best)
    gained = [one for one in chosen if one.gain > 0]
    lost = [one for one in chosen if one.gain <= 0]
    tops = sorted((max(p.gain for p in pairs if p.episode == e) for e in {p.episode for p in pairs}), reverse=True)
    assert [one.gain for one in gained] == [gain for gain in tops if gain > 0][:best]
    assert len({one.episode for one in gained}) == len(gained)
    least = min(one.gain for one in pairs)
    assert [one.gain for one in lost] == ([least] if least < 0 else [])


def test_square_and_wide_views_are_drawn(tmp_path: Path) -> None:
    from dataclasses import replace

    from labeling.io.episodes import read_episode, write_episode

    from ..labeling.synthetic_room import make_episode

    for name, size in (("square", (48, 48)), ("wide", (32, 96))):
        folder = tmp_path / name
        write_episode(folder, replace(make_episode(3, 2, size, num_objects=3), name=name))
        found = tuple(one for one in read_episode(folder).detections or () if one.view_index == 1)
        draw([ViewChange(folder, 1, 2, (), found), ViewChange(folder, 1, -1, found, ())], tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}.png").stat().st_size > 1000
