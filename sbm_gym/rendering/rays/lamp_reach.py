"""How much of each lamp's light is drawn where: most lamps of a home are in another room.

A lamp is a point, so light that falls through a door would end in hard-edged patches metres away, where that of a real
lamp, and what walls and ceiling give back of it, has spread. Lamps therefore fade out where little of their room can be
seen. Shadow rays are cast only where something is left of them.
"""

import numpy as np
from jaxtyping import Float

from sbm_gym.rendering.rays.raycast import RayCaster
from sbm_gym.rendering.tables.light_tables import DIRECTIONAL, NOWHERE, SOMEWHAT, WHOLLY, LampReach, LightTable

CELL_M = 0.5
MAX_CELLS = 40_000
"""Larger worlds get larger cells."""
SAMPLES = 64
"""Places in a cell from which a lamp and its surroundings are looked for."""
SPREAD = 1.2
"""These places fill somewhat more than the cell: light may fall through a gap between them."""
SURROUNDINGS_M = 2.5
"""A lamp's room is what it lights this near to it."""
FADED, FULL = 0.5, 0.9
"""Where less of the lamp's room is in sight nothing is drawn of its light, where more is all of it."""
FEWEST_LAMPS = 2
"""A single lamp lights all that it can."""


def everywhere(lights: LightTable) -> LampReach:
    """All light is drawn wherever it arrives."""
    slots = int(lights.shadow_slot.max(initial=-1)) + 1
    shape = (max(slots, 1), 1, 1, 1)
    return LampReach(np.ones(shape, np.float32), np.full(shape, WHOLLY, np.uint8), np.full(3, 1e9), 1.0)


def lamp_reach(lights: LightTable, caster: RayCaster, bounds: Float[np.ndarray, "2 3"]) -> LampReach:
    """Looks from everywhere in a world for every fixed lamp.

    Args:
        lights: the lights; the sun, and lamps that move, count as seen from everywhere.
        caster: what stands in the way.
        bounds: low and high corner of the world.

    Returns:
        A grid over the world, the same every time.
    """
    rows = np.flatnonzero((lights.shadow_slot >= 0) & lights.is_fixed & (lights.kind != DIRECTIONAL))
    if len(rows) < FEWEST_LAMPS:
        return everywhere(lights)
    extent = bounds[1] - bounds[0] + 2e-3
    cell = max(CELL_M, float(np.prod(extent) / MAX_CELLS) ** (1 / 3))
    shape = np.ceil(extent / cell).astype(int)
    origin = bounds[0] - 1e-3
    index = np.stack(np.meshgrid(*(np.arange(side) for side in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    rng = np.random.default_rng(0)
    within = 0.5 + SPREAD * (rng.random((SAMPLES, 3)) - 0.5)
    places = (origin + cell * (index[:, None] + within)).astype(np.float32)
    offsets = rng.uniform(-SURROUNDINGS_M, SURROUNDINGS_M, (64 * SAMPLES, 3))
    offsets = offsets[np.linalg.norm(offsets, axis=1) < SURROUNDINGS_M]
    seen = np.empty((len(rows), *shape, SAMPLES), bool)
    for index, row in enumerate(rows):
        targets = _surroundings(lights.position[row], offsets, caster)
        rays = np.concatenate([places, targets.astype(np.float32) - places], axis=2).reshape(-1, 6)
        seen[index] = ~caster.shadows(rays).reshape(*shape, SAMPLES)
    # Places that no lamp's light comes near to lie within walls, or in rooms whose only light comes through the door.
    in_open = np.maximum(seen.any(axis=0).sum(axis=-1), 1)
    share = np.ones((int(lights.shadow_slot.max()) + 1, *shape), np.float32)
    for row, visible in zip(rows, seen, strict=True):
        found = np.clip((_highest_around(visible.sum(axis=-1) / in_open) - FADED) / (FULL - FADED), 0.0, 1.0)
        share[lights.shadow_slot[row]] = found * found * (3.0 - 2.0 * found)
    share = np.ascontiguousarray(share.transpose(0, 3, 2, 1))
    around = np.full(share.shape, SOMEWHAT, np.uint8)
    for grid, code in zip(share, around, strict=True):
        code[_highest_around(grid) <= 0.0] = NOWHERE
        code[_highest_around(-grid) <= -1.0] = WHOLLY
    return LampReach(share, around, origin, cell)


def _surroundings(lamp: Float[np.ndarray, "3"], offsets: Float[np.ndarray, "n 3"], caster: RayCaster):
    """As many places as there are samples in a cell, all lit by the lamp."""
    rays = np.empty((len(offsets), 6), np.float32)
    rays[:, :3] = lamp
    rays[:, 3:] = offsets
    lit = np.flatnonzero(~caster.shadows(rays))
    # A lamp that is shut in lights nothing but itself.
    chosen = offsets[np.resize(lit, SAMPLES)] if len(lit) else np.zeros((SAMPLES, 3))
    return lamp + chosen


def _highest_around(cells: np.ndarray) -> np.ndarray:
    """The highest value of each cell and of those that share a face, an edge or a corner with it."""
    for axis in range(3):
        moved = np.moveaxis(cells, axis, 0)
        highest = moved.copy()
        highest[1:] = np.maximum(highest[1:], moved[:-1])
        highest[:-1] = np.maximum(highest[:-1], moved[1:])
        cells = np.moveaxis(highest, 0, axis)
    return cells
