"""Files appear whole or not at all, whatever interrupts the writer."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from labeling.formats import atomic
from labeling.formats.atomic import atomic_file, atomic_folder, finish_replacing, write_json

ROOT = Path(__file__).resolve().parents[4]


class InterruptionError(Exception):
    """Stands for anything that goes wrong while writing."""


def fail_after_writing(path: Path) -> None:
    path.write_text("half")
    raise InterruptionError


def contents(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_atomic_folder_appears_with_its_content_and_its_parents(tmp_path):
    with atomic_folder(tmp_path / "a" / "b") as temporary:
        (temporary / "file").write_text("new")
        assert not (tmp_path / "a" / "b").exists()
    assert contents(tmp_path) == {"a/b/file": "new"}


def test_atomic_folder_replaces_all_of_an_older_one(tmp_path):
    (tmp_path / "episode").mkdir()
    (tmp_path / "episode" / "stale").write_text("old")
    with atomic_folder(tmp_path / "episode") as temporary:
        (temporary / "fresh").write_text("new")
        assert contents(tmp_path / "episode") == {"stale": "old"}
    assert contents(tmp_path) == {"episode/fresh": "new"}


@pytest.mark.parametrize("existed", [True, False])
def test_an_error_leaves_a_folder_as_it_was(tmp_path, existed):
    if existed:
        (tmp_path / "episode").mkdir()
        (tmp_path / "episode" / "file").write_text("old")
    with pytest.raises(InterruptionError), atomic_folder(tmp_path / "episode") as temporary:
        fail_after_writing(temporary / "file")
    assert contents(tmp_path) == ({"episode/file": "old"} if existed else {})
    assert len(list(tmp_path.iterdir())) == existed


@pytest.mark.parametrize("existed", [True, False])
def test_an_error_leaves_a_file_as_it_was(tmp_path, existed):
    if existed:
        (tmp_path / "file").write_text("old")
    with pytest.raises(InterruptionError), atomic_file(tmp_path / "file") as temporary:
        fail_after_writing(temporary)
    assert contents(tmp_path) == ({"file": "old"} if existed else {})


def test_a_killed_process_leaves_no_half_folder_nor_file(tmp_path):
    """Killed without a chance to tidy up, the writer leaves only dot names, which readers pass over."""
    program = (
        "import os, signal, sys; from pathlib import Path\n"
        "from labeling.formats.atomic import atomic_file, atomic_folder\n"
        "root = Path(sys.argv[1])\n"
        "with atomic_folder(root / 'episode') as folder, atomic_file(root / 'file') as file:\n"
        "    (folder / 'transforms.json').write_text('half'); file.write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    (tmp_path / "file").write_text("old")
    finished = subprocess.run([sys.executable, "-c", program, str(tmp_path)], cwd=ROOT, check=False)
    assert finished.returncode == -9
    assert [path.name for path in tmp_path.iterdir() if not path.name.startswith(".")] == ["file"]
    assert (tmp_path / "file").read_text() == "old"


def leave_temporaries(folder: Path) -> subprocess.CompletedProcess:
    """Has a process killed while it writes a file and a folder."""
    program = (
        "import os, signal, sys; from pathlib import Path\n"
        "from labeling.formats.atomic import atomic_file, atomic_folder\n"
        "root = Path(sys.argv[1])\n"
        "with atomic_folder(root / 'episode') as folder, atomic_file(root / 'file') as file:\n"
        "    (folder / 'half').write_text(''); file.write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    return subprocess.run([sys.executable, "-c", program, str(folder)], cwd=ROOT, check=False)


@pytest.mark.parametrize("write", ["file", "folder"])
def test_what_a_killed_process_has_left_goes_when_somebody_else_writes_there(tmp_path, write):
    leave_temporaries(tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    (tmp_path / ".mine.1-2.tmp").write_text("whoever this belongs to keeps it")
    if write == "file":
        write_json(tmp_path / "other.json", [])
    else:
        with atomic_folder(tmp_path / "other"):
            pass
    assert {path.name for path in tmp_path.iterdir()} == {".mine.1-2.tmp", "other.json" if write == "file" else "other"}


def test_what_others_are_writing_stays(tmp_path):
    alive = tmp_path / f".file.{os.getppid()}-{atomic._machine()}.tmp"
    elsewhere, abandoned = tmp_path / ".file.999999999-abcdef.tmp", tmp_path / ".old.999999999-abcdef.tmp"
    for path in (alive, elsewhere, abandoned):
        path.write_text("half")
    os.utime(abandoned, (0, 0))
    write_json(tmp_path / "other.json", [])
    assert {path.name for path in tmp_path.iterdir()} == {alive.name, elsewhere.name, "other.json"}


def test_write_json_round_trips_and_replaces(tmp_path):
    for content in ({"a": [1, 2.5, None, "é"]}, []):
        write_json(tmp_path / "deep" / "x.json", content)
        assert json.loads((tmp_path / "deep" / "x.json").read_text(encoding="utf-8")) == content
    assert list(contents(tmp_path)) == ["deep/x.json"]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object()])
def test_write_json_refuses_what_is_not_json_and_keeps_the_old_file(tmp_path, value):
    write_json(tmp_path / "x.json", [1])
    with pytest.raises((ValueError, TypeError)):
        write_json(tmp_path / "x.json", {"value": value})
    assert contents(tmp_path) == {"x.json": "[\n 1\n]\n"}


REPLACING = (
    "import os, signal, sys; from pathlib import Path\n"
    "from labeling.formats import atomic\n"
    "root, moves = Path(sys.argv[1]), int(sys.argv[2])\n"
    "if sys.argv[3] == 'without':\n"
    "    atomic._exchange = lambda one, other: False\n"
    "replace = Path.replace\n"
    "def counted(one, other):\n"
    "    global moves\n"
    "    if moves == 0: os.kill(os.getpid(), signal.SIGKILL)\n"
    "    moves -= 1\n"
    "    return replace(one, other)\n"
    "Path.replace = counted\n"
    "with atomic.atomic_folder(root / 'run') as folder:\n"
    "    (folder / 'file').write_text('new')\n"
)


@pytest.mark.parametrize("exchange", ["with", "without"])
@pytest.mark.parametrize("moves", range(3))
def test_a_process_killed_between_two_moves_leaves_the_old_folder_or_the_new_one(tmp_path, exchange, moves):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "file").write_text("old")
    subprocess.run([sys.executable, "-c", REPLACING, str(tmp_path), str(moves), exchange], cwd=ROOT, check=False)
    if exchange == "with":
        assert (tmp_path / "run" / "file").is_file()
    finish_replacing(tmp_path / "run")
    assert (tmp_path / "run" / "file").read_text() == ("new" if exchange == "with" or moves == 2 else "old")


def test_replacing_works_where_folders_cannot_be_exchanged(tmp_path, monkeypatch):
    monkeypatch.setattr(atomic, "_exchange", lambda one, other: False)
    test_atomic_folder_replaces_all_of_an_older_one(tmp_path)


def test_an_old_folder_that_was_put_aside_goes_when_a_new_one_is_there(tmp_path):
    for name in ("run", ".run.replaced"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text(name)
    finish_replacing(tmp_path / "run")
    assert contents(tmp_path) == {"run/file": "run"}
