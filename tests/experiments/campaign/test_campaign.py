"""The campaign finds faults that are there, does the same for the same seed, and goes on where it was."""

import json
import shutil
import struct
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.campaign import campaign, corruptions, trial
from experiments.campaign.campaign_config import CampaignConfig
from experiments.campaign.damage import damage, damage_json, forge_png_size
from experiments.campaign.processes import leftovers, tree_digest
from experiments.campaign.soak import Sample, growth_mb_per_1000
from experiments.campaign.subjects import SUBJECTS, files_of
from labeling.core.errors import UsageError
from labeling.io.episodes import write_episode
from labeling.runtime.provenance import COMMIT_VARIABLE

from ...labeling.synthetic_room import make_episode

FAULTY = "tests.experiments.campaign.spoilt_commands"


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    for number in range(2):
        room = make_episode(number, num_views=3, size=(24, 32), num_objects=2)
        write_episode(folder / "episodes" / f"{number:04d}", room)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "outcome"),
    [
        ("nothing", "done"),
        ("refused", "refused"),
        ("raises", "traceback"),
        ("hangs", "hang"),
        ("greedy", "memory"),
        ("outside", "outside"),
        ("half-written", "half-written"),
        ("silent", "silent"),
    ],
)
def test_each_fault_is_found(what: str, outcome: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "PATIENCE_S", 1)
    monkeypatch.setattr(trial, "MOST_MEMORY_MB", 60)
    out = tmp_path / "results" / "out"
    out.parent.mkdir()
    found = trial.run_trial(FAULTY, [what, str(tmp_path), str(out)], tmp_path, out)
    assert found.outcome == outcome
    assert outcome in trial.OUTCOMES


@given(st.integers(0, 2**32 - 1))
def test_json_is_changed_and_the_original_is_not(seed: int) -> None:
    content = {"frames": [{"a": 1.5, "b": [1, 2, 3]}, {"a": 2.5}], "name": "room"}
    before = json.dumps(content)
    changed, what = damage_json(content, np.random.default_rng(seed))
    assert json.dumps(content) == before
    assert what
    again, _ = damage_json(content, np.random.default_rng(seed))
    assert json.dumps(again) == json.dumps(changed)


def test_a_forged_picture_claims_to_be_huge_with_a_valid_header() -> None:
    import zlib

    data = cv2.imencode(".png", np.zeros((4, 5, 3), np.uint8))[1].tobytes()
    forged = forge_png_size(data, np.random.default_rng(0))
    width, height = struct.unpack(">II", forged[16:24])
    assert min(width, height) >= 30_000
    assert struct.unpack(">I", forged[29:33])[0] == zlib.crc32(forged[12:29])
    assert forged[33:] == data[33:]


def test_damage_is_that_of_the_seed_and_stays_in_the_files(inputs: Path, tmp_path: Path) -> None:
    label = SUBJECTS[0]
    names = files_of(label, inputs / label.inputs)
    assert names
    digests = []
    for copy in ("one", "other"):
        shutil.copytree(inputs / "episodes", tmp_path / copy)
        done = damage(tmp_path / copy, names, np.random.default_rng(7))
        assert set(done) <= set(names)
        digests.append(tree_digest(tmp_path / copy))
    assert digests[0] == digests[1] != tree_digest(inputs / "episodes")


@pytest.mark.slow
def test_a_short_campaign_goes_on_and_finds_no_fault(
    inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = tuple(one for one in SUBJECTS if one.inputs == "episodes" and one.module.startswith("labeling"))
    monkeypatch.setattr(corruptions, "SUBJECTS", chosen)
    monkeypatch.setattr(campaign, "make_inputs", partial(shutil.copytree, inputs, dirs_exist_ok=True))
    # In this process, so that it is a short one.
    monkeypatch.setattr(campaign, "run_jobs", lambda work, jobs, workers, always_spawn: _here(work.make(), jobs))
    first = campaign.run_campaign(CampaignConfig(("corruptions",), trials=10, out=tmp_path))
    with (tmp_path / "corruptions.jsonl").open("a") as lines:
        lines.write('{"number": 10, "subj')  # cut off by a kill
    summary = campaign.run_campaign(CampaignConfig(("corruptions",), trials=24, out=tmp_path))
    assert first["corruptions"]["trials"] == 10
    assert summary["corruptions"]["trials"] == 24
    assert not summary["corruptions"]["not_survived"]
    assert f"24 of {24} survived" in campaign.table(summary)
    for differs in ({"seed": 7}, {}):
        if not differs:
            monkeypatch.setenv(COMMIT_VARIABLE, "0123456")
        with pytest.raises(UsageError, match="made with other settings"):
            campaign.run_campaign(CampaignConfig(("corruptions",), trials=24, out=tmp_path, **differs))


def _here(work, jobs):
    from labeling.runtime.process_pool import Outcome

    for job in jobs:
        yield Outcome(job.number, job, work(job), None)


def test_sums_tell_what_was_not_survived() -> None:
    trials = [
        {"number": 0, "subject": "label", "what": "cut", "outcome": "refused", "told": ""},
        {"number": 1, "subject": "label", "what": "flip", "outcome": "traceback", "told": "Traceback"},
    ]
    found = campaign.summed(trials)
    assert found["survived"] == 1
    assert found["outcomes"] == {"label": {"refused": 1, "traceback": 1}}
    assert [one["number"] for one in found["not_survived"]] == [1]


def test_leftovers_are_hidden_files_and_temporary_ones(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "labels.json").write_text("")
    assert leftovers(tmp_path / "out") == []
    (tmp_path / ".out.abc").mkdir()
    (tmp_path / "out" / "x.tmp").write_text("")
    assert leftovers(tmp_path / "out") == [".out.abc", "out/x.tmp"]


def test_growth_is_the_slope_of_the_second_half() -> None:
    samples = [Sample(100 * k, 400.0 + (50.0 if k < 5 else 0.0) + 0.2 * k) for k in range(10)]
    assert growth_mb_per_1000(samples) == pytest.approx(2.0)
