import importlib
import os
from pathlib import Path

import pytest

from experiments.cache.stages import Store, digest, folder_digest, run_tasks
from labeling.core.errors import SbmError
from labeling.runtime.code_digest import code_digest, reached_files

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


def test_code_reaches_what_is_imported_in_functions_and_through_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "labeling"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "a.py").write_text("def f():\n    from labeling import b\n    import numpy\n")
    (package / "b.py").write_text("from labeling.c import x\n")
    (package / "c.py").write_text("import labeling.a\nx = 1\n")
    (package / "d.py").write_text("x = 2\n")
    monkeypatch.setattr("labeling.runtime.code_digest.ROOT", tmp_path)
    (package / "learnt.json").write_text("{}")
    names = {path.name for path in reached_files(["labeling.a"])}
    assert names == {"__init__.py", "a.py", "b.py", "c.py", "learnt.json"}
    code_digest.cache_clear()
    before = code_digest("labeling.a")
    (package / "d.py").write_text("x = 3\n")
    code_digest.cache_clear()
    assert code_digest("labeling.a") == before
    (package / "c.py").write_text("import labeling.a\nx = 2\n")
    code_digest.cache_clear()
    assert code_digest("labeling.a") != before
    code_digest.cache_clear()


def test_labels_depend_on_the_code_that_makes_them() -> None:
    names = {path.stem for path in reached_files(["labeling.generator.propagate"])}
    assert {"association", "mean_field", "permutohedral_lattice", "per_detection", "published_defects"} <= names
    assert not names & {"report", "viewer"}


def test_store_keeps_and_reports_damage(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert not store.has("stage", "abcd")
    store.write("stage", "abcd", {"x": [1, None]})
    assert store.read("stage", "abcd") == {"x": [1, None]}
    store.path("stage", "abcd").write_text("{")
    with pytest.raises(SbmError, match="delete it"):
        store.read("stage", "abcd")


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
