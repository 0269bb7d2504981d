"""Labels from moving: posed RGB-D views and a few confident detections in, pseudo-labels for every view out.

Needs neither MuJoCo nor Gymnasium, so that it serves anybody's recordings.

>>> import numpy as np
>>> from labeling import Detection, RgbdViews, propagate
>>> rgb = np.full((2, 48, 64, 3), 128, np.uint8)            # two views of a wall, a box before it
>>> depth_m = np.full((2, 48, 64), 3.0, np.float32)
>>> rgb[:, 12:36, 20:44], depth_m[:, 12:36, 20:44] = (200, 60, 60), 2.0
>>> intrinsics = np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])
>>> views = RgbdViews(rgb, depth_m, np.stack([intrinsics] * 2), np.stack([np.eye(4)] * 2))
>>> box = Detection(view_index=0, category="box", confidence=0.95, mask=depth_m[0] < 2.5)
>>> [(label.view_index, label.category) for label in propagate(views, [box]).labels]
[(0, 'box'), (1, 'box')]

What users import comes from here; paths inside the package may change.
"""

import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from labeling.core.detector import DetectorError
    from labeling.core.episode import Episode
    from labeling.core.episode_labels import EpisodeLabels
    from labeling.core.errors import SbmError
    from labeling.core.rle import decode_mask, encode_mask
    from labeling.core.types import Box3d, Detection, GroundTruth, PseudoLabel
    from labeling.core.views import Camera, RgbdViews
    from labeling.detectors.registry import load_detector
    from labeling.generator.propagate import propagate
    from labeling.generator.settings.label_config import LabelConfig
    from labeling.generator.settings.presets import PRESETS
    from labeling.io.episodes import find_episodes, read_episode, write_episode
    from labeling.io.label_set import LabelSet, read_label_set
    from labeling.io.recordings.recording_config import RecordingConfig
    from labeling.metrics.mask_ap import average_precision
    from labeling.metrics.matching import MaskInstance

__version__ = "0.1.0"

_MODULES = {
    "Box3d": "core.types",
    "Camera": "core.views",
    "Detection": "core.types",
    "DetectorError": "core.detector",
    "Episode": "core.episode",
    "EpisodeLabels": "core.episode_labels",
    "GroundTruth": "core.types",
    "LabelConfig": "generator.settings.label_config",
    "LabelSet": "io.label_set",
    "MaskInstance": "metrics.matching",
    "PRESETS": "generator.settings.presets",
    "PseudoLabel": "core.types",
    "RecordingConfig": "io.recordings.recording_config",
    "RgbdViews": "core.views",
    "SbmError": "core.errors",
    "average_precision": "metrics.mask_ap",
    "decode_mask": "core.rle",
    "encode_mask": "core.rle",
    "find_episodes": "io.episodes",
    "load_detector": "detectors.registry",
    "propagate": "generator.propagate",
    "read_episode": "io.episodes",
    "read_label_set": "io.label_set",
    "write_episode": "io.episodes",
}
"""Where the names come from that are loaded when they are first asked for."""

__all__ = [
    "PRESETS",
    "Box3d",
    "Camera",
    "Detection",
    "DetectorError",
    "Episode",
    "EpisodeLabels",
    "GroundTruth",
    "LabelConfig",
    "LabelSet",
    "MaskInstance",
    "PseudoLabel",
    "RecordingConfig",
    "RgbdViews",
    "SbmError",
    "average_precision",
    "decode_mask",
    "encode_mask",
    "find_episodes",
    "load_detector",
    "propagate",
    "read_episode",
    "read_label_set",
    "write_episode",
]

# numba tries TBB first and warns about each one it finds too old. OpenMP is always there (see apt-packages.txt) and,
# unlike numba's own workqueue, may be called from several threads. Set before numba is imported; workers inherit it.
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp workqueue tbb")
# Threads that wait for others spin for a moment only: on a machine that others use too, they would spin on the very
# core that the others need (measured on two cores under load: half the time of an episode).
os.environ.setdefault("GOMP_SPINCOUNT", "10000")


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
