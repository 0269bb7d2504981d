import json
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import get_args

import pytest

import experiments.cache.episode_pool
from experiments.ablations import label_ablation, label_comparison
from experiments.ablations.ablation_variants import FACTORS, NOT_STUDIED, Factor, Variant, variants
from experiments.ablations.label_modes import modes
from experiments.cache.episode_pool import EpisodePool, ablation_pools
from experiments.cache.origin import MADE_ON
from experiments.cache.registry import experiments as known_experiments
from experiments.cache.stages import Scale
from experiments.run import main
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.episodes import write_episode

from ..labeling.synthetic_room import make_episode


def test_every_default_has_a_sentence() -> None:
    settings = [name for factor in FACTORS for name in factor.settings] + list(NOT_STUDIED)
    assert sorted(settings) == sorted(one.name for one in fields(LabelConfig))


def test_variants_change_the_settings_of_their_factor_and_nothing_else() -> None:
    seen = [LabelConfig()]
    for factor, one in variants("full"):
        assert set(one.changes) <= {*factor.settings, "dilations"}, one.name
        config = one.config(seed=3)
        config.check()
        assert config.seed == 3
        assert replace(config, seed=0) not in seen, f"{factor.title}: {one.name} has been tried already"
        seen.append(replace(config, seed=0))
    quick = [(factor.title, one.name) for factor, one in variants("quick")]
    assert len(set(quick)) == len(quick) < len(variants("full"))


def test_modes_are_checked_presets_and_at_full_scale_each_defect_alone() -> None:
    assert list(modes("quick")) == ["default", "unfitted", "paper", "released"]
    full = modes("full")
    assert len(full) == 4 + 7
    for name, config in full.items():
        config.check()
        if name.startswith("paper, "):
            assert [key for key, on in vars(config.published).items() if on] == [name.removeprefix("paper, ")]


def test_settings_are_never_chosen_on_test_scenes() -> None:
    for scale in get_args(Scale):
        found = ablation_pools(scale)
        assert {pool.split for pool in found} == {"train", "val"}
        assert all(pool.name.endswith(pool.split) for pool in found)


def test_whatever_has_a_size_for_one_scale_has_one_for_each() -> None:
    known_experiments()
    sizes = {
        f"{name}.{variable}": value
        for name, module in list(sys.modules.items())
        if name.startswith("experiments.") and module is not None
        for variable, value in vars(module).items()
        if isinstance(value, dict) and "smoke" in value
    }
    assert len(sizes) > 10
    for name, value in sizes.items():
        assert tuple(value) == get_args(Scale), name


def test_list_names_every_experiment(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(known_experiments())
    assert all(len(line.split()) > 4 for line in lines)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["table_0_0"], "label_ablation"),
        (["label_modes", "--seeds", "0"], "--seeds"),
        (
            ["label_modes", "--rounds", "3"],
            "--rounds must be 1 or more, and is for loops: never_ending, never_ending_again, ",
        ),
        (["never_ending", "--rounds", "0"], "--rounds must be 1 or more"),
        (["label_modes", "--cluster", "auto", "--cache", "/cache"], "--cache /cache: with --cluster give it as seen"),
        (["label_modes", "--cluster", "somewhere"], "--cluster must be local, auto, HOST:PORT or ray://HOST:PORT"),
    ],
)
def test_bad_requests_are_one_line(arguments: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert told in error
    assert len(error.strip().splitlines()) == 1


def test_a_report_needs_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["label_ablation", "--report", "--results", str(tmp_path), "--docs", str(tmp_path / "docs")]) == 2
    assert "label_ablation.json" in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two tiny rooms in place of recorded ones, and two variants."""
    some = (EpisodePool("rooms_train", "none", "train", 2), EpisodePool("rooms_val", "none", "val", 1))
    folders = {}
    for number, pool in enumerate(some):
        folders[pool.name] = [tmp_path / pool.name / f"{index:04d}" for index in range(pool.episodes)]
        for index, folder in enumerate(folders[pool.name]):
            room = make_episode(7 + number + 2 * index, 3, (36, 48), num_objects=3, confident_share=2.0)
            write_episode(folder, replace(room, name=folder.name, metadata={"scene": f"room/{index}"}))
    monkeypatch.setattr(experiments.cache.episode_pool, "ablation_pools", lambda scale: some)
    monkeypatch.setattr(label_comparison, "record", lambda pool, context: folders[pool.name])
    tried = (Variant("no direct votes", {"votes": False}), Variant("no CRF", {"iterations": 0}))
    factor = Factor("Anything", ("votes",), "Why not.", tried)
    monkeypatch.setattr(label_ablation, "FACTORS", (factor,))
    monkeypatch.setattr(label_ablation, "variants", lambda scale: [(factor, one) for one in tried])
    return tmp_path


def nothing_to_do(work, tasks, *args, **options):
    assert not tasks, "a second run has nothing left to do"
    yield from ()


@pytest.mark.slow
def test_an_ablation_runs_resumes_and_reports(
    small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*flags: str) -> int:
        places = ["--cache", str(small / "cache"), "--results", str(small / "results"), "--docs", str(small / "docs")]
        return main(["label_ablation", *places, "--workers", "1", *flags])

    assert run() == 0
    written = small / "results" / "label_ablation.json"
    content = json.loads(written.read_text())
    assert content["seeds"] == [0]
    assert content["pools"]["rooms_train"]["scenes"] == ["room/0", "room/1"]
    base = content["results"]["default"]["rooms_train"]
    itself = {"mean": 0.0, "low": None, "high": None, "std": 0.0, "resolves": None, "episodes": 2, "scenes": 2}
    assert base["difference"]["mean_iou"] == itself
    (factor,) = content["factors"]
    for one in factor["variants"]:
        found = one["results"]["rooms_train"]
        gaps = [a - b for a, b in zip(found["per_episode"]["mean_iou"], base["per_episode"]["mean_iou"], strict=True)]
        assert found["difference"]["mean_iou"]["mean"] == pytest.approx(sum(gaps) / 2, abs=1e-4)
    page = (small / "docs" / "label-generator.md").read_text()
    assert "no direct votes" in page
    assert (small / "docs" / "pictures" / "label_ablation.png").stat().st_size > 1000
    monkeypatch.setattr("experiments.cache.stages.run_jobs", nothing_to_do)
    assert run() == 0
    assert {**json.loads(written.read_text()), MADE_ON: ""} == {**content, MADE_ON: ""}
    capsys.readouterr()
