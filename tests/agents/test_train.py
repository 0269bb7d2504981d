"""Training: it learns, goes on where it stopped, and says in one line what it cannot do."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from agents.network.files import HISTORY_FILE, LAST, POLICY_FILE, SETTINGS_FILE, STATE_FILE
from agents.network.policy_network import observed_keys
from agents.policies.ppo import Ppo
from agents.ppo import training
from agents.ppo.config import PpoConfig
from agents.ppo.envs import (
    EPISODES_PER_SCENE,
    REWARDS,
    CompleteEpisodes,
    EnvConfig,
    NumberedEpisodes,
    make_env,
    make_vec_env,
    share,
    training_scenes,
    validation_scenes,
)
from agents.train import main
from labeling.core.errors import SbmError, UsageError
from sbm_gym.env.rewards import reward_terms
from sbm_gym.robot.object_memory import MemoryUpdate
from sbm_gym.worlds.splits import INTERIORS

from .toy_world import ENV_ID, Echo

ROOT = Path(__file__).resolve().parents[2]
HYPERPARAMS = """toy/Echo-v0: &toy
  n_timesteps: 2000
  n_envs: 1
  n_steps: 100
  batch_size: 50
  n_epochs: 8
  gamma: 0.5
  learning_rate: lin_0.003
  normalize: {norm_obs: false, norm_reward: true}
  policy_kwargs:
    net_arch: [16]
    log_std_init: -0.5
    features_extractor_kwargs: {features: 16, picture_features: 4, channels: [4]}
