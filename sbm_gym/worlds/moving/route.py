"""Ways along which things move: lines on the floor, with their corners rounded."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

SPACING_M = 0.25
"""Between the points of a rounded corner."""


@dataclass(frozen=True)
class Route:
    """A line on the floor, from point to point."""

    points_m: Float[np.ndarray, "n 2"]
    """No two that follow each other are the same."""

    @cached_property
    def lengths_m(self) -> Float[np.ndarray, "n"]:
        """How far along the line each point lies."""
        steps = np.linalg.norm(np.diff(self.points_m, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length_m(self) -> float:
        """Of the whole line."""
        return float(self.lengths_m[-1])

    def at(self, along_m: float | Float[np.ndarray, "k"]) -> Float[np.ndarray, "*k 2"]:
        """Points of the line; its ends for what lies beyond them."""
        x, y = (np.interp(along_m, self.lengths_m, column) for column in self.points_m.T)
        return np.stack([x, y], axis=-1)

    def nearest(self, point_m: Float[np.ndarray, "2"], after_m: float = 0.0) -> float:
        """How far along the line the point nearest to another one lies, not before ``after_m``; to within a step."""
        along = np.arange(after_m, max(self.length_m, after_m) + SPACING_M, SPACING_M)
        apart = np.linalg.norm(self.at(along) - point_m, axis=1)
        # The first time that it comes as near as it ever does: routes may come back.
        return float(along[int(np.argmax(apart <= apart.min() + 1e-6))])


def rounded(corners_m: Sequence[Float[np.ndarray, "2"]], cuts_m: Sequence[float]) -> Float[np.ndarray, "n 2"]:
    """A line with its corners replaced by arcs.

    Args:
        corners_m: its ends and the corners between them.
        cuts_m: how far before and behind each inner corner its arc begins and ends. Arcs must not overlap.

    Returns:
        Its points: the ends, and those of the arcs.
    """
    points = [np.asarray(corners_m[0], float)]
    for (before, corner, after), cut_m in zip(
        zip(corners_m[:-2], corners_m[1:-1], corners_m[2:], strict=True), cuts_m, strict=True
    ):
        into, out = _unit(corner - before), _unit(after - corner)
        turn = float(np.arctan2(into[0] * out[1] - into[1] * out[0], into @ out))
        if abs(turn) < 1e-6:
            points.append(np.asarray(corner, float))
            continue
        radius_m = cut_m / np.tan(abs(turn) / 2)
        start = corner - cut_m * into
        left = np.array([-into[1], into[0]]) * np.sign(turn)
        centre = start + radius_m * left
        count = max(2, int(np.ceil(radius_m * abs(turn) / SPACING_M)))
        for angle in np.linspace(0.0, turn, count + 1):
            cos, sin = np.cos(angle), np.sin(angle)
            points.append(centre + np.array([[cos, -sin], [sin, cos]]) @ (start - centre))
    points.append(np.asarray(corners_m[-1], float))
    line = np.array(points)
    keep = np.append(True, np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-9)
    return line[keep]


def _unit(vector: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)
