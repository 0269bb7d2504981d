"""Every command that README and docs name is there, takes the options that stand with it, and knows the experiment."""

import re
from collections import defaultdict
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from experiments.cache.registry import experiments

ROOT = Path(__file__).resolve().parents[2]
PLACEHOLDERS = {"NAME", "list"}


def commands() -> dict[str, set[str]]:
    """What stands after each module's name, somewhere in README or docs."""
    found: dict[str, set[str]] = defaultdict(set)
    for file in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text = file.read_text(encoding="utf-8").replace("\\\n", " ")
        for module, rest in re.findall(r"python -m ((?:labeling|sbm_gym|agents|experiments)[\w.]*)([^\n`|;]*)", text):
            found[module.rstrip(".")].add(rest.partition("#")[0])
    return found


@cache
def options(module: str, subcommand: str = "") -> set[str]:
    import contextlib
    import io

    try:
        main = import_module(f"{module}.__main__").main
    except ModuleNotFoundError:
        main = import_module(module).main
    said = io.StringIO()
    with contextlib.redirect_stdout(said), pytest.raises(SystemExit) as left:
        main([part for part in (subcommand, "--help") if part])
    assert left.value.code == 0
    plain = re.sub(r"\x1b\[[0-9;]*m", "", said.getvalue())
    return set(re.findall(r"--[\w.-]+", plain))


@pytest.mark.parametrize("module", sorted(commands()))
def test_commands_take_the_options_that_docs_give_them(module: str) -> None:
    known = options(module)
    for rest in commands()[module]:
        asked = set(re.findall(r"(?<!\S)--[\w.-]+", rest))
        words = rest.split()
        if asked - known and words and words[0].islower():
            known = known | options(module, words[0])
        assert asked <= known, f"python -m {module}{rest}"


def test_experiments_in_docs_are_those_of_the_registry() -> None:
    named = {rest.split()[0] for rest in commands()["experiments.run"] if rest.split()}
    assert named - PLACEHOLDERS <= set(experiments())
    assert named & set(experiments())
