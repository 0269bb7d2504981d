"""The site: every page has its place, every link an end, nothing public is missing, and pages tell of the code."""

import importlib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest
import yaml

import sbm_gym
from sbm_gym.env.fixation_env import FixationEnv

from .imports import PACKAGES, ROOT, commands
from .test_readme import BLOCKS

sys.path.insert(0, str(ROOT))

from tools import environments
from tools.website import commands as command_pages
from tools.website import links, reference
from tools.website.doctests import fenced
from tools.website.lists import lists_apart

GENERATED = {*links.PAGES.values()}
TUTORIALS = {
    "Label my recording": "label-my-recording.md",
    "Train a policy": "train-a-policy.md",
    "Improve a detector": "improve-a-detector.md",
}


def navigation() -> list:
    return yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]


def pages_of(entry) -> list[str]:
    """Pages below an entry of the navigation."""
    if isinstance(entry, str):
        return [entry]
    return [page for one in (entry if isinstance(entry, list) else entry.values()) for page in pages_of(one)]


def test_every_page_stands_in_the_navigation_once() -> None:
    listed = [page for page in pages_of(navigation()) if not page.startswith("https:")]
    written = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    of_packages = {f"reference/{name}.md" for name in ("index", *reference.PACKAGES)}
    assert len(listed) == len(set(listed))
    assert set(listed) == written | GENERATED | of_packages | {"commands"}


def test_links_lead_to_the_same_place_from_docs_and_from_beside_it() -> None:
    moved = links.links_of_site
    assert moved("[a](../README.md#limits)", "docs/x.md", "x.md") == "[a](index.md#limits)"
    assert moved("[a](../worlds.md)", "docs/deep/x.md", "deep/x.md") == "[a](../worlds.md)"
    assert moved("![a](docs/pictures/a.png)", "README.md", "index.md") == "![a](pictures/a.png)"
    assert moved("[`a`](../agents/a.yaml)", "docs/x.md", "x.md") == f"[`a`]({links.REPOSITORY}agents/a.yaml)"
    for same in ("[a](#b)", "[a](https://a.org/b)", "`[a](LICENSE)`", "```\n[a](LICENSE)\n```"):
        assert moved(same, "docs/x.md", "x.md") == same


def test_links_to_the_repository_have_an_end() -> None:
    sources = [*(ROOT / "docs").rglob("*.md"), *(ROOT / name for name in links.PAGES)]
    for path in sources:
        source = path.relative_to(ROOT).as_posix()
        text = links.links_of_site(path.read_text(encoding="utf-8"), source, source.removeprefix("docs/"))
        for target in re.findall(re.escape(links.REPOSITORY) + r"([^)#\s]+)", text):
            assert (ROOT / target).exists(), (source, target)


def test_doctests_are_fenced_with_their_indentation() -> None:
    text = "Says.\n\nExample:\n    >>> a = [\n    ...     1]\n    >>> a[0]\n    1\n\nArgs:\n    a: one."
    lines = fenced(text).splitlines()
    assert lines[3] == "    ```pycon"
    assert lines[8] == "    ```"
    assert [line for line in lines if "```" not in line] == text.splitlines()
    assert len(lines) == len(text.splitlines()) + 2
    assert fenced("No example.") == "No example."


def test_lists_are_set_apart_but_in_code() -> None:
    assert lists_apart("Has\n- a;\n- b.\n\nNext:\n\n- c\n") == "Has\n\n- a;\n- b.\n\nNext:\n\n- c\n"
    assert lists_apart("- a\n  goes on\n- b\n") == "- a\n  goes on\n- b\n"
    for same in ("```\na\n- b\n```", "| a |\n|---|\n| b |\n", "a - b\n"):
        assert lists_apart(same) == same


@pytest.mark.parametrize("package", reference.PACKAGES)
def test_the_reference_has_every_exported_name(package: str) -> None:
    page = reference.package_page(ROOT, package)
    exported = {name for name in importlib.import_module(package).__all__ if not name.startswith("_")}
    assert set(re.findall(rf"^::: {package}\.(\w+)$", page, re.MULTILINE)) == exported


def test_every_command_has_a_page() -> None:
    modules = {module for names in command_pages.groups().values() for module, _ in names.values()}
    assert {module.removesuffix(".__main__") for module in modules} == {*commands()} - {*PACKAGES, "experiments.sbm"}
    names = [name for names in command_pages.groups().values() for name in names]
    assert len({command_pages.page_of(name) for name in names}) == len(names)


@pytest.mark.parametrize(("name", "module"), [("sbm label", "labeling.generate"), ("sbm collect", "agents.collect")])
def test_a_page_of_a_command_has_all_that_its_help_has(name: str, module: str) -> None:
    said, page = command_pages.help_of(name, module), command_pages.command_page(name, module)
    options = set(re.findall(r"^  (?:-\w, )?(--[\w-]+)", said, re.MULTILINE))
    assert len(options) > 10
    assert options <= set(re.findall(r"^`[^`]*?(--[\w-]+)", page, re.MULTILINE))
    told = "".join(re.findall(r"\w+", page.replace("&lt;", "<").replace("&amp;", "&")))
    for line in said.splitlines()[2:]:
        assert "".join(re.findall(r"\w+", line[24:] if line.startswith(" " * 24) else "")) in told, line
    assert "## Examples" in page


