"""Labels of what other detectors find: what is written, what is left alone, what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from experiments.detector_labels import _figures, main
from experiments.pages.detector_labels import page
from labeling.evaluation.compare import FIGURES, figures
from labeling.evaluation.detector_scores import score_episodes
from labeling.io.episodes import write_episode

from ..labeling.synthetic_room import make_episode


@pytest.mark.slow
def test_detections_and_labels_are_scored_on_copies(tmp_path: Path) -> None:
    rooms = tmp_path / "rooms"
    for number in range(2):
        about = {"world": "rooms", "scene": f"room/{number}", "detector": "drawn"}
        room = make_episode(number, num_views=3, size=(64, 64), num_objects=3, confident_share=2.0)
        write_episode(rooms / f"000{number}", replace(room, metadata=about))
    before = {file: file.read_bytes() for file in rooms.rglob("*") if file.is_file()}
    results, cache = tmp_path / "results.json", tmp_path / "cache"
    assert main(["compact", "--episodes", str(rooms), "--cache", str(cache), "--results", str(results)]) == 0
    assert {file: file.read_bytes() for file in rooms.rglob("*") if file.is_file()} == before
    content = json.loads(results.read_text())
    (record,) = content["detectors"]
    assert (record["detector"], record["dataset"], record["episodes"]) == ("compact", "rooms", 2)
    assert record["scenes"] == ["room/0", "room/1"]
    (looked_at,) = (cache / "episodes").iterdir()
    scored = score_episodes(looked_at)["detector"]
    assert record["detections"] == {name: round(scored[name], 4) for name in FIGURES}
    assert set(record["alone"]) == set(record["shared"]) == set(FIGURES)
    text = page(content)
    assert "`compact`" in text
    assert f"{100 * record['alone']['mask_ap50']:.1f}" in text
    # Recorded again into the same folder: these episodes are looked at, not those of before.
    anew = make_episode(7, num_views=2, size=(64, 64), num_objects=3, confident_share=2.0)
    write_episode(rooms / "0000", replace(anew, metadata={"world": "rooms", "scene": "room/7", "detector": "drawn"}))
    assert main(["compact", "--episodes", str(rooms), "--cache", str(cache), "--results", str(results)]) == 0
    (changed,) = json.loads(results.read_text())["detectors"]
    assert changed["scenes"] == ["room/1", "room/7"]
    views = sorted(len(list((one / "0000" / "rgb").iterdir())) for one in (cache / "episodes").iterdir())
    assert views == [2, 3]


def test_what_is_undefined_stays_so() -> None:
    undefined = _figures(figures([], [], []))
    assert undefined["mask_ap50"] is None
    record = {"detector": "x", "dataset": "d", "episodes": 1, "worlds": [], "scenes": ["a"]}
    text = page({"detectors": [record | dict.fromkeys(("detections", "alone", "shared"), undefined)]})
    assert "| - |" in text


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "give at least one DETECTOR"),
        (["compact"], "--episodes with at least one folder"),
        (["nobody", "--episodes", "rooms"], "unknown detector 'nobody'"),
    ],
)
def test_what_is_missing_is_one_line(arguments: list[str], says: str, capsys) -> None:
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert says in told
    assert len(told.splitlines()) == 1
