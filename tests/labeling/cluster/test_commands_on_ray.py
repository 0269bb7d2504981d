"""Commands of ``labeling`` on a real Ray cluster: the same bytes as on one machine."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from labeling import detect, generate
from labeling.io.episodes import write_episode

from ..synthetic_room import make_episode

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    for seed in (1, 2, 3):
        episode = make_episode(seed, num_views=3, size=(48, 64), num_objects=3, confident_share=2.0)
        scene = {"world": "rooms", "scene": f"room_{seed // 2}"}
        write_episode(folder / f"room_{seed}", replace(episode, metadata=scene))
    return folder


@pytest.fixture
def dataset(recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(ROOT))
    return Path(shutil.copytree(recorded, tmp_path / "dataset"))


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.nightly
def test_labels_are_the_same_bytes_as_on_one_machine(
    ray_cluster: Any, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    (dataset / "room_2" / "depth" / "001.png").unlink()  # one episode that cannot be read
    shutil.copytree(dataset, dataset / ".." / "again")
    assert generate.main([str(dataset), "--out", str(here)]) == 2
    told = capsys.readouterr().err
    assert generate.main([str(dataset), "--out", str(there), "--cluster", ray_cluster.address]) == 2
    assert contents(there) == contents(here)
    errors = re.findall("error: .*", told)  # also behind a progress bar
    assert re.findall("error: .*", capsys.readouterr().err) == errors
    assert len(errors) == 2
    written = {path: path.stat().st_mtime_ns for path in (there / "clouds").iterdir()}
    generate.main([str(dataset), "--out", str(there), "--cluster", ray_cluster.address])
    assert {path: path.stat().st_mtime_ns for path in (there / "clouds").iterdir()} == written
    assert contents(there) == contents(here)


@pytest.mark.nightly
def test_scenes_that_share_labels_are_labelled_together(
    ray_cluster: Any, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for out, more in (("here", []), ("there", ["--cluster", ray_cluster.address])):
        assert generate.main(["dataset", "--out", out, "--share-scenes", *more]) == 0
    assert contents(Path("there")) == contents(Path("here"))
    before = {path: path.stat().st_mtime_ns for path in Path("there/clouds").iterdir()}
    assert generate.main(["dataset", "--out", "there", "--share-scenes", "--cluster", ray_cluster.address]) == 0
    assert {path: path.stat().st_mtime_ns for path in Path("there/clouds").iterdir()} == before
    assert contents(Path("there")) == contents(Path("here"))


@pytest.mark.nightly
def test_detections_come_home_into_the_episodes(
    ray_cluster: Any, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (dataset / "room_1" / "detections.json").unlink()
    other = Path(shutil.copytree(dataset, tmp_path / "other"))
    detector = "tests.labeling.cluster.cluster_work:find"
    command = ["--detector", detector, "--replace"]
    assert detect.main([str(dataset), *command]) == 0
    assert detect.main([str(other), *command, "--cluster", ray_cluster.address]) == 0
    assert contents(other) == contents(dataset)
    capsys.readouterr()
    assert detect.main([str(other), *command, "--cluster", ray_cluster.address]) == 0
    assert "3 were done already" in capsys.readouterr().out


@pytest.mark.nightly
def test_a_program_that_is_killed_goes_on_where_it_was(ray_cluster: Any, dataset: Path, tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    assert generate.main([str(dataset), "--out", str(here)]) == 0
    command = [sys.executable, "-m", "labeling.generate", str(dataset), "--out", str(there)]
    command += ["--cluster", ray_cluster.address]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as program:
        deadline_s = time.monotonic() + 120
        while not list(there.glob("episodes/*.json")) and time.monotonic() < deadline_s:
            time.sleep(0.01)
        program.kill()
        program.communicate(timeout=60)
    assert program.returncode == -signal.SIGKILL
    assert subprocess.run(command, cwd=ROOT, check=False, timeout=120).returncode == 0
    assert contents(there) == contents(here)
    # It is told to stop, too.
    shutil.rmtree(there)
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True, env=dict(os.environ)) as program:
        assert program.stderr is not None
        assert any("cluster: 2 nodes, 2 cores" in line for line in program.stderr)  # the first that does
        program.send_signal(signal.SIGTERM)
        _, errors = program.communicate(timeout=60)
    assert program.returncode == 143
    assert "ended by SIGTERM" in errors
    assert "Traceback" not in errors
