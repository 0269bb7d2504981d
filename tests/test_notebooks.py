"""The notebooks of docs: they run, cell by cell, hold no outputs, and are linked from the site."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from .imports import ROOT

FOLDER = ROOT / "docs" / "notebooks"
NOTEBOOKS = {path.stem: path for path in sorted(FOLDER.glob("*.ipynb"))}
FIGURES = """
import matplotlib.pyplot as plt
def _show():
    [plt.figure(number).savefig(f"figure_{_show.count + number}.png") for number in plt.get_fignums()]
    _show.count += len(plt.get_fignums())
    plt.close("all")
_show.count = 0
plt.show = _show
"""
"""What stands for the screen of a notebook: figures become files."""


def cells(name: str, kind: str) -> list[str]:
    """The sources of a notebook's cells of a kind, in order."""
    content = json.loads(NOTEBOOKS[name].read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in content["cells"] if cell["cell_type"] == kind]


def run(name: str, folder: Path) -> str:
    """Runs the code cells in order in a process of their own; returns what they print."""
    program = folder / f"{name}.py"
    program.write_text("\n\n".join([FIGURES, *cells(name, "code")]), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", "TMPDIR": str(folder)}
    command = [sys.executable, "-W", "error::UserWarning", str(program)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_there_are_two_notebooks() -> None:
    assert set(NOTEBOOKS) == {"label_a_recording", "train_and_watch_a_policy"}


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebooks_are_clean_and_linked(name: str) -> None:
    content = json.loads(NOTEBOOKS[name].read_text(encoding="utf-8"))
    assert (content["nbformat"], content["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in content["cells"]]
    assert len(set(ids)) == len(ids)
    for cell in content["cells"]:
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
    for target in re.findall(r"\]\(([^)#:]+)", "".join(cells(name, "markdown"))):
        assert (FOLDER / target).resolve().is_file(), target
    pages = [path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "tutorials").glob("*.md")]
    assert sum(f"../notebooks/{name}.ipynb" in page for page in pages) == 1


@pytest.mark.slow
def test_a_recording_is_labelled(tmp_path: Path) -> None:
    said = run("label_a_recording", tmp_path)
    ap = {name: float(value) for name, value in re.findall(r"^(\w+): mask AP50 ([\d.]+)", said, re.MULTILINE)}
    assert ap["pseudo_labels"] > ap["detector"] + 0.2
    assert len(list(tmp_path.glob("figure_*.png"))) == 3
    assert len(list(tmp_path.rglob("report.html"))) == len(list(tmp_path.rglob("films/*.gif"))) == 1


@pytest.mark.nightly
def test_a_policy_is_trained_and_watched(tmp_path: Path) -> None:
    said = run("train_and_watch_a_policy", tmp_path)
    returns = dict(re.findall(r"'([\w ]+)': (-?[\d.]+)", said.splitlines()[-2]))
    assert set(returns) == {"my own", "ring", "trained"}
    assert float(returns["ring"]) > 0
    assert len(list(tmp_path.glob("figure_*.png"))) == 2
    assert len(list(tmp_path.rglob("ring.gif"))) == 1
