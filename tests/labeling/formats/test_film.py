"""Films: animated GIFs that are small enough."""

from pathlib import Path

import numpy as np
import pytest

from labeling.core.errors import SbmError
from labeling.formats import film
from labeling.formats.film import write_film


def frames(count: int, size_px: tuple[int, int] = (60, 80)) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, (*size_px, 3), np.uint8) for _ in range(count)]


def test_a_film_shows_its_pictures_in_order(tmp_path: Path) -> None:
    from PIL import Image

    shown = [np.full((8, 10, 3), value, np.uint8) for value in (10, 90, 200)]
    write_film(shown, tmp_path / "film.gif")
    with Image.open(tmp_path / "film.gif") as shot:
        for number, picture in enumerate(shown):
            shot.seek(number)
            assert np.abs(np.asarray(shot.convert("RGB"), int) - picture).max() <= 8


def test_films_are_made_small_enough_or_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_film(frames(4), tmp_path / "film.gif")
    whole = (tmp_path / "film.gif").stat().st_size
    monkeypatch.setattr(film, "MAX_MB", 0.9 * whole / 1e6)
    write_film(frames(4), tmp_path / "smaller.gif")
    assert (tmp_path / "smaller.gif").stat().st_size <= 0.9 * whole
    monkeypatch.setattr(film, "MAX_MB", 1e-3)
    with pytest.raises(SbmError, match=r"none\.gif"):
        write_film(frames(4), tmp_path / "none.gif")
    assert not list(tmp_path.glob("*none*"))
