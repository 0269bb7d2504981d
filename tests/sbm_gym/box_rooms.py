"""A small hand-written world for tests: a square room with boxes that pass for furniture."""

from dataclasses import dataclass

import mujoco
import numpy as np

from labeling.core.types import Box3d
from sbm_gym.scenes.profiles import INDOOR, WorldProfile
from sbm_gym.worlds.geometry.navigable import navigable_map
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION, GEOM_GROUP_VISUAL, ObjectInstance, World

HALF_ROOM_M = 3.0
BOX = mujoco.mjtGeom.mjGEOM_BOX
FURNITURE = {
    # category: centre x and y, full extent, yaw
    "fridge": (0.0, 0.0, (0.7, 0.6, 1.6), 0.4),
    "couch": (-2.0, 1.2, (0.9, 1.9, 0.8), 0.0),
    "table": (1.9, -1.7, (1.2, 0.8, 0.7), 0.0),
    "tv": (2.3, 1.9, (0.3, 1.0, 1.1), -0.5),
}


@dataclass(frozen=True)
class BoxRooms:
    """Scenes "box_0" to "box_3": the same furniture, some of it moved. Implements ``WorldSource``."""

    num_scenes: int = 4
    profile: WorldProfile = INDOOR

    def scenes(self, split: str | None) -> tuple[str, ...]:
        """The last scene is for validation, all others for training; the endless split ends with them all."""
        names = tuple(f"box_{k}" for k in range(self.num_scenes))
        return {"train": names[:-1], "val": names[-1:], "test": names[-1:], "endless": names, None: names}[split]

    def canonical(self, scene: str | int) -> str:
        """Checks a name."""
        if scene not in self.scenes(None):
            raise ValueError(f"unknown scene {scene!r}; known: {', '.join(self.scenes(None))}")
        return str(scene)

    def build(self, scene: str) -> World:
        """Builds a scene."""
        number = int(scene.removeprefix("box_"))
        spec = mujoco.MjSpec()
        floor = spec.worldbody
        floor.add_light(pos=[0.5, 0.3, 2.4], diffuse=[0.8, 0.8, 0.8])
        size = [HALF_ROOM_M, HALF_ROOM_M, 0.05]
        for group in (GEOM_GROUP_VISUAL, GEOM_GROUP_COLLISION):
            floor.add_geom(type=BOX, size=size, pos=[0, 0, -0.05], rgba=[0.6, 0.5, 0.4, 1], **_group(group))
            for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                half = [0.05 if x else HALF_ROOM_M, 0.05 if y else HALF_ROOM_M, 1.25]
                place = [x * (HALF_ROOM_M + 0.05), y * (HALF_ROOM_M + 0.05), 1.25]
                floor.add_geom(type=BOX, size=half, pos=place, rgba=[0.8, 0.8, 0.75, 1], **_group(group))
        objects, obstacles = [], []
        for index, (category, (x, y, extent, yaw)) in enumerate(FURNITURE.items()):
            yaw = yaw + 0.3 * number
            x, y = (x + 0.2 * number, y) if category == "fridge" else (x, y)
            quat = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
            body = floor.add_body(name=f"object_{index + 1}", pos=[x, y, extent[2] / 2], quat=quat)
            for group in (GEOM_GROUP_VISUAL, GEOM_GROUP_COLLISION):
                colour = [*np.random.default_rng(index).uniform(0.2, 0.9, 3), 1]
                body.add_geom(type=BOX, size=[side / 2 for side in extent], rgba=colour, **_group(group))
            rotation = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1.0]])
            box = Box3d(np.array([x, y, extent[2] / 2]), np.array(extent), rotation)
            objects.append(ObjectInstance(index + 1, category, body.name, box, f"box-{category}"))
            obstacles.append([x, y, extent[0] / 2, extent[1] / 2, yaw])
        corner = np.full(2, HALF_ROOM_M)
        return World(scene, spec, tuple(objects), navigable_map(-corner, corner, np.array(obstacles)))


def _group(group: int) -> dict:
    touched = int(group == GEOM_GROUP_COLLISION)
    return {"group": group, "contype": touched, "conaffinity": touched}
