"""The frame that benches run in: registry, table, files; and the render bench once, quickly."""

import json
import subprocess
import sys
from importlib import import_module
from types import SimpleNamespace

import pytest

from experiments import bench
from experiments.benchmarks import label_stages, policies, rows
from experiments.benchmarks.rows import Row, as_json, row_of, table
from experiments.pages.benchmarks import page


def fake_rows(quick):
    rows.log("measuring")
    yield Row("ours: a thing", "theirs", 0.5 if quick else 0.25, 1.0, "3x", True)
    yield Row("ours: another", "limit", 2.0, None, "< 1 s", False)
    yield Row("ours: third", "limit", 0.001, None, megabytes=12.4)


@pytest.fixture
def fake_bench(monkeypatch):
    monkeypatch.setattr(bench, "BENCHES", {"fake": "experiments.bench_fake"})
    monkeypatch.setattr(bench, "import_module", lambda name: SimpleNamespace(measure=fake_rows))


def test_rows_are_printed_and_written(fake_bench, tmp_path, capsys):
    assert bench.main(["fake", "--out", str(tmp_path)]) == 0
    written = json.loads((tmp_path / "fake.json").read_text())
    assert written["bench"] == "fake"
    assert written["machine"]["cpus"] >= 1
    first, second, third = written["rows"]
    assert (first["rival"], first["seconds"], first["rival_seconds"], first["ratio"]) == ("theirs", 0.25, 1.0, 4.0)
    assert (second["rival_seconds"], second["ratio"], second["holds"]) == (None, None, False)
    assert third["holds"] is None
    out = capsys.readouterr()
    assert "4.0x" in out.out
    assert "MISSED" in out.out
    assert "12 MB" in out.out
    assert out.err == "measuring\n"


def test_tables_are_aligned():
    lines = table("fake", list(fake_rows(True))).splitlines()
    column = lines[2].index("baseline")
    assert {line[column:].split()[0] for line in lines[3:]} == {"theirs", "limit"}


def test_unknown_benches_name_the_known(tmp_path, capsys):
    assert bench.main(["speed", "--out", str(tmp_path / "o")]) == 2
    assert capsys.readouterr().err == "error: there is no bench 'speed'; benches are " + ", ".join(bench.BENCHES) + "\n"
    assert not (tmp_path / "o").exists()


def test_every_registered_bench_can_be_imported():
    for module in bench.BENCHES.values():
        assert callable(import_module(module).measure)


@pytest.mark.nightly
def test_render_bench_measures_every_promise(tmp_path):
    command = [sys.executable, "-m", "experiments.bench", "render", "--quick", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "render.json").read_text())["rows"]
    assert {row["wanted"] for row in rows} >= {"12x", "15x", "4x", "< 50 ms"}
    assert all(row["seconds"] > 0 for row in rows)
    assert all(row["note"].startswith("OpenGL: ") for row in rows if "mujoco.Renderer" in row["rival"])
    assert all((row["ratio"] is None) == (row["rival_seconds"] is None) for row in rows)


@pytest.mark.nightly
def test_policies_are_timed_beside_the_planner(monkeypatch):
    monkeypatch.setattr(policies, "ENVS", {"rooms": "sbm_gym/IndoorBuiltin-v0"})
    found = list(policies.measure(quick=True))
    assert [row.what.rpartition(" ")[2] for row in found] == list(policies.POLICIES)
    assert {row.baseline for row in found} == {"next_best_view"}
    assert all(row.seconds > 0 for row in found)
    assert [row.holds is None for row in found] == [False, True, True]


@pytest.mark.bench
@pytest.mark.nightly
def test_label_bench_measures_every_promise(tmp_path):
    command = [sys.executable, "-m", "experiments.bench", "labels", "--quick", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "labels.json").read_text())["rows"]
    assert {row["wanted"] for row in rows} >= {"15x, IoU no lower", "< 2.5 s", "< 1000 MB", "exponent <= 1.1"}
    # No stage can be faster than its floor.
    stages = [row for row in rows if row["what"].startswith("stage: ")]
    assert len(stages) >= 10
    assert all(row["ratio"] < 1.2 for row in stages)
    assert (tmp_path / "labels_views.png").is_file()


def test_rows_survive_being_written_and_stand_on_the_page():
    rows = [Row("one", "limit", 0.5, None, "< 1 s", True, "fast"), Row("two", "rival", 0.002, 0.01, "6x", False)]
    assert [row_of(json.loads(json.dumps(as_json(row)))) for row in rows] == rows
    machine = {"cpus": 2, "python": "3"}
    ours = {"machine": machine, "rows": [as_json(row) for row in rows]}
    before = {"machine": machine, "rows": [as_json(Row("two", "rival", 0.03, 0.01))]}
    text = page({"env": ours}, {"env": before})
    assert "| one | 500.0 ms |  | limit |  |  | < 1 s | holds; fast |\n" in text
    assert "| two | 2.0 ms | 30.0 ms | rival | 10.0 ms | 5.0x | 6x | **missed** |\n" in text


def test_every_timed_stage_is_a_function_that_exists():
    for stage, target in label_stages.STAGES.items():
        module, _, name = target.rpartition(".")
        assert callable(getattr(import_module(module), name)), stage


@pytest.mark.slow
def test_every_stage_of_labelling_is_timed_beside_its_floor(tmp_path, monkeypatch):
    from dataclasses import replace

    from experiments.benchmarks.labels import _label
    from labeling.io.episodes import write_episode

    from ...labeling.synthetic_room import make_episode

    monkeypatch.setattr(label_stages, "_bandwidth_mb_s", lambda: 1e4)
    monkeypatch.setattr(label_stages, "_flops_s", lambda: 1e11)
    room = make_episode(7, 4, (48, 64), num_objects=3, confident_share=2.0)
    write_episode(tmp_path / "room", replace(room, name="room"))
    rows = list(label_stages.stage_rows(lambda out: _label(tmp_path / "room", out), tmp_path / "room", 1))
    assert [row.what.removeprefix("stage: ") for row in rows] == list(label_stages.STAGES)
    assert all(row.seconds > 0 for row in rows)
    assert all(row.baseline_seconds is not None and row.baseline_seconds > 0 for row in rows)
