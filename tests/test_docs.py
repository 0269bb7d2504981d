"""What README, CONTRIBUTING and docs tell people to type works."""

import importlib
import re
import runpy
import shlex
import sys
from unittest.mock import patch

import numpy as np
import pytest
import tyro

from .imports import ROOT, commands

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
COMMAND = re.compile(r"python -m ((?:labeling|sbm_gym|agents|experiments)[\w.]*)([^`\n#|]*)")
LINK, HEADING = re.compile(r"\]\(([^)\s]+)\)"), re.compile(r"^#+ (.+)$", re.MULTILINE)
TEMPLATE = re.compile(r"\.\.\.|…|<|\[")
"""A line that leaves something out, which is not to be typed as it stands."""


def without_code(page):
    """The text of a page without its blocks of code."""
    return re.sub(r"^ *```.*?^ *```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


def anchors(page):
    """What headings of a page are called in links to them, as GitHub derives it."""
    titles = [re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", title) for title in HEADING.findall(without_code(page))]
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings_that_are_there(page):
    dead = []
    for link in LINK.findall(without_code(page)):
        place, _, heading = link.partition("#")
        if "://" in link or place.startswith("mailto:"):
            continue
        to = (page.parent / place).resolve() if place else page
        if not to.exists() or (heading and heading not in anchors(to)):
            dead.append(link)
    assert not dead


def typed_commands():
    """Every command line of the pages, once."""
    found = {}
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for module, rest in COMMAND.findall(text):
            found.setdefault((module, rest.strip().rstrip(".,;:)")), page.name)
    return sorted((module, rest, page) for (module, rest), page in found.items())


class ParsedError(Exception):
    """Stands for the work of a command whose line was understood."""


@pytest.mark.slow
@pytest.mark.parametrize(("module", "rest", "page"), typed_commands())
def test_commands_of_the_pages_are_understood(module, rest, page):
    assert module in commands(), page
    if not rest or TEMPLATE.search(rest):
        return
    is_folder = (ROOT / module.replace(".", "/")).is_dir()
    program = importlib.import_module(f"{module}.__main__" if is_folder else module)
    parse = tyro.cli

    def only_parse(*args, **kwargs):
        parse(*args, **kwargs)
        raise ParsedError

    with patch.object(tyro, "cli", only_parse), pytest.raises(ParsedError):
        program.main(shlex.split(rest))


@pytest.fixture
def examples(tmp_path, monkeypatch):
    """The modules of CONTRIBUTING, importable by the names in their first lines."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for name, code in re.findall(r"```python\n# (\w+)\.py\n(.*?)```", text, re.DOTALL):
        (tmp_path / f"{name}.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    for name in ("my_world", "my_policy", "my_detector"):
        sys.modules.pop(name, None)


def test_the_world_and_the_policy_of_contributing_record_an_episode(examples):
    import gymnasium

    from agents.policies.registry import make_policy

    env = gymnasium.make("my_world:sbm_gym/Arena-v0")
    observation, info = env.reset(seed=0)
    policy = make_policy("my_policy:Forward")
    policy.reset(env, observation, info, np.random.default_rng(0))
    for _ in range(3):
        observation, _, _, _, info = env.step(policy.act(observation, info))
    assert info["scene"].startswith("arena/")


def test_the_detector_of_contributing_finds_what_is_red(examples):
    from labeling.detectors.adapters.function import FunctionDetector

    picture = np.zeros((1, 8, 8, 3), np.uint8)
    picture[0, 2:5, 2:5, 0] = 200
    (found,) = FunctionDetector("my_detector:find").detect(picture)
    assert found.masks.sum() == 9


def test_the_experiment_of_contributing_runs(tmp_path, monkeypatch):
    from experiments.cache import registry
    from experiments.cache.stages import RunContext

    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n# experiments/tables/squares.py\n(.*?)```", text, re.DOTALL)
    monkeypatch.setattr(registry, "_REGISTRY", registry.experiments())
    (tmp_path / "squares_of_contributing.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    module = importlib.import_module("squares_of_contributing")
    assert module.run_squares(RunContext("smoke", (0,), 1, tmp_path / "cache")) == {"squares": [0, 1]}
    assert "squares" in registry.experiments()


def test_names_in_the_walks_of_the_architecture_exist():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`((?:labeling|sbm_gym|agents|experiments)(?:\.\w+)+)`", text))
    assert len(names) >= 12
    for name in names:
        parts, attributes = name.split("."), []
        while not (ROOT.joinpath(*parts)).is_dir() and not ROOT.joinpath(*parts).with_suffix(".py").is_file():
            attributes.insert(0, parts.pop())
        found = importlib.import_module(".".join(parts))
        for attribute in attributes:
            found = getattr(found, attribute)


def test_the_list_of_folders_is_that_of_the_code():
    assert runpy.run_path(str(ROOT / "tools" / "architecture.py"))["updated_page"]() == (
        ROOT / "docs" / "architecture.md"
    ).read_text(encoding="utf-8"), "run: python tools/architecture.py"
