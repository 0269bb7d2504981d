"""Large static geometry as few meshes: flat polygons collected by what they are covered with."""

import functools
from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from sbm_gym.assets.models.surfaces import Material
from sbm_gym.worlds.scene_builder import SceneBuilder

Rgba = tuple[float, float, float, float]

_Mapping = tuple[float, float] | Float[np.ndarray, "4 2"] | None
"""Size of a tile, or texture coordinates of a quad's corners; None where there is no picture."""


@dataclass
class StaticMeshes:
    """Quads of one body, one mesh for each look. A triangle is a quad whose last two corners are the same point."""

    builder: SceneBuilder
    body: mujoco.MjsBody
    _parts: dict[tuple, list[tuple[np.ndarray, _Mapping]]] = field(default_factory=dict)
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
        look = {
            "picture": material.texture,
            "specular": material.specular,
            "shininess": material.shininess,
            "rgba": tint,
        }
        self._add(("tiled", id(material.texture), tint), look, corners_m, material.size_m)

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
        texcoords = np.array([[left, 1.0], [right, 1.0], [right, 0.0], [left, 0.0]])
        self._add(("pictured", id(picture), specular, emission), look, corners_m, texcoords)

    def boxes(self, low_m: Float[np.ndarray, "n 3"], high_m: Float[np.ndarray, "n 3"], rgba: Rgba, **look) -> None:
        """Adds axis-aligned boxes without their undersides."""
        self.plain(box_quads(low_m, high_m), rgba, **look)

    def _add(self, key: tuple, look: dict, corners_m, mapping: _Mapping) -> None:
        corners_m = np.asarray(corners_m, float).reshape(-1, 4, 3)
        if len(corners_m) == 0:
            return
        # The look keeps its picture alive, so that the picture's id stays its own.
        self._looks.setdefault(key, look)
        self._parts.setdefault(key, []).append((corners_m, mapping))

    def build(self) -> None:
        """Adds the meshes to the body."""
        for key, parts in self._parts.items():
            corners = np.concatenate([part for part, _ in parts])
            faces = (np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(len(corners))[:, None, None]).reshape(-1, 3)
            points = corners.reshape(-1, 3)
            across = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
            faces = faces[np.linalg.norm(across, axis=1) > 1e-9]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            length = np.linalg.norm(normal, axis=1, keepdims=True)
            normals = np.repeat(normal / np.maximum(length, 1e-12), 4, axis=0)
            texcoords = _texcoords(corners, normal, parts)
            mesh = self.builder.mesh(points, normals, faces, texcoords)
            self.builder.drawn(self.body, mesh, self.builder.material(**self._looks[key]))
        self._parts.clear()


def _texcoords(
    corners_m: Float[np.ndarray, "q 4 3"], normal: Float[np.ndarray, "q 3"], parts: list[tuple[np.ndarray, _Mapping]]
) -> Float[np.ndarray, "n 2"] | None:
    """Texture coordinates of the corners of all parts of one look, which are mapped in one way."""
    mapping = parts[0][1]
    if mapping is None:
        return None
    if isinstance(mapping, np.ndarray):
        counts = [len(quads) for quads, _ in parts]
        return np.repeat(np.array([texcoords for _, texcoords in parts]), counts, axis=0).reshape(-1, 2)
    normal = np.abs(normal)
    # Roofs lie flatter than walls stand: they are covered from above unless they are nearly upright.
    steep = normal[:, 2] < 0.5 * normal[:, :2].max(axis=1)
    axis = np.where(steep, np.argmax(normal[:, :2], axis=1), 2)
    picks = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    plan = np.take_along_axis(corners_m, picks[:, None, :].repeat(4, axis=1), axis=2)
    return (plan / np.array(mapping) * [1.0, -1.0]).reshape(-1, 2)


def box_quads(low_m: Float[np.ndarray, "n 3"], high_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "q 4 3"]:
    """Four sides and the top of axis-aligned boxes."""
    low, high = np.atleast_2d(np.asarray(low_m, float)), np.atleast_2d(np.asarray(high_m, float))
    (x0, y0, z0), (x1, y1, z1) = low.T, high.T
    faces = [
        [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)],
        [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
        [(x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1)],
        [(x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1)],
        [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
    ]
    return np.concatenate([np.stack([np.stack(corner, axis=1) for corner in face], axis=1) for face in faces])


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
        a0, a1, z0, z1, o = _columns(a0, a1, z0, z1, out_m)
        local = np.empty((np.broadcast(a0, a1, z0, z1, o).shape[0], 4, 3))
        local[:, 0::3, 0], local[:, 1:3, 0], local[:, :, 1] = a0, a1, o
        local[:, :2, 2], local[:, 2:, 2] = z0, z1
        return self._placed(local)

    def boxes(self, a0, a1, o0, o1, z0, z1) -> Float[np.ndarray, "q 4 3"]:
        """Front, sides, top and underside of boxes that stand out from the wall (or lie within it)."""
        return self._placed(self._boxes(a0, a1, o0, o1, z0, z1)[:, _BOX_FACES].reshape(-1, 4, 3))

    def reveals(self, a0, a1, z0, z1, depth_m: float) -> Float[np.ndarray, "q 4 3"]:
        """The four inner sides of openings that go ``depth_m`` into the wall."""
        return self._placed(self._boxes(a0, a1, -depth_m, 0.0, z0, z1)[:, _REVEAL_FACES].reshape(-1, 4, 3))

    @staticmethod
    def _boxes(a0, a1, o0, o1, z0, z1) -> Float[np.ndarray, "n 8 3"]:
        """Corners by index along (bit 0), out (bit 1) and up (bit 2), in the wall's own axes."""
        a0, a1, o0, o1, z0, z1 = _columns(a0, a1, o0, o1, z0, z1)
        local = np.empty((np.broadcast(a0, a1, o0, o1, z0, z1).shape[0], 8, 3))
        local[:, 0::2, 0], local[:, 1::2, 0] = a0, a1
        local[:, 0:2, 1], local[:, 4:6, 1], local[:, 2:4, 1], local[:, 6:8, 1] = o0, o0, o1, o1
        local[:, :4, 2], local[:, 4:, 2] = z0, z1
        return local

    def _placed(self, local: Float[np.ndarray, "*shape 3"]) -> Float[np.ndarray, "*shape 3"]:
        turn, shift = self._pose
        return (local.reshape(-1, 3) @ turn + shift).reshape(local.shape)

    @functools.cached_property
    def _pose(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
        x, y = self.along
        turn = np.array([[x, y, 0.0], [y, -x, 0.0], [0.0, 0.0, 1.0]])
        return turn, np.array([self.corner_m[0], self.corner_m[1], self.ground_m])


def _columns(*values) -> list[Float[np.ndarray, "n 1"]]:
    return [np.asarray(value, float).reshape(-1, 1) for value in values]


_BOX_FACES = np.array([[2, 3, 7, 6], [3, 1, 5, 7], [0, 2, 6, 4], [6, 7, 5, 4], [0, 1, 3, 2]])
_REVEAL_FACES = np.array([[2, 0, 4, 6], [1, 3, 7, 5], [2, 3, 1, 0], [4, 5, 7, 6]])
