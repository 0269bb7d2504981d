"""Recording: what is written is right, and being killed changes nothing."""

import dataclasses
import json
import shutil
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from agents.collect import main
from agents.rollouts import recorder
from agents.rollouts.collect_config import CollectConfig
from agents.rollouts.recorder import collect_episodes, noise_seed
from labeling.core.errors import UsageError
from labeling.core.geometry import unproject
from labeling.io.episodes import find_episodes, read_episode
from sbm_gym.sensors.noise_config import SensorNoise
from sbm_gym.sensors.sensor_noise import add_noise

from ..sbm_gym.box_rooms import BoxRooms

ENV_ID = "collect_test/Boxes-v0"
ROOT = Path(__file__).resolve().parents[2]
if ENV_ID not in gym.registry:
    gym.register(
        ENV_ID, entry_point="sbm_gym.env.fixation_env:FixationEnv", kwargs={"worlds": BoxRooms()}, max_episode_steps=25
    )


def config(out: Path, **changes) -> CollectConfig:
    return dataclasses.replace(CollectConfig(out=out, env=ENV_ID, episodes=3, size=64), **changes)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("recorded") / "episodes"
    collect_episodes(config(out))
    return out


@pytest.mark.slow
def test_episodes_read_back_whole_and_with_a_source_view(recorded):
    folders = find_episodes(recorded)
    assert [folder.name for folder in folders] == ["0000", "0001", "0002"]
    for folder in folders:
        episode = read_episode(folder)
        assert episode.num_views == 25
        assert episode.size == (64, 64)
        assert any(d.confidence >= 0.9 for d in episode.detections or ())
        assert episode.metadata["policy"] == "ring"
        assert len(episode.metadata["steps"]) == 25
        for step in episode.metadata["steps"]:
            assert step["reward"] == pytest.approx(sum(step["reward_terms"].values()))
            assert len(step["action"]) == 4
    scenes = {read_episode(folder).metadata["scene"] for folder in folders}
    assert len(scenes) == 3


@pytest.mark.slow
def test_ground_truth_on_disk_lies_in_its_boxes(recorded):
    for folder in find_episodes(recorded):
        episode = read_episode(folder)
        for label in episode.ground_truth or ():
            assert label.box_3d is not None
            view = label.view_index
            y, x = np.nonzero(label.modal)
            points = unproject(
                np.stack([x, y], axis=1).astype(float),
                episode.depth_m[view][y, x].astype(float),
                episode.intrinsics[view],
                episode.camera_to_world[view],
            )
            local = np.abs((points - label.box_3d.centre_m) @ label.box_3d.rotation)
            assert np.all(local <= label.box_3d.extent_m / 2 + 0.05)


@pytest.mark.slow
def test_killed_and_run_again_gives_the_same_bytes(recorded, tmp_path, monkeypatch):
    out, written = tmp_path / "episodes", []
    real = recorder.write_episode

    def write_then_die(folder, episode):
        if len(written) == 1:
            raise KeyboardInterrupt
        written.append(folder)
        real(folder, episode)

    monkeypatch.setattr(recorder, "write_episode", write_then_die)
    with pytest.raises(KeyboardInterrupt):
        collect_episodes(config(out))
    assert len(find_episodes(out)) == 1
    monkeypatch.setattr(recorder, "write_episode", real)
    collect_episodes(config(out))
    assert contents(out) == contents(recorded)


@pytest.mark.slow
def test_an_episode_does_not_depend_on_the_others(recorded, tmp_path):
    collect_episodes(config(tmp_path / "one", episodes=1))
    assert contents(tmp_path / "one" / "0000") == contents(recorded / "0000")


@pytest.mark.slow
def test_a_scene_is_begun_in_different_places(recorded, tmp_path):
    folders = collect_episodes(config(tmp_path / "twice", episodes=4, episodes_per_scene=2))
    episodes = [read_episode(folder) for folder in folders]
    scenes = [episode.metadata["scene"] for episode in episodes]
    assert scenes[0] == scenes[1] != scenes[2] == scenes[3]
    assert scenes[::2] == [read_episode(recorded / name).metadata["scene"] for name in ("0000", "0001")]
    begun = [tuple(episode.camera_to_world[0, :2, 3]) for episode in episodes]
    assert len(set(begun)) == 4


