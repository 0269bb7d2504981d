import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labeling.core.errors import UsageError
from labeling.core.rle import decode_mask
from labeling.generate import main
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.presets import PRESETS, PresetName, describe
from labeling.generator.thesis.per_detection import SegmentMasks, non_maximum_suppression
from labeling.io.episodes import write_episode

from ...synthetic_room import make_episode


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("presets") / "room"
    write_episode(folder, make_episode(1, num_views=4, size=(48, 64), num_objects=3, confident_share=2.0))
    return folder


def run(dataset: Path, out: Path, *flags: str) -> int:
    return main([str(dataset), "--out", str(out), *flags])


def read(path: Path):
    return json.loads(path.read_text())


@pytest.mark.parametrize("preset", list(PRESETS))
def test_presets_run_end_to_end_and_are_recorded(dataset: Path, tmp_path: Path, preset: PresetName) -> None:
    assert run(dataset, tmp_path / "labels", "--preset", preset) == 0
    summary = read(tmp_path / "labels" / "label_set.json")
    assert summary["preset"] == preset
    assert summary["changed"] == {}
    assert summary["config"]["fuse_views"] == (preset in ("default", "unfitted"))
    assert summary["config"]["published"] == vars(PRESETS[preset].published)
    annotations = read(tmp_path / "labels" / "instances_modal.json")["annotations"]
    assert annotations
    assert (summary["uncalibrated_detectors"] == []) == (preset != "default")  # none is asked for but by default
    if preset == "released":
        assert {one["score"] for one in annotations} == {1.0}


def test_labels_of_single_views_ask_for_no_calibration(dataset: Path, tmp_path: Path) -> None:
    assert run(dataset, tmp_path / "labels", "--no-fuse-views") == 0
    assert read(tmp_path / "labels" / "label_set.json")["uncalibrated_detectors"] == []


@pytest.mark.parametrize("form", [("--preset", "paper"), ("--preset=paper",)])
def test_flags_change_single_settings_of_a_preset(dataset: Path, tmp_path: Path, form: tuple[str, ...]) -> None:
    flags = ("--crop-m", "2", "--seed", "4", "--published.amodal-boxes")
    assert run(dataset, tmp_path / "labels", *flags, *form) == 0
    summary = read(tmp_path / "labels" / "label_set.json")
    assert summary["preset"] == "paper"
    assert summary["changed"] == {"crop_m": 2.0, "published.amodal_boxes": True}
    paper = PRESETS["paper"]
    expected = replace(paper, crop_m=2.0, seed=4, published=replace(paper.published, amodal_boxes=True))
    assert summary["config"] == json.loads(json.dumps(_plain(expected)))


def _plain(config: LabelConfig) -> dict:
    return {**vars(config), "published": vars(config.published)}


def test_amodal_boxes_reach_the_file(dataset: Path, tmp_path: Path) -> None:
    assert run(dataset, tmp_path / "labels", "--published.amodal-boxes") == 0
    boxes = {}
    for kind in ("modal", "amodal"):
        for one in read(tmp_path / "labels" / f"instances_{kind}.json")["annotations"]:
            boxes[kind, one["image_id"], one["instance_id"]] = one["bbox"]
            if kind == "amodal":
                columns = np.flatnonzero(decode_mask(one["segmentation"]).any(axis=0))
                assert one["bbox"][0] == columns[0]
    shared = {key[1:] for key in boxes if key[0] == "modal"}
    assert shared
    assert all(boxes["modal", *key] == boxes["amodal", *key] for key in shared)


def test_an_unknown_preset_is_told_with_the_known_ones(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        run(dataset, tmp_path / "labels", "--preset", "best")
    assert end.value.code == 2
    assert "released" in capsys.readouterr().err


def test_help_shows_the_defaults_of_the_preset() -> None:
    command = [sys.executable, "-m", "labeling.generate", "--preset", "paper", "--help"]
    result = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[4])
    words = " ".join(result.stdout.replace("│", " ").split())
    assert "(default: paper)" in words
    half_edge = words[words.index("--crop-m") :]
    assert half_edge[: half_edge.index(")", half_edge.index("(default"))].endswith("(default: 1.0")


def test_presets_are_sound_and_described_as_themselves() -> None:
    for name, config in PRESETS.items():
        config.check()
        assert describe(config) == {"preset": name, "changed": {}}
        assert describe(replace(config, seed=7, crop=0.7)) == {"preset": name, "changed": {"crop": 0.7}}


@pytest.mark.parametrize(
    "changes",
    [
        {"erosions": -1},
        {"crop_m": 0.0},
        {"outer_share": 1.5},
        {"outer_share": -0.1},
        {"max_sources": -1},
        {"appearance_width_m": float("nan")},
        {"fill_px": -1.0},
        {"outlier_spread": 0.0},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_settings_that_make_no_sense_are_refused(changes: dict) -> None:
    with pytest.raises(UsageError, match=f"--{next(iter(changes)).replace('_', '-')}"):
        replace(LabelConfig(), **changes).check()


def mask(left: int, right: int, top: int = 0, bottom: int = 10) -> np.ndarray:
    drawn = np.zeros((20, 40), bool)
    drawn[top:bottom, left:right] = True
    return drawn


def test_of_two_masks_of_one_thing_the_more_confident_is_kept() -> None:
    sure, again, apart = mask(0, 20), mask(8, 20), mask(18, 30)
    drawn = [
        SegmentMasks(0, "chair", sure, sure),
        SegmentMasks(1, "chair", again, again),
        SegmentMasks(2, "chair", apart, apart),
        SegmentMasks(3, "couch", mask(0, 19), mask(0, 19)),
        SegmentMasks(4, "couch", mask(0, 9), mask(0, 9)),
    ]
    kept = non_maximum_suppression(drawn)
    assert [one.segment for one in kept] == [0, 2]  # 1 lies within 0; 3 and 4 have no pixel of their own
    assert np.array_equal(kept[1].modal, mask(20, 30))
    assert np.sum([one.modal for one in kept], axis=0).max() == 1
    last = non_maximum_suppression(drawn, last_wins=True)
    assert np.array_equal(next(one for one in last if one.segment == 2).modal, apart)
    assert non_maximum_suppression([]) == []
