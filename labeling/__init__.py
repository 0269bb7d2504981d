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

import lazy_loader

from labeling.runtime.start_up import expect_interrupts

__version__ = "0.1.0"

# numba tries TBB first and warns about each one it finds too old. OpenMP is always there (see apt-packages.txt) and,
# unlike numba's own workqueue, may be called from several threads. Set before numba is imported; workers inherit it.
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp workqueue tbb")
# Threads that wait for others spin for a moment only: on a machine that others use too, they would spin on the very
# core that the others need (measured on two cores under load: half the time of an episode).
os.environ.setdefault("GOMP_SPINCOUNT", "10000")

expect_interrupts()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # what __init__.pyi lists
