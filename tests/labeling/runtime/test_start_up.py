"""Ctrl-C while a command still imports ends it with one line; programs of others keep Python's own answer."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
INTERRUPTED_IMPORT = "raise KeyboardInterrupt\n"


def ends(arguments: list[str], where: Path, **packages: str) -> subprocess.CompletedProcess[str]:
    """Runs Python with stand-ins for modules that are imported first."""
    for name, text in packages.items():
        (where / f"{name}.py").write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(where), str(ROOT)))}
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=where, env=environment, check=False)


@pytest.mark.parametrize("module", ["labeling.generate", "agents.collect", "sbm_gym.preview", "experiments.run"])
def test_ctrl_c_while_a_command_imports_is_one_line(module: str, tmp_path: Path) -> None:
    done = ends(["-m", module, "--help"], tmp_path, tyro=INTERRUPTED_IMPORT)
    assert done.returncode == 130
    assert done.stderr == "interrupted before anything was done\n"


def test_other_errors_keep_their_traceback(tmp_path: Path) -> None:
    done = ends(["-m", "labeling.generate", "--help"], tmp_path, tyro="raise RuntimeError('of tyro')\n")
    assert done.returncode == 1
    assert done.stderr.startswith("Traceback")
    assert done.stderr.rstrip().endswith("RuntimeError: of tyro")


def test_programs_of_others_keep_pythons_answer(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "__init__.py").write_text("import labeling\n", encoding="utf-8")
    (tmp_path / "theirs" / "run.py").write_text(INTERRUPTED_IMPORT, encoding="utf-8")
    done = ends(["-m", "theirs.run"], tmp_path)
    assert "KeyboardInterrupt" in done.stderr
    assert "Traceback" in done.stderr
