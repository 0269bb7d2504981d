"""Environments on a cluster: what is lost with a node is played again, to the same bytes."""

import json
import time
from collections.abc import Hashable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.vec_env import DummyVecEnv

from agents.network.files import HISTORY_FILE, LAST, STATE_FILE
from agents.ppo import training
from agents.ppo.config import PpoConfig
from agents.ppo.envs import CompleteEpisodes, NumberedEpisodes
from agents.ppo.ray_vec_env import Past, RayGroup
from agents.ppo.vec_env import GroupedVecEnv
from labeling.cluster.cluster_config import ClusterConfig
from labeling.cluster.ray_objects import RemoteObjects
from labeling.core.errors import SbmError, UsageError
from labeling.runtime.process_pool import WorkerDiedError

from ..toy_world import Echo

ROOT = Path(__file__).parents[3]
HYPERPARAMS = """sbm_gym/IndoorBuiltin-v0:
  n_timesteps: 150
  n_envs: 3
  n_steps: 25
  batch_size: 25
  n_epochs: 2
  gamma: 0.9
  learning_rate: lin_0.003
  normalize: {norm_obs: false, norm_reward: true}
  policy_kwargs:
    net_arch: [16]
    features_extractor_kwargs: {features: 16, picture_features: 4, channels: [4]}
"""


