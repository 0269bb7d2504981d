"""What kernels need to know about light: the lamps, where they reach, and the light from everywhere."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int64, UInt8

DIRECTIONAL, POINT, SPOT = 0, 1, 2


class LightTable(NamedTuple):
    """Lights in the world."""

    kind: Int64[np.ndarray, "l"]
    position: Float[np.ndarray, "l 3"]
    direction: Float[np.ndarray, "l 3"]
    diffuse: Float[np.ndarray, "l 3"]
    specular: Float[np.ndarray, "l 3"]
    attenuation: Float[np.ndarray, "l 3"]
    spot: Float[np.ndarray, "l 2"]
    """Cosine of the cut-off angle, exponent."""
    shadow_slot: Int64[np.ndarray, "l"]
    """Which of the lights that cast shadows it is; -1: casts none."""
    is_fixed: np.ndarray
    """Whether the light stands where it stands for as long as nobody edits the model."""


NOWHERE, SOMEWHAT, WHOLLY = 0, 1, 2


class LampReach(NamedTuple):
    """How much of each lamp's light is drawn where: all of it in its own room, less beyond doors, none elsewhere."""

    share: Float32[np.ndarray, "s z y x"]
    """By shadow slot, at the centres of cells."""
    around: UInt8[np.ndarray, "s z y x"]
    """Whether the share is 0 in the cell and all around it (``NOWHERE``), or 1 (``WHOLLY``), or neither."""
    origin: Float[np.ndarray, "3"]
    cell_m: float


class AmbientTable(NamedTuple):
    """Light from everywhere, and how much of it reaches a place."""

    colour: Float[np.ndarray, "3"]
    sky: Float[np.ndarray, "3 3"]
    """Zenith, horizon and ground colours of the background, linear."""
    haze_per_m: float
    """Share of what is seen that haze, which has the horizon's colour, replaces in each metre."""
    exposure: float
    """What all light is multiplied by before it becomes a picture."""
    sky_texture: int
    """Skybox texture, -1 for the plain sky."""
    density: Float32[np.ndarray, "z y x"]
    """Blurred share of each cell of a coarse grid that is filled with surfaces."""
    grid_origin: Float[np.ndarray, "3"]
    cell_m: float
