"""A detector that is a Python function, and recordings that no detector has looked at."""

import sys
from pathlib import Path

import pytest

DETECTOR = '''
import numpy as np

CALLS = []

def find(rgb):
    """The chair, whole, and a vase that is not there."""
    CALLS.append(1)
    chair, vase = np.zeros(rgb.shape[:2], bool), np.zeros(rgb.shape[:2], bool)
    chair[2:10, 2:10] = True
    vase[0:3, 28:31] = True
    return [("chair", 0.9, chair), ("vase", 0.7, vase)]

def find_near(rgb, depth_m):
    """All that is nearer than two metres."""
    return [("chair", 0.9, (depth_m > 0) & (depth_m < 2))]

def fail(rgb):
    raise RuntimeError("out of film")
'''


@pytest.fixture
def detector(tmp_path, monkeypatch):
    name = f"finder_{tmp_path.name.replace('-', '_')}"
    (tmp_path / f"{name}.py").write_text(DETECTOR)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield name
    sys.modules.pop(name, None)


@pytest.fixture
def dataset(scene) -> Path:
    """Two episodes that no detector has looked at."""
    for name in ("one", "two"):
        scene.add_episode(name, detections=None)
    return scene.dataset