def test_subcommands_are_told_too() -> None:
    page = command_pages.command_page("sbm scenes", "sbm_gym.scenes.__main__")
    assert {"## sbm scenes build", "## sbm scenes list"} <= set(page.splitlines())
    assert "`--split" in page.partition("## sbm scenes build")[2]


@pytest.mark.parametrize("tour", BLOCKS)
def test_tutorials_have_the_tested_commands_of_readme(tour: str) -> None:
    text = (ROOT / "docs" / "tutorials" / TUTORIALS[tour]).read_text(encoding="utf-8")
    first = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)[0]
    lines = [shlex.split(line, comments=True) for line in first.splitlines()]
    assert lines == [shlex.split(line, comments=True) for line in BLOCKS[tour].splitlines()]


def test_pages_of_environments_are_those_of_the_code() -> None:
    for name, text in environments.pages().items():
        path = environments.FOLDER / name
        assert path.read_text(encoding="utf-8") == text, "run: python tools/environments.py"


@pytest.mark.parametrize("env_id", sbm_gym.ENV_IDS)
def test_pages_of_environments_tell_what_the_environments_do(env_id: str) -> None:
    kind = "outdoor" if "Outdoor" in env_id else "indoor"
    page = (environments.FOLDER / f"{kind}.md").read_text(encoding="utf-8")
    env = gymnasium.make(env_id)
    robot = env.unwrapped
    assert isinstance(robot, FixationEnv)
    assert f"`{env_id}`" in page
    assert f"| Action space | `{env.action_space}` |" in page
    assert isinstance(env.observation_space, gymnasium.spaces.Dict)
    for name, space in env.observation_space.spaces.items():
        assert f"| Observation `{name}` | `{space}` |" in page
        if name != "state":
            assert f"`{name}`: `Box(0, 255, {space.shape}, uint8)`" in page
    assert f"| Episode | {robot.num_views} views |" in page
    assert f"camera {robot.profile.body.camera_height_m:g} m above the floor" in page
    assert f"one stride ({robot.profile.stride_m:g} m)" in page
    assert f"levels of {100 * robot.profile.scales.depth_level_m:g} cm" in page
    entries = re.findall(r"^\| \d+ \| `(\w+)` \|$", page, re.MULTILINE)
    assert entries == list(robot.state_names)


@pytest.mark.slow
def test_pages_of_environments_have_every_argument() -> None:
    rows = [name for name, _, _ in environments.arguments()]
    assert sorted(rows) == sorted(set(FixationEnv.__init__.__annotations__) - {"return"})


SEARCH = """
const [toggle, query] = [document.querySelector("#__search"), document.querySelector(".md-search__input")];
toggle.checked = true;
toggle.dispatchEvent(new Event("change"));
query.focus();
query.value = "depth unit";
query.dispatchEvent(new Event("input", { bubbles: true }));
query.dispatchEvent(new Event("keyup", { bubbles: true }));
"""
"""A user who types into the search."""
FOUND = """(async () => {
  const results = document.querySelector(".md-search-result");
  for (let tries = 0; tries < 500 && !/\\d+ matching documents/.test(results.textContent); tries++)
    await new Promise((resolve) => setTimeout(resolve, 20));
  return results.innerHTML;
})()"""
"""What it finds, once it has."""


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site, built with warnings as errors."""
    folder = tmp_path_factory.mktemp("site") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    calm = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=calm)
    assert done.returncode == 0, done.stderr + done.stdout
    return folder


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_loads_nothing_from_elsewhere(site: Path) -> None:
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|img|iframe|link)[^>]*?(?:src|href)=\"?(https?:[^\" >]+)", text)
        assert not loaded, (path, loaded)
    index = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))
    found = " ".join(entry["title"] for entry in index["docs"])
    assert all(word in found for word in ("sbm label", "propagate", "Rooms", "Glossary"))
    for package in reference.PACKAGES:
        page = (site / "reference" / f"{package}.html").read_text(encoding="utf-8")
        assert all(f'id="{package}.{name}"' in page for name in reference.exported(ROOT, package))


@pytest.mark.slow
def test_search_works_on_a_site_that_is_opened_from_disk(site: Path, browser_page) -> None:
    browser_page.open((site / "index.html").as_uri(), 1200, 900, settle_s=0)
    browser_page.script(SEARCH)
    found = browser_page.script(FOUND)
    assert re.search(r"\d+ matching documents", found)
    assert re.search(r'href="file:[^"]*/your-own-recordings\.html', found.partition("</ol>")[0])
