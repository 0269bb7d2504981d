import importlib
import os
from pathlib import Path

import pytest

from experiments.cache.stages import RunContext, cached, digest, folder_digest, run_tasks
from labeling.core.errors import SbmError

WORK = """
import os
from pathlib import Path
from labeling.core.errors import SbmError

def write_square(path):
    number = int(Path(path).name)
    if number == 13:
        raise SbmError("13 is unlucky")
    Path(path).write_text(f"{number**2} {os.environ['NUMBA_NUM_THREADS']}")
"""


def test_digests_follow_content_not_order() -> None:
    assert digest({"a": 1, "b": [2]}) == digest({"b": [2], "a": 1})
    assert digest({"a": 1}) != digest({"a": 2})
    assert digest("ab", "c") != digest("a", "bc")
    with pytest.raises(ValueError):
        digest(float("nan"))


def test_folder_digest_changes_with_names_and_bytes(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("1")
    before = folder_digest(tmp_path)
    (tmp_path / "a").write_text("2")
    changed = folder_digest(tmp_path)
    (tmp_path / "a").rename(tmp_path / "b")
    assert len({before, changed, folder_digest(tmp_path)}) == 3


def test_outcomes_are_kept_and_damage_is_reported(tmp_path: Path) -> None:
    context, computed = RunContext("smoke", (0,), 1, tmp_path), []

    def compute(job: int) -> dict[str, list[int | None]]:
        computed.append(job)
        return {"x": [job, None]}

    jobs = [("abcd", 1), ("efgh", 2), ("abcd", 1)]
    expected = [{"x": [1, None]}, {"x": [2, None]}, {"x": [1, None]}]
    assert cached("stage", compute, jobs, context, "title") == expected
    assert cached("stage", compute, jobs, context, "title") == expected
    assert computed == [1, 2]
    (tmp_path / "stages" / "stage" / "ab" / "abcd.json").write_text("{")
    with pytest.raises(SbmError, match="delete it"):
        cached("stage", compute, jobs, context, "title")


def test_tasks_run_in_single_threaded_processes_and_one_failure_does_not_stop_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sbm_squares.py").write_text(WORK)
    (tmp_path / "out").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    write_square = importlib.import_module("sbm_squares").write_square
    before = os.environ.get("NUMBA_NUM_THREADS")
    with pytest.raises(SbmError, match=r"1 of 3 tasks failed.*13 is unlucky"):
        run_tasks(write_square, [str(tmp_path / "out" / name) for name in ("3", "13", "4")], 2, "squares")
    assert {path.name: path.read_text() for path in (tmp_path / "out").iterdir()} == {"3": "9 1", "4": "16 1"}
    assert os.environ.get("NUMBA_NUM_THREADS") == before
    run_tasks(write_square, [], 2, "nothing")
    assert "squares" in capsys.readouterr().err
