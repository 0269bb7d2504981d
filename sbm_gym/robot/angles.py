"""Angles."""

import numpy as np


def wrap(angle_rad):
    """Angles (a number or an array) in [-pi, pi)."""
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi
