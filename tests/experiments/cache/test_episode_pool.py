"""Episodes of several pools as one dataset."""

from dataclasses import replace
from pathlib import Path

import pytest

from agents.rollouts.recorder import collect_episodes
from experiments.cache import episode_pool
from experiments.cache.episode_pool import EpisodePool, link_dataset, record
from experiments.cache.stages import RunContext
from labeling.io.episodes import find_episodes
from labeling.runtime.code_digest import ROOT, reached_code


@pytest.fixture
def sources(tmp_path: Path) -> dict[str, Path]:
    """Two folders of one name, as pools have them."""
    found = {}
    for pool in ("first", "second"):
        folder = tmp_path / pool / "0000"
        (folder / "rgb").mkdir(parents=True)
        (folder / "rgb" / "0.txt").write_text(pool)
        found[pool] = folder
    return found


def contents(folders: list[Path]) -> dict[str, str]:
    return {folder.name: (folder / "rgb" / "0.txt").read_text() for folder in folders}


@pytest.mark.parametrize("links", [True, False])
def test_episodes_of_several_pools_come_together(
    sources: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool
) -> None:
    def refuse(source: str, target: str) -> None:
        raise OSError("no links here")

    if not links:
        monkeypatch.setattr(episode_pool.os, "link", refuse)
    context = RunContext("smoke", (0,), 1, tmp_path / "cache")
    wanted = {"b": sources["first"], "a": sources["second"]}
    folders = link_dataset("both", wanted, context)
    assert contents(folders) == {"a": "second", "b": "first"}
    assert [folder.parent.name for folder in folders] == ["both", "both"]
    assert contents(link_dataset("both", wanted, context)) == contents(folders)


def test_what_is_not_asked_for_goes_and_what_was_cut_short_is_made_anew(
    sources: dict[str, Path], tmp_path: Path
) -> None:
    context = RunContext("smoke", (0,), 1, tmp_path / "cache")
    (first,) = link_dataset("some", {"old": sources["first"]}, context)
    (first.parent / ".new").mkdir()
    (first.parent / ".new" / "half").write_text("")
    folders = link_dataset("some", {"new": sources["second"]}, context)
    assert contents(folders) == {"new": "second"}
    assert [path.name for path in first.parent.iterdir()] == ["new"]
    assert contents([sources["first"]]) == {"0000": "first"}


@pytest.mark.nightly
def test_a_small_pool_is_a_dataset_of_its_own_where_a_larger_one_has_been(tmp_path: Path) -> None:
    context = RunContext("smoke", (0,), 1, tmp_path / "cache")
    pool = EpisodePool("rooms", "sbm_gym/IndoorBuiltin-v0", "train", 1, policy="spin")
    before = record(pool, context)
    larger = record(replace(pool, episodes=2), context)
    assert [folder.parent for folder in larger] == [before[0].parent] * 2
    (after,) = record(pool, context)
    assert [one.name for one in find_episodes(after.parent)] == [after.name] == [before[0].name]
    assert (after / "episode.json").read_bytes() == (before[0] / "episode.json").read_bytes()


@pytest.mark.slow
def test_neither_settings_of_labels_nor_training_decide_how_episodes_are_recorded() -> None:
    # Labels or losses that are improved must not have all episodes recorded anew.
    reached = {path.relative_to(ROOT).as_posix() for path in reached_code(collect_episodes).contents()}
    assert "labeling/generator/objects/object_posterior.py" in reached  # whose judgement the robot makes as it goes
    decide_labels = ("labeling/generator/settings/", "labeling/generator/propagate.py")
    assert not [name for name in reached if name.startswith(decide_labels)]
    assert "labeling/detectors/networks/mask_rcnn.py" in reached  # whose detections guide it
    assert not [name for name in reached if name.startswith("labeling/detectors/networks/losses.py")]
