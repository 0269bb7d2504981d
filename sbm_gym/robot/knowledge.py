"""The contract between robot and policy: what a policy may ask of the robot that it moves."""

from collections.abc import Sequence
from typing import Protocol

from sbm_gym.robot.object_memory import KnownObject, ViewBins
from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.robot.seen_space import SeenSpace
from sbm_gym.robot.view_history import ViewHistory
from sbm_gym.worlds.geometry.navigable import NavigableMap


class RobotKnowledge(Protocol):
    """All that a robot knows from its own senses (detector, depth camera, odometry), its map and its settings.

    ``env.unwrapped.knowledge`` is one, of the current episode: ask for it anew after every ``reset``. What it returns
    stays up to date as the episode goes on. Nothing in it comes from the simulator's ground truth, so that a policy
    written against it can move a real robot. Lengths are metres in the world frame (right-handed, +Z up, floor at z =
    0), angles radians, counter-clockwise from +X.
    """

    # Settings, the same in every episode ------------------------------------------------------------------------------

    @property
    def stride_m(self) -> float:
        """Longest move of one step."""
        ...

    @property
    def camera_height_m(self) -> float:
        """Height of the camera above the floor."""
        ...

    @property
    def rest_tilt_rad(self) -> float:
        """Tilt of the camera when nothing is fixated; up is positive."""
        ...

    @property
    def max_depth_m(self) -> float:
        """Objects and floor farther from the camera than this are left for later."""
        ...

    @property
    def ring_m(self) -> tuple[float, float]:
        """Least and greatest horizontal distance at which objects are circled."""
        ...

    @property
    def ring_clearance_m(self) -> float:
        """The ring begins at least this far outside an object, as far as its extent is known."""
        ...

    @property
    def search_distance_m(self) -> tuple[float, float]:
        """Least and greatest distance to another place to search from, where there is one."""
        ...

    @property
    def view_bins(self) -> ViewBins:
        """How directions from which an object is seen are told apart."""
        ...

    # This episode -----------------------------------------------------------------------------------------------------

    @property
    def navigable(self) -> NavigableMap:
        """The map the robot navigates by: where the middle of its body may be."""
        ...

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
    def view_history(self) -> ViewHistory:
        """Unconfirmed candidates, and from which view bins candidates and objects have been looked at."""
        ...

    @property
    def seen_floor(self) -> SeenFloor:
        """Which part of the floor that it can get to depth has shown."""
        ...

    @property
    def seen_space(self) -> SeenSpace:
        """Which cells of space depth has shown to be filled: what may hide an object."""
        ...

    def fixate(self, object_id: int) -> None:
        """Makes another confirmed object the fixation target, from the next step on.

        Raises:
            ValueError: if no object with this id has been confirmed.
        """
        ...
