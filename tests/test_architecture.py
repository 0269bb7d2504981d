"""House rules that a machine can check: which way imports go, how full a folder is, where commands stand."""

import subprocess
import sys
import tomllib
from collections import Counter
from graphlib import TopologicalSorter

import pytest

from .imports import (
    PACKAGES,
    ROOT,
    checked_by_jaxtyping,
    commands,
    folder_imports,
    folder_of,
    imported_names,
    imports,
    modules,
    package_of,
    relative_imports,
    syntax_tree,
)

COMMANDS = commands()
HEAVY = ("torch", "torchvision", "open3d", "sklearn", "scipy", "numba", "mujoco", "stable_baselines3", "matplotlib")
MOST_MODULES = 15
"""In one folder: what fits on a screen."""


@pytest.mark.parametrize("package", PACKAGES)
def test_no_folder_shows_more_than_fifteen_modules(package):
    count = Counter(map(folder_of, modules(package)))
    assert not {folder: n for folder, n in count.items() if n > MOST_MODULES}


@pytest.mark.parametrize("package", PACKAGES)
def test_no_package_imports_a_higher_one(package):
    allowed = set(PACKAGES[: PACKAGES.index(package) + 1])
    wrong = {name: other for name in modules(package) for other in imports()[name] if package_of(other) not in allowed}
    assert not wrong


@pytest.mark.parametrize("package", PACKAGES)
def test_folders_import_in_one_direction(package):
    graph = folder_imports(package)
    assert graph
    # Raises CycleError, which names the folders of the cycle.
    TopologicalSorter(graph).prepare()


def test_no_two_modules_import_each_other():
    circles = {
        tuple(sorted((name, other)))
        for name, others in imports().items()
        for other in others
        if name in imports()[other]
    }
    assert not circles


def test_commands_stand_at_the_top_of_a_package():
    assert {package_of(command) for command in COMMANDS} == set(PACKAGES)
    assert not [command for command in COMMANDS if command.count(".") != 1]


@pytest.mark.xfail(reason="three commands are still imported")
def test_commands_are_imported_by_nobody_in_their_package():
    wrong = {
        name: other
        for name, others in imports().items()
        for other in others
        if other.removesuffix(".__main__") in COMMANDS and package_of(other) == package_of(name)
    }
    assert not wrong


def test_code_stands_in_modules_and_not_in_folders():
    """Only a package's root says what users import; other ``__init__`` files say what their folder is for."""
    for package in PACKAGES:
        for path in (ROOT / package).rglob("__init__.py"):
            if path.parent.parent != ROOT:
                assert len(syntax_tree(path).body) == 1, path


@pytest.mark.parametrize("folder", ["sbm_gym.assets", "sbm_gym.rendering"])
def test_assets_and_rendering_know_nothing_of_worlds(folder):
    wrong = {
        name: other for name in modules(folder) for other in imports()[name] if other.startswith("sbm_gym.worlds.")
    }
    assert not wrong


def test_labeling_never_imports_a_simulator():
    for path in modules("labeling").values():
        imported = {name.partition(".")[0] for name in imported_names(syntax_tree(path))}
        assert not imported & {"mujoco", "gymnasium", "stable_baselines3", "open3d"}, path


@pytest.mark.parametrize("package", PACKAGES)
def test_relative_imports_are_not_used(package):
    assert not [path for path in modules(package).values() if relative_imports(path)]


def test_array_shapes_of_most_modules_are_checked_while_tests_run():
    checked = checked_by_jaxtyping()
    assert len(checked) > 40
    assert {"labeling.core.geometry", "sbm_gym.worlds.geometry.navigable"} <= set(checked)


def test_what_the_packages_read_is_installed_with_them():
    """Every file beside the code that is not code is listed as package data."""
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    shipped = {
        path
        for name, patterns in setuptools["package-data"].items()
        for pattern in patterns
        for path in (ROOT / name.replace(".", "/")).glob(pattern)
    }
    data = {
        path
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.*")
        if path.is_file() and path.suffix not in (".py", ".pyc", ".nbi", ".nbc") and "results" not in path.parts
    }
    assert data
    assert data <= shipped


@pytest.mark.parametrize("command", COMMANDS)
def test_help_answers_without_loading_anything_heavy(command):
    program = (
        "import runpy, sys\n"
        f"sys.argv = ['python -m {command}', '--help']\n"
        "try:\n"
        f"    runpy.run_module({command!r}, run_name='__main__')\n"
        "except SystemExit as end:\n"
        "    assert end.code in (0, None), end.code\n"
        f"loaded = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "assert not loaded, loaded\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert result.returncode == 0, result.stderr
    assert "usage" in result.stdout.lower()


def test_labeling_runs_where_no_simulator_is_installed(tmp_path, apc_shelf):
    program = (
        "import sys\n"
        "from importlib.abc import MetaPathFinder\n"
        "class Absent(MetaPathFinder):\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] in ('mujoco', 'gymnasium', 'stable_baselines3', 'torch', 'open3d'):\n"
        "            raise ModuleNotFoundError(name)\n"
        "sys.meta_path.insert(0, Absent())\n"
        "import runpy\n"
        f"sys.argv = ['generate', {str(apc_shelf)!r}, '--confident', '0.6', '--out', {str(tmp_path / 'labels')!r}]\n"
        "runpy.run_module('labeling.generate', run_name='__main__')\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "labels" / "instances_modal.json").is_file()
