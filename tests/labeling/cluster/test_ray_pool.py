"""Jobs on a real Ray cluster: two nodes of one core on this machine."""

import itertools
import os
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from labeling.cluster import ray_connection, ray_orders, ray_schedule
from labeling.cluster.cluster_config import ClusterConfig, JobFiles, SameThere
from labeling.cluster.jobs import map_jobs, run_jobs
from labeling.core.errors import SbmError, UsageError
from labeling.runtime.process_pool import WorkerDiedError

from . import cluster_work

ROOT = Path(__file__).parents[3]


@pytest.fixture
def where(ray_cluster: Any, monkeypatch: pytest.MonkeyPatch) -> ClusterConfig:
    monkeypatch.syspath_prepend(str(ROOT))  # processes find modules where this one does
    return ClusterConfig(ray_cluster.address)


@pytest.mark.slow
def test_results_come_in_order_from_processes_of_all_nodes(where: ClusterConfig, tmp_path: Path) -> None:
    jobs = [(str(tmp_path), number, 2) for number in range(20)]
    found = list(map_jobs(cluster_work.meet, jobs, 1, where=where, ordered=True))
    assert [job for job, _ in found] == list(range(20))
    assert len({pid for _, pid in found}) == 2
    assert os.getpid() not in {pid for _, pid in found}
    assert list(map_jobs(cluster_work.double, [], 1, where=where)) == []
    ((threads, opencv, _, folder),) = map_jobs(cluster_work.surroundings, [0], 1, where=where)
    assert (threads, opencv) == (1, 1)
    assert folder.endswith(str(Path.cwd()))


@pytest.mark.nightly
def test_a_job_that_kills_its_process_three_times_is_told_and_the_others_are_done(
    where: ClusterConfig, capfd: pytest.CaptureFixture[str]
) -> None:
    outcomes = list(run_jobs(cluster_work.die_or_double, range(8), 1, where=where, ordered=True))
    assert [outcome.number for outcome in outcomes] == list(range(8))
    assert [outcome.value for outcome in outcomes] == [0, 2, 4, None, 8, None, 12, 14]
    died, unlucky = outcomes[3].error, outcomes[5].error
    assert isinstance(died, WorkerDiedError)
    assert "its process was lost 3 times" in str(died)
    assert "ActorDiedError on node" in str(died)
    assert type(unlucky) is SbmError
    assert str(unlucky) == "5 is unlucky"
    assert capfd.readouterr().err.count("its job is done again") == 2


