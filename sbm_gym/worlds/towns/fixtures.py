"""What towns make themselves: road signs, traffic lights, hydrants, post boxes, bus shelters."""

import functools

import numpy as np
from jaxtyping import Float

from sbm_gym.worlds.geometry.placing import Box
from sbm_gym.worlds.static_meshes import Facade, prism
from sbm_gym.worlds.towns import materials
from sbm_gym.worlds.towns.furnisher import STEEL, Furnisher
from sbm_gym.worlds.towns.plan import KERB_M, Spawn
from sbm_gym.worlds.towns.shops import fascia

DARK = (0.10, 0.11, 0.12, 1.0)


def sign(furnisher: Furnisher, xy: Float[np.ndarray, "2"], front: Float[np.ndarray, "2"], kind: str) -> None:
    """A road sign on a post, unless something is in the way.

    Args:
        furnisher: the town.
        xy: where it stands.
        front: where it looks: against the traffic on its side of the road.
        kind: as ``materials.road_sign`` knows them.
    """
    if not furnisher.post(xy, 0.035, 2.75):
        return
    right = np.array([-front[1], front[0]])
    picture = materials.road_sign(kind)
    for offset, side, shown in ((0.045, 1.0, picture), (0.040, -1.0, _back_of(kind))):
        facade = Facade(xy + offset * front - side * 0.33 * right, side * right, KERB_M)
        furnisher.meshes.pictured(facade.quads(0.0, 0.66, 2.1, 2.76), shown, specular=0.1)


@functools.cache
def _back_of(kind: str) -> np.ndarray:
    """The bare metal of a sign's back."""
    picture = materials.road_sign(kind)[:, ::-1].copy()
    picture[..., :3] = (150, 152, 154)
    return picture


def post_box(furnisher: Furnisher, xy: Float[np.ndarray, "2"]) -> None:
    """A red pillar box, unless something is in the way."""
    if furnisher.post(xy, 0.24, 1.25, (0.70, 0.07, 0.08, 1.0)):
        furnisher.meshes.plain(prism(xy, 0.28, KERB_M + 1.25, KERB_M + 1.38), (0.62, 0.05, 0.06, 1.0), specular=0.3)
        furnisher.meshes.plain(prism(xy, 0.26, KERB_M, KERB_M + 0.18), DARK)


def hydrant(furnisher: Furnisher, xy: Float[np.ndarray, "2"], front: Float[np.ndarray, "2"]) -> None:
    """A red fire hydrant. The library's has 31 000 triangles, more than ten cars."""
    red = (0.72, 0.06, 0.05, 1.0)
    if not furnisher.post(xy, 0.13, 0.50, red):
        return
    meshes, z = furnisher.meshes, KERB_M
    rings = ((0.19, 0.0, 0.06), (0.17, 0.44, 0.5), (0.15, 0.5, 0.58), (0.10, 0.58, 0.66), (0.04, 0.66, 0.74))
    for radius, low, high in rings:
        meshes.plain(prism(xy, radius, z + low, z + high, 12), red, specular=0.4)
    right = np.array([-front[1], front[0]])
    for out, reach in ((front, 0.20), (right, 0.19), (-right, 0.19)):
        side = np.array([-out[1], out[0]])
        spout = Facade(xy - 0.07 * side, side, z)
        meshes.plain(spout.boxes(0.0, 0.14, 0.0, reach, 0.29, 0.43), (0.62, 0.05, 0.05, 1.0), specular=0.4)


def traffic_light(furnisher: Furnisher, xy: Float[np.ndarray, "2"], heading: Float[np.ndarray, "2"]) -> None:
    """A post with three lamps that look against the traffic, red for the moment."""
    if not furnisher.post(xy, 0.06, 3.3, DARK):
        return
    right = np.array([heading[1], -heading[0]])
    facade = Facade(xy - 0.15 * heading - 0.16 * right, right, KERB_M)
    lit = int(furnisher.rng.integers(2)) * 2
    furnisher.meshes.plain(facade.boxes(0.0, 0.32, -0.22, 0.0, 2.4, 3.35), DARK)
    furnisher.meshes.plain(Facade(xy + 0.08 * heading + 0.16 * right, -right, KERB_M).quads(0.0, 0.32, 2.4, 3.35), DARK)
    for k, colour in enumerate(((0.95, 0.12, 0.08), (0.95, 0.65, 0.10), (0.10, 0.85, 0.35))):
        glow = 1.0 if k == lit else 0.22
        shown = (glow * colour[0], glow * colour[1], glow * colour[2], 1.0)
        height = 3.2 - 0.31 * k
        angles = 2 * np.pi * np.arange(10) / 10
        rim = facade.points(0.16 + 0.11 * np.cos(angles), 0.012, height + 0.11 * np.sin(angles))
        middle = np.broadcast_to(facade.points(0.16, 0.012, height), rim.shape)
        after = np.roll(rim, -1, axis=0)
        furnisher.meshes.plain(np.stack([middle, rim, after, after], axis=1), shown, specular=0.3)


def bus_stop(furnisher: Furnisher, spawn: Spawn) -> None:
    """A glass shelter with a bench on the pavement beside a bus bay."""
    ahead = spawn.ahead
    right = np.array([ahead[1], -ahead[0]])
    middle = spawn.middle_m + right * (spawn.width_m / 2 + 2.2)
    half_length = 1.9
    x, y = (middle + 0.1 * right).tolist()
    back = Box(x, y, half_length, 0.28, spawn.heading_rad)
    if not furnisher.fits(back, 0.2):
        return
    furnisher.block(back)
    # Seen from the road: along it to the right is against the traffic's heading.
    shelter = Facade(middle + half_length * ahead + 0.35 * right, -ahead, KERB_M)
    meshes, length = furnisher.meshes, 2 * half_length
    posts = np.array([0.0, 0.5, 1.0]) * (length - 0.08)
    meshes.plain(shelter.boxes(posts, posts + 0.08, 0.0, 0.08, 0.0, 2.35), DARK, specular=0.2)
    meshes.plain(shelter.boxes(0.0, length, 0.0, 1.5, 2.35, 2.47), STEEL, specular=0.2)
    meshes.plain(shelter.quads(0.08, length - 0.08, 0.3, 2.25, 0.04), (0.75, 0.82, 0.84, 0.25), specular=0.8)
    meshes.plain(shelter.boxes(0.5, length - 0.5, 0.15, 0.5, 0.42, 0.48), (0.45, 0.32, 0.20, 1.0))
    meshes.pictured(
        shelter.quads(length - 1.3, length - 0.2, 0.5, 2.0, 0.06), fascia("BUS", (24, 78, 160), (244, 244, 240))
    )