toy/Large-v0: *toy
"""


@pytest.fixture(scope="module")
def hyperparams(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("hyperparams") / "toy.yaml"
    path.write_text(HYPERPARAMS)
    return path


class Bar:
    """Takes the place of tqdm; may press Ctrl-C."""

    def __init__(self, interrupt_at=None, **_):
        self.steps, self.interrupt_at = 0, interrupt_at

    def update(self, count):
        self.steps += count
        if self.steps == self.interrupt_at:
            signal.raise_signal(signal.SIGINT)

    def set_postfix_str(self, text):
        pass

    def close(self):
        pass


def train(config: PpoConfig, interrupt_at=None):
    said: list[str] = []
    progress = training.train_ppo(config, said.append, lambda **given: Bar(interrupt_at=interrupt_at, **given))
    return progress, said


@pytest.fixture(scope="module")
def config(hyperparams, tmp_path_factory) -> PpoConfig:
    out = tmp_path_factory.mktemp("trained") / "run"
    return PpoConfig(
        out=out, env=ENV_ID, hyperparams=hyperparams, eval_every=500, eval_episodes=4, seed=1, device="cpu"
    )


@pytest.fixture(scope="module")
def trained(config):
    return train(config)


def tensors(folder: Path) -> dict:
    return torch.load(folder / LAST / STATE_FILE, weights_only=True)


def same(one, other) -> bool:
    if isinstance(one, torch.Tensor):
        return torch.equal(one, other)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other


@pytest.mark.slow
def test_two_thousand_steps_improve_a_trivial_env(trained):
    progress, said = trained
    before, after = progress.validations[0], progress.validations[-1]
    assert (before["at"], after["at"]) == (0, 2000)
    assert after["return"] > before["return"] + 1.0
    assert progress.best == max(one["return"] for one in progress.validations)
    assert len(progress.rollouts) == 20
    assert any(line.startswith("policy: ") for line in said)


@pytest.mark.slow
def test_figures_are_kept_by_name(trained, config):
    assert config.out is not None
    history = json.loads((config.out / HISTORY_FILE).read_text())
    wanted = {"at", "return", "success", "coverage", "collisions", "objects_confirmed", "reward/discovery"}
    for one in (*history["rollouts"], *history["validations"]):
        assert wanted <= one.keys()
        assert one["return"] == pytest.approx(one["reward/discovery"] + one["reward/diversity"])
        assert one["steps"] == 10
    assert [one["at"] for one in history["validations"]] == [0, 500, 1000, 1500, 2000]


@pytest.mark.slow
def test_curves_are_drawn_for_tensorboard(trained, config):
    event_accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    assert config.out is not None
    board = event_accumulator.EventAccumulator(str(config.out / "tensorboard"))
    board.Reload()
    tags = set(board.Tags()["scalars"])
    assert tags >= {"reward/discovery", "reward/diversity", "episode/success", "episode/coverage"}
    assert tags >= {"episode/collisions", "episode/objects_confirmed", "validation/return", "train/approx_kl"}
    assert [event.step for event in board.Scalars("validation/return")] == [0, 500, 1000, 1500, 2000]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_policy_and_another_seed_another(trained, config, tmp_path):
    assert config.out is not None
    short = replace(config, steps=300, eval_every=10_000)
    for name, seed in (("one", 1), ("two", 1), ("three", 2)):
        train(replace(short, out=tmp_path / name, seed=seed))
    weights = [(tmp_path / name / LAST / "policy.safetensors").read_bytes() for name in ("one", "two", "three")]
    assert weights[0] == weights[1]
    assert weights[0] != weights[2]


@pytest.mark.slow
def test_an_interrupted_run_goes_on_from_the_last_update_exactly(config, tmp_path):
    out = tmp_path / "run"
    config = replace(config, out=out, steps=600)
    with pytest.raises(KeyboardInterrupt):
        train(config, interrupt_at=250)
    stopped = tensors(out)
    assert json.loads(stopped["progress"])["steps"] == 200
    # Stopped again at once: what was restored is what is written.
    restored = {}
    real = training.restore_training

    def restore_and_look(model, env, folder):
        progress = real(model, env, folder)
        training.write_training_state(tmp_path / "again.pt", model, progress)
        restored["weights"] = {name: value.clone() for name, value in model.policy.state_dict().items()}
        return progress

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "restore_training", restore_and_look)
        progress, said = train(PpoConfig(resume=out, device="cpu"))
    assert same(torch.load(tmp_path / "again.pt", weights_only=True), stopped)
    assert "going on from step 200" in said
    assert progress.steps == 600
    assert [int(one["at"]) for one in progress.rollouts] == [100, 200, 300, 400, 500, 600]


@pytest.mark.slow
@pytest.mark.parametrize("envs", [1, 2])
def test_a_run_that_goes_on_ends_as_one_that_was_never_stopped(config, tmp_path, envs):
    config = replace(config, steps=600, envs=envs, processes=1)
    straight, _ = train(replace(config, out=tmp_path / "straight"))
    stopped = replace(config, out=tmp_path / "stopped")
    for interrupt_at in (250, 100):
        with pytest.raises(KeyboardInterrupt):
            train(stopped, interrupt_at=interrupt_at)
    progress, _ = train(stopped)
    assert progress == straight
    for name in ("policy.safetensors", "vecnormalize.json"):
        one, other = (tmp_path / run / LAST / name for run in ("straight", "stopped"))
        assert one.read_bytes() == other.read_bytes()
    assert same(tensors(tmp_path / "straight"), tensors(tmp_path / "stopped"))


@pytest.mark.slow
def test_training_that_diverges_says_so_and_keeps_what_was_before(config, hyperparams, tmp_path):
    wild = tmp_path / "wild.yaml"
    wild.write_text(hyperparams.read_text().replace("lin_0.003", "1.0e+30"))
    config = replace(config, out=tmp_path / "run", steps=300, hyperparams=wild)
    with pytest.raises(SbmError, match=r"training has diverged after step 0: .* a smaller learning_rate"):
        train(config)
    assert json.loads(tensors(config.out)["progress"])["steps"] == 0


@pytest.mark.slow
def test_rollouts_that_fit_into_no_memory_are_refused(config, hyperparams, tmp_path):
    huge = tmp_path / "huge.yaml"
    huge.write_text(hyperparams.read_text().replace("n_steps: 100", "n_steps: 25000000000"))
    with pytest.raises(UsageError, match=r"of a rollout of .* = 25,000,000,000 steps take .* give a smaller n_steps"):
        train(replace(config, out=tmp_path / "run", hyperparams=huge))
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "at", [pytest.param(0, marks=pytest.mark.nightly), 200, pytest.param(600, marks=pytest.mark.nightly)]
)
def test_a_validation_that_was_given_up_is_done_when_the_run_goes_on(config, tmp_path, monkeypatch, at):
    config = replace(config, steps=600, eval_every=200)
    straight, _ = train(replace(config, out=tmp_path / "straight"))
    stopped = replace(config, out=tmp_path / "stopped")
    validate, left = training.validate, [at // 200]

    def interrupted(*given):
        if left and left[0] == 0:
            signal.raise_signal(signal.SIGINT)
        left[0] -= 1
        return validate(*given)

    monkeypatch.setattr(training, "validate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train(stopped)
    monkeypatch.undo()
    assert at not in [one["at"] for one in json.loads(tensors(stopped.out)["progress"])["validations"]]
    progress, _ = train(stopped)
    assert progress == straight
    assert same(tensors(tmp_path / "straight"), tensors(tmp_path / "stopped"))
    assert any(line.startswith("finished at step 600 already") for line in train(stopped)[1])


@pytest.mark.slow
def test_the_same_command_goes_on_and_a_finished_run_takes_more_steps(config, tmp_path):
    config = replace(config, out=tmp_path / "run", steps=200)
    train(config)
    progress, said = train(config)
    assert progress.steps == 200
    assert "finished at step 200 already; --steps with more goes on" in said
    progress, _ = train(replace(config, steps=300))
    assert progress.steps == 300
    progress, _ = train(PpoConfig(resume=config.out, steps=400, device="cpu"))
    assert progress.steps == 400


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"seed": 2}, "seed 1 there, 2 now"),
        ({"reward": "neither"}, "reward both there, neither now"),
        ({"env": "toy/Large-v0"}, "env toy/Echo-v0 there, toy/Large-v0 now"),
    ],
)
def test_other_settings_in_the_same_folder_are_refused(trained, config, change, says):
    with pytest.raises(UsageError) as caught:
        train(replace(config, **change))
    assert says in str(caught.value)


@pytest.mark.slow
def test_what_cannot_be_changed_is_refused_with_resume(trained, config):
    with pytest.raises(UsageError, match=r"--seed 7 cannot be given with --resume"):
        train(PpoConfig(resume=config.out, seed=7))


@pytest.mark.slow
def test_a_validation_that_a_kill_kept_from_the_history_is_there_when_the_run_goes_on(config, trained, tmp_path):
    run = shutil.copytree(config.out, tmp_path / "run")
    before = (run / HISTORY_FILE).read_bytes()
    history = json.loads(before)
    del history["validations"][-1]  # as between the last checkpoint and the history
    (run / HISTORY_FILE).write_text(json.dumps(history))
    train(PpoConfig(resume=run, device="cpu"))
    assert (run / HISTORY_FILE).read_bytes() == before


@pytest.mark.slow
def test_rollouts_that_end_within_episodes_are_told_of(config, hyperparams, tmp_path):
    uneven = tmp_path / "uneven.yaml"
    uneven.write_text(hyperparams.read_text().replace("n_steps: 100", "n_steps: 105").replace(": 50", ": 35"))
    told = "note: n_steps 105 is no multiple of the 10 steps of an episode"
    for name, file, count in (("even", hyperparams, 0), ("uneven", uneven, 1)):
        _, said = train(replace(config, out=tmp_path / name, steps=100, hyperparams=file))
        assert sum(line.startswith(told) for line in said) == count


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--steps", "0"], "--steps must be at least 1"),
        (["--seed", "-1"], "--seed must lie from 0"),
        (["--env", "sbm_gym/Moon-v0"], "unknown env 'sbm_gym/Moon-v0'; known: "),
        (["--env", "no_such_module:sbm_gym/Indoor-v0"], "cannot import 'no_such_module'"),
        (["--env", "toy/Echo-v0"], "env_wrapper moves_and_looks goes with worlds of this project"),
        (["--resume", "nowhere"], "is not the folder of a run"),
        (["--device", "abacus"], "--device abacus"),
        (["--detector", "eyes"], "eyes"),
        (["--hyperparams", "none.yaml"], "No such file"),
    ],
)
def test_bad_arguments_are_one_line_and_leave_nothing_behind(tmp_path, monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert says in error
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_batches_that_do_not_fill_a_rollout_are_refused(config, tmp_path):
    text = HYPERPARAMS.replace("batch_size: 50", "batch_size: 64")
    (tmp_path / "toy.yaml").write_text(text)
    with pytest.raises(UsageError, match=r"batch_size 64 must divide n_envs \* n_steps = 3 \* 100 = 300"):
        train(replace(config, out=tmp_path / "run", hyperparams=tmp_path / "toy.yaml", envs=3))


@pytest.mark.slow
def test_folders_of_others_are_left_alone(config, tmp_path):
    (tmp_path / "thesis.txt").write_text("precious")
    with pytest.raises(UsageError, match="was not made by this program"):
        train(replace(config, out=tmp_path))
    with pytest.raises(UsageError, match="is a file"):
        train(replace(config, out=tmp_path / "thesis.txt"))
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


@pytest.mark.nightly
def test_ctrl_c_reaches_everybody_and_costs_no_more_than_the_rollout(hyperparams, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    out = tmp_path / "run"
    settings = ["--env", f"toy_world:{ENV_ID}", "--hyperparams", str(hyperparams), "--eval-every", "200"]
    command = [sys.executable, "-m", "agents.train", "--out", str(out), "--envs", "2", "--steps", "10000000", *settings]
    found_by = [str(Path(__file__).parent), str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(found_by)}
    run = subprocess.Popen(
        command, cwd=ROOT, env=environment, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        deadline = time.monotonic() + 120
        while steps_at(out) < 400 and run.poll() is None and time.monotonic() < deadline:
            time.sleep(0.1)  # another process: its file is all there is to wait on
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGINT)
        said, complaints = (text.decode() for text in run.communicate(timeout=60))
    finally:
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGKILL)
            run.communicate()
    assert run.returncode == 130, complaints
    assert "Traceback" not in complaints
    stopped = steps_at(out)
    assert stopped >= 400
    assert stopped % 200 == 0  # two workers, 100 steps each
    assert f"stopped at step {stopped}; python -m agents.train --resume {out} goes on" in said
    progress, _ = train(PpoConfig(resume=out, envs=1, steps=stopped + 100, device="cpu", allow_code=True))
    assert progress.steps == stopped + 100
    assert json.loads((out / SETTINGS_FILE).read_text())["hyperparameters"]["n_envs"] == 1


def steps_at(out: Path) -> int:
    try:
        return json.loads((out / LAST / POLICY_FILE).read_text())["steps"]
    except FileNotFoundError:
        return -1


def test_episodes_end_for_good_and_hand_on_statistics_only():
    env = CompleteEpisodes(gym.make(ENV_ID))
    observation, info = env.reset(seed=0)
    assert info == {}
    rewards = []
    for step in range(10):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        rewards.append(reward)
        assert (terminated, truncated) == (step == 9, False)
        assert set(info) == ({"episode_statistics"} if terminated else set())
    assert env.observation_space.contains(observation)
    assert info["episode_statistics"]["return"] == pytest.approx(sum(rewards))
    assert info["episode_statistics"]["collisions"] == sum(reward < 0.5 for reward in rewards)
    assert info["episode_statistics"]["steps"] == 10


def test_training_and_validation_share_no_scene():
    config = EnvConfig("sbm_gym/IndoorBuiltin-v0", keys=("state",), scenes=7, validation_scenes=4)
    env = make_env(config)
    training, validation = training_scenes(env, config), validation_scenes(env, config)
    env.close()
    assert (len(training), len(validation)) == (7, 4)
    assert not set(training) & set(validation)
    assert set(training) | set(validation) <= set(INTERIORS.of_split("endless"))


def test_training_in_all_scenes_that_there_are_is_refused():
    env = Rooms()
    env.scene_names = ("a", "b", "c", "d")  # type: ignore[attr-defined]
    assert validation_scenes(env, EnvConfig(ENV_ID, scenes=2)) == ("c",)
    for scenes in (3, 4):  # the last one is for comparing
        with pytest.raises(
            UsageError, match=f"--scenes {scenes} leaves none to validate in: there are 4 scenes, the last"
        ):
            validation_scenes(env, EnvConfig(ENV_ID, scenes=scenes))


@pytest.mark.nightly
def test_results_do_not_depend_on_the_number_of_processes(hyperparams, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    config, found = EnvConfig(f"toy_world:{ENV_ID}"), []
    for processes in (1, 2):
        with contextlib.closing(make_vec_env(config, 3, processes)) as envs:
            envs.seed(5)
            seen: list[Any] = [envs.reset()["state"]]  # type: ignore[call-overload]
            for step in range(12):
                observation, rewards, ends, infos = envs.step(np.full((3, 4), 0.1 * step))
                seen += [observation["state"], rewards, ends, len(infos)]  # type: ignore[call-overload]
            assert envs.get_attr("split") == ["endless"] * 3
        found.append(seen)
    assert all(np.array_equal(one, other) for one, other in zip(*found, strict=True))


@pytest.mark.parametrize(("scenes", "workers"), [(15, 4), (3, 3), (3, 4), (15, 1)])
def test_every_scene_has_a_worker(scenes, workers):
    names = tuple(f"train/{k:02d}" for k in range(scenes))
    shares = [share(names, index, workers) for index in range(workers)]
    assert set().union(*shares) == set(names)
    assert all(shares)
    assert sum(map(len, shares)) == (scenes if scenes >= workers else scenes * workers)


class Rooms(Echo):
    """Notes where its episodes are and how they begin."""

    def reset(self, *, seed=None, options=None):
        observation, info = super().reset(seed=seed)
        self.began = (options or {}).get("scene"), tuple(observation["state"])
        return observation, info


def begun(env: gym.Env, count: int, seed: int | None) -> list[tuple]:
    found = []
    for episode in range(count):
        env.reset(seed=seed if episode == 0 else None)
        found.append(env.unwrapped.began)  # type: ignore[attr-defined]
    return found


def test_workers_stay_in_their_share_of_the_scenes_and_are_seeded():
    count = 12 * EPISODES_PER_SCENE
    first, again, other = (begun(NumberedEpisodes(Rooms(), "abc"), count, seed) for seed in (0, 0, 1))
    assert {scene for scene, _ in first} == set("abc")
    assert first == again
    assert first != other
    assert len(set(first)) == count
    for episode in range(0, count, EPISODES_PER_SCENE):
        assert len({scene for scene, _ in first[episode : episode + EPISODES_PER_SCENE]}) == 1


@pytest.mark.parametrize("scenes", ["abc", ""])
@pytest.mark.parametrize("number", [0, 3, EPISODES_PER_SCENE, 19])
def test_episodes_are_what_their_numbers_say(scenes, number):
    env = NumberedEpisodes(Rooms(), scenes)
    straight = begun(env, 24, 5)
    env.begin_at(number)
    assert begun(env, 24 - number, None) == straight[number:]
    env = NumberedEpisodes(Rooms(), scenes)
    env.begin_at(number)
    assert begun(env, 24 - number, 5) == straight[number:]


def test_rewards_switch_terms_off_by_name():
    update = MemoryUpdate(
        (0,), 0.5, num_new_azimuths=2, num_new_cells=1, visible=(0,), confidence_now={}, unconfirmed=()
    )
    paid = {
        name: {term for term, value in reward_terms(update, True, weights).items() if value}
        for name, weights in REWARDS.items()
    }
    assert paid == {
        "both": {"discovery", "diversity", "collision"},
        "discovery": {"discovery", "collision"},
        "diversity": {"diversity", "collision"},
        "neither": {"collision"},
    }


def test_a_policy_whose_parts_observations_lack_is_refused() -> None:
    config = EnvConfig(ENV_ID, wrapper=None, keys=observed_keys("ChoicePolicy", {}))
    with pytest.raises(UsageError, match=r"looks at summary, moves, looks, .* env_wrapper none do not have"):
        make_env(config)


def test_training_pays_the_reward_asked_for_in_the_scenes_of_its_split():
    env = make_env(EnvConfig(ENV_ID, reward="discovery")).unwrapped
    assert isinstance(env, Echo)
    assert env.split == "endless"
    assert env.settings["reward_weights"] == REWARDS["discovery"]
    assert env.settings["detector"] == "simulated"


@pytest.mark.slow
def test_a_trained_policy_does_what_it_learnt(trained, config):
    assert config.out is not None
    policy, env = Ppo(config.out), gym.make(ENV_ID)
    observation, info = env.reset(seed=5)
    policy.reset(env, observation, info, np.random.default_rng(0))
    missed = []
    for _ in range(10):
        action = policy.act(observation, info)
        missed.append(abs(action[0] - observation["state"][0]))
        observation, *_, info = env.step(action)
    assert np.mean(missed) < 0.3  # an action that ignores the state misses it by 0.5 and more


def test_help_names_the_options():
    result = subprocess.run(
        [sys.executable, "-m", "agents.train", "--help"], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert all(option in result.stdout for option in ("--env", "--out", "--steps", "--resume", "--seed", "--device"))


@pytest.mark.slow
@pytest.mark.parametrize("field", ["env", "detector"])
def test_code_that_a_run_names_is_run_only_if_allowed(config, trained, tmp_path, monkeypatch, capsys, field):
    run = shutil.copytree(config.out, tmp_path / "run")
    (tmp_path / "planted.py").write_text("from pathlib import Path\nPath(__file__).with_suffix('.ran').touch()\n")
    monkeypatch.syspath_prepend(tmp_path)
    settings = json.loads((run / "train.json").read_text())
    settings[field] = {"env": f"planted:{settings['env']}", "detector": "planted:detect"}[field]
    (run / "train.json").write_text(json.dumps(settings))
    assert main(["--resume", str(run)]) == 2
    told = capsys.readouterr().err
    assert f"{field} '{settings[field]}' is Python code, which would be run" in told
    assert "--allow-code" in told
    assert not (tmp_path / "planted.ran").exists()
    assert main(["--resume", str(run), "--allow-code", "--device", "cpu"]) == 0
    # The toy environment has no use for a detector.
    assert (tmp_path / "planted.ran").exists() == (field == "env")
