"""What kernels need to know about the points that rays hit."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int32, Int64


class SurfaceTable(NamedTuple):
    """What each of n rays hit first."""

    rays: Float32[np.ndarray, "n 6"]
    """Origin and un-normalised direction, world frame, metres."""
    t: Float32[np.ndarray, "n"]
    """The hit is at origin + t * direction (for camera rays t is z-depth); infinite for nothing."""
    triangle: Int64[np.ndarray, "n"]
    """Row of the ``TriangleTable``, -1 for nothing."""
    geom: Int32[np.ndarray, "n"]
    """Row of the ``GeomTable``, -1 for nothing."""
    normal: Float32[np.ndarray, "n 3"]
    """Unit length, smooth, on the side that is seen; undefined for nothing."""
