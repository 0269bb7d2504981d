"""A label set of two small rooms, and what it says view by view."""

from pathlib import Path

import pytest

from labeling.generate import main as generate
from labeling.io.episodes import write_episode
from labeling.io.labelled_views import LabelledView, labelled_views

from ..synthetic_room import make_episode


@pytest.fixture(scope="session")
def labels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The label set of two rooms whose cameras look down a little."""
    folder = tmp_path_factory.mktemp("exports")
    for seed in (1, 2):
        episode = make_episode(seed, num_views=3, size=(48, 64), num_objects=3, confident_share=2.0)
        write_episode(folder / "dataset" / f"room_{seed}", episode)
    assert generate([str(folder / "dataset"), "--out", str(folder / "labels")]) == 0
    return folder / "labels"


@pytest.fixture(scope="session")
def views(labels: Path) -> list[LabelledView]:
    found = list(labelled_views(labels))
    assert len(found) == 6
    assert sum(len(view.labels) for view in found) > 6
    return found
