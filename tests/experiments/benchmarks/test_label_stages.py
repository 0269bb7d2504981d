from contextlib import ExitStack
from pathlib import Path
from pkgutil import resolve_name
from unittest import mock

import pytest

from experiments.benchmarks.label_stages import STAGES
from experiments.benchmarks.rows import timed
from labeling.generate import GenerateConfig, run
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.episodes import write_episode

from ...labeling.synthetic_room import make_episode


@pytest.mark.slow
def test_every_stage_is_timed_where_labelling_calls_it(tmp_path: Path) -> None:
    write_episode(tmp_path / "room", make_episode(3, num_views=4, size=(60, 80), num_objects=3, confident_share=2.0))
    spent = dict.fromkeys(STAGES, 0.0)
    with ExitStack() as patches:
        for stage, target in STAGES.items():
            patches.enter_context(mock.patch(target, timed(resolve_name(target), spent, stage)))
        run(GenerateConfig(dataset=tmp_path / "room", out=tmp_path / "labels", label=LabelConfig(confident=0.5)))
    assert [stage for stage, seconds in spent.items() if seconds == 0] == []
