"""Groups of a scene that are not labelled as one: why is told, and what is done is kept."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from labeling.core.episode import Episode
from labeling.generate import main
from labeling.generator.label_jobs import Job
from labeling.generator.sharing import label_together
from labeling.generator.sharing.label_together import GroupJob
from labeling.io.episodes import write_episode

from ...synthetic_room import make_episode, pick


@pytest.fixture(scope="module")
def whole() -> Episode:
    return make_episode(3, num_views=6, size=(48, 64), num_objects=3, confident_share=2.0)


@pytest.fixture
def dataset(whole: Episode, tmp_path: Path) -> Path:
    """Two visits of a room."""
    for number, views in enumerate(([0, 2, 4], [1, 3, 5])):
        visit = replace(pick(whole, views), metadata={"world": "rooms", "scene": "room_3"})
        write_episode(tmp_path / "visits" / f"visit_{number}", visit)
    return tmp_path / "visits"


def label(dataset: Path, code: int = 0) -> dict[str, dict]:
    """What ``label_set.json`` says of each episode."""
    out = dataset.parent / "labels"
    assert main([str(dataset), "--share-scenes", "--out", str(out)]) == code
    return {one["name"]: one for one in json.loads((out / "label_set.json").read_text())["episodes"]}


def why_alone(episode: dict) -> list[str]:
    start = "labelled by itself, not with other episodes of its scene: "
    return [note.removeprefix(start) for note in episode["notes"] if note.startswith(start)]


@pytest.mark.slow
def test_episodes_that_are_labelled_together_have_no_such_note(dataset: Path) -> None:
    found = label(dataset)
    assert [why_alone(found[f"visit_{number}"]) for number in (0, 1)] == [[], []]


@pytest.mark.slow
def test_pictures_of_two_sizes(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = make_episode(3, num_views=3, size=(36, 48), num_objects=3, confident_share=2.0)
    write_episode(dataset / "visit_1", replace(small, metadata={"world": "rooms", "scene": "room_3"}))
    for _ in range(2):  # labelled, and read from records
        found = label(dataset)
        assert [why_alone(one) for one in found.values()] == [["their pictures differ in size"]] * 2
        assert "note: visit_0: labelled by itself" in capsys.readouterr().err


def test_too_many_pixels(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(label_together, "MAX_PIXELS", 5 * 48 * 64)
    expected = ["all their views have more than 15,360 pixels"]
    assert [why_alone(one) for one in label(dataset).values()] == [expected] * 2


def test_what_cannot_be_done_together(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_):
        raise MemoryError("no room\nfor all of them")

    monkeypatch.setattr(label_together, "join_episodes", fails)
    expected = ["this failed (MemoryError: no room for all of them)"]
    assert [why_alone(one) for one in label(dataset).values()] == [expected] * 2


def test_the_only_one_that_can_be_read(dataset: Path) -> None:
    (dataset / "visit_1" / "rgb" / "001.png").write_bytes(b"no picture")
    found = label(dataset, code=2)
    assert why_alone(found["visit_0"]) == ["these could not be labelled"]
    assert (found["visit_1"]["status"], found["visit_1"]["notes"]) == ("failed", [])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("about", "why"),
    [({}, "its episode.json names no scene"), ({"scene": "room_4"}, "there is no other one here")],
)
def test_no_other_episode_of_the_scene(dataset: Path, about: dict[str, str], why: str) -> None:
    (dataset / "visit_1" / "episode.json").write_text(json.dumps(about))
    found = label(dataset)
    assert why_alone(found["visit_1"]) == [why]
    assert why_alone(found["visit_0"]) == ["there is no other one here"]


@pytest.mark.slow
def test_a_group_with_an_unreadable_episode_is_labelled_once(whole: Episode, dataset: Path) -> None:
    """And anew when that one has been mended, or another has changed."""
    third = replace(pick(whole, [0, 1, 2]), metadata={"world": "rooms", "scene": "room_3"})
    write_episode(dataset / "visit_2", third)
    broken = dataset / "visit_1" / "rgb" / "001.png"
    picture = broken.read_bytes()
    broken.write_bytes(b"no picture")

    def clouds() -> dict[str, int]:
        return {file.name: file.stat().st_mtime_ns for file in (dataset.parent / "labels" / "clouds").iterdir()}

    first = label(dataset, code=2)
    before = clouds()
    assert len(before) == 2
    assert label(dataset, code=2) == first
    assert clouds() == before
    broken.write_bytes(picture)
    assert {one["status"] for one in label(dataset).values()} == {"labelled"}
    assert not before.items() & clouds().items()


@pytest.mark.slow
def test_a_cluster_is_not_asked_for_a_group_that_is_done_but_for_an_unreadable_episode(dataset: Path) -> None:
    (dataset / "visit_1" / "rgb" / "001.png").write_bytes(b"no picture")
    folders = sorted(dataset.iterdir())
    work = GroupJob(Job(dataset, dataset.parent / "labels"))
    assert work.kept(folders) is None
    done = work.label_group(folders)
    assert [one.record is None for one in done] == [False, True]
    assert work.kept(folders) == done
