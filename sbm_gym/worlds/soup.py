"""Large static geometry as few meshes: flat polygons collected by what they are covered with."""

from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from sbm_gym.worlds.building import SceneBuilder
from sbm_gym.worlds.surfaces import Material

Rgba = tuple[float, float, float, float]
UPRIGHT = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
"""Texture coordinates that fill a quad (lower left, lower right, upper right, upper left) with one picture."""


@dataclass
class QuadSoup:
    """Quads of one body, one mesh for each look. A triangle is a quad whose last two corners are the same point."""

    builder: SceneBuilder
    body: mujoco.MjsBody
    _parts: dict[tuple, list[tuple[np.ndarray, np.ndarray]]] = field(default_factory=dict)
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
        corners_m = np.asarray(corners_m, float).reshape(-1, 4, 3)
        if len(corners_m) == 0:
            return
        normal = np.abs(np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0]))
        # Roofs lie flatter than walls stand: they are covered from above unless they are nearly upright.
        steep = normal[:, 2] < 0.5 * normal[:, :2].max(axis=1)
        axis = np.where(steep, np.argmax(normal[:, :2], axis=1), 2)
        picks = np.array([[1, 2], [0, 2], [0, 1]])[axis]
        plan = np.take_along_axis(corners_m, picks[:, None, :].repeat(4, axis=1), axis=2)
        texcoords = plan / np.array(material.size_m) * [1.0, -1.0]
        look = {
            "picture": material.texture,
            "specular": material.specular,
            "shininess": material.shininess,
            "rgba": tint,
        }
        self._add(("tiled", id(material.texture), tint), look, corners_m, texcoords)

    def plain(
        self, corners_m: Float[np.ndarray, "q 4 3"], rgba: Rgba, specular: float = 0.0, shininess: float = 0.3
    ) -> None:
        """Adds quads of one colour."""
        corners_m = np.asarray(corners_m, float).reshape(-1, 4, 3)
        look = {"rgba": rgba, "specular": specular, "shininess": shininess}
        self._add(("plain", rgba, specular), look, corners_m, np.zeros((len(corners_m), 4, 2)))

    def pictured(
        self,
        corners_m: Float[np.ndarray, "q 4 3"],
        picture: UInt8[np.ndarray, "h w c"],
        specular: float = 0.0,
        shininess: float = 0.3,
        texcoords: Float[np.ndarray, "4 2"] = UPRIGHT,
        emission: float = 0.0,
    ) -> None:
        """Adds quads that show one whole picture each (lower left, lower right, upper right, upper left)."""
        corners_m = np.asarray(corners_m, float).reshape(-1, 4, 3)
        look = {"picture": picture, "specular": specular, "shininess": shininess, "emission": emission}
        key = ("pictured", id(picture), specular, emission)
        self._add(key, look, corners_m, np.broadcast_to(texcoords, (len(corners_m), 4, 2)))

    def boxes(self, low_m: Float[np.ndarray, "n 3"], high_m: Float[np.ndarray, "n 3"], rgba: Rgba, **look) -> None:
        """Adds axis-aligned boxes without their undersides."""
        self.plain(box_quads(low_m, high_m), rgba, **look)

    def _add(self, key: tuple, look: dict, corners_m, texcoords) -> None:
        if len(corners_m) == 0:
            return
        # The look keeps its picture alive, so that the picture's id stays its own.
        self._looks.setdefault(key, look)
        self._parts.setdefault(key, []).append((corners_m, np.asarray(texcoords, float)))

    def build(self) -> None:
        """Adds the meshes to the body."""
        for key, parts in self._parts.items():
            corners = np.concatenate([part[0] for part in parts])
            texcoords = np.concatenate([part[1] for part in parts])
            faces = (np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(len(corners))[:, None, None]).reshape(-1, 3)
            points = corners.reshape(-1, 3)
            across = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
            faces = faces[np.linalg.norm(across, axis=1) > 1e-9]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            length = np.linalg.norm(normal, axis=1, keepdims=True)
            normals = np.repeat(normal / np.maximum(length, 1e-12), 4, axis=0)
            look = self._looks[key]
            has_picture = look.get("picture") is not None
            mesh = self.builder.mesh(points, normals, faces, texcoords.reshape(-1, 2) if has_picture else None)
            self.builder.drawn(self.body, mesh, self.builder.material(**look))
        self._parts.clear()


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
        x = self.corner_m[0] + a * self.along[0] + o * self.along[1]
        y = self.corner_m[1] + a * self.along[1] - o * self.along[0]
        return np.stack(np.broadcast_arrays(x, y, np.add(z, self.ground_m)), axis=-1)

    def quads(self, a0, a1, z0, z1, out_m=0.0) -> Float[np.ndarray, "q 4 3"]:
        """Upright rectangles parallel to the wall."""
        a0, a1, z0, z1, o = (np.atleast_1d(v).astype(float) for v in np.broadcast_arrays(a0, a1, z0, z1, out_m))
        return np.stack([self.points(a, o, z) for a, z in ((a0, z0), (a1, z0), (a1, z1), (a0, z1))], axis=1)

    def boxes(self, a0, a1, o0, o1, z0, z1) -> Float[np.ndarray, "q 4 3"]:
        """Front, sides, top and underside of boxes that stand out from the wall (or lie within it)."""
        a0, a1, o0, o1, z0, z1 = (np.atleast_1d(v).astype(float) for v in np.broadcast_arrays(a0, a1, o0, o1, z0, z1))
        # Corners by index along (bit 0), out (bit 1) and up (bit 2).
        corners = [self.points(a, o, z) for z in (z0, z1) for o in (o0, o1) for a in (a0, a1)]
        faces = [[2, 3, 7, 6], [3, 1, 5, 7], [0, 2, 6, 4], [6, 7, 5, 4], [0, 1, 3, 2]]
        return np.concatenate([np.stack([corners[k] for k in face], axis=1) for face in faces])

    def reveals(self, a0, a1, z0, z1, depth_m: float) -> Float[np.ndarray, "q 4 3"]:
        """The four inner sides of openings that go ``depth_m`` into the wall."""
        a0, a1, z0, z1 = (np.atleast_1d(v).astype(float) for v in np.broadcast_arrays(a0, a1, z0, z1))
        p, d = self.points, -depth_m
        faces = [
            [p(a0, 0, z0), p(a0, d, z0), p(a0, d, z1), p(a0, 0, z1)],
            [p(a1, d, z0), p(a1, 0, z0), p(a1, 0, z1), p(a1, d, z1)],
            [p(a0, 0, z0), p(a1, 0, z0), p(a1, d, z0), p(a0, d, z0)],
            [p(a0, d, z1), p(a1, d, z1), p(a1, 0, z1), p(a0, 0, z1)],
        ]
        return np.concatenate([np.stack(face, axis=1) for face in faces])
