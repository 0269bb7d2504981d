"""The contract between robot and policy: what a policy may ask of the robot that it moves."""

from collections.abc import Sequence
from typing import Protocol

from sbm_gym.robot.object_beliefs import ObjectBeliefs
from sbm_gym.robot.object_memory import KnownObject, ViewBins
from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.robot.seen_space import SeenSpace
from sbm_gym.robot.view_history import ViewHistory
from sbm_gym.worlds.geometry.navigable import NavigableMap


class RobotKnowledge(Protocol):
    """All that a robot knows from its own senses (detector, depth camera, odometry), its map and its settings.

    ``env.unwrapped.knowledge`` is one, of the current episode: ask for it anew after every ``reset``. What it returns
    stays up to date as the episode goes on. But for the map, which is complete and exact from the start, nothing in it
    comes from the simulator's ground truth, so that a policy written against it can move a real robot that has a map.
    Lengths are metres in the world frame (right-handed, +Z up, floor at z = 0), angles radians, counter-clockwise from
    +X.
    """

    # Settings, the same in every episode ------------------------------------------------------------------------------

    stride_m: float
    """Longest move of one step."""
    camera_height_m: float
    """Height of the camera above the floor."""
    rest_tilt_rad: float
    """Tilt of the camera when nothing is fixated; up is positive."""
    max_depth_m: float
    """Objects and floor farther from the camera than this are left for later."""
    ring_m: tuple[float, float]
    """Least and greatest horizontal distance at which objects are circled."""
    ring_clearance_m: float
    """The ring begins at least this far outside an object, as far as its extent is known."""
    search_distance_m: tuple[float, float]
    """Least and greatest distance to another place to search from, where there is one."""
    view_bins: ViewBins
    """How directions from which an object is seen are told apart."""

    # This episode -----------------------------------------------------------------------------------------------------

    navigable: NavigableMap
    """The map the robot navigates by: where the middle of its body may be, in rooms that it has not seen, too."""
    view_history: ViewHistory
    """Unconfirmed candidates, and from which view bins candidates and objects have been looked at."""
    seen_floor: SeenFloor
    """Which part of the floor that it can get to depth has shown."""
    seen_space: SeenSpace
    """Which cells of space depth has shown to be filled: what may hide an object."""

    @property
    def views_left(self) -> int:
        """Steps until the episode ends."""
        ...

    @property
    def objects(self) -> Sequence[KnownObject]:
        """The confirmed objects in the order of discovery; ``object_id`` is the position in it."""
        ...

    @property
    def target(self) -> KnownObject | None:
        """The object that it fixates, None before any is confirmed."""
        ...

    @property
    def beliefs(self) -> ObjectBeliefs:
        """What all looks so far say of everything that the detector has pointed at, sure or not: the chances of its
        names, and how many labels may be expected to be right. Worked out when asked for, in about 1 ms a view.
        """
        ...

    def fixate(self, object_id: int) -> None:
        """Makes another confirmed object the fixation target, from the next step on.

        Raises:
            ValueError: if no object with this id has been confirmed.
        """
        ...
