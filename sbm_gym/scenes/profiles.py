"""What differs between an agent in a room and one in a street: its body, its strides, how far it sees and circles."""

from dataclasses import dataclass, field

from sbm_gym.assets.models.classes import OUTDOOR_CATEGORIES
from sbm_gym.detection.simulated import SimulatedDetectorConfig
from sbm_gym.robot.body import BodyConfig
from sbm_gym.robot.object_memory import MemoryConfig, ViewBins
from sbm_gym.robot.state import RobotConfig


@dataclass(frozen=True)
class ObservationScales:
    """Lengths that observations are scaled by."""

    depth_level_m: float = 0.04
    """One level of the depth observation: 255 levels reach 10.2 m. 0 = no return; farther returns read 255."""
    free_reach_m: float = 2.0
    """How far the robot looks for free floor around it."""
    range_reach_m: float = 5.0
    """Range of objects that reads 1."""


@dataclass(frozen=True)
class WorldProfile(RobotConfig):
    """Settings that fit a kind of world; the defaults are those of rooms. Every source of worlds brings its own."""

    kind: str = "indoor"
    """What kind it is, as files of fitted settings name it."""
    image_size: tuple[int, int] = (84, 84)
    """Height and width of observed pictures, pixels."""
    capture_size: tuple[int, int] = (256, 256)
    """Height and width of recorded pictures, pixels (thesis: 256x256 indoors)."""
    scales: ObservationScales = field(default_factory=ObservationScales)
    """Lengths that observations are scaled by."""
    detector: SimulatedDetectorConfig = field(default_factory=SimulatedDetectorConfig)
    """The simulated detector: its categories, and at which distances views differ."""


INDOOR = WorldProfile()
"""Rooms. Source: thesis A.2.2 (Replica)."""

OUTDOOR = WorldProfile(
    kind="outdoor",
    body=BodyConfig(camera_height_m=1.65, speed_m_s=3.0),
    rest_tilt_rad=-0.08,
    # The circumference at 8 m is 50 m: 25 views of 2.5 m go around more than once.
    stride_m=2.5,
    ring_m=(3.0, 15.0),
    # 3 m from the middle of a bus is inside it.
    ring_clearance_m=2.5,
    image_size=(64, 192),
    capture_size=(256, 768),
    scales=ObservationScales(depth_level_m=0.2, free_reach_m=8.0, range_reach_m=20.0),
    memory=MemoryConfig(
        merge_radius_m=0.8,
        max_depth_m=30.0,
        max_own_size_m=5.0,
        bins=ViewBins(range_edges_m=(2.0, 6.0, 10.0, 16.0), elevation_edges_rad=(0.12, 0.25)),
    ),
    detector=SimulatedDetectorConfig(categories=OUTDOOR_CATEGORIES, good_size=0.2, range_unit_m=5.0),
    seen_cell_m=0.25,
    search_distance_m=(5.0, 12.0),
)
"""Towns. Source: thesis A.2.2 (CARLA) and its published code: camera at 1.65 m, pitch -0.08 rad, ring of 3 to 15 m."""
