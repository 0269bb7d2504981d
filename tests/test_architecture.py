"""House rules that a machine can check: one direction of imports, light command lines, a ground floor of its own."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOORS = ("labeling", "sbm_gym", "agents", "experiments")
COMMANDS = (
    "labeling.generate",
    "labeling.evaluate",
    "labeling.convert",
    "labeling.inspect",
    "labeling.detect",
    "labeling.finetune",
    "labeling.train3d",
    "labeling.detect3d",
    "sbm_gym.assets",
    "sbm_gym.photographs",
    "sbm_gym.preview",
    "agents.collect",
    "agents.evaluate",
    "agents.train",
    "experiments.bench",
    "experiments.box_pictures",
    "experiments.calibrate_labels",
    "experiments.capture",
    "experiments.demo",
    "experiments.pictures",
    "experiments.policies_page",
    "experiments.policy_pictures",
    "experiments.pretrain_compact",
    "experiments.run",
    "experiments.ship_policy",
)
HEAVY = ("torch", "torchvision", "open3d", "sklearn", "scipy", "numba", "mujoco", "stable_baselines3", "matplotlib")


def modules_of(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def imported_packages(path: Path) -> set[str]:
    """Top-level names of all imports of a file, also those inside functions."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add((node.module or "").split(".")[0])
    return names


@pytest.mark.parametrize("floor", range(len(FLOORS)), ids=FLOORS)
def test_no_floor_imports_a_higher_one(floor):
    higher = set(FLOORS[floor + 1 :])
    for path in modules_of(FLOORS[floor]):
        assert not imported_packages(path) & higher, path


def test_assets_and_rendering_know_nothing_of_worlds():
    for path in [*modules_of("sbm_gym/assets"), *modules_of("sbm_gym/rendering")]:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not {name for name in imported if name and name.startswith("sbm_gym.worlds")}, path


def test_what_the_label_generator_has_learnt_is_installed_with_it():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"][
        "package-data"
    ]
    shipped = {path for name, globs in declared.items() for glob in globs for path in _folder(name).glob(glob)}
    data = {path for path in (ROOT / "labeling").rglob("*.*") if path.suffix in (".json", ".safetensors")}
    assert data
    assert data <= shipped


def _folder(package: str) -> Path:
    return ROOT / package.replace(".", "/")


def test_labeling_never_imports_a_simulator():
    for path in modules_of("labeling"):
        assert not imported_packages(path) & {"mujoco", "gymnasium", "stable_baselines3"}, path


@pytest.mark.parametrize("package", FLOORS)
def test_relative_imports_are_not_used(package):
    for path in modules_of(package):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        assert not any(isinstance(node, ast.ImportFrom) and node.level for node in ast.walk(tree)), path


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
