"""Evaluation: the same starts for all, figures as counted by hand, and being killed changes nothing."""

import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import torch

from agents.evaluate import main
from agents.evaluation import run as evaluation_run
from agents.evaluation.evaluate_config import VIEW_COUNTS, EvaluateConfig
from agents.evaluation.label_quality import label_record
from agents.evaluation.results import policy_key
from agents.evaluation.run import Evaluator, evaluate_policies
from agents.evaluation.statistics import paired_record
from agents.evaluation.table import COLUMNS, _differences_table, print_tables, resolution
from agents.rollouts.run_episode import episode_spec
from labeling.core.errors import UsageError
from labeling.generator.calibration import detector_calibration
from labeling.generator.calibration.detector_calibration import calibration_of
from sbm_gym.env.fixation_env import FixationEnv

from ..sbm_gym.box_rooms import BoxRooms

ENV_ID = "evaluate_test/Boxes-v0"
ROOT = Path(__file__).resolve().parents[2]
if ENV_ID not in gym.registry:
    gym.register(
        ENV_ID, entry_point="sbm_gym.env.fixation_env:FixationEnv", kwargs={"worlds": BoxRooms()}, max_episode_steps=6
    )


def config(out: Path, **changes) -> EvaluateConfig:
    settings = {"policies": ("ring", "random"), "episodes": 2, "seeds": 2, "size": 64, "labels": False}
    return EvaluateConfig(env=ENV_ID, out=out, **{**settings, **changes})


def contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file() and path.suffix == ".json"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("evaluated") / "out"
    evaluate_policies(config(out, labels=True, pictures=1))
    return out


def results(out: Path, policy: str) -> list[dict]:
    return [json.loads(path.read_text()) for path in sorted((out / "episodes" / policy).glob("*.json"))]


@pytest.mark.slow
def test_all_policies_start_alike_and_episodes_differ(evaluated):
    ring, random = results(evaluated, "ring"), results(evaluated, "random")
    assert len(ring) == len(random) == 4
    for ours, theirs in zip(ring, random, strict=True):
        assert all(ours[key] == theirs[key] for key in ("seed", "episode", "scene", "env_seed", "start"))
        assert ours["steps"] != theirs["steps"]
    assert len({json.dumps(one["start"]) for one in ring}) == 4


@pytest.mark.slow
def test_scenes_that_nothing_is_learnt_from_are_used_unless_others_are_asked_for(evaluated, tmp_path):
    assert EvaluateConfig().split == "endless"
    assert {one["scene"] for one in results(evaluated, "ring")} == {"box_3"}
    for count, scenes in ((None, {"box_0", "box_1", "box_2"}), (2, {"box_0", "box_1"})):
        out = tmp_path / str(count)
        evaluate_policies(config(out, split="train", scenes=count, policies=("spin",), episodes=3, seeds=1))
        assert {one["scene"] for one in results(out, "spin")} == scenes


@pytest.mark.slow
def test_policies_that_draw_are_played_several_times_and_averaged(tmp_path, monkeypatch):
    out, alone = tmp_path / "out", tmp_path / "alone"
    evaluate_policies(config(alone, policies=("random", "spin"), seeds=1))
    evaluate_policies(config(out, policies=("random", "spin"), seeds=1))
    content = evaluate_policies(config(out, policies=("random", "spin"), seeds=1, draws=3))
    names = {folder.name: sorted(path.stem for path in folder.iterdir()) for folder in (out / "episodes").iterdir()}
    assert names["spin"] == ["seed0-0000", "seed0-0001"]
    assert names["random"] == [f"seed0-000{start}{draw}" for start in (0, 1) for draw in ("", "-draw1", "-draw2")]
    for path in (alone / "episodes").rglob("*.json"):
        assert path.read_bytes() == (out / path.relative_to(alone)).read_bytes()
    played = results(out, "random")
    for start in (0, 1):
        plays = [one for one in played if one["episode"] == start]
        assert all(one["start"] == plays[0]["start"] for one in plays)
        assert len({json.dumps(one["steps"]) for one in plays}) == 3
    mean = np.mean([one["figures"]["return"] for one in played])
    assert content["policies"]["random"]["figures"]["return"]["mean"] == pytest.approx(mean, abs=1e-5)
    monkeypatch.setattr(Evaluator, "run", lambda *_: pytest.fail("nothing is missing"))
    evaluate_policies(config(out, policies=("random", "spin"), seeds=1, draws=2))