@pytest.mark.slow
def test_noise_is_added_to_the_same_walk(recorded, tmp_path):
    """Depth and poses are as a sensor gives them; pictures, detections and ground truth are those without noise."""
    noise = {"sensor_noise": "kinect", "pose_noise_deg": 2.0, "pose_drift_m": 0.1}
    (folder,) = collect_episodes(config(tmp_path / "noisy", episodes=1, **noise))
    clean, noisy = read_episode(recorded / "0000"), read_episode(folder)
    for name in ("detections.json", "ground_truth.json"):
        assert (folder / name).read_bytes() == (recorded / "0000" / name).read_bytes()
    np.testing.assert_array_equal(noisy.rgb, clean.rgb)
    shift_m = np.linalg.norm(noisy.camera_to_world[:, :3, 3] - clean.camera_to_world[:, :3, 3], axis=1)
    assert shift_m[0] == pytest.approx(0, abs=1e-9)
    assert 0.001 < shift_m.max() < 0.5
    both = (noisy.depth_m > 0) & (clean.depth_m > 0)
    assert both.mean() > 0.5
    assert 0.001 < np.abs(noisy.depth_m - clean.depth_m)[both].mean() < 0.1
    again = add_noise(clean, SensorNoise("kinect", 2.0, pose_drift_m=0.1), noise_seed(0, 0))
    np.testing.assert_allclose(noisy.camera_to_world, again.camera_to_world, atol=1e-9)
    assert noisy.metadata["noise"]["sensor"] == "kinect"


