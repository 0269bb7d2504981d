"""Building blocks of builtin models: boxes with soft edges, lathed and swept parts, leaves, pillows."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numba import njit

from sbm_gym.assets.models.model import FurnitureModel, Surface
from sbm_gym.assets.parametric.parts.paints import Paint

CREASE_RAD = np.deg2rad(42.0)
"""Faces that meet at a larger angle keep an edge; others are shaded as one round surface."""

Size = tuple[float, float, float]
"""Width, depth and height, metres."""
Rectangle = tuple[tuple[float, float], tuple[float, float]]
"""Its corner with the least coordinates, and that with the greatest."""
CORNERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))
"""Signs of x and y of the four corners of a footprint."""
Triangles = Float[np.ndarray, "t 3 3"]
Warp = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n 3"]]


def with_halves(size: Size) -> tuple[float, float, float, float, float]:
    """Width, depth, height, and half of the width and of the depth: how far the sides are from the middle."""
    width, depth, height = size
    return width, depth, height, width / 2, depth / 2


def corner_normals(triangles: Triangles, crease_rad: float = CREASE_RAD) -> Triangles:
    """A normal for every corner: the mean of the faces around the corner that turn by less than ``crease_rad``.

    Args:
        triangles: corners, counter-clockwise from outside; corners at the same place are one vertex.
        crease_rad: faces at a larger angle do not count.
    """
    cross = _across(triangles)
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    flat = np.where(length > 1e-14, cross / np.maximum(length, 1e-14), [0.0, 0.0, 1.0])
    keys = np.round(triangles.reshape(-1, 3) / 1e-5).astype(np.int64)
    # One number for each place: whole rows take several times as long to sort.
    keys -= keys.min(axis=0, initial=0)
    spans = keys.max(axis=0, initial=0) + 1
    place = (keys[:, 0] * spans[1] + keys[:, 1]) * spans[2] + keys[:, 2]
    total = np.zeros((len(place), 3))
    _add_neighbours(place, np.argsort(place, kind="stable"), flat, cross, np.cos(crease_rad), total)
    norm = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(norm > 1e-14, total / np.maximum(norm, 1e-14), np.repeat(flat, 3, axis=0)).reshape(-1, 3, 3)


@njit(cache=True)
def _across(triangles):
    """Normals of triangles, as long as twice their areas; numpy's cross product takes longer to begin than to end."""
    across = np.empty((len(triangles), 3))
    for n in range(len(triangles)):
        a, b, c = triangles[n]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        across[n, 0], across[n, 1], across[n, 2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return across


@njit(cache=True)
def _add_neighbours(place, order, flat, cross, least_cosine, total):
    """Adds to each corner what is across the faces at its place that turn little from its own."""
    start = 0
    while start < len(order):
        stop = start + 1
        while stop < len(order) and place[order[stop]] == place[order[start]]:
            stop += 1
        for corner in order[start:stop]:
            own = corner // 3
            for other in order[start:stop]:
                face = other // 3
                cosine = flat[own, 0] * flat[face, 0] + flat[own, 1] * flat[face, 1] + flat[own, 2] * flat[face, 2]
                if cosine > least_cosine:
                    for axis in range(3):
                        total[corner, axis] += cross[face, axis]
        start = stop


def turn_z(angle_rad: float) -> Float[np.ndarray, "3 3"]:
    """Turns counter-clockwise as seen from above."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def turn_x(angle_rad: float) -> Float[np.ndarray, "3 3"]:
    """Turns +Y towards +Z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def grid_triangles(points: Float[np.ndarray, "a b 3"]) -> Triangles:
    """Two triangles for every cell; the normal is the first index's direction x the second's."""
    p, q, r, s = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    both = np.stack([np.stack([p, q, r], axis=-2), np.stack([p, r, s], axis=-2)], axis=2)
    return both.reshape(-1, 3, 3)


def fan_triangles(ring: Float[np.ndarray, "n 3"]) -> Triangles:
    """A convex polygon as triangles that share its first corner."""
    return np.stack([np.broadcast_to(ring[0], (len(ring) - 2, 3)), ring[1:-1], ring[2:]], axis=1)


def circle(middle: tuple[float, float], radius: float | tuple[float, float], sides: int) -> list[tuple[float, float]]:
    """Corners of a round outline for ``Kit.prism``; with two radii it is an ellipse."""
    (a, b), (r, s) = middle, radius if isinstance(radius, tuple) else (radius, radius)
    return [(a + r * np.cos(turn), b + s * np.sin(turn)) for turn in np.arange(sides) * 2 * np.pi / sides]


def frame(outer: Rectangle, inner: Rectangle) -> list[Rectangle]:
    """What of a rectangle lies around another one within it, as four rectangles: front, back, left, right."""
    ((x0, y0), (x1, y1)), ((a0, b0), (a1, b1)) = outer, inner
    return [((x0, y0), (x1, b0)), ((x0, b1), (x1, y1)), ((x0, b0), (a0, b1)), ((a1, b0), (x1, b1))]


@dataclass(frozen=True)
class _Part:
    """Triangles of one look. Their normals are worked out when the model is finished: many are only measured."""

    paint: Paint
    triangles: Triangles
    """Before they are turned."""
    rotation: Float[np.ndarray, "3 3"]
    turned: Triangles
    """Where they stand in the model, on both sides if they are seen from both."""
    texcoords: Float[np.ndarray, "t 3 2"] | None
    crease_rad: float
    both_sides: bool

    def look(self) -> tuple[Triangles, Float[np.ndarray, "t 3 2"]]:
        """Normals and texture coordinates of the turned triangles."""
        normals = corner_normals(self.triangles, self.crease_rad)
        texcoords = self.texcoords
        if texcoords is None:
            texcoords = _project(self.triangles) / (self.paint.tile_m or 1.0)
        if self.both_sides:
            normals = np.concatenate([normals, -normals[:, ::-1]])
            texcoords = np.concatenate([texcoords, texcoords[:, ::-1]])
        return normals @ self.rotation.T, texcoords


class Kit:
    """Collects the parts of one model."""

    def __init__(self) -> None:
        """Starts with nothing."""
        self._parts: list[_Part] = []
        self._rotation, self._shift = np.eye(3), np.zeros(3)
        self.footprint: list[tuple[float, float, float, float]] | None = None
        """Rectangles (min x, min y, max x, max y) that it stands on or hangs over; all of its size if None."""

    @contextmanager
    def placed(self, shift: Sequence[float] = (0.0, 0.0, 0.0), rotation: np.ndarray | None = None) -> Iterator[None]:
        """Parts added inside are turned, then moved."""
        before = self._rotation, self._shift
        self._shift = self._rotation @ np.asarray(shift, float) + self._shift
        self._rotation = self._rotation @ (np.eye(3) if rotation is None else rotation)
        yield
        self._rotation, self._shift = before

    def add(
        self,
        paint: Paint,
        triangles: Triangles,
        texcoords: Float[np.ndarray, "t 3 2"] | None = None,
        crease_rad: float = CREASE_RAD,
        both_sides: bool = False,
    ) -> None:
        """Adds triangles, counter-clockwise from outside.

        Args:
            paint: their look.
            triangles: corners, metres.
            texcoords: for each corner; by default the model's own axes, in step with ``paint.tile_m``.
            crease_rad: edges sharper than this stay edges.
            both_sides: also add them as seen from behind (leaves).
        """
        keep = np.linalg.norm(_across(triangles), axis=1)
        triangles, texcoords = triangles[keep > 1e-12], None if texcoords is None else texcoords[keep > 1e-12]
        seen = np.concatenate([triangles, triangles[:, ::-1]]) if both_sides else triangles
        turned = seen @ self._rotation.T + self._shift
        self._parts.append(_Part(paint, triangles, self._rotation, turned, texcoords, crease_rad, both_sides))

    def box(self, paint: Paint, low: Sequence[float], high: Sequence[float], bevel: float = 0.0, puff: float = 0.0):
        """An axis-aligned box.

        Args:
            paint: its look.
            low: least corner.
            high: greatest corner.
            bevel: radius of its edges.
            puff: how far its faces bulge, as upholstery does; the box keeps its bounds.
        """
        least, most = np.minimum(low, high).astype(float), np.maximum(low, high).astype(float)
        half = 0.5 * (most - least)
        bevel = float(min(bevel, 0.98 * half.min()))
        samples = [_samples(h, bevel, puff > 0) for h in half]
        core = half - bevel
        out = []
        for axis in range(3):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            u, v = np.meshgrid(samples[a], samples[b], indexing="ij")
            for sign in (-1.0, 1.0):
                p = np.empty((*u.shape, 3))
                p[..., a], p[..., b], p[..., axis] = u, v, sign * half[axis]
                if bevel > 0:
                    inner = np.clip(p, -core, core)
                    away = p - inner
                    p = inner + bevel * away / np.linalg.norm(away, axis=-1, keepdims=True)
                if puff > 0:
                    # Faces rise to the bounds in their middle and sink towards their edges.
                    sink = 1 - (1 - (u / half[a]) ** 2) * (1 - (v / half[b]) ** 2)
                    p[..., axis] -= sign * puff * sink**2
                out.append(grid_triangles(p if sign > 0 else p.swapaxes(0, 1)))
        self.add(paint, np.concatenate(out) + 0.5 * (least + most), crease_rad=np.deg2rad(60) if bevel else CREASE_RAD)

    def lathe(
        self,
        paint: Paint,
        radii: Sequence[float] | Float[np.ndarray, "n"],
        heights: Sequence[float] | Float[np.ndarray, "n"],
        centre: Sequence[float] = (0.0, 0.0),
        sides: int = 16,
        warp: Warp | None = None,
        scale: tuple[float, float] = (1.0, 1.0),
    ) -> None:
        """A body of revolution about an upright axis.

        Args:
            paint: its look.
            radii: of its profile, from the bottom up along the outside.
            heights: of the same points.
            centre: x and y of the axis.
            sides: corners of its cross section.
            warp: moves points before they are centred, such as to an oval.
            scale: what radii and heights are multiples of, metres.
        """
        r, z = scale[0] * np.array(radii, float), scale[1] * np.array(heights, float)
        angle = np.linspace(0, 2 * np.pi, sides + 1)
        points = np.stack(
            [np.cos(angle)[:, None] * r, np.sin(angle)[:, None] * r, np.broadcast_to(z, (sides + 1, len(z)))], axis=-1
        )
        points[-1] = points[0]
        around = np.array(angle)[:, None] * max(float(r.max()), 1e-3)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(r), np.diff(z)))])
        uv = np.stack([np.broadcast_to(around, points.shape[:2]), np.broadcast_to(-along, points.shape[:2])], axis=-1)
        if warp is not None:
            points = warp(points.reshape(-1, 3)).reshape(points.shape)
        points = points + np.array([centre[0], centre[1], 0.0])
        uv3 = np.concatenate([uv, np.zeros((*uv.shape[:2], 1))], axis=-1)
        self.add(paint, grid_triangles(points), grid_triangles(uv3)[..., :2] / (paint.tile_m or 1.0))

    def ball(
        self, paint: Paint, centre: Sequence[float], radius: float, half_height: float, rings: int = 7, sides: int = 10
    ) -> None:
        """A ball, or an egg whose height is not its width."""
        turn = np.linspace(0, np.pi, rings)
        self.lathe(paint, radius * np.sin(turn), centre[2] - half_height * np.cos(turn), centre[:2], sides)

    def tube(
        self,
        paint: Paint,
        path: Sequence[Sequence[float]] | Float[np.ndarray, "n 3"],
        radius: float | Sequence[float],
        sides: int = 8,
    ) -> None:
        """A round rod along a path, closed at both ends; ``radius`` may change along it."""
        points = np.array(path, float)
        radii = np.broadcast_to(np.asarray(radius, float), len(points))
        tangents = np.gradient(points, axis=0)
        tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
        side = np.cross(tangents[0], [0.0, 0.0, 1.0] if abs(tangents[0, 2]) < 0.9 else [1.0, 0.0, 0.0])
        angle = np.linspace(0, 2 * np.pi, sides + 1)
        rings = []
        for point, tangent, r in zip(points, tangents, radii, strict=True):
            side = side - (side @ tangent) * tangent
            side = side / np.linalg.norm(side)
            up = np.cross(tangent, side)
            ring = point + r * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up)
            ring[-1] = ring[0]
            rings.append(ring)
        rings = [np.repeat(points[:1], sides + 1, axis=0), *rings, np.repeat(points[-1:], sides + 1, axis=0)]
        self.add(paint, grid_triangles(np.stack(rings, axis=1)))

    def prism(self, paint: Paint, outline: Sequence[tuple[float, float]], axis: int, start: float, end: float) -> None:
        """A plate with a convex outline.

        Args:
            paint: its look.
            outline: corners in the two other axes in cyclic order (axis 2: x, y; axis 0: y, z; axis 1: z, x),
                counter-clockwise as seen from the end of the axis.
            axis: along which it is thick.
            start: one end along the axis.
            end: the other one.
        """
        flat = np.array(outline, float)
        rings = np.empty((len(flat) + 1, 2, 3))
        rings[..., [(axis + 1) % 3, (axis + 2) % 3]] = np.append(flat, flat[:1], axis=0)[:, None]
        rings[..., axis] = sorted((start, end))
        lower, upper = fan_triangles(rings[:-1, 0])[:, [0, 2, 1]], fan_triangles(rings[:-1, 1])
        self.add(paint, np.concatenate([grid_triangles(rings), lower, upper]))

    def legs(self, paint: Paint, w: float, d: float, top: float, thick: float, style: int, inset: float = 0.0) -> None:
        """Legs at the corners of a w x d rectangle: square posts (style 0), tapered or splayed rods."""
        for sx, sy in CORNERS:
            x, y = sx * (w / 2 - thick / 2 - inset), sy * (d / 2 - thick / 2 - inset)
            if style == 0:
                self.box(paint, (x - thick / 2, y - thick / 2, 0), (x + thick / 2, y + thick / 2, top))
            elif style == 1:
                self.lathe(paint, [0, 0.32 * thick, 0.5 * thick, 0], [0, 0, top, top], (x, y), sides=10)
            else:
                foot = (sx * (w / 2 - 0.3 * thick), sy * (d / 2 - 0.3 * thick), 0.0)
                self.tube(paint, [foot, (0.72 * x, 0.72 * y, top)], [0.32 * thick, 0.5 * thick], sides=9)

    def card(
        self, paint: Paint, corners: Sequence[Sequence[float]], texcoords: Sequence[Sequence[float]] | None = None
    ) -> None:
        """A flat quad, corners counter-clockwise from its front; its picture fills it unless told otherwise."""
        uv = np.array(texcoords if texcoords is not None else [[0, 1], [1, 1], [1, 0], [0, 0]], float)
        quad = np.array(corners, float)
        self.add(paint, np.stack([quad[[0, 1, 2]], quad[[0, 2, 3]]]), np.stack([uv[[0, 1, 2]], uv[[0, 2, 3]]]))

    def picture(self, paint: Paint, across: tuple[float, float], height: tuple[float, float], y: float) -> None:
        """An upright quad that looks towards -Y, from least to greatest x and z; its picture fills it."""
        (x0, x1), (z0, z1) = across, height
        self.card(paint, [(x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)])

    def leaf(
        self,
        paint: Paint,
        root: Sequence[float],
        azimuth_rad: float,
        length: float,
        width: float,
        rise_rad: float,
        droop_rad: float,
        segments: int = 3,
    ) -> None:
        """A leaf, seen from both sides: it starts at an angle and bends down along its length."""
        t = np.linspace(0, 1, segments + 1)
        pitch = rise_rad - droop_rad * t
        step = length / segments
        out = np.concatenate([[0.0], np.cumsum(np.cos(pitch[:-1]) * step)])
        up = np.concatenate([[0.0], np.cumsum(np.sin(pitch[:-1]) * step)])
        spread = 0.5 * width * np.sin(np.pi * np.clip(0.08 + 0.92 * t, 0, 1)) ** 0.7
        left = np.stack([out, spread, up + 0.25 * spread], axis=1)
        right = np.stack([out, -spread, up + 0.25 * spread], axis=1)
        middle = np.stack([out, np.zeros_like(t), up], axis=1)
        points = np.stack([right, middle, left], axis=1) @ turn_z(azimuth_rad).T + np.asarray(root, float)
        self.add(paint, grid_triangles(points), crease_rad=np.deg2rad(80), both_sides=True)

    def pillow(
        self,
        paint: Paint,
        size: Sequence[float],
        *,
        cells: int = 12,
        piping: Paint | None = None,
        sag: float = 0.0,
        sharp: float = 0.42,
    ) -> None:
        """A stuffed cushion lying on z = 0, as two skins that meet in a seam.

        Source: superellipse ``|x|^4 + |y|^4 = 1`` as outline, thickness ``((1 - x^2)(1 - y^2))^sharp``.

        Args:
            paint: its cover.
            size: width, depth and thickness.
            cells: along each side.
            piping: look of the cord along the seam; none if not given.
            sag: how far the sides are pulled in between the corners, relative to the size.
            sharp: smaller is fuller.
        """
        width, depth, thick = size
        s = np.sin(0.5 * np.pi * np.linspace(-1, 1, cells + 1))
        u, v = np.meshgrid(s, s, indexing="ij")
        # Corners stick out, as on real cushions, whose sides the stuffing pulls inwards.
        x = u * (1 - sag * (1 - v**2))
        y = v * (1 - sag * (1 - u**2))
        z = np.clip((1 - u**2) * (1 - v**2), 0, 1) ** sharp
        cord = 0.0 if piping is None else 0.009
        points = np.stack([x * (0.5 * width - cord), y * (0.5 * depth - cord), 0.5 * thick * (1 + z)], axis=-1)
        under = points * [1, 1, -1] + [0, 0, thick]
        uv = np.stack([x * 0.5 * width, y * 0.5 * depth, np.zeros_like(x)], axis=-1) / (paint.tile_m or 1.0)
        skins = np.concatenate([grid_triangles(points), grid_triangles(under.swapaxes(0, 1))])
        coords = np.concatenate([grid_triangles(uv), grid_triangles(uv.swapaxes(0, 1))])[..., :2]
        self.add(paint, skins, coords, crease_rad=np.deg2rad(75))
        if piping is not None:
            edge = np.concatenate([points[:, 0], points[-1, 1:], points[-2::-1, -1], points[0, -2::-1]])
            self.tube(piping, edge, cord, sides=5)

    @property
    def num_triangles(self) -> int:
        """Triangles of all parts together."""
        return sum(len(part.turned) for part in self._parts)

    def extent_m(self) -> tuple[float, float, float]:
        """Width, depth and height of all parts together."""
        everything = np.concatenate([part.turned for part in self._parts]).reshape(-1, 3)
        width, depth, height = np.round(np.ptp(everything, axis=0), 4).tolist()
        return width, depth, height

    def finish(self, model_id: str, size_m: tuple[float, float, float]) -> FurnitureModel:
        """The model, brought exactly to its size, with its middle over the origin and its lowest point on the floor.

        Args:
            model_id: its name.
            size_m: width, depth and height.
        """
        everything = np.concatenate([part.turned for part in self._parts]).reshape(-1, 3)
        low, high = everything.min(axis=0), everything.max(axis=0)
        target = np.array(size_m)
        scale = target / np.maximum(high - low, 1e-9)
        origin = np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]])
        groups: dict[int, list[int]] = {}
        for index, part in enumerate(self._parts):
            groups.setdefault(id(part.paint), []).append(index)
        surfaces = []
        for members in groups.values():
            paint = self._parts[members[0]].paint
            looks = [self._parts[i].look() for i in members]
            corners = np.concatenate([self._parts[i].turned for i in members]).reshape(-1, 3)
            normals = np.concatenate([normals for normals, _ in looks]).reshape(-1, 3) / scale
            normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
            uv = np.concatenate([texcoords for _, texcoords in looks]).reshape(-1, 2)
            textured = paint.texture is not None
            rows = np.concatenate([(corners - origin) * scale, normals, uv if textured else uv[:, :0]], axis=1)
            unique, inverse = np.unique(rows.astype(np.float32), axis=0, return_inverse=True)
            surfaces.append(
                Surface(
                    vertices_m=np.ascontiguousarray(unique[:, :3]),
                    normals=np.ascontiguousarray(unique[:, 3:6]),
                    texcoords=np.ascontiguousarray(unique[:, 6:8]) if textured else None,
                    faces=inverse.reshape(-1, 3).astype(np.int32),
                    rgba=(*paint.rgb, paint.alpha),
                    specular=paint.specular,
                    shininess=paint.shininess,
                    texture=paint.texture,
                )
            )
        half_x, half_y = 0.5 * size_m[0], 0.5 * size_m[1]
        footprint = np.array(self.footprint or [(-half_x, -half_y, half_x, half_y)])
        return FurnitureModel(model_id, size_m, tuple(surfaces), footprint)


def _samples(half: float, bevel: float, puffed: bool) -> Float[np.ndarray, "n"]:
    """Where a face of a box is cut along one axis."""
    inner = np.linspace(-(half - bevel), half - bevel, 4 if puffed else 2)
    if bevel <= 0:
        return inner
    # tan(22.5 degrees) halves the round edge, which spans 90 degrees over two faces.
    edge = np.array([1.0, np.tan(np.pi / 8)]) if puffed else np.array([1.0])
    return np.concatenate([-(half - bevel) - bevel * edge, inner, (half - bevel) + bevel * edge[::-1]])


def _project(triangles: Triangles) -> Float[np.ndarray, "t 3 2"]:
    """Texture coordinates in metres: each triangle laid flat along the axis that it faces most."""
    cross = np.abs(_across(triangles))
    axis = np.argmax(cross, axis=1)
    first = np.array([1, 0, 0])[axis]
    second = np.array([2, 2, 1])[axis]
    rows = np.arange(len(triangles))
    return np.stack([triangles[rows, :, first], -triangles[rows, :, second]], axis=-1)