def test_networks_compute_in_one_thread(tmp_path, monkeypatch):
    seen, real, before = [], Evaluator.run, torch.get_num_threads()

    def run(evaluator, spec, policy):
        seen.append(torch.get_num_threads())
        real(evaluator, spec, policy)

    monkeypatch.setattr(Evaluator, "run", run)
    torch.set_num_threads(3)
    try:
        evaluate_policies(config(tmp_path, policies=("spin",), seeds=1, episodes=1))
        assert (seen, torch.get_num_threads()) == ([1], 3)
    finally:
        torch.set_num_threads(before)


def evaluation(starts: int, scenes: int, std: float = 3.0) -> dict:
    """As ``evaluation.json`` has it: one policy much better than the first in return, one not to be told from it."""
    rng, names = np.random.default_rng(0), [str(number % scenes) for number in range(starts)]
    base = rng.normal(5.0, std, starts)
    policies = {}
    for policy, gain in {"ring": None, "better": 4.0, "same": 0.0}.items():
        ours = base if gain is None else base + gain + rng.normal(0.0, std, starts)
        difference = None if gain is None else paired_record(ours.tolist(), base.tolist(), names)
        one = {"mean": float(ours.mean()), "low": 4.0, "high": 6.0, "difference": difference}
        policies[policy] = {"figures": dict.fromkeys(COLUMNS, one), "labels": None}
    asked = {"env": "e", "split": "s", "detector": "d", "episodes": starts, "seeds": [0], "scenes": sorted(set(names))}
    return {"settings": asked, "compared_with": "ring", "policies": policies}


def test_bold_is_what_is_shown_and_how_much_can_be_is_said(capsys):
    content = evaluation(400, 40)
    table = _differences_table(content)
    better, same = (list(table.columns[1].cells)[row] for row in (0, 1))
    assert better.startswith("[bold]")
    assert "[bold]" not in same
    text = resolution(content)
    differences = [content["policies"][name]["figures"]["return"]["difference"] for name in ("better", "same")]
    resolved = max(one["resolves"] for one in differences)
    assert f"400 starts in 40 scenes resolve differences of return of {resolved:.2f} at 95 %" in text
    assert "bold" not in text
    needed = int(text.split("would take about ")[1].split()[0])
    assert needed == pytest.approx(400 * (resolved / 0.25) ** 2, rel=0.15)
    print_tables(content)
    said = capsys.readouterr().out
    assert "± half of the 95 % interval" in said
    assert f"{content['policies']['better']['figures']['return']['mean']:.2f} ±1.00" in said


@pytest.mark.parametrize(("starts", "scenes"), [(60, 20), (400, 1)])
def test_too_few_starts_or_scenes_show_nothing(starts, scenes):
    content = evaluation(starts, scenes)
    assert "[bold]" not in "".join(map(str, _differences_table(content).columns[1].cells))
    assert "Nothing is bold: that takes 100 starts in 4 scenes or more." in resolution(content)
    assert ("intervals are over starts" in resolution(content)) == (scenes == 1)


@pytest.mark.slow
def test_episodes_played_for_their_labels_need_not_be_played_again(evaluated, tmp_path, monkeypatch):
    evaluate_policies(config(tmp_path / "afresh"))
    monkeypatch.setattr(Evaluator, "run", None)
    evaluate_policies(config(tmp_path / "adopted"), reuse=evaluated)
    assert contents(tmp_path / "adopted") == contents(tmp_path / "afresh")


def test_starts_depend_on_seed_and_number_alone_and_take_scenes_in_turn():
    scenes = ("a", "b", "c")
    for seed in range(3):
        assert sorted(episode_spec(scenes, seed, number).scene for number in range(3)) == list(scenes)
    assert episode_spec(scenes, 1, 2) == episode_spec(scenes, 1, 2)
    assert len({episode_spec(scenes, seed, number).env_seed for seed in range(4) for number in range(4)}) == 16


