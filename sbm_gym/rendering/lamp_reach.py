"""Which parts of a world each lamp can light: most lamps of a home are in another room."""

import numpy as np
from jaxtyping import Float

from sbm_gym.rendering.raycast import Caster
from sbm_gym.rendering.shading import DIRECTIONAL, LampReach, LightTable

CELL_M = 0.5
MAX_CELLS = 40_000
"""Larger worlds get larger cells."""
SAMPLES = 64
"""Places in a cell from which a lamp is looked for."""
SPREAD = 1.2
"""These places fill somewhat more than the cell, and a cell beside one that is lit counts as lit: slivers of light that
fall through a gap between samples end in neighbours of cells where the light is broader."""
FEWEST_LAMPS = 3
"""With fewer, shadow rays cost less than the search."""


def everywhere(lights: LightTable) -> LampReach:
    """Nothing is known: all light may arrive anywhere."""
    slots = int(lights.shadow_slot.max(initial=-1)) + 1
    return LampReach(np.ones((max(slots, 1), 1, 1, 1), bool), np.full(3, 1e9), 1.0)


def lamp_reach(lights: LightTable, caster: Caster, bounds: Float[np.ndarray, "2 3"]) -> LampReach:
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
    within = 0.5 + SPREAD * (np.random.default_rng(0).random((SAMPLES, 3)) - 0.5)
    places = (origin + cell * (index[:, None] + within)).reshape(-1, 3)
    slots = int(lights.shadow_slot.max()) + 1
    reached = np.ones((slots, *shape), bool)
    rays = np.empty((len(places), 6), np.float32)
    rays[:, :3] = places
    for row in rows:
        rays[:, 3:] = lights.position[row] - places
        seen = ~caster.shadows(rays)
        reached[lights.shadow_slot[row]] = _widened(np.any(seen.reshape(*shape, SAMPLES), axis=-1))
    return LampReach(np.ascontiguousarray(reached.transpose(0, 3, 2, 1)), origin, cell)


def _widened(cells: np.ndarray) -> np.ndarray:
    """Cells that are set or share a face, an edge or a corner with one that is."""
    for axis in range(3):
        moved = np.moveaxis(cells, axis, 0)
        wider = moved.copy()
        wider[1:] |= moved[:-1]
        wider[:-1] |= moved[1:]
        cells = np.moveaxis(wider, 0, axis)
    return cells
