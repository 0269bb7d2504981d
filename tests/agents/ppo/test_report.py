"""What a run tells of itself: plan, pace, hand-written policies beside it, and what came of it in unseen scenes."""

import json
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from agents.evaluation.evaluate_config import EvaluateConfig
from agents.evaluation.statistics import paired_record
from agents.network.files import FIRST, HISTORY_FILE, LAST, WEIGHTS_FILE
from agents.policies.ppo import Ppo
from agents.policies.registry import make_policy
from agents.ppo import report, training
from agents.ppo.baselines import BASELINES
from agents.ppo.config import KeptOptions, PpoConfig
from agents.ppo.envs import EnvConfig, make_env, training_scenes, validation_scenes
from agents.ppo.report import Pace, commands, duration, plan, resident_bytes, table
from agents.ppo.run_settings import resolve_settings
from agents.ppo.training_state import Progress
from agents.ppo.validation import validate
from agents.rollouts.collect_config import CollectConfig
from agents.rollouts.scene_shares import scenes_to_compare_in
from labeling.core.errors import UsageError

from ...sbm_gym.box_rooms import BoxRooms

ENV_ID = "report_test/Boxes-v0"
HYPERPARAMS = f"""{ENV_ID}:
  n_timesteps: 60
  n_envs: 2
  n_steps: 10
  batch_size: 10
  n_epochs: 1
  policy_kwargs: {{net_arch: [8], features_extractor_kwargs: {{features: 8, pictures: []}}}}
"""
if ENV_ID not in gym.registry:
    gym.register(
        ENV_ID, entry_point="sbm_gym.env.fixation_env:FixationEnv", kwargs={"worlds": BoxRooms(8)}, max_episode_steps=5
    )


class Bar:
    """Takes the place of tqdm; keeps what it is told."""

    texts: list[str]

    def __init__(self, **_):
        self.texts = []

    def update(self, count):
        pass

    def set_postfix_str(self, text):
        self.texts.append(text)

    def close(self):
        pass


def train(config: PpoConfig) -> tuple[Progress, list[str], list[Bar]]:
    said: list[str] = []
    bars: list[Bar] = []

    def bar(**given) -> Bar:
        bars.append(Bar(**given))
        return bars[-1]

    return training.train_ppo(config, said.append, bar), said, bars


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> PpoConfig:
    folder = tmp_path_factory.mktemp("trained")
    (folder / "boxes.yaml").write_text(HYPERPARAMS)
    return PpoConfig(
        out=folder / "run",
        env=ENV_ID,
        hyperparams=folder / "boxes.yaml",
        processes=1,
        scenes=3,
        validation_scenes=2,
        eval_every=20,
        eval_episodes=4,
        compare_episodes=4,
        device="cpu",
    )


@pytest.fixture(scope="module")
def trained(config):
    return train(config)


@pytest.mark.slow
def test_a_run_says_what_it_will_take_and_how_fast_it_goes(trained, config):
    _, said, _ = trained
    told = said[0]
    assert f"run:    {config.out}" in told
    assert f"tensorboard --logdir {config.out / 'tensorboard'}" in told
    assert "60 steps in rollouts of 20; about 4 validations of 4 starts in 2 scenes" in told
    assert "12 episodes of random, ring, next_best_view before, 20 unseen ones after" in told
    (pace,) = [line for line in said if "steps/s" in line]
    assert re.fullmatch(r"[\d,]+ steps/s: about \d+ (s|min) to go; \d\.\d GB of memory", pace)
    assert [text.split()[1] for text in said if text.startswith("step ")] == ["0:", "20:", "40:", "60:"]


@pytest.mark.slow
def test_hand_written_policies_are_played_in_the_very_validation_episodes(trained, config):
    _, said, bars = trained
    kept = json.loads((config.out / HISTORY_FILE).read_text())["baselines"]
    plain = EnvConfig(ENV_ID, KeptOptions.detector, keys=("state",), scenes=3, validation_scenes=2)
    env = make_env(plain)
    scenes = validation_scenes(env, plain)
    assert scenes == ("box_3", "box_4")
    for name in BASELINES:
        assert kept[name] == validate(make_policy(name, ENV_ID), env, 4, scenes=scenes)
    env.close()
    beside = ", ".join(f"{name} {kept[name]['return']:.2f}" for name in BASELINES)
    assert all(f"({beside})" in text for text in said if text.startswith("step "))
    assert all(f"({beside})" in text for text in bars[-1].texts)


@pytest.mark.slow
def test_they_are_drawn_as_levels_beside_the_curve(trained, config):
    event_accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    kept = json.loads((config.out / HISTORY_FILE).read_text())["baselines"]
    for name in BASELINES:
        board = event_accumulator.EventAccumulator(str(config.out / "tensorboard" / name))
        board.Reload()
        points = {event.step: event.value for event in board.Scalars("validation/return")}
        assert points == dict.fromkeys([0, 20, 40, 60], pytest.approx(kept[name]["return"]))


