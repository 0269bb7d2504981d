"""House rules that a machine can check: which way imports go, how full a folder is, where commands stand."""

import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from graphlib import TopologicalSorter

import pytest

from labeling.runtime.extras import EXTRAS

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
MOST_MODULES = 15
"""In one folder: what fits on a screen."""


@pytest.mark.parametrize("package", PACKAGES)
def test_no_folder_shows_more_than_fifteen_modules(package):
    count = Counter(map(folder_of, modules(package)))
    assert not {folder: n for folder, n in count.items() if n > MOST_MODULES}


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES)
def test_no_package_imports_a_higher_one(package):
    allowed = set(PACKAGES[: PACKAGES.index(package) + 1])
    wrong = {name: other for name in modules(package) for other in imports()[name] if package_of(other) not in allowed}
    assert not wrong


@pytest.mark.slow
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
    assert not [command for command in COMMANDS if command.count(".") > 1]


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
        for folder in (PACKAGES if name == "*" else [name.replace(".", "/")])
        for path in (ROOT / folder).glob(pattern)
    }
    data = {
        path
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.*")
        if path.is_file() and path.suffix not in (".py", ".pyc", ".nbi", ".nbc") and "results" not in path.parts
    }
    assert data
    assert data <= shipped


ABSENT = """
import sys
from importlib.abc import MetaPathFinder
class Absent(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in {names!r}:
            raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)
sys.meta_path.insert(0, Absent())
import runpy
"""
"""A program's first lines, in which modules cannot be imported."""


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_help_answers_where_no_extra_is_installed_and_loads_nothing_heavy(command):
    heavy = ("scipy", "numba", "cv2")
    program = ABSENT.format(names=set(EXTRAS)) + (
        f"sys.argv = ['python -m {command}', '--help']\n"
        "try:\n"
        f"    runpy.run_module({command!r}, run_name='__main__')\n"
        "except SystemExit as end:\n"
        "    assert end.code in (0, None), end.code\n"
        f"loaded = [name for name in {heavy!r} if name in sys.modules]\n"
        "assert not loaded, loaded\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert result.returncode == 0, result.stderr
    assert "usage" in result.stdout.lower()


def test_a_missing_extra_is_one_sentence_that_names_it(tmp_path):
    program = ABSENT.format(names=set(EXTRAS)) + (
        f"sys.argv = ['train', '--env', 'sbm_gym/Indoor-v0', '--out', {str(tmp_path / 'run')!r}, '--seed', '1']\n"
        "runpy.run_module('agents.train', run_name='__main__')\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert result.returncode == 2, result.stderr
    assert result.stderr == (
        "error: python -m agents.train needs the extra 'rl': pip install './CLONE[rl]', "
        "with CLONE the folder of seeing-by-moving\n"
    )


def test_every_import_is_declared():
    """A package imports what plain installation brings, and what its extras bring; each extra lists what it is for."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    renamed = {"cv2": "opencv-python-headless", "OpenGL": "pyopengl", "PIL": "pillow", "pydensecrf": "pydensecrf2"}
    renamed |= {
        "sklearn": "scikit-learn",
        "yaml": "pyyaml",
        "markupsafe": "jinja2",
        "llvmlite": "numba",
    }  # which need it

    def listed(requirements):
        return {re.split(r"[<>=\[]", requirement)[0] for requirement in requirements}

    imported = {
        name.partition(".")[0]
        for package in PACKAGES
        for path in modules(package).values()
        for name in imported_names(syntax_tree(path))
    } - {*sys.stdlib_module_names, *PACKAGES}
    for name in imported:
        distribution = renamed.get(name, name.replace("_", "-"))
        requirements = project["optional-dependencies"][EXTRAS[name]] if name in EXTRAS else project["dependencies"]
        assert distribution in listed(requirements), name


@pytest.mark.slow
def test_labeling_runs_where_no_extra_is_installed(tmp_path, apc_shelf):
    program = ABSENT.format(names=set(EXTRAS)) + (
        f"sys.argv = ['generate', {str(apc_shelf)!r}, '--confident', '0.6', '--out', {str(tmp_path / 'labels')!r}]\n"
        "runpy.run_module('labeling.generate', run_name='__main__')\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "labels" / "instances_modal.json").is_file()


@pytest.mark.nightly
def test_the_bare_wheel_labels_a_capture(tmp_path, apc_shelf):
    """Built, installed with nothing but its dependencies into a fresh environment, and run away from the sources."""
    source, labels, venv = tmp_path / "source", tmp_path / "labels", tmp_path / "venv"
    ignored = shutil.ignore_patterns(".*", "out", "build", "*.egg-info", "tests", "__pycache__", "pictures")
    shutil.copytree(ROOT, source, ignore=ignored)
    pip = [str(venv / "bin" / "python"), "-m", "pip", "--quiet", "--disable-pip-version-check"]
    for line in (
        [sys.executable, "-m", "venv", str(venv)],
        [*pip, "wheel", "--no-deps", "--wheel-dir", str(tmp_path), str(source)],
        [*pip, "install", "--constraint", str(ROOT / "constraints.txt")],
    ):
        line = [*line, *map(str, tmp_path.glob("*.whl"))] if "install" in line else line
        done = subprocess.run(line, capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    python = str(venv / "bin" / "python")
    capture = [str(apc_shelf), "--confident", "0.6", "--out", str(labels)]
    done = subprocess.run([python, "-m", "labeling.generate", *capture], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (labels / "instances_modal.json").is_file()
    for absent in ("torch", "mujoco", "gymnasium", "open3d", "stable_baselines3"):
        assert subprocess.run([python, "-c", f"import {absent}"], capture_output=True, cwd=tmp_path).returncode == 1
    packages = next(venv.glob("lib/*/site-packages"))
    shipped = {path.relative_to(packages) for package in PACKAGES for path in (packages / package).rglob("*.*")}
    expected = {
        path.relative_to(ROOT)
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.*")
        if path.is_file() and path.suffix not in (".pyc", ".nbi", ".nbc") and "results" not in path.parts
    }
    assert expected <= shipped