@pytest.mark.slow
def test_complete_folders_are_left_alone(recorded, monkeypatch):
    monkeypatch.setattr(recorder, "write_episode", lambda *_: pytest.fail("nothing is missing"))
    assert collect_episodes(config(recorded)) == [recorded / f"{k:04d}" for k in range(3)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"policy": "random"},
        {"size": 32},
        {"split": "val"},
        {"episodes_per_scene": 2},
        {"pose_drift_m": 0.1},
    ],
)
def test_other_settings_in_the_same_folder_are_refused(recorded, change):
    with pytest.raises(UsageError, match="other settings"):
        collect_episodes(config(recorded, **change))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--env", "sbm_gym/Moon-v0"], "sbm_gym/Indoor-v0"),
        (["--policy", "clever"], "random, ring"),
        (["--env", "no_such_module:x/Y-v0"], "no_such_module"),
        (["--episodes", "0"], "at least 1"),
        (["--size", "8"], "at least 32"),
        (["--seed", "-1"], "--seed must be 0 or more, not -1"),
        (["--workers", "0"], "at least 1"),
        (["--episodes-per-scene", "0"], "at least 1"),
        (["--pose-noise-deg", "-1"], "--pose-noise-deg must be 0 or more"),
    ],
)
def test_bad_arguments_are_one_line_and_leave_nothing_behind(tmp_path, capsys, arguments, says):
    out = tmp_path / "out"
    assert main(["--out", str(out), "--env", ENV_ID, *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert says in error
    assert not out.exists()


def test_folders_of_others_are_refused(tmp_path, capsys):
    (tmp_path / "thesis.txt").write_text("precious")
    assert main(["--out", str(tmp_path), "--env", ENV_ID]) == 2
    assert "not made by this program" in capsys.readouterr().err
    assert main(["--out", str(tmp_path / "thesis.txt"), "--env", ENV_ID]) == 2


@pytest.mark.slow
def test_a_damaged_episode_is_reported(recorded, tmp_path, capsys):
    import shutil

    out = tmp_path / "damaged"
    shutil.copytree(recorded, out)
    (out / "0001" / "depth" / "003.png").unlink()
    arguments = ["--out", str(out), "--env", ENV_ID, "--episodes", "3", "--size", "64"]
    assert main(arguments) == 2
    assert "0001" in capsys.readouterr().err


def test_a_world_without_anything_to_find_gives_up_with_a_clear_error(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(recorder, "MAX_ATTEMPTS", 2)
    monkeypatch.setattr(recorder, "CONFIDENT", 1.1)
    assert main(["--out", str(tmp_path / "out"), "--env", ENV_ID, "--size", "64"]) == 2
    assert "without one confident detection" in capsys.readouterr().err


@pytest.mark.slow
def test_settings_are_kept_with_the_episodes(recorded):
    settings = json.loads((recorded / "collection.json").read_text())["settings"]
    assert settings == {
        "env": ENV_ID,
        "policy": "ring",
        "detector": "simulated",
        "seed": 0,
        "split": "train",
        "unseen_models": False,
        "episodes_per_scene": 1,
        "size": 64,
        "moving": 0,
        "shifted": 0,
        "moving_speed": 1.0,
        "sensor_noise": "ideal",
        "pose_noise_deg": 0.0,
        "pose_noise_m": 0.0,
        "pose_drift_deg": 0.0,
        "pose_drift_m": 0.0,
    }


@pytest.mark.slow
def test_folders_of_before_a_setting_was_there_are_gone_on_with(recorded, tmp_path):
    out = tmp_path / "episodes"
    shutil.copytree(recorded, out)
    content = json.loads((out / "collection.json").read_text())
    del content["settings"]["detector"]
    (out / "collection.json").write_text(json.dumps(content))
    assert len(collect_episodes(config(out))) == 3
    with pytest.raises(UsageError, match="--detector simulated there, compact now"):
        collect_episodes(config(out, detector="compact"))


@pytest.mark.slow
def test_a_folder_is_of_the_weights_that_its_names_stood_for(recorded, tmp_path, monkeypatch):
    for name in ("policy_digest", "digest_of_detector"):
        out = tmp_path / name
        shutil.copytree(recorded, out)
        monkeypatch.setattr(recorder, name, lambda *_: "one")
        collect_episodes(config(out))  # recorded before weights were noted: it goes on, and they are noted now
        assert json.loads((out / "collection.json").read_text())["weights"] == {
            {"policy_digest": "policy_digest", "digest_of_detector": "detector_digest"}[name]: "one"
        }
        monkeypatch.setattr(recorder, name, lambda *_: "another")
        with pytest.raises(UsageError, match="_digest one there, another now"):
            collect_episodes(config(out))
        monkeypatch.undo()


@pytest.mark.slow
def test_damaged_settings_are_named(recorded, tmp_path, capsys):
    out = tmp_path / "episodes"
    shutil.copytree(recorded, out)
    for damaged in ("{}", '{"settings": []}', '{"settings": {}, "weights": 3}'):
        (out / "collection.json").write_text(damaged)
        assert main(["--env", ENV_ID, "--out", str(out)]) == 2
        assert capsys.readouterr().err == (
            f"error: {out / 'collection.json'}: is damaged: it does not say what was begun here; give another --out\n"
        )


def test_environments_of_others_are_refused_in_one_line(tmp_path, capsys):
    assert main(["--env", "CartPole-v1", "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: env 'CartPole-v1' has no scenes and no detector, as those of this project: sbm_gym/")
    assert not (tmp_path / "out").exists()


def test_unknown_detectors_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(UsageError, match="unknown detector 'yolo'"):
        collect_episodes(config(tmp_path / "episodes", detector="yolo"))
    assert not (tmp_path / "episodes").exists()


def test_help_names_the_options():
    result = subprocess.run(
        [sys.executable, "-m", "agents.collect", "--help"], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert all(option in result.stdout for option in ("--env", "--policy", "--episodes", "--out", "--seed", "--split"))


@pytest.mark.slow
def test_several_workers_record_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))  # workers find modules where this process does
    env = "tests.experiments.box_env:policies_test/BoxesShort-v0"
    for workers in (1, 2):
        collect_episodes(CollectConfig(out=tmp_path / str(workers), env=env, episodes=3, size=64, workers=workers))
    assert contents(tmp_path / "1") == contents(tmp_path / "2")


@pytest.mark.slow
def test_final_scenes_are_furnished_from_held_out_models_where_it_is_asked_for(tmp_path, monkeypatch):
    asked = []
    make_env = recorder.make_env
    monkeypatch.setattr(recorder, "make_env", lambda *given, **more: asked.append(more) or make_env(*given, **more))
    arguments = ["--env", "sbm_gym/IndoorBuiltin-v0", "--policy", "spin", "--episodes", "1", "--size", "64"]
    assert main(["--out", str(tmp_path), *arguments, "--split", "final", "--unseen-models"]) == 0
    metadata = read_episode(tmp_path / "0000").metadata
    assert metadata["unseen_models"] is True
    assert metadata["split"] == "final"
    assert asked == [{"unseen_models": True}]


@pytest.mark.slow
def test_what_moves_is_recorded_with_where_it_is(tmp_path):
    arguments = ["--env", "sbm_gym/IndoorBuiltin-v0", "--policy", "spin", "--episodes", "1", "--size", "64"]
    assert main(["--out", str(tmp_path), *arguments, "--moving", "2", "--shifted", "1"]) == 0
    episode = read_episode(tmp_path / "0000")
    assert episode.metadata["motion"] == {"moving": 2, "shifted": 1, "moving_speed": 1.0}
    assert episode.motion is not None
    assert len(episode.motion) == 2
    for motion in episode.motion:
        assert motion.object_to_world.shape == (episode.num_views, 4, 4)
        for truth in episode.ground_truth or ():
            if truth.instance_id == motion.instance_id:
                assert truth.category == motion.category
                assert truth.box_3d is not None
                where = motion.object_to_world[truth.view_index]
                assert np.allclose(truth.box_3d.centre_m[:2], where[:2, 3], atol=1e-6)
                assert np.allclose(truth.box_3d.rotation, where[:3, :3], atol=1e-6)
