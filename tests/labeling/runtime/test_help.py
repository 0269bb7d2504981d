"""Help of commands: grouped, without marks of other notations, and with examples that the command understands."""

import importlib
import re
import shlex
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated

import pytest
import tyro

from labeling.core.errors import SbmError
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.option_groups import GROUPS
from labeling.runtime import cli
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp, help_text
from labeling.runtime.package_commands import commands as listed
from labeling.runtime.package_commands import overview

from ...imports import PACKAGES, ROOT, commands

COMMANDS = sorted({*commands()} - {*PACKAGES, "experiments.sbm"})
MOST_OPTIONS = 20
"""In one group: what fits on a screen."""


@dataclass(frozen=True)
class Inner:
    """What is inside. Of the box."""

    colour: Annotated[tuple[float, float] | None, "a note"] = None
    """Two shares, 50 % each; None takes those of ``out_dir``."""


@dataclass(frozen=True)
class Config:
    """Boxes things.

    As ``many`` as there are.
    """

    things: tyro.conf.Positional[tuple[Path, Path]]
    """What to box."""
    out_dir: Path
    """Where to."""
    many: int = 3
    """How many."""
    fast: bool = True
    """Whether ``fast``."""
    limit_m: float | None = None
    """At most; see ``out_dir``."""
    inner: tyro.conf.OmitArgPrefixes[Inner] = field(default_factory=Inner)


def main_of(command: str):
    try:
        return importlib.import_module(f"{command}.__main__").main
    except ModuleNotFoundError:
        return importlib.import_module(command).main


def helped(command: str, capsys: pytest.CaptureFixture, *words: str) -> str:
    with pytest.raises(SystemExit) as left:
        main_of(command)([*words, "--help"])
    assert left.value.code == 0
    return capsys.readouterr().out


def test_groups_stand_in_the_order_given_and_then_dataclass_by_dataclass(monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    about = CommandHelp({"common": ("out-dir", "things")}, (("A B --out-dir C", "two things"),))
    assert help_text(Config, "box", about) == (
        "usage: box [-h] PATH PATH --out-dir PATH [OPTIONS]\n\n"
        "Boxes things.\n\n"
        "As --many as there are.\n\n"
        "common:\n"
        "  --out-dir PATH        Where to. (required)\n"
        "  PATH PATH             What to box. (required)\n\n"
        "options:\n"
        "  --many INT            How many. (default: 3)\n"
        "  --fast, --no-fast     Whether --fast. (default: on)\n"
        "  --limit-m FLOAT       At most; see --out-dir.\n\n"
        "what is inside:\n"
        "  --colour FLOAT FLOAT  Two shares, 50 % each; None takes those of --out-dir.\n\n"
        "examples:\n"
        "  # two things\n"
        "  box A B --out-dir C"
    )


def test_a_group_of_options_that_do_not_exist_is_an_error() -> None:
    with pytest.raises(KeyError, match="nothing"):
        help_text(Config, "box", CommandHelp({"common": ("nothing",)}))


def test_a_subcommand_has_its_own_help_with_its_examples() -> None:
    command = Annotated[Config, tyro.conf.subcommand("put")] | Annotated[Inner, tyro.conf.subcommand("take")]
    about = CommandHelp(examples=(("put A --out-dir C", "one"), ("take", "another")))
    alone = help_text(command, "box", about, description="Boxes.")
    assert "  put                   Boxes things." in alone
    assert "box put A --out-dir C" in alone
    assert "box take" in alone
    put = help_text(command, "box", about, ["put", "-h"])
    assert put.startswith("usage: box put [-h] ")
    assert "box put A --out-dir C" in put
    assert "box take" not in put


def test_help_asked_for_among_other_options_is_given(capsys) -> None:
    with pytest.raises(SystemExit):
        make_main("box", Config, print)(["thing", "--many", "many", "-h"])
    assert capsys.readouterr().out.startswith("usage: python -m box [-h]")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_plain_and_fits_the_screen(command: str, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text = helped(command, capsys)
    assert not re.findall(r"\{None\}|`|\(default: (None)?\)|\x1b", text)
    body = text.partition("examples:")[0]
    assert max(len(line) for line in body.splitlines() if "{" not in line) <= 80
    for group in re.split(r"\n\n", body):
        assert len(re.findall(r"^  [-A-Z]", group, re.MULTILINE)) <= MOST_OPTIONS, group


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_examples_at_the_end_are_understood(command: str, capsys, monkeypatch) -> None:
    examples = re.findall(rf"^  (python -m {command}.*)$", helped(command, capsys).partition("examples:")[2], re.M)
    assert examples
    really = tyro.cli

    def parse(*positional, **named):
        really(*positional, **named)
        raise SbmError("understood")

    monkeypatch.setattr(cli.tyro, "cli", parse)
    for example in examples:
        with suppress(SystemExit):
            main_of(command)(shlex.split(example)[3:])
        assert capsys.readouterr().err == "error: understood\n", example


def test_every_setting_of_the_label_generator_is_in_a_group() -> None:
    grouped = [name for names in GROUPS.values() for name in names]
    assert len(grouped) == len(set(grouped))
    missing = {one.name.replace("_", "-") for one in fields(LabelConfig)} - {*grouped, "published"}
    assert not missing


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_lists_its_commands(package: str) -> None:
    assert set(listed(package)) == {name for name in commands() if name.startswith(f"{package}.")}
    assert all(does and not does.startswith("python") for does in listed(package).values())
    said = subprocess.run([sys.executable, "-m", package], capture_output=True, text=True, cwd=ROOT, check=True).stdout
    assert all(name in said for name in listed(package))
    assert overview(package).splitlines()[0] == f"usage: python -m {package}.COMMAND ..."


def test_a_command_given_to_a_package_is_put_right(capsys) -> None:
    assert importlib.import_module("labeling.__main__").main(["generat"]) == 2
    assert "did you mean python -m labeling.generate?" in capsys.readouterr().err
