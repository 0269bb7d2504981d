"""Labels from moving: posed RGB-D views and a few confident detections in, pseudo-labels for every view out.

The ground floor: needs neither MuJoCo nor Gymnasium, so that it serves anybody's recordings.
"""

import os

# numba tries TBB first and warns about each one it finds too old. OpenMP is always there (see apt-packages.txt) and,
# unlike numba's own workqueue, may be called from several threads. Set before numba is imported; workers inherit it.
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp workqueue tbb")
# Threads that wait for others spin for a moment only: on a machine that others use too, they would spin on the very
# core that the others need (measured on two cores under load: half the time of an episode).
os.environ.setdefault("GOMP_SPINCOUNT", "10000")