@pytest.mark.slow
def test_figures_are_those_of_the_steps(evaluated):
    for policy in ("ring", "random"):
        for record in results(evaluated, policy):
            steps, figures = record["steps"], record["figures"]
            assert len(steps) == 6
            assert figures["return"] == pytest.approx(sum(step["reward"] for step in steps))
            for term in ("discovery", "diversity", "collision", "step"):
                assert figures[term] == pytest.approx(sum(step["terms"][term] for step in steps))
            assert figures["objects"] == len(record["objects"]) == steps[-1]["objects"]
            assert figures["sectors"] == sum(len(known["sectors"]) for known in record["objects"])
            places = np.array([record["start"]["position_m"], *(step["position_m"] for step in steps)])
            length_m = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
            assert figures["path_m"] == pytest.approx(length_m, abs=1e-2)


@pytest.mark.slow
def test_what_is_written_is_what_was_evaluated(evaluated):
    content = json.loads((evaluated / "evaluation.json").read_text())
    ring = [one["figures"]["return"] for one in results(evaluated, "ring")]
    random = [one["figures"]["return"] for one in results(evaluated, "random")]
    found = content["policies"]["ring"]["figures"]["return"]
    per_seed = [np.mean(ring[:2]), np.mean(ring[2:])]
    assert found["per_seed"] == pytest.approx(per_seed, abs=1e-5)
    assert found["mean"] == pytest.approx(np.mean(per_seed), abs=1e-5)
    assert found["std"] == pytest.approx(np.std(per_seed, ddof=1), abs=1e-5)
    assert found["difference"] is None
    difference = content["policies"]["random"]["figures"]["return"]["difference"]
    assert difference["mean"] == pytest.approx(np.mean(random) - np.mean(ring), abs=1e-5)
    assert difference["low"] <= difference["mean"] <= difference["high"]
    assert content["policies"]["ring"]["curves"]["return"]["mean"][-1] == pytest.approx(np.mean(ring), abs=1e-5)
    assert list(content["policies"]["ring"]["labels"]) == ["5"]
    for path in ("evaluation.png", "pictures/seed0-0000.png"):
        assert (evaluated / path).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_killed_and_run_again_gives_the_same_bytes(evaluated, tmp_path, monkeypatch):
    out, played, real = tmp_path / "out", [], Evaluator.run

    def run_then_die(evaluator, spec, policy):
        if len(played) == 3:
            raise KeyboardInterrupt
        played.append(policy)
        real(evaluator, spec, policy)

    monkeypatch.setattr(Evaluator, "run", run_then_die)
    with pytest.raises(KeyboardInterrupt):
        evaluate_policies(config(out, labels=True))
    assert len(list(out.rglob("seed*.json"))) == 3
    assert not (out / "evaluation.json").exists()
    monkeypatch.setattr(Evaluator, "run", real)
    evaluate_policies(config(out, labels=True))
    assert contents(out) == contents(evaluated)


def test_results_that_are_there_are_left_alone_and_policies_can_be_added(tmp_path, monkeypatch):
    evaluate_policies(config(tmp_path / "out", policies=("random",)))
    before = contents(tmp_path / "out")
    evaluate_policies(config(tmp_path / "out", policies=("random", "spin")))
    after = contents(tmp_path / "out")
    assert all(after[name] == content for name, content in before.items() if name != "evaluation.json")
    assert sum(name.startswith("episodes/spin") for name in after) == 4
    monkeypatch.setattr(Evaluator, "run", lambda *_: pytest.fail("nothing is missing"))
    evaluate_policies(config(tmp_path / "out", policies=("random",), episodes=1))


@pytest.mark.slow
@pytest.mark.parametrize("change", [{"split": "train"}, {"size": 32}, {"labels": False}])
def test_other_settings_in_the_same_folder_are_refused(evaluated, change):
    with pytest.raises(UsageError, match="other settings"):
        evaluate_policies(config(evaluated, **{"labels": True, **change}))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--policies", "clever"], "next_best_view, random, ring, spin"),
        (["--policies", "ring", "ring"], "twice"),
        (["--policies", "ppo:nowhere"], "nowhere"),
        (["--env", "sbm_gym/Moon-v0"], "sbm_gym/Indoor-v0"),
        (["--env", "no_such_module:x/Y-v0"], "no_such_module"),
        (["--detector", "oracle"], "oracle"),
        (["--episodes", "0"], "at least 1"),
        (["--seeds", "0"], "at least 1"),
        (["--size", "8"], "at least 32"),
        (["--pictures", "-1"], "0 or more"),
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


