"""The one door: it leads to every command, under the name that was typed, and shells complete it."""

import subprocess
import tomllib
from pathlib import Path

import pytest

from experiments.sbm import MODULES, completion, main, options
from labeling import __version__

from ..imports import PACKAGES, commands

ROOT = Path(__file__).resolve().parents[2]
FOR_DEVELOPERS = {
    *("experiments.before_after", "experiments.box_pictures", "experiments.calibrate_labels", "experiments.pictures"),
    *("experiments.detector_failures", "experiments.policy_pictures", "experiments.pretrain_compact"),
    "experiments.detector_labels",
    *("experiments.ship_policy", "experiments.sbm"),
}
"""They make what is committed; ``python -m`` runs them."""


def test_every_command_has_a_verb() -> None:
    assert {module.removesuffix(".__main__") for module in MODULES.values()} == {*commands()} - {
        *FOR_DEVELOPERS,
        *PACKAGES,
    }


def test_alone_it_lists_all(capsys) -> None:
    assert main([]) == 0
    listed = capsys.readouterr().out
    assert all(f"  {verb} " in listed for verb in (*MODULES, "completion"))
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"seeing-by-moving {__version__}\n"


@pytest.mark.parametrize(
    ("typed", "says"), [("labl", "did you mean 'label'?"), ("zzz", "no command 'zzz'; sbm --help")]
)
def test_what_there_is_not_is_one_line(typed: str, says: str, capsys) -> None:
    assert main([typed]) == 2
    told = capsys.readouterr().err
    assert says in told
    assert len(told.splitlines()) == 1


def test_a_command_goes_by_the_name_that_was_typed(tmp_path: Path, capsys) -> None:
    with pytest.raises(SystemExit):
        main(["convert", "--help"])
    assert "usage: sbm convert" in capsys.readouterr().out
    assert main(["convert", str(tmp_path / "nothing"), "--out", str(tmp_path / "out")]) == 2
    assert "error: " in capsys.readouterr().err


def test_it_is_installed_as_a_program() -> None:
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    assert scripts == {"sbm": "experiments.sbm:main"}


def completed(*words: str) -> list[str]:
    """What a real bash offers for the last word."""
    script = completion("bash") + f"\nCOMP_WORDS=({' '.join(map(repr, words))}); COMP_CWORD={len(words) - 1}; _sbm\n"
    script += 'printf "%s\\n" "${COMPREPLY[@]}"\n'
    said = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    return said.stdout.split()


def test_bash_completes_verbs_and_options() -> None:
    assert completed("sbm", "col") == ["collect"]
    assert set(completed("sbm", "")) >= set(MODULES)
    assert completed("sbm", "label", "--share-s") == ["--share-scenes"]
    assert completed("sbm", "completion", "") == ["bash", "zsh"]
    assert {"--out", "--policy", "--seed"} <= set(options("collect"))
    assert "bashcompinit" in completion("zsh")
    assert main(["completion", "fish"]) == 2
