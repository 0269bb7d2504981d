"""A run goes on with the settings it was begun with, and never in a folder of something else."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from labeling.core.errors import SbmError, UsageError
from labeling.io.file_names import TRANSFORMS_FILE
from labeling.io.recordings.layouts import LAYOUTS
from labeling.runtime.run_folder import OTHER_RECORDINGS, RECORDING_FILE, as_options, claim_run_folder

FILE = "settings.json"
SETTINGS = {"env": "a", "seed": 1, "steps": 10}


def decisive(content):
    return as_options({name: content.get(name, 0) for name in ("env", "seed", "new_one")})


def test_settings_are_written_once_and_the_same_go_on(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "run"
    claim_run_folder(folder, FILE, SETTINGS)
    written = (folder / FILE).stat().st_mtime_ns
    (folder / "result").write_text("")
    claim_run_folder(folder, FILE, dict(SETTINGS))
    assert json.loads((folder / FILE).read_text()) == SETTINGS
    assert (folder / FILE).stat().st_mtime_ns == written


@pytest.mark.parametrize(
    ("change", "says"),
    [({"seed": 2}, "--seed 1 there, 2 now"), ({"env": "b"}, "--env a there, b now"), ({"new_one": 3}, "--new-one 0")],
)
def test_others_are_refused_and_what_differs_is_named(tmp_path: Path, change: dict, says: str) -> None:
    claim_run_folder(tmp_path, FILE, SETTINGS, decisive)
    with pytest.raises(UsageError, match="other settings") as caught:
        claim_run_folder(tmp_path, FILE, {**SETTINGS, **change}, decisive, "episodes")
    assert says in str(caught.value)
    assert "holds episodes" in str(caught.value)
    assert json.loads((tmp_path / FILE).read_text()) == SETTINGS


def test_what_does_not_decide_may_change_and_is_noted(tmp_path: Path) -> None:
    claim_run_folder(tmp_path, FILE, SETTINGS, decisive)
    claim_run_folder(tmp_path, FILE, {**SETTINGS, "steps": 20}, decisive)
    assert json.loads((tmp_path / FILE).read_text())["steps"] == 20


def test_folders_of_something_else_are_refused(tmp_path: Path) -> None:
    (tmp_path / "holiday.txt").write_text("")
    with pytest.raises(UsageError, match="not made by this program"):
        claim_run_folder(tmp_path, FILE, SETTINGS)
    with pytest.raises(UsageError, match="is a file; --out is a folder for episodes"):
        claim_run_folder(tmp_path / "holiday.txt", FILE, SETTINGS, results="episodes")
    (tmp_path / FILE).write_text("[1")
    with pytest.raises(SbmError, match=FILE):
        claim_run_folder(tmp_path, FILE, SETTINGS)


def test_what_a_kill_left_before_the_settings_were_there_is_no_obstacle(tmp_path: Path) -> None:
    program = (
        "import os, sys; from pathlib import Path; from labeling.formats.atomic import atomic_file\n"
        f"with atomic_file(Path(sys.argv[1]) / {FILE!r}) as file: file.write_text('half'); os._exit(9)"
    )
    assert subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=False).returncode == 9
    assert len(list(tmp_path.iterdir())) == 1
    claim_run_folder(tmp_path, FILE, SETTINGS)
    assert json.loads((tmp_path / FILE).read_text()) == SETTINGS
    assert [path.name for path in tmp_path.iterdir()] == [FILE]


def test_folders_that_cannot_be_written_to_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot write to"):
        claim_run_folder(tmp_path / "file" / "run", FILE, SETTINGS)


def test_nothing_is_begun_inside_a_recording(tmp_path):
    assert RECORDING_FILE == TRANSFORMS_FILE
    (tmp_path / "capture").mkdir()
    (tmp_path / "capture" / "transforms.json").write_text("{}")
    with pytest.raises(UsageError, match=r"lies inside the recording .*capture; give an --out outside of it"):
        claim_run_folder(tmp_path / "capture" / "deep" / "labels", "settings.json", {})
    assert [path.name for path in (tmp_path / "capture").iterdir()] == ["transforms.json"]


def test_the_marks_of_recordings_are_those_of_all_layouts() -> None:
    assert {(RECORDING_FILE,), *OTHER_RECORDINGS} == {layout.marks for layout in LAYOUTS}
