"""Which noise a recording has."""

from dataclasses import dataclass
from typing import Literal

from labeling.runtime.ranges import NonNegative, Settings

Sensor = Literal["ideal", "kinect", "stereo", "lidar"]


@dataclass(frozen=True)
class SensorNoise(Settings):
    """What a recording's depth and poses are like; by default as the simulator knows them.

    Example:
        >>> SensorNoise(sensor="kinect", pose_noise_deg=2.0, pose_noise_m=0.05).pose_drift_m
        0.0
    """

    sensor: Sensor = "ideal"
    """Whose depth: "ideal", "kinect" (structured light), "stereo" or "lidar"."""
    pose_noise_deg: NonNegative[float] = 0.0
    """Error of each view's orientation, independent of the others, degrees (root mean square)."""
    pose_noise_m: NonNegative[float] = 0.0
    """Error of each view's position, independent of the others, metres (root mean square)."""
    pose_drift_deg: NonNegative[float] = 0.0
    """How far the orientation has wandered off at the last view, degrees (root mean square)."""
    pose_drift_m: NonNegative[float] = 0.0
    """How far the position has wandered off at the last view, metres (root mean square)."""