@pytest.mark.slow
def test_they_are_played_once(trained, config, tmp_path, monkeypatch):
    monkeypatch.setattr(training, "play_baselines", lambda *_: pytest.fail("they have been played"))
    run = shutil.copytree(config.out, tmp_path / "run")
    before = json.loads((run / HISTORY_FILE).read_text())
    _, said, _ = train(replace(config, out=run, compare_episodes=0))
    assert "finished at step 60 already; --steps with more goes on" in said
    train(replace(config, out=run, steps=80, compare_episodes=0))
    after = json.loads((run / HISTORY_FILE).read_text())
    assert after["baselines"] == before["baselines"]
    assert after["validations"][:-1] == before["validations"]


@pytest.mark.slow
def test_a_run_that_is_stopped_meanwhile_goes_on(config, tmp_path, monkeypatch):
    again = replace(config, out=tmp_path / "run", steps=20, compare_episodes=0)
    with monkeypatch.context() as patch:
        patch.setattr(training, "play_baselines", lambda *_: None)
        with pytest.raises(KeyboardInterrupt):
            train(again)
    assert train(again)[0].steps == 20


@pytest.mark.slow
def test_a_run_in_rooms_goes_on_as_if_it_had_never_stopped(trained, config, tmp_path):
    stopped = replace(config, out=tmp_path / "run", compare_episodes=0)
    train(replace(stopped, steps=20))  # no hyperparameter depends on how many there are to be
    progress, _, _ = train(replace(stopped, steps=60))
    assert progress == trained[0]
    one, other = (run / LAST / WEIGHTS_FILE for run in (config.out, tmp_path / "run"))
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.slow
def test_it_ends_with_a_table_on_scenes_that_nothing_was_done_in(trained, config):
    progress, said, _ = trained
    content = json.loads((config.out / "unseen" / "evaluation.json").read_text())
    assert content["settings"]["scenes"] == ["box_6", "box_7"]
    (text,) = [text for text in said if text.startswith("return from 4 unseen starts in 2 scenes")]
    rows = {row[0]: row[1] for row in re.findall(r"^  (\S.*?)  +(\S+)", text, re.MULTILINE)}
    names = [f"trained ({progress.best_steps} steps)", "untrained", *BASELINES]
    assert list(rows) == names
    for name, found in zip(names, content["policies"].values(), strict=True):
        assert rows[name] == f"{found['figures']['return']['mean']:.2f}"
    assert "Nothing is shown by fewer than 100 starts in 4 scenes." in text
    first = Ppo(config.out / FIRST)
    assert first.description["steps"] == 0


def test_the_table_tells_how_much_better_the_trained_policy_is():
    rng, scenes = np.random.default_rng(1), [number % 20 for number in range(200)]
    trained = rng.normal(5.0, 1.0, 200)
    gains = (4.0, 3.0, 2.0, 0.0)
    policies = {"best": {"figures": {"return": {"mean": trained.mean(), "low": 4.8, "high": 5.2, "difference": None}}}}
    for name, gain in zip(("first", *BASELINES), gains, strict=True):
        theirs = trained - gain + rng.normal(0.0, 1.0, 200)
        difference = paired_record(theirs.tolist(), trained.tolist(), scenes)
        figure = {"mean": theirs.mean(), "low": None, "high": None, "difference": difference}
        policies[name] = {"figures": {"return": figure}}
    content = {"policies": policies, "settings": {"episodes": 200, "scenes": list(range(20))}}
    lines = table(content, Progress(steps=20_000, best_steps=12_000)).splitlines()
    assert re.match(r"  trained \(12,000 steps\) +\d\.\d\d ±0\.20$", lines[2])
    for line, gain, found in zip(lines[3:7], gains, list(policies.values())[1:], strict=True):
        difference = found["figures"]["return"]["difference"]
        mean, low, high = map(float, re.findall(r"[+-]\d+\.\d\d", line))
        assert (mean, low, high) == pytest.approx(
            (-difference["mean"], -difference["high"], -difference["low"]), abs=0.0051
        )
        assert low <= mean <= high
        assert line.endswith("*") == (gain > 0)
    resolved = max(one["figures"]["return"]["difference"]["resolves"] for one in list(policies.values())[1:])
    assert lines[7] == f"200 starts resolve differences of {resolved:.2f}; * marks what is shown."
    assert len(lines) == 8


