"""Whatever happens to an episode's files, labelling either works or says in one line what is wrong: never half."""

import copy
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from labeling.core.types import Detection
from labeling.generate import main
from labeling.inspection.checks import inspect_label_set
from labeling.io.episodes import write_episode

from .synthetic_room import make_episode

JSON_FILES = ("transforms.json", "detections.json", "ground_truth.json", "episode.json")
PICTURES = ("rgb/001.png", "depth/001.png")

ODD_VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 3),
    st.sampled_from([2**31, -(2**63), 10**30, 1e308, -1e308, 0.5, float("nan"), float("inf")]),
    st.text(max_size=8),
    st.sampled_from([[], {}, [[]], [None], {"size": [1, 1]}, "../../etc", "\0", "é" * 50, [1e9] * 6]),
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "room"
    room = make_episode(1, num_views=3, size=(48, 64), num_objects=2)
    sure = tuple(Detection(t.view_index, t.category, 0.95, t.modal) for t in room.ground_truth or () if t.modal.any())
    write_episode(folder, replace(room, detections=(*sure, *(room.detections or ()))))
    if not (folder / "episode.json").exists():
        (folder / "episode.json").write_text(json.dumps({"categories": list(room.categories)}))
    return folder


def places(value: Any, path: tuple = ()) -> list[tuple]:
    """All paths into a JSON value."""
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(below for key, child in children for below in places(child, (*path, key)))]


def damage_json(draw, text: str) -> str:
    content = json.loads(text)
    for _ in range(draw(st.integers(1, 3))):
        # The deepest paths by far outnumber the others: first how deep, then where.
        all_places = places(content)
        depth = draw(st.integers(0, max(len(place) for place in all_places)))
        path = draw(st.sampled_from([place for place in all_places if len(place) == depth] or [()]))
        if not path:
            content = draw(ODD_VALUES)
            continue
        parent = content
        for key in path[:-1]:
            parent = parent[key]
        action = draw(st.sampled_from(["replace", "delete", "repeat"]))
        if action == "replace":
            parent[path[-1]] = draw(ODD_VALUES)
        elif action == "delete":
            del parent[path[-1]]
        elif isinstance(parent, list):
            parent.append(copy.deepcopy(parent[path[-1]]))
        if not isinstance(content, dict | list):
            break
    return json.dumps(content)


def damage_bytes(draw, data: bytes) -> bytes:
    action = draw(st.sampled_from(["cut", "flip", "insert", "empty"]))
    if action == "empty" or not data:
        return b""
    at = draw(st.integers(0, len(data) - 1))
    if action == "cut":
        return data[:at]
    noise = draw(st.binary(min_size=1, max_size=12))
    return data[:at] + noise + data[at + (len(noise) if action == "flip" else 0) :]


@st.composite
def corruptions(draw, folder: Path) -> dict[str, bytes | None]:
    """New contents of one or two files of an episode; None for a file that is gone."""
    changed: dict[str, bytes | None] = {}
    for _ in range(draw(st.integers(1, 2))):
        name = draw(st.sampled_from((*JSON_FILES, "transforms.json", "detections.json", *PICTURES)))
        data = (folder / name).read_bytes()
        how = draw(st.sampled_from(["json", "json", "json", "bytes", "gone"]))
        if how == "gone":
            changed[name] = None
        elif how == "json" and name.endswith(".json"):
            changed[name] = damage_json(draw, data.decode()).encode()
        else:
            changed[name] = damage_bytes(draw, data)
    return changed


def check(corruption: dict[str, bytes | None], recorded: Path, root: Path, capsys) -> None:
    dataset, out = root / "data" / "room", root / "labels"
    shutil.copytree(recorded, dataset)
    for name, content in corruption.items():
        (dataset / name).unlink(missing_ok=True)
        if content is not None:
            (dataset / name).write_bytes(content)
    capsys.readouterr()
    code = main([str(dataset), "--out", str(out), "--iterations", "2"])
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error:")]
    assert code in (0, 2)
    assert (code == 2) == bool(errors)
    if (out / "label_set.json").exists():
        assert all("was not labelled" in problem for problem in inspect_label_set(out))
        states = json.loads((out / "label_set.json").read_text())["episodes"]
        assert [state["status"] for state in states] == ["labelled" if code == 0 else "failed"]
    else:
        assert code == 2
        assert not out.exists() or not any(path.is_file() for path in out.rglob("*"))
    assert not [path for path in root.rglob("*") if path.name.endswith(".tmp")]
    shutil.rmtree(root)


def corrupt(count: int, recorded: Path, factory: pytest.TempPathFactory, capsys) -> None:
    """Generates so many corruptions, the same ones every time."""

    @settings(
        max_examples=count,
        derandomize=True,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),  # pyright: ignore[reportArgumentType]
    )
    @given(corruptions(recorded))
    def each(corruption: dict[str, bytes | None]) -> None:
        check(corruption, recorded, factory.mktemp("spoilt"), capsys)

    each()


@pytest.mark.slow
def test_no_corruption_gives_a_traceback_or_half_a_label_set(recorded, tmp_path_factory, capsys) -> None:
    corrupt(40, recorded, tmp_path_factory, capsys)


@pytest.mark.nightly
def test_none_of_many_corruptions_gives_a_traceback_or_half_a_label_set(recorded, tmp_path_factory, capsys) -> None:
    corrupt(200, recorded, tmp_path_factory, capsys)


@pytest.mark.slow
def test_an_untouched_episode_is_labelled(recorded: Path, tmp_path: Path) -> None:
    assert main([str(recorded), "--out", str(tmp_path / "labels")]) == 0
    boxes = json.loads((tmp_path / "labels" / "boxes_3d.json").read_text())["boxes"]
    assert len(boxes) >= 1
    assert np.isfinite([box["extent"] for box in boxes]).all()
