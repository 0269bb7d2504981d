from dataclasses import replace
from pathlib import Path

import pytest

from experiments.cache.worlds import SIZES
from labeling import finetune
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.detectors.finetuning.presets import PRESETS


def test_defaults_are_those_of_the_tables_but_for_interpolation_and_length() -> None:
    of_tables = SIZES["standard"].train
    assert FinetuneConfig() == PRESETS["default"] == replace(of_tables, interpolate=0.7, iterations=720)
    assert of_tables.iterations == 2 * FinetuneConfig().iterations
    assert PRESETS["paper"] == SIZES["full"].train
    assert PRESETS["new-categories"] == replace(SIZES["standard"].train_new(), interpolate=0.7)


@pytest.mark.parametrize("form", [("--preset", "paper"), ("--preset=paper",)])
def test_flags_change_single_settings_of_a_preset(form: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    given = []
    monkeypatch.setattr(finetune, "run", given.append)
    assert finetune.main(["LABELS", "--out", "RUN", "--iterations", "50", *form]) == 0
    (command,) = given
    assert command.labels == (Path("LABELS"),)
    changed = {name: value for name, value in vars(command.train).items() if value != vars(PRESETS["paper"])[name]}
    assert (command.preset, changed) == ("paper", {"iterations": 50})


def test_an_unknown_preset_is_told_with_the_known_ones(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        finetune.main(["LABELS", "--out", "RUN", "--preset", "papr"])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert all(name in told for name in PRESETS)
