"""What gaze actions mean: how far the camera turns or, while the robot fixates an object, how far from it it points.

Near zero an action of 0.1 is 4.5 degrees, for looking around an object with care; an action of 1 is half a turn, for
looking anywhere at once.
"""

import numpy as np

TURN_RAD, TILT_RAD = np.deg2rad(60.0), np.deg2rad(30.0)
"""What gaze actions of 1 turn and tilt the camera by, without a fixation target."""
PITCH_RAD = np.deg2rad(45.0)
"""How far above or below the fixation target a gaze pitch of 1 points the camera."""
FINE_RAD, COARSE_RAD = np.deg2rad(45.0), np.deg2rad(135.0)
"""A gaze yaw ``a`` points the camera ``FINE_RAD a + COARSE_RAD a^3`` to the left of the target: 1 is half a turn."""


def yaw_offset_rad(action: float) -> float:
    """How far to the left of the fixation target a gaze yaw action in [-1, 1] points the camera."""
    return float(FINE_RAD * action + COARSE_RAD * action**3)


def yaw_action(offset_rad: float) -> float:
    """The gaze yaw action that points the camera so far to the left of the fixation target.

    Args:
        offset_rad: from -pi to pi; ``yaw_offset_rad`` gives it back.
    """
    # The real root of a^3 + 3 p a = 2 q (Cardano).
    p, q = FINE_RAD / (3.0 * COARSE_RAD), offset_rad / (2.0 * COARSE_RAD)
    root = np.sqrt(q**2 + p**3)
    return float(np.cbrt(q + root) + np.cbrt(q - root))
