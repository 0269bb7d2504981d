"""Upright boxes as numbers that a network can learn: centre, sides with the longer horizontal one first, and heading.

A box looks the same from front and back, and labels do not know which is which: headings are the direction of the
longer side, within half a turn.
"""

import numpy as np
from jaxtyping import Float

from labeling.core.errors import UsageError
from labeling.core.geometry import is_rotation
from labeling.core.types import Box3d
from labeling.detectors3d.frustums import rotation_about_z

HALF_TURN = np.pi
MAX_TILT = 0.02
"""A box whose third axis leans further from the vertical (sine of the angle) is not upright."""


def encode_box(box: Box3d) -> Float[np.ndarray, "7"]:
    """Centre (3), length, width and height (metres; length is not below width), heading in [0, pi).

    Raises:
        UsageError: if the box is not upright, or is none.
    """
    values = np.concatenate([np.ravel(box.centre_m), np.ravel(box.extent_m), np.ravel(box.rotation)])
    if not np.all(np.isfinite(values)):
        raise UsageError("a 3-D box must have finite centre, extent and rotation")
    if not np.all(np.asarray(box.extent_m) > 0):
        raise UsageError(f"the extent of a 3-D box must be above 0, not {np.asarray(box.extent_m).tolist()}")
    if not is_rotation(box.rotation):
        raise UsageError("the rotation of a 3-D box must be a rotation: orthonormal columns, determinant 1")
    vertical = np.argmax(np.abs(box.rotation[2]))
    if abs(box.rotation[2, vertical]) < 1 - MAX_TILT**2 / 2:
        raise UsageError("boxes must stand upright (one axis along world Z) to be learnt from; this one is tilted")
    first, second = (axis for axis in range(3) if axis != vertical)
    if box.extent_m[second] > box.extent_m[first]:
        first, second = second, first
    along = box.rotation[:, first]
    heading = np.mod(np.arctan2(along[1], along[0]), HALF_TURN)
    if heading >= HALF_TURN:  # rounding
        heading = 0.0
    return np.array([*box.centre_m, box.extent_m[first], box.extent_m[second], box.extent_m[vertical], heading])


def decode_box(numbers: Float[np.ndarray, "7"]) -> Box3d:
    """The other way round."""
    numbers = np.asarray(numbers, float)
    return Box3d(numbers[:3], numbers[3:6], rotation_about_z(numbers[6]))
