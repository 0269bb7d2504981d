"""The command that takes the screenshots of docs."""

import io
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from .imports import ROOT

sys.path.insert(0, str(ROOT))

from tools import screenshots
from tools.browser import find_browser


def test_without_a_browser_one_sentence_says_so(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert screenshots.main(["--only", "help", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "no browser; looked for chromium, " in said
    assert not (tmp_path / "out").exists()


def test_a_label_set_without_report_is_refused(tmp_path: Path, capsys) -> None:
    with pytest.raises(SystemExit) as raised:
        screenshots.main(["--labels", str(tmp_path)])
    assert raised.value.code == 2
    assert "holds no report.html" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(find_browser() is None, reason="needs chromium or chrome")
def test_help_is_shown_whole(tmp_path: Path) -> None:
    assert screenshots.main(["--only", "help", "--out", str(tmp_path)]) == 0
    file = tmp_path / "screenshot_help.png"
    with Image.open(file) as shot:
        picture = np.asarray(shot.convert("RGB"), int)
    bright = (picture.sum(axis=2) > 300).any(axis=1)  # rows of text
    lines = np.flatnonzero(bright)
    assert lines[0] < 40
    assert len(picture) - 60 < lines[-1] < len(picture) - 4
    assert file.stat().st_size <= screenshots.MAX_BYTES


def test_pictures_are_made_small_enough_and_stay_what_they_are(monkeypatch) -> None:
    rng = np.random.default_rng(0)
    picture = np.kron(rng.integers(0, 255, (30, 40, 3)), np.ones((8, 8, 1))).astype(np.uint8)
    kept = io.BytesIO()
    Image.fromarray(picture).save(kept, format="PNG")
    found = np.asarray(Image.open(io.BytesIO(screenshots.small_png(kept.getvalue()))).convert("RGB"), int)
    assert found.shape == picture.shape
    assert np.abs(found - picture).mean() < 12
    noise = io.BytesIO()
    Image.fromarray(rng.integers(0, 255, (500, 600, 3), np.uint8)).save(noise, format="PNG")
    assert len(screenshots.small_png(noise.getvalue())) <= screenshots.MAX_BYTES


def test_the_committed_ones_are_small_and_shown() -> None:
    files = sorted((ROOT / "docs/pictures").glob("screenshot_*.png"))
    pages = "".join(path.read_text(encoding="utf-8") for path in [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")])
    assert len(files) >= 6
    for file in files:
        assert file.stat().st_size <= screenshots.MAX_BYTES
        assert file.name in pages
