"""Tiny rooms to run experiments on."""

from dataclasses import replace
from pathlib import Path

import pytest

import experiments.cache.episode_pool
from experiments.cache import worlds
from experiments.cache.worlds import SIZES, Size
from labeling.detectors.data.annotated_pictures import read_pictures
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.io.episodes import write_episode

from ..labeling.synthetic_room import make_episode


@pytest.fixture
def small_rooms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list:
    """Tiny rooms in place of recorded ones and of photographs; returns the pools that were asked for."""
    asked: list = []

    def record(pool, context):
        asked.append(pool)
        folder = tmp_path / "episodes" / pool.name / "0000"
        if not folder.exists():
            room = make_episode(len(pool.name) + pool.seed, 3, (64, 64), num_objects=3, confident_share=2.0)
            write_episode(folder, replace(room, name=folder.name, metadata={"scene": "room/0"}))
        return [folder]

    def photographs(counts, context):
        pictures = read_pictures(record(replace(asked[-1], name="photographs") if asked else POOL, context)[0])
        return pictures if counts[0] else [], pictures[:1]

    train = FinetuneConfig(iterations=2, batch_size=2, validate_every=1, warmup=1)
    size = Size({"rooms": (1, 1, 1)}, (3, 1), train, {"rooms": AugmentConfig(short_side_px=(64, 64))}, command=train)
    monkeypatch.setitem(SIZES, "smoke", size)
    monkeypatch.setattr(experiments.cache.episode_pool, "record", record)
    monkeypatch.setattr(worlds, "source_photographs", photographs)
    return asked


POOL = experiments.cache.episode_pool.EpisodePool("photographs", "none", "train", 1)