@pytest.mark.slow
def test_files_travel_and_what_comes_home_is_what_would_be_written_here(
    where: ClusterConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "home"
    (home / "inputs").mkdir(parents=True)
    monkeypatch.chdir(home)
    (home / "word").write_text("word")
    (home / "elsewhere.txt").write_text("linked")
    inputs = [home / "inputs" / "absolute.txt", Path("inputs/relative.txt"), Path("../home/inputs/up.txt")]
    for path in inputs:
        path.write_text(path.stem)
    Path("inputs/link.txt").symlink_to(home / "elsewhere.txt")
    inputs += [Path("inputs/link.txt"), Path("inputs/bad.txt"), Path("inputs/missing.txt")]
    Path("inputs/bad.txt").write_text("bad")
    found = {}
    for name, place in (("here", ClusterConfig()), ("there", where)):
        out = home / name
        out.mkdir()
        copier = cluster_work.Copier(out, Path("word"))
        files = JobFiles(out, lambda job: [job], [Path("word")])
        outcomes = list(run_jobs(copier.copy, inputs, 1, where=place, files=files, ordered=True))
        written = {path.name: path.read_bytes() for path in sorted(out.iterdir())}
        found[name] = [(one.value, str(one.error)) for one in outcomes], written
        if place is where:
            written.pop("bad.json", None)
    (results, written), (expected, locally) = found["there"], found["here"]
    locally.pop("bad.json")  # of a job that fails nothing comes home
    assert results == expected
    assert written == locally
    assert len(written) == 4
    assert "bad.txt: is bad" in results[4][1]
    assert "No such file" in results[5][1]


def test_paths_through_folders_that_do_not_travel_lead_on(tmp_path: Path) -> None:
    from labeling.cluster.travel import pack, unpack

    (tmp_path / "here" / "labels" / "one").mkdir(parents=True)
    (tmp_path / "here" / "picture").write_text("picture")
    given = tmp_path / "here" / "labels" / "one" / ".." / ".." / "picture"
    written = unpack(pack([given, given]), str(tmp_path / "there"))
    assert {path.name for path in written} == {"picture"}
    assert Path(f"{tmp_path / 'there'}{given}").read_text() == "picture"


def test_a_whole_folder_appears_at_once(tmp_path: Path) -> None:
    from labeling.cluster.travel import bring_home

    bring_home(tmp_path, [("0001/a/x.txt", b"x"), ("0001/y.txt", b"y")], whole=True)
    assert (tmp_path / "0001" / "a" / "x.txt").read_bytes() == b"x"
    assert [path.name for path in tmp_path.iterdir()] == ["0001"]
    with pytest.raises(UsageError, match=r"called '\.\./evil'"):
        bring_home(tmp_path, [("../evil", b"")], whole=False)


@pytest.mark.nightly
def test_jobs_without_end_are_taken_as_processes_become_free(where: ClusterConfig) -> None:
    taken = itertools.count()
    with closing(map_jobs(cluster_work.double, taken, 1, where=where, ordered=True)) as results:
        assert list(itertools.islice(results, 5)) == [0, 2, 4, 6, 8]
    assert next(taken) < 30


@pytest.mark.nightly
def test_a_node_that_dies_costs_its_jobs_once(
    where: ClusterConfig, ray_cluster: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    third = ray_cluster.add_node(num_cpus=1)
    jobs = [(str(tmp_path), number) for number in range(9)]

    def kill_when_all_are_busy() -> None:
        deadline_s = time.monotonic() + 120
        while len(list(tmp_path.glob("begun-*"))) < 3 and time.monotonic() < deadline_s:
            time.sleep(0.05)
        pids = {int(path.name.split("-")[2]) for path in tmp_path.glob("begun-*")}
        ray_cluster.remove_node(third, allow_graceful=False)
        while all(Path("/proc", str(pid)).exists() for pid in pids) and time.monotonic() < deadline_s:
            time.sleep(0.05)  # a process outlives its node by a moment
        (tmp_path / "may end").touch()

    killer = threading.Thread(target=kill_when_all_are_busy)
    killer.start()
    found = list(map_jobs(cluster_work.stay, jobs, 1, where=where, ordered=True))
    killer.join()
    assert found == list(range(9))
    begun = sorted(path.name.split("-")[1] for path in tmp_path.glob("begun-*"))
    assert len(begun) == 10  # one job twice
    assert len(set(begun)) == 9
    assert capfd.readouterr().err.count("its job is done again") == 1


@pytest.mark.nightly
def test_an_input_larger_than_an_object_store_is_one_sentence(where: ClusterConfig, tmp_path: Path) -> None:
    large, small = tmp_path / "large.txt", tmp_path / "small.txt"
    small.write_text("small")
    with large.open("wb") as file:
        file.truncate(140_000_000)  # takes no room on the disk
    copier = cluster_work.Copier(tmp_path / "out", small)
    files = JobFiles(tmp_path / "out", lambda job: [job], [small])
    too_large, fine = run_jobs(copier.copy, [large, small], 1, where=where, files=files, ordered=True)
    assert isinstance(too_large.error, SbmError)
    assert "large.txt: 140 MB are too many for the object store of node" in str(too_large.error)
    assert "of 157 MB; start it with a larger --object-store-memory, or give --shared" in str(too_large.error)
    assert fine.error is None
    files = JobFiles(tmp_path / "out", common=[large])
    with pytest.raises(SbmError, match="what all jobs read: 140 MB are too many"):
        list(run_jobs(cluster_work.double, [1], 1, where=where, files=files))


@pytest.mark.nightly
def test_inputs_on_the_way_never_fill_an_object_store(where: ClusterConfig, tmp_path: Path) -> None:
    inputs = [tmp_path / f"{number}.txt" for number in range(3)]
    for path in inputs:
        path.write_bytes(b"x" * 600_000)
    on_the_way = []
    give = ray_schedule.Schedule._give

    def watched(run: Any, process: Any, given: Any) -> None:
        give(run, process, given)
        on_the_way.append(sum(other.given.bytes for other in run.processes if other.given))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ray_schedule.Schedule, "_give", watched)
        patch.setattr(ray_schedule, "STORE_SHARE", 0.005)
        files = JobFiles(tmp_path / "out", lambda job: [job])
        assert list(map_jobs(len_of, inputs, 1, where=where, files=files, ordered=True)) == [600_000] * 3
    assert on_the_way == [600_000] * 3  # two would be more than this share of 157 MB


def len_of(path: Path) -> int:
    return path.stat().st_size


@pytest.mark.slow
def test_a_node_that_differs_is_named_with_what_differs(
    where: ClusterConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    same = [SameThere("furniture libraries", cluster_work.digest_of_process)]
    with pytest.raises(SbmError, match="no node of the cluster can be used") as refused:
        list(map_jobs(cluster_work.double, [1], 1, where=where, same=same))
    assert "furniture libraries: chairs.sh3f is " in str(refused.value)
    assert f"there and {os.getpid()} here" in str(refused.value)
    assert "is not used" in capfd.readouterr().err
    contents_here = ray_orders.contents_here

    def of_other_code(*arguments: Any) -> dict[str, dict[str, str]]:
        found = contents_here(*arguments)
        return {**found, "code": {**found["code"], "labeling/generate.py": "0123456789abcdef"}}

    monkeypatch.setattr(ray_orders, "contents_here", of_other_code)
    with pytest.raises(SbmError, match=r"code: labeling/generate.py is [0-9a-f]{12} there and 0123456789ab here"):
        list(map_jobs(cluster_work.double, [1], 1, where=where))


@pytest.mark.nightly
def test_a_shared_disk_is_used_where_it_is(
    where: ClusterConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.txt").write_text("in")
    shared = ClusterConfig(where.cluster, tmp_path)
    copier = cluster_work.Copier(Path("out"), Path("in.txt"))
    files = JobFiles(Path("out"), lambda job: [job], [Path("in.txt")])
    assert list(map_jobs(copier.copy, [Path("in.txt")], 1, where=shared, files=files)) == ["in.txt: in.txt: in in"]
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["in.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.txt", "out"]
    with pytest.raises(UsageError, match=r"--shared .*: /elsewhere does not lie below it"):
        list(map_jobs(copier.copy, [Path("in.txt")], 1, where=shared, files=JobFiles(Path("/elsewhere"))))


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("127.0.0.1:1", "nobody answers there"),
        ("ray://127.0.0.1:1", "nobody answers there"),
        ("somewhere", "must be local, auto, HOST:PORT or ray://HOST:PORT, not 'somewhere'"),
    ],
)
def test_a_cluster_that_is_not_there_is_one_sentence(address: str, told: str) -> None:
    pytest.importorskip("ray", reason="needs the extra 'cluster'")
    with pytest.raises(UsageError, match=told):
        ray_connection.check_reachable(address)
