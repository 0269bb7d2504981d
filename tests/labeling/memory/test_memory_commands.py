"""Training a memory and looking at what it predicts, from the command line."""

import json
import os
import signal
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from labeling import imagine, train_memory
from labeling.core.detector import DetectorError
from labeling.io.episodes import write_episode
from labeling.memory.networks.weights import MEMORY_FILE, SPEC_KEY, build_memory, load_memory, read_around, save_memory
from labeling.memory.view_prediction.training import MemoryTask
from labeling.training.weights import ABOUT_KEY, save_weights

from .orbits import orbit_episode, ring
from .test_networks import TINY

QUICK = (
    "--voxels", "16", "16", "8", "--voxel-m", "0.32", "--channels", "8", "--planes", "8", "--width", "8",
    "--picture", "32", "32", "--iterations", "4", "--validate-every", "2", "--pairs", "32", "--inputs", "2",
    "--device", "cpu",
)  # fmt: skip


@pytest.fixture(scope="module")
def episodes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("episodes")
    for seed in range(3):
        write_episode(folder / f"toys_{seed}", orbit_episode(seed, ring(seed, 6)))
    return folder


@pytest.fixture(scope="module")
def run(episodes: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained") / "run"
    assert train_memory.main([str(episodes), "--val", str(episodes), "--out", str(out), *QUICK]) == 0
    return out


def refused(capsys, main, *arguments: object) -> str:
    assert main(list(map(str, arguments))) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("error: ")
    return error.splitlines()[-1]


@pytest.mark.slow
def test_training_says_what_it_learnt_from_and_what_to_run_next(episodes, run, capsys):
    results = json.loads((run / "results.json").read_text())
    assert results["iterations"] == 4
    assert results["validation"]["psnr"] > 3
    assert [one["iteration"] for one in json.loads((run / "history.json").read_text())] == [2, 4]
    assert train_memory.main([str(episodes), "--val", str(episodes), "--out", str(run), *QUICK]) == 0
    said = capsys.readouterr().out
    assert "3 episodes to learn from, 3 to choose by" in said
    assert "going on from step 4" in said
    assert f"memory: {run / 'memory.safetensors'}" in said
    assert "python -m labeling.imagine" in said


@pytest.mark.slow
def test_every_tenth_episode_is_held_out(tmp_path, capsys):
    for number in range(11):
        write_episode(tmp_path / "many" / f"{number:02d}", orbit_episode(number % 2, ring(number, 3), (32, 32)))
    assert train_memory.main([str(tmp_path / "many"), "--out", str(tmp_path / "run"), *QUICK]) == 0
    assert "10 episodes to learn from, 1 to choose by" in capsys.readouterr().out
    assert json.loads((tmp_path / "run" / "train.json").read_text())["validation"] == ["09"]


@pytest.mark.slow
@pytest.mark.parametrize("model", ["grnn", "cn3d"])
def test_predicted_views_are_drawn_and_filmed(episodes, run, model, tmp_path, capsys):
    from PIL import Image

    if model == "cn3d":
        run = tmp_path / "cn3d"
        assert train_memory.main([str(episodes), "--model", model, "--out", str(run), *QUICK]) == 0
    out = tmp_path / "pictures"
    shown = ["--inputs", "0", "2", "--views", "1", "3", "4"]
    assert imagine.main([str(run), str(episodes / "toys_1"), "--out", str(out), *shown]) == 0
    said = capsys.readouterr().out
    assert str(out / "toys_1_views.png") in said
    picture = cv2.imread(str(out / "toys_1_views.png"))
    assert picture is not None
    assert picture.shape[:2] == (4 * (128 + 18), 3 * 128 + 2 * 4)
    true_view = cv2.resize(picture[146 + 18 : 2 * 146, :128, ::-1], (32, 32), interpolation=cv2.INTER_NEAREST)
    expected = cv2.resize(orbit_episode(1, ring(1, 6)).rgb[1], (32, 32), interpolation=cv2.INTER_AREA)
    assert np.abs(true_view.astype(int) - expected).max() <= 1
    with Image.open(out / "toys_1_film.gif") as film:
        assert film.n_frames == 6  # type: ignore[attr-defined]


@pytest.mark.slow
def test_a_run_told_to_stop_loses_no_batch_and_ends_like_one_that_was_not(episodes, run, tmp_path, monkeypatch, capsys):
    out, losses = tmp_path / "run", MemoryTask.losses

    def told(self, batch, step):
        if step == 2:
            os.kill(os.getpid(), signal.SIGTERM)
        return losses(self, batch, step)

    command = [str(episodes), "--val", str(episodes), "--out", str(out), *QUICK]
    with monkeypatch.context() as patch:
        patch.setattr(MemoryTask, "losses", told)
        assert train_memory.main(command) == 128 + signal.SIGTERM
    assert "goes on with what is missing" in capsys.readouterr().err
    assert train_memory.main(command) == 0
    assert "going on from step 3" in capsys.readouterr().out
    resumed, whole = (load_memory(one).state_dict() for one in (out, run))
    assert all(torch.equal(value, whole[name]) for name, value in resumed.items())


@pytest.mark.slow
def test_what_cannot_be_done_is_refused_in_one_sentence(episodes, run, tmp_path, capsys):
    out = tmp_path / "out"
    assert "nothing to learn from was given" in refused(capsys, train_memory.main, "--out", out)
    assert "no such folder" in refused(capsys, train_memory.main, tmp_path / "nowhere", "--out", out)
    assert "--inputs must be above 0" in refused(capsys, train_memory.main, episodes, "--out", out, "--inputs", "0")
    assert "--seed must lie from 0 to" in refused(capsys, train_memory.main, episodes, "--out", out, "--seed", "9" * 14)
    every = ("--inputs", *map(str, range(6)))
    assert "none is left to predict" in refused(capsys, imagine.main, run, episodes / "toys_1", "--out", out, *every)
    assert "a grid has 4 to 512 voxels" in refused(capsys, train_memory.main, episodes, "--out", out, "--voxel-m", "-1")
    assert "multiples of 4" in refused(capsys, train_memory.main, episodes, "--out", out, "--channels", "5")
    assert "holds a run with other data or settings" in refused(
        capsys, train_memory.main, episodes, "--out", run, *QUICK, "--seed", "3"
    )
    one = episodes / "toys_1"
    assert "give the folder of a labeling.train_memory run" in refused(capsys, imagine.main, out, one, "--out", out)
    assert "view 17 does not look at the middle" in refused(capsys, imagine.main, run, one, "--out", out, "--views", 17)
    assert "none is left to remember" in refused(
        capsys, imagine.main, run, one, "--out", out, "--views", 0, 1, 2, 3, 4, 5
    )
    assert not out.exists()


@pytest.mark.slow
def test_episodes_without_depth_are_left_out_with_a_note(episodes, tmp_path, capsys):
    blind = orbit_episode(4, ring(4, 4))
    write_episode(tmp_path / "some" / "blind", replace(blind, depth_m=np.zeros_like(blind.depth_m)))
    write_episode(tmp_path / "some" / "toys", blind)
    assert train_memory.main([str(tmp_path / "some"), "--out", str(tmp_path / "run"), *QUICK]) == 0
    said = capsys.readouterr().out
    assert "note: left out blind: no view has any depth" in said
    assert "1 episodes to learn from" in said or "1 episode to learn from" in said


def written(folder: Path, about: str) -> Path:
    """A run of random weights whose header says this of where they come from."""
    folder.mkdir()
    header = {SPEC_KEY: json.dumps(asdict(TINY)), ABOUT_KEY: about}
    save_weights(folder / MEMORY_FILE, build_memory(TINY), header)
    return folder


def test_where_the_grid_stood_is_read_from_a_run_or_its_file_and_refused_if_malformed(tmp_path):
    run = written(tmp_path / "run", '{"around": "scene", "episodes": "some"}')
    assert read_around(run) == read_around(run / MEMORY_FILE) == "scene"
    save_memory(run / MEMORY_FILE, build_memory(TINY), {})
    assert read_around(run) == "fixated"
    for number, about in enumerate(("{", "[]", '{"around": "moon"}', '{"around": 3}')):
        with pytest.raises(DetectorError, match="the description of its network is damaged"):
            read_around(written(tmp_path / str(number), about))
    with pytest.raises(DetectorError, match=r"give the folder of a labeling\.train_memory run"):
        read_around(tmp_path)


@pytest.mark.slow
def test_a_file_of_weights_is_imagined_from_as_its_run_and_a_malformed_header_refused(episodes, tmp_path, capsys):
    run, one = written(tmp_path / "run", '{"around": "scene"}'), episodes / "toys_1"
    options = ("--device", "cpu", "--views", "1")
    pictures = []
    for place in (run, run / MEMORY_FILE):
        out = tmp_path / f"out_{place.name}"
        assert imagine.main([str(place), str(one), "--out", str(out), *options]) == 0
        pictures.append((out / "toys_1_views.png").read_bytes())
    assert pictures[0] == pictures[1]
    for number, about in enumerate(("{", "[]", '{"around": "moon"}')):
        bad = written(tmp_path / str(number), about)
        assert "is damaged" in refused(capsys, imagine.main, bad, one, "--out", tmp_path / "none", *options)