class Uneven(Echo):
    """Episodes of several lengths."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        found = super().reset(seed=seed)
        self.left = int(self.np_random.integers(2, 5))
        return found

    def step(self, action: Any) -> Any:
        self.left -= 1
        observation, reward, _, _, info = super().step(action)
        return observation, reward, self.left == 0, False, info


def make(length: int | None, indices: range) -> DummyVecEnv:
    """Toy environments, of episodes of one length or of several."""

    def one() -> gym.Env:
        env = Uneven() if length is None else gym.wrappers.TimeLimit(Echo(), length)
        return CompleteEpisodes(NumberedEpisodes(env, ()))

    return DummyVecEnv([one for _ in indices])  # type: ignore[list-item]


class ObjectsHere(RemoteObjects):
    """Objects of this process; some are lost while they do something."""

    def __init__(self, make: Any, losses: dict[int, int]) -> None:
        self.make, self.losses = make, losses
        """Of which call, and how often in a row."""
        self.there: dict[Hashable, Any] = {}
        self.answers: dict[Hashable, Any] = {}
        self.calls, self.made = 0, 0

    def call(self, key: Hashable, method: str, *arguments: Any) -> None:
        if key not in self.there:
            self.there[key] = self.make(key)
            self.made += 1
        self.calls += 1
        self.answers[key] = (self.calls, getattr(self.there[key], method)(*arguments))

    def answer(self, key: Hashable) -> Any:
        number, answer = self.answers.pop(key)
        if number in self.losses:
            del self.there[key]
            raise WorkerDiedError("it is gone")
        return answer


def played(envs: Any, steps: int) -> list[Any]:
    envs.seed(5)
    envs.env_method("begin_at", 3)
    seen: list[Any] = [envs.reset()["state"]]
    for step in range(steps):
        observation, rewards, ends, infos = envs.step(np.full((envs.num_envs, 4), 0.01 * step))
        seen += [observation["state"].copy(), rewards, ends, json.dumps(infos, default=str)]
    return seen


@pytest.mark.slow
@pytest.mark.parametrize("length", [4, None])
@pytest.mark.parametrize("lost", [1, 3, 4, 6, 9, 12, 13, 25])
def test_what_is_lost_is_played_again_to_the_same_bytes(length: int | None, lost: int) -> None:
    expected = played(make(length, range(3)), 30)
    objects = ObjectsHere(partial(make, length), {lost: 1})
    group = RayGroup(objects, range(3))
    found = played(GroupedVecEnv([group], [3]), 30)
    assert objects.made == 2
    assert all(np.array_equal(one, other) for one, other in zip(found, expected, strict=True))


def test_only_what_went_on_since_the_last_common_beginning_is_played_again() -> None:
    past = Past(2)
    none = np.zeros(2, bool)
    for call, answer in (
        (("get_attr", ("spec",)), [None] * 2),
        (("seed", (5,)), [5, 6]),
        (("env_method", ("begin_at", 7)), [None] * 2),
        (("reset", ()), "first"),
        (("step", (1,)), (1, 1, none, [])),
        (("step", (2,)), (2, 2, ~none, [])),
        (("step", (3,)), (3, 3, none, [])),
    ):
        past.add(call, answer)
    begun = [("seed", (5,)), ("env_method", ("begin_at", 8)), ("reset", ())]
    assert past.calls() == [*begun, ("step", (3,))]
    past.add(("step", (4,)), (4, 4, np.array([True, False]), []))
    past.add(("step", (5,)), (5, 5, np.array([False, True]), []))
    assert past.calls() == [*begun, *(("step", (number,)) for number in (3, 4, 5))]
    past.add(("reset", ()), "again")
    assert past.calls() == [("seed", (5,)), ("env_method", ("begin_at", 10)), ("reset", ())]


def test_a_group_that_is_lost_again_and_again_or_does_otherwise_ends_the_rollout() -> None:
    group = RayGroup(ObjectsHere(partial(make, 4), dict.fromkeys(range(8, 30), 1)), range(2))
    with pytest.raises(WorkerDiedError, match="the process of environments 0 to 1 was lost 3 times in one step"):
        played(GroupedVecEnv([group], [2]), 5)

    made = []

    def other_each_time(indices: range) -> DummyVecEnv:
        made.append(make(None if made else 4, indices))
        return made[-1]

    group = RayGroup(ObjectsHere(other_each_time, {8: 1}), range(2))
    with pytest.raises(SbmError, match="do not do again what they did before"):
        played(GroupedVecEnv([group], [2]), 5)


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PpoConfig:
    monkeypatch.setattr(training, "play_baselines", lambda *arguments: {})
    (tmp_path / "small.yaml").write_text(HYPERPARAMS)
    sizes: dict[str, Any] = {
        "scenes": 6,
        "validation_scenes": 2,
        "eval_every": 75,
        "eval_episodes": 2,
        "compare_episodes": 0,
    }
    return PpoConfig(detector="simulated", hyperparams=tmp_path / "small.yaml", device="cpu", **sizes)


class Bar:
    """Takes the place of tqdm; does something at a step."""

    def __init__(self, at: int = -1, do: Any = None, **_: Any) -> None:
        self.steps, self.at, self.do = 0, at, do

    def update(self, count: int) -> None:
        self.steps += count
        if self.steps == self.at:
            self.do()

    def set_postfix_str(self, text: str) -> None: ...

    def close(self) -> None: ...


def train(config: PpoConfig, at: int = -1, do: Any = None) -> Any:
    return training.train_ppo(config, lambda line: None, lambda **given: Bar(at, do, **given))


def assert_same_run(one: Path, other: Path) -> None:
    for name in (f"{LAST}/policy.safetensors", f"{LAST}/vecnormalize.json", "best/policy.safetensors", HISTORY_FILE):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


def is_running(pid: int) -> bool:
    status = Path(f"/proc/{pid}/status")
    return status.exists() and "State:\tZ" not in status.read_text()


@pytest.mark.nightly
def test_training_on_a_cluster_ends_with_the_same_weights(
    ray_cluster: Any,
    config: PpoConfig,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    where = ClusterConfig(ray_cluster.address)
    here, there = tmp_path / "here", tmp_path / "there"
    train(replace(config, out=here, processes=2))
    third = ray_cluster.add_node(num_cpus=1)

    def lose_a_node() -> None:
        parent = third.all_processes["raylet"][0].process.pid
        children = [int(one) for one in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]
        ray_cluster.remove_node(third, allow_graceful=False)
        deadline_s = time.monotonic() + 60
        while any(map(is_running, children)) and time.monotonic() < deadline_s:
            time.sleep(0.05)  # a process outlives its node by a moment

    # A node dies in the middle of an episode of the second rollout.
    train(replace(config, out=there, where=where), at=3 * (25 + 7), do=lose_a_node)
    assert capsys.readouterr().err.count("note: a process is lost; what it held is made anew elsewhere") == 1
    assert_same_run(here, there)


@pytest.mark.nightly
def test_a_run_that_was_stopped_goes_on_elsewhere_exactly(
    ray_cluster: Any, config: PpoConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    where = ClusterConfig(ray_cluster.address)
    straight, stopped = tmp_path / "straight", tmp_path / "stopped"
    train(replace(config, out=straight, processes=1))

    receive = RayGroup.receive

    def lose_everything(self: RayGroup) -> Any:
        raise WorkerDiedError("its process was lost 3 times")

    def break_down() -> None:
        monkeypatch.setattr(RayGroup, "receive", lose_everything)

    with pytest.raises(
        SbmError,
        match=r"lost 3 times; python -m agents.train --resume .* goes on from the last checkpoint",
    ):
        train(replace(config, out=stopped, where=where), at=3 * 30, do=break_down)
    monkeypatch.setattr(RayGroup, "receive", receive)
    assert (stopped / LAST / STATE_FILE).is_file()
    train(PpoConfig(resume=stopped, where=where, device="cpu", compare_episodes=0))
    assert_same_run(straight, stopped)


def test_names_and_clusters_are_checked_before_anything_is_begun(config: PpoConfig, tmp_path: Path) -> None:
    away = replace(config, out=tmp_path / "run", where=ClusterConfig("127.0.0.1:1"))
    with pytest.raises(UsageError, match=r"--cluster 127\.0\.0\.1:1: nobody answers there"):
        train(away)
    (tmp_path / "atlas").mkdir()
    with pytest.raises(UsageError, match="atlas: with --cluster give its path as seen from the folder"):
        train(replace(away, atlas=tmp_path / "atlas"))
    assert not (tmp_path / "run").exists()
