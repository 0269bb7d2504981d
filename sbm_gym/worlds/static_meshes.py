"""Large static geometry as few meshes: flat polygons collected by what they are covered with."""

import functools
from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from sbm_gym.assets.models.surfaces import Material
from sbm_gym.worlds.scene_builder import SceneBuilder, look_of, tiled_texcoords

Rgba = tuple[float, float, float, float]


@dataclass
class StaticMeshes:
    """Quads of one body, one mesh for each look. A triangle is a quad whose last two corners are the same point."""

    builder: SceneBuilder
    body: mujoco.MjsBody
    _parts: dict[tuple, list[tuple[np.ndarray, np.ndarray | None]]] = field(default_factory=dict)
    _looks: dict[tuple, dict] = field(default_factory=dict)

    def tiled(
        self, corners_m: Float[np.ndarray, "q 4 3"], material: Material, tint: Rgba = (1.0, 1.0, 1.0, 1.0)
    ) -> None:
        """Adds quads covered with a building material, in step across quads of one plane.

        Args:
            corners_m: counter-clockwise as seen from the front.
            material: what they are covered with.
            tint: what its colours are multiplied by.
        """
        look = look_of(material) | {"rgba": tint}
        self._add(("tiled", id(material.texture), tint), look, corners_m, tiled_texcoords(corners_m, material))

    def plain(
        self, corners_m: Float[np.ndarray, "q 4 3"], rgba: Rgba, specular: float = 0.0, shininess: float = 0.3
    ) -> None:
        """Adds quads of one colour."""
        look = {"rgba": rgba, "specular": specular, "shininess": shininess}
        self._add(("plain", rgba, specular), look, corners_m, None)

    def pictured(
        self,
        corners_m: Float[np.ndarray, "q 4 3"],
        picture: UInt8[np.ndarray, "h w c"],
        specular: float = 0.0,
        shininess: float = 0.3,
        part: tuple[float, float] = (0.0, 1.0),
        emission: float = 0.0,
    ) -> None:
        """Adds quads that show one picture each (lower left, lower right, upper right, upper left).

        Args:
            corners_m: counter-clockwise as seen from the front.
            picture: what they show.
            specular: strength of highlights.
            shininess: sharpness of highlights.
            part: where the shown part of the picture begins and ends, as shares of its width.
            emission: how much it shines by itself.
        """
        look = {"picture": picture, "specular": specular, "shininess": shininess, "emission": emission}
        left, right = part
        texcoords = np.tile([[left, 1.0], [right, 1.0], [right, 0.0], [left, 0.0]], (len(corners_m), 1))
        self._add(("pictured", id(picture), specular, emission), look, corners_m, texcoords)

    def boxes(self, low_m: Float[np.ndarray, "n 3"], high_m: Float[np.ndarray, "n 3"], rgba: Rgba, **look) -> None:
        """Adds axis-aligned boxes without their undersides."""
        self.plain(box_quads(low_m, high_m), rgba, **look)

    def _add(self, key: tuple, look: dict, corners_m, texcoords: np.ndarray | None) -> None:
        if len(corners_m):
            # The look keeps its picture alive, so that the picture's id stays its own.
            self._looks.setdefault(key, look)
            self._parts.setdefault(key, []).append((corners_m, texcoords))

    def build(self) -> None:
        """Adds the meshes to the body."""
        for key, parts in self._parts.items():
            corners, texcoords = zip(*parts, strict=True)
            mapped = None if texcoords[0] is None else np.concatenate(texcoords)
            mesh = self.builder.flat_mesh(np.concatenate(corners), mapped)
            self.builder.drawn(self.body, mesh, self.builder.material(**self._looks[key]))
        self._parts.clear()


def box_quads(low_m: Float[np.ndarray, "n 3"], high_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "q 4 3"]:
    """Four sides and the top of axis-aligned boxes."""
    ends = np.concatenate(np.broadcast_arrays(np.atleast_2d(low_m), np.atleast_2d(high_m)), axis=1, dtype=float)
    return ends[:, _SIDES_AND_TOP].swapaxes(0, 1).reshape(-1, 4, 3)


