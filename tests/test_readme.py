"""README keeps its word: its code blocks run, and its links lead somewhere, on a package index, too."""

import importlib
import re
import runpy
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from .imports import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
TOURS = README.partition("## Three tours")[2]
BLOCKS = dict(re.findall(r"\*\*(.*?)\.\*\*[^`]*?\n\n```sh\n(.*?)```", TOURS, re.DOTALL))
"""The shell commands of each tour, by its title."""
SMOKE = {
    "sbm_gym.preview": {"--what": "scenes", "--worlds": "indoor-builtin", "--scenes": "1", "--size": "48"},
    "agents.train": {
        **{"--steps": "400", "--envs": "4", "--processes": "1", "--scenes": "1", "--validation-scenes": "1"},
        **{"--eval-every": "400", "--eval-episodes": "1", "--compare-episodes": "0", "--detector": "simulated"},
    },
    "agents.evaluate": {"--episodes": "1", "--seeds": "1", "--detector": "simulated"},
    "agents.collect": {
        **{"--env": "sbm_gym/IndoorBuiltin-v0", "--episodes": "1", "--size": "96", "--detector": "simulated"},
        "--workers": "1",
    },
    "experiments.policy_pictures": {"--episodes": "1"},
    "labeling.generate": {"--workers": "1"},
    "labeling.finetune": {
        **{"--iterations": "2", "--batch-size": "1", "--validate-every": "1"},
        "--short-side-px": "64 64",
    },
}
"""What makes the commands of the tours small enough for a test."""


def smoke(module: str, words: list[str]) -> list[str]:
    """A command line of README with the options that make it small, in place of its own."""
    for option, value in SMOKE.get(module, {}).items():
        if option in words:
            start = words.index(option)
            end = next((i for i in range(start + 1, len(words)) if words[i].startswith("--")), len(words))
            words = words[:start] + words[end:]
        words = [*words, option, *value.split()]
    return words


def run_block(block: str) -> list[str]:
    """Runs every line of a block; returns the commands."""
    ran = []
    for line in block.splitlines():
        program, dash, module, *words = shlex.split(line, comments=True)
        assert (program, dash) == ("python", "-m"), line
        main = importlib.import_module(module).main
        assert main(smoke(module, words)) == 0, line
        ran.append(module)
    return ran


def test_there_are_three_tours_of_five_lines() -> None:
    assert list(BLOCKS) == ["Label my recording", "Train a policy", "Improve a detector"]
    assert all(len(block.splitlines()) == 5 for block in BLOCKS.values())


@pytest.mark.nightly
def test_a_recording_is_labelled_as_readme_says(tmp_path: Path, monkeypatch) -> None:
    from agents.collect import main as collect

    monkeypatch.chdir(tmp_path)
    recorded = ["--env", "sbm_gym/IndoorBuiltin-v0", "--detector", "simulated", "--size", "96", "--out", "EPISODES"]
    assert collect(["--policy", "ring", "--episodes", "1", *recorded]) == 0
    (folder,) = (path.parent for path in Path("EPISODES").glob("*/transforms.json"))
    shutil.move(folder, "MY_CAPTURE")
    Path("MY_CAPTURE", "detections.json").unlink()
    run_block(BLOCKS["Label my recording"])
    assert {"instances_modal.json", "boxes_3d.json", "metrics.json", "report.html"} <= {
        path.name for path in Path("LABELS").iterdir()
    }
    assert list(Path("PICTURES").glob("*.png"))


@pytest.mark.nightly
def test_a_policy_is_trained_as_readme_says(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_block(BLOCKS["Train a policy"])
    assert list(Path("PREVIEW").rglob("*.png"))
    assert list(Path("FILMS").glob("*.gif"))
    assert list(Path("EPISODES").glob("*/transforms.json"))


@pytest.mark.nightly
def test_a_detector_is_improved_as_readme_says(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_block(BLOCKS["Improve a detector"])
    assert Path("BETTER", "detector.safetensors").is_file()


def test_the_python_blocks_run() -> None:
    propagating, acting = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    rgb, depth_m = np.full((2, 48, 64, 3), 128, np.uint8), np.full((2, 48, 64), 3.0, np.float32)
    rgb[:, 12:36, 20:44], depth_m[:, 12:36, 20:44] = (200, 60, 60), 2.0
    intrinsics = np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])
    names = {
        **{"rgb": rgb, "depth_m": depth_m, "mask": depth_m[0] < 2.5},
        **{"intrinsics": np.stack([intrinsics] * 2), "camera_to_world": np.stack([np.eye(4)] * 2)},
    }
    exec(propagating, names)
    assert names["labels"].labels[0].category == "chair"
    exec(acting, names)
    assert set(names["info"]["reward_terms"]) >= {"discovery", "diversity", "collision", "step"}


def test_links_lead_somewhere_in_the_clone_and_on_a_package_index() -> None:
    absolute = runpy.run_path(str(ROOT / "setup.py"))["absolute_links"]
    local = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", README)
    assert len(local) > 20
    for target in local:
        assert (ROOT / target).is_file(), target
    page = absolute(README)
    targets = re.findall(r"\]\(([^)]+)\)", page)
    assert len(targets) >= len(local)
    assert all(target.startswith("https://") for target in targets)
    assert (
        "](https://raw.githubusercontent.com/seeing-by-moving/seeing-by-moving/main/docs/pictures/labels.png)" in page
    )
    assert "](https://github.com/seeing-by-moving/seeing-by-moving/blob/main/docs/worlds.md)" in page
    assert absolute(page) == page


def test_the_table_of_results_is_that_of_the_committed_results() -> None:
    from experiments.pages.readme import with_results

    assert with_results(README, ROOT / "experiments" / "results") == README, "run: python -m experiments.pages readme"