def test_folders_of_others_are_refused_and_damaged_results_named(tmp_path, capsys):
    (tmp_path / "thesis.txt").write_text("precious")
    arguments = ["--env", ENV_ID, "--policies", "spin", "--episodes", "1", "--seeds", "1", "--no-labels"]
    assert main(["--out", str(tmp_path), *arguments]) == 2
    assert "not made by this program" in capsys.readouterr().err
    out = tmp_path / "out"
    assert main(["--out", str(out), *arguments]) == 0
    for damaged in ("{", "{}", '{"scene": "a", "figures": [], "steps": []}'):
        (out / "episodes" / "spin" / "seed0-0000.json").write_text(damaged)
        assert main(["--out", str(out), *arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()[-1:]
        assert line.startswith("error: ")
        assert "seed0-0000.json" in line
    (out / "settings.json").write_text("{}")
    assert main(["--out", str(out), *arguments]) == 2
    assert "settings.json: is damaged" in capsys.readouterr().err


def test_results_are_of_the_detector_that_the_name_stood_for(tmp_path, monkeypatch):
    settings = config(tmp_path / "out", policies=("spin",), episodes=1, seeds=1)
    monkeypatch.setattr(evaluation_run, "digest_of_detector", lambda name: "one")
    evaluate_policies(settings)
    monkeypatch.setattr(evaluation_run, "digest_of_detector", lambda name: "another")
    with pytest.raises(UsageError, match="detector_digest one there, another now"):
        evaluate_policies(settings)


def test_a_trained_policy_is_known_by_what_its_checkpoint_holds(tmp_path, monkeypatch):
    best = tmp_path / "best"
    monkeypatch.setitem(sys.modules, "agents.ppo", ModuleType("agents.ppo"))
    reader = SimpleNamespace(checkpoint_folder=lambda path: best)
    monkeypatch.setitem(sys.modules, "agents.network.checkpoint", reader)
    best.mkdir()
    (best / "weights").write_bytes(b"one")
    first = policy_key(f"ppo:{tmp_path}", ENV_ID)
    # What a run writes beside its checkpoint changes nothing.
    (tmp_path / "log").write_bytes(b"longer and longer")
    assert first == policy_key(f"ppo:{tmp_path}", ENV_ID)
    (best / "weights").write_bytes(b"two")
    assert policy_key(f"ppo:{tmp_path}", ENV_ID) != first
    assert policy_key("ring", ENV_ID) == "ring"


def test_labels_are_made_with_the_calibration_of_the_detector(evaluated, tmp_path, monkeypatch):
    """As those of recorded episodes are."""
    asked: list[str | None] = []
    monkeypatch.setattr(
        detector_calibration, "calibration_of", lambda name=None: (asked.append(name), calibration_of(name))[1]
    )
    evaluate_policies(config(tmp_path / "out", policies=("spin",), episodes=1, seeds=1, labels=True, label_views=(3,)))
    assert "simulated" in asked


@pytest.mark.parametrize("detector", ["simulated", "simulated:compact"])
def test_labels_are_judged_by_the_object_model_that_the_robot_judges_by(detector, monkeypatch):
    used = []
    monkeypatch.setattr(
        detector_calibration, "calibration_of", lambda name=None: used.append(calibration_of(name)) or used[-1]
    )
    env = FixationEnv(BoxRooms(), detector=detector)
    env.reset(seed=0)
    label_record([env.capture(64, 64)], env.categories, (1,), detector)
    (calibration,) = used
    assert calibration.objects is env.knowledge.beliefs._model


@pytest.mark.slow
def test_short_episodes_have_no_early_comparison(evaluated):
    content = json.loads((evaluated / "evaluation.json").read_text())
    assert content["policies"]["random"]["early"] is None


@pytest.mark.slow
def test_folders_with_labels_of_other_views_are_refused(evaluated, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    before = json.loads((evaluated / "settings.json").read_text())["settings"]
    assert before.pop("views") == list(VIEW_COUNTS)
    (out / "settings.json").write_text(json.dumps({"settings": before}))
    with pytest.raises(UsageError, match="--views"):
        evaluate_policies(config(out, labels=True))


def test_help_names_the_options():
    result = subprocess.run(
        [sys.executable, "-m", "agents.evaluate", "--help"], capture_output=True, text=True, cwd=ROOT, check=True
    )
    options = (
        "--policies",
        "--split",
        "--episodes",
        "--seeds",
        "--env",
        "--detector",
        "--labels",
        "--out",
        "--pictures",
    )
    assert all(option in result.stdout for option in options)