@pytest.mark.slow
def test_the_commands_that_use_a_policy_are_ones_that_there_are(trained, config, capsys):
    _, said, _ = trained
    settings = resolve_settings(PpoConfig(resume=config.out))
    assert said[-1] == commands(settings)
    lines = [shlex.split(line) for line in said[-1].splitlines()[1:]]
    assert [line[2] for line in lines] == [
        "agents.collect",
        "agents.evaluate",
        "experiments.policy_pictures",
        "agents.train",
    ]
    options = {
        "agents.collect": CollectConfig,
        "agents.evaluate": EvaluateConfig,
        "agents.train": PpoConfig,
    }
    for line in lines:
        assert line[:2] == ["python", "-m"]
        known = options.get(line[2])
        if known is not None:
            asked = {word[2:].replace("-", "_") for word in line if word.startswith("--")}
            assert asked <= set(known.__dataclass_fields__)


def test_commands_can_be_typed_whatever_the_folder_is_called(config):
    settings = resolve_settings(replace(config, out=Path("my runs/it's"), reward="evidence"))
    lines = [shlex.split(line) for line in commands(settings).splitlines()[1:]]
    assert lines[0][lines[0].index("--policy") + 1] == "ppo:my runs/it's/best"
    assert lines[1][lines[1].index("--reward") + 1] == "evidence"
    assert [line[line.index("--out") + 1] for line in lines[:3]] == [
        f"my runs/it's/{name}" for name in ("episodes", "evaluation", "pictures")
    ]
    assert lines[3][lines[3].index("--resume") + 1] == "my runs/it's"


def test_pace_counts_training_and_validation(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(report.time, "monotonic", lambda: clock[0])
    pace = Pace(total=10_000, eval_every=2_000)
    assert pace.forecast(0) is None
    pace.begin_rollout(0)
    assert pace.forecast(0) is None
    clock[0] += 4.0
    pace.validation_s = 30.0
    assert str(pace.forecast(1_000)).startswith("250 steps/s: about 3 min to go")  # 9000 / 250 + 5 x 30 = 186 s


def test_durations_and_memory():
    assert [duration(seconds) for seconds in (0.4, 99.0, 100.0, 5999.0, 7200.0)] == [
        "0 s",
        "99 s",
        "2 min",
        "100 min",
        "2.0 h",
    ]
    found = resident_bytes()
    assert found is None or 2**20 < found < 2**40


@pytest.mark.slow
def test_plans_of_runs_that_go_on_count_what_is_left(config):
    settings = resolve_settings(replace(config, steps=100))
    assert "40 steps in rollouts of 20; about 2 validations of 4 starts" in plan(settings, 60, 2, 0)
    assert "unseen" not in plan(settings, 60, 2, 0)
    assert "in 0 scenes" not in plan(settings, 0, 0, 100)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "train", "validate_in"), [(40, 28, 10), (41, 36, 20), (12, 8, 4), (12, 9, 1)])
def test_worlds_with_few_scenes_keep_some_to_compare_in(count, train, validate_in):
    class Named(gym.Env):
        scene_names = tuple(f"scene/{number}" for number in range(count))

    env = Named()
    compared = count // 4
    asked = EnvConfig("any", scenes=train, validation_scenes=validate_in)
    if train >= count - compared:
        kept = f"there are {count} scenes, the last {compared} of which are for comparing"
        with pytest.raises(UsageError, match=f"leaves none to validate in: {kept}"):
            validation_scenes(env, asked)
        asked = replace(asked, scenes=count - compared - 2)
    found = validation_scenes(env, asked)
    assert found == Named.scene_names[asked.scenes : min(asked.scenes + validate_in, count - compared)]
    assert found
    assert not {*found, *training_scenes(env, asked)} & set(scenes_to_compare_in("endless", Named.scene_names))


def test_the_table_at_the_end_is_of_the_reward_that_was_trained_for(config):
    for reward, paid in (("evidence", "evidence"), ("both", "views"), ("discovery", "views")):
        asked = report.comparison(resolve_settings(replace(config, reward=reward)), 8, 1)
        assert asked.reward == paid
    difference = paired_record([1.0, 2.0], [0.0, 0.5], ["a", "a"])
    figures = {"return": {"mean": 1.0, "low": None, "high": None, "difference": difference}}
    for settings, title in (({"reward": "evidence"}, "return of evidence from 8"), ({}, "return from 8")):
        content = {
            "settings": {"episodes": 8, "scenes": ["a"], **settings},
            "policies": {name: {"figures": figures} for name in range(2 + len(BASELINES))},
        }
        assert table(content, Progress()).startswith(title)


def test_scenes_for_comparing_cannot_be_trained_in(config):
    with pytest.raises(UsageError, match="99500 or less together, not 99490 and 20"):
        resolve_settings(replace(config, scenes=99_490, validation_scenes=20))
