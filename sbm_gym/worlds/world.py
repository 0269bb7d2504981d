"""What every world hands to the environment: a MuJoCo scene, the objects in it, and where one can stand."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Int

from labeling.core.types import Box3d
from sbm_gym.worlds.geometry.navigable import NavigableMap
from sbm_gym.worlds.geometry.placing import yaw_quaternion
from sbm_gym.worlds.left_out import LeftOut
from sbm_gym.worlds.moving.motion_config import MotionConfig
from sbm_gym.worlds.moving.movers import Mover, moved_box

GEOM_GROUP_VISUAL = 2
"""Geoms that are drawn and never touched."""
GEOM_GROUP_COLLISION = 3
"""Geoms that are touched and never drawn (MuJoCo's own viewers hide groups 3 and above too)."""


@dataclass(frozen=True)
class ObjectInstance:
    """One object of a class that detectors know, standing in a world."""

    instance_id: int
    """Positive, unique within the world."""
    category: str
    body_name: str
    """The MuJoCo body that holds the object's geoms."""
    box_3d: Box3d
    """Gravity-aligned, around the whole object, in the model's own axes: +X its right, +Y its back, +Z up."""
    model_name: str
    """Which catalogue entry it is, for credits and for keeping models of test scenes out of training."""


@dataclass(frozen=True)
class Arrangement:
    """What one episode has that others in the same world have not."""

    objects: tuple[ObjectInstance, ...]
    """All objects of this episode, those that always stand there too."""
    navigable: NavigableMap
    starts: NavigableMap
    """Where the agent may start."""
    apply: Callable[[mujoco.MjModel], None]
    """Changes poses of mocap bodies, light and sky in a compiled model. Nothing else may change."""
    movers: tuple[Mover, ...] = ()
    """Objects that move while the robot does; ``apply`` puts them where they set out."""

    def with_movers(self, movers: Sequence[Mover], objects: Sequence[ObjectInstance]) -> "Arrangement":
        """The same with things that set out from where they have their routes begin.

        Args:
            movers: they are mocap bodies.
            objects: what they are, wherever their boxes are; those that are in the arrangement already take their
                places.
        """
        poses = {one.instance_id: one.start_pose() for one in movers}
        known = {one.instance_id: one for one in (*self.objects, *objects)}
        placed = tuple(
            replace(one, box_3d=moved_box(one.box_3d, poses[one.instance_id])) if one.instance_id in poses else one
            for one in known.values()
        )

        def apply(model: mujoco.MjModel) -> None:
            self.apply(model)
            for one in movers:
                body, (x, y, yaw) = model.body(one.body_name).id, one.pose(0.0)
                model.body_pos[body], model.body_quat[body] = [x, y, 0.0], yaw_quaternion(yaw)

        return replace(self, objects=placed, apply=apply, movers=tuple(movers))


class Stage(Protocol):
    """Arranges a world anew for every episode."""

    def arrange(self, rng: np.random.Generator) -> Arrangement:
        """Draws an arrangement."""
        ...


@runtime_checkable
class MovingStage(Stage, Protocol):
    """A stage on which things can move."""

    def set_in_motion(
        self, arrangement: Arrangement, rng: np.random.Generator, motion: MotionConfig, seconds: float
    ) -> Arrangement:
        """An arrangement of this stage with things that move.

        Args:
            arrangement: as ``arrange`` has drawn it.
            rng: draws what moves, and where.
            motion: how much of it.
            seconds: how long an episode lasts.
        """
        ...


@dataclass(frozen=True)
class WorldContents:
    """What stands in a world and where one can stand: all that is asked of it once it is compiled."""

    name: str
    objects: tuple[ObjectInstance, ...]
    navigable: NavigableMap
    starts: NavigableMap | None = None
    """Where the agent may start; None for anywhere in ``navigable``."""
    stage: Stage | None = None
    """Arranges the world anew for every episode; None if it always stays the same."""

    def instance_of_geom(self, model: mujoco.MjModel) -> Int[np.ndarray, "ngeom"]:
        """For every geom of the compiled model the ``instance_id`` of the object it belongs to, 0 for none."""
        instance_of_body = np.zeros(model.nbody, np.int32)
        for instance in self.objects:
            instance_of_body[model.body(instance.body_name).id] = instance.instance_id
        return instance_of_body[model.geom_bodyid]


@dataclass(frozen=True)
class World:
    """A furnished scene. The agent is not in it yet: it is added to its spec before compilation."""

    name: str
    bare: mujoco.MjSpec
    """Without what is left out of it."""
    objects: tuple[ObjectInstance, ...]
    navigable: NavigableMap
    starts: NavigableMap | None = None
    stage: Stage | None = None
    left_out: LeftOut | None = None
    """Meshes and pictures that ``bare`` does without."""

    @property
    def spec(self) -> mujoco.MjSpec:
        """The whole of it: what was left out is put into it when this is asked for the first time."""
        if self.left_out is not None:
            self.left_out.put_into(self.bare)
        return self.bare

    @property
    def contents(self) -> WorldContents:
        """The world without its geometry; fields have the same meaning there."""
        return WorldContents(self.name, self.objects, self.navigable, self.starts, self.stage)

    def instance_of_geom(self, model: mujoco.MjModel) -> Int[np.ndarray, "ngeom"]:
        """See ``WorldContents``."""
        return self.contents.instance_of_geom(model)
