"""A small hand-written world for tests: furniture in rooms that one cannot see from one place."""

from dataclasses import dataclass, replace

import numpy as np

from sbm_gym.worlds.geometry.navigable import navigable_map
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION, World

from ..sbm_gym.box_rooms import BOX, HALF_ROOM_M, BoxRooms, _group

WALLS = ((1.0, -1.2, 0.05, 1.8), (-0.3, -1.4, 1.3, 0.05), (-0.9, 1.9, 0.05, 1.1))
"""Centre x and y and half sizes; doors are left at their ends."""


@dataclass(frozen=True)
class WalledRooms(BoxRooms):
    """``BoxRooms`` with walls that stand about in the room."""

    def build(self, scene: str) -> World:
        """Builds a scene."""
        world = super().build(scene)
        for x, y, half_x, half_y in WALLS:
            for group in (0, GEOM_GROUP_COLLISION):
                world.spec.worldbody.add_geom(
                    type=BOX, size=[half_x, half_y, 1.25], pos=[x, y, 1.25], rgba=[0.7, 0.7, 0.7, 1], **_group(group)
                )
        furniture = [
            [*one.box_3d.centre_m[:2], *one.box_3d.extent_m[:2] / 2, np.arctan2(*one.box_3d.rotation[[1, 0], 0])]
            for one in world.objects
        ]
        corner = np.full(2, HALF_ROOM_M)
        obstacles = np.array([*furniture, *([*wall, 0.0] for wall in WALLS)])
        return replace(world, navigable=navigable_map(-corner, corner, obstacles))
