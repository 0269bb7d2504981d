import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from labeling.generate import main
from labeling.io.episodes import write_episode
from labeling.runtime.threads import THREAD_VARIABLES

from ..synthetic_room import make_episode

ROOT = Path(__file__).parents[3]
DETECTOR = """
import os, time
from pathlib import Path
import numpy as np

def steady(rgb):
    Path({log!r}, f"{{os.getpid()}}.threads").write_text(
        " ".join([str(__import__("numba").get_num_threads()), str(__import__("cv2").getNumThreads())])
    )
    mask = np.zeros(rgb.shape[:2], bool)
    mask[20:40, 20:44] = True
    return [("thing", 0.95, mask)]

def deadly(rgb):
    if rgb[0, 0, 0] == 255:
        os._exit(9)
    return steady(rgb)

def slow(rgb):
    Path({log!r}, f"{{os.getpid()}}.slow").write_text("")
    time.sleep(60)  # is killed meanwhile; what a failed test leaves behind ends by itself
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rooms")
    for seed in range(3):
        episode = make_episode(seed, num_views=3, size=(48, 64), num_objects=3, confident_share=2.0)
        episode.rgb[:, 0, 0] = 255 if seed == 1 else 0
        write_episode(folder / f"room_{seed}", episode)
    return folder


@pytest.fixture
def detector(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Name of a module with detectors that only processes started in ``tmp_path`` and this one know."""
    name = f"detectors_of_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(DETECTOR.format(log=str(tmp_path)))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(tmp_path)]))
    return name


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def others_of_session(pid: int) -> list[int]:
    """Live processes, other than its leader, of the session that ``pid`` leads."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == pid and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return [one for one in found if one != pid]


def wait_for(condition, seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.05)  # other processes do what is waited for: nothing tells of it but to look again


@pytest.mark.slow
def test_labels_are_the_same_for_any_number_of_workers(dataset: Path, tmp_path: Path) -> None:
    before = dict(os.environ)
    for workers in (1, 2):
        assert main([str(dataset), "--out", str(tmp_path / str(workers)), "--workers", str(workers)]) == 0
    assert files(tmp_path / "1") == files(tmp_path / "2")
    assert dict(os.environ) == before


@pytest.mark.parametrize("most_px", [0, 10**9])
def test_episodes_read_ahead_and_written_behind_are_told_in_order(
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    threads_told: Callable[[int], None],
    capsys: pytest.CaptureFixture[str],
    most_px: int,
) -> None:
    threads_told(2)
    monkeypatch.setattr("labeling.generator.label_jobs.MAX_BESIDE_PX", most_px)
    broken = tmp_path / "rooms"
    shutil.copytree(dataset, broken)
    (broken / "room_1" / "rgb" / "000.png").write_bytes(b"no picture")
    assert main([str(broken), "--out", str(tmp_path / "labels")]) == 2
    assert "room_1" in capsys.readouterr().err
    states = json.loads((tmp_path / "labels" / "label_set.json").read_text())["episodes"]
    assert [(one["name"], one["status"]) for one in states] == [
        ("room_0", "labelled"),
        ("room_1", "failed"),
        ("room_2", "labelled"),
    ]
    threads_told(1)
    assert main([str(broken), "--out", str(tmp_path / "alone")]) == 2
    written, alone = files(tmp_path / "labels"), files(tmp_path / "alone")
    assert written == alone
    assert {"episodes/room_0.json", "episodes/room_2.json"} <= set(written)


@pytest.mark.slow
def test_threads_are_shared_out_among_the_workers(dataset: Path, tmp_path: Path, detector: str) -> None:
    flags = ["--detector", f"{detector}:steady", "--workers", "2"]
    assert main([str(dataset), "--out", "labels", *flags]) == 0
    logs = list(tmp_path.glob("*.threads"))
    assert f"{os.getpid()}.threads" not in {log.name for log in logs}
    share = max(1, len(os.sched_getaffinity(0)) // 2)
    told = os.environ.get("NUMBA_NUM_THREADS")
    share = share if told is None else max(1, int(told) // 2)
    assert {log.read_text() for log in logs} == {f"{share} {share}"}


@pytest.mark.slow
def test_an_episode_whose_worker_dies_is_told_and_the_others_are_labelled(
    dataset: Path, tmp_path: Path, detector: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(dataset), "--out", "labels", "--detector", f"{detector}:deadly", "--workers", "2"]) == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if "error:" in line]
    assert len(errors) == 2
    assert "room_1" in errors[0]
    assert "exit code 9" in errors[0]
    states = json.loads(Path("labels/label_set.json").read_text())["episodes"]
    assert [state["status"] for state in states] == ["labelled", "failed", "labelled"]


@pytest.mark.slow
@pytest.mark.parametrize("how", [pytest.param(signal.SIGINT, marks=pytest.mark.nightly), signal.SIGKILL])
def test_no_worker_and_no_half_file_outlives_the_program(
    dataset: Path, tmp_path: Path, detector: str, how: int
) -> None:
    command = [sys.executable, "-m", "labeling.generate", str(dataset), "--out", str(tmp_path / "labels")]
    command += ["--detector", f"{detector}:slow", "--workers", "2"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        wait_for(lambda: len(list(tmp_path.glob("*.slow"))) == 2)
        if how == signal.SIGINT:
            os.killpg(process.pid, how)  # as a terminal does
        else:
            process.kill()
        _, errors = process.communicate(timeout=60)
    wait_for(lambda: not others_of_session(process.pid))
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert "Traceback" not in errors
        assert errors.strip().splitlines()[-1].startswith("interrupted")
    assert not [path for path in (tmp_path / "labels").rglob("*") if path.is_file()]


def test_fewer_workers_than_one_are_refused(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(dataset), "--out", str(tmp_path / "labels"), "--workers", "0"]) == 2
    assert "--workers" in capsys.readouterr().err
    assert not (tmp_path / "labels").exists()


def test_all_thread_pools_are_bounded() -> None:
    assert {"NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"} <= set(THREAD_VARIABLES)