_CORNERS = np.arange(3) + 3 * ((np.arange(8)[:, None] >> np.arange(3)) & 1)
"""Where the coordinates of a box's corners stand among its low and high ends, corners by index along the first axis
(bit 0), the second (bit 1) and the third (bit 2)."""
_SIDES_AND_TOP = _CORNERS[[[0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6], [4, 5, 7, 6]]]
_QUAD = _CORNERS[[0, 1, 5, 4]]
_BOX_FACES = _CORNERS[[[2, 3, 7, 6], [3, 1, 5, 7], [0, 2, 6, 4], [6, 7, 5, 4], [0, 1, 3, 2]]]
_REVEAL_FACES = _CORNERS[[[2, 0, 4, 6], [1, 3, 7, 5], [2, 3, 1, 0], [4, 5, 7, 6]]]


def prism(
    xy: Float[np.ndarray, "2"], radius_m: float, low_m: float, high_m: float, sides: int = 8
) -> Float[np.ndarray, "q 4 3"]:
    """Sides and top of an upright prism."""
    angles = 2 * np.pi * np.arange(sides) / sides
    a = np.asarray(xy) + radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    b = np.roll(a, -1, axis=0)
    low, high = np.full((sides, 1), low_m), np.full((sides, 1), high_m)
    walls = np.stack([np.hstack(v) for v in ((a, low), (b, low), (b, high), (a, high))], axis=1)
    centre = np.broadcast_to(np.append(xy, high_m), (sides, 3))
    top = np.stack([centre, np.hstack((a, high)), np.hstack((b, high)), np.hstack((b, high))], axis=1)
    return np.concatenate([walls, top])


@dataclass(frozen=True)
class Facade:
    """A wall's own axes: along it (to the right as seen from outside), out of it, and up."""

    corner_m: Float[np.ndarray, "2"]
    """Its lower left corner as seen from outside."""
    along: Float[np.ndarray, "2"]
    ground_m: float = 0.0

    @property
    def out(self) -> Float[np.ndarray, "2"]:
        """The direction that the wall looks in."""
        return np.array([self.along[1], -self.along[0]])

    def points(self, a, o, z) -> Float[np.ndarray, "*shape 3"]:
        """World points of coordinates along, out and up."""
        local = np.empty((*np.broadcast(a, o, z).shape, 3))
        local[..., 0], local[..., 1], local[..., 2] = a, o, z
        return self._placed(local)

    def quads(self, a0, a1, z0, z1, out_m=0.0) -> Float[np.ndarray, "q 4 3"]:
        """Upright rectangles parallel to the wall."""
        return self._placed(self._ends(a0, a1, out_m, out_m, z0, z1)[:, _QUAD])

    def boxes(self, a0, a1, o0, o1, z0, z1) -> Float[np.ndarray, "q 4 3"]:
        """Front, sides, top and underside of boxes that stand out from the wall (or lie within it)."""
        return self._placed(self._ends(a0, a1, o0, o1, z0, z1)[:, _BOX_FACES].reshape(-1, 4, 3))

    def reveals(self, a0, a1, z0, z1, depth_m: float) -> Float[np.ndarray, "q 4 3"]:
        """The four inner sides of openings that go ``depth_m`` into the wall."""
        return self._placed(self._ends(a0, a1, -depth_m, 0.0, z0, z1)[:, _REVEAL_FACES].reshape(-1, 4, 3))

    @staticmethod
    def _ends(a0, a1, o0, o1, z0, z1) -> Float[np.ndarray, "n 6"]:
        """Low and high ends of boxes in the wall's own axes."""
        ends = np.empty((*np.broadcast(a0, o0, z0, a1, o1, z1).shape, 6))
        for column, coordinate in enumerate((a0, o0, z0, a1, o1, z1)):
            ends[..., column] = coordinate
        return ends.reshape(-1, 6)

    def _placed(self, local: Float[np.ndarray, "*shape 3"]) -> Float[np.ndarray, "*shape 3"]:
        turn, shift = self._pose
        return (local.reshape(-1, 3) @ turn + shift).reshape(local.shape)

    @functools.cached_property
    def _pose(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
        x, y = self.along
        turn = np.array([[x, y, 0.0], [y, -x, 0.0], [0.0, 0.0, 1.0]])
        return turn, np.array([self.corner_m[0], self.corner_m[1], self.ground_m])
