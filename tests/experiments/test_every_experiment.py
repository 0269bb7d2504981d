"""Every experiment, at its smallest scale, in real worlds, from recording to the page."""

import json
from pathlib import Path

import pytest

from experiments.cache.registry import experiments
from experiments.run import main


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One cache for all, as somebody would have who runs them one after the other."""
    root = tmp_path_factory.mktemp("experiments")
    return {name: root / name for name in ("cache", "results", "docs")}


@pytest.mark.nightly
@pytest.mark.parametrize("name", experiments())
def test_it_runs_end_to_end(name: str, places: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [f"--{place}={folder}" for place, folder in places.items()]
    assert main([name, "--scale", "smoke", "--seeds", "1", "--workers", "2", *arguments]) == 0
    content = json.loads((places["results"] / f"{name}.json").read_text())
    assert (content["experiment"], content["scale"], content["seeds"]) == (name, "smoke", [0])
    said = [Path(line) for line in capsys.readouterr().out.splitlines() if line.startswith(str(places["docs"]))]
    assert any(path.suffix == ".md" for path in said)
    assert all(path.stat().st_size > 0 for path in said)
