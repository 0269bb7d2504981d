"""Furnishing one room: picking models, putting them along walls, hanging them up, decorating them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
from sbm_gym.worlds.geometry.placing import Layout, Placement, Wall, rotation

MAX_OBJECTS = 14
"""Objects with a class in one room, cushions aside."""
HUNG_GAP_M = 0.006
"""Between a wall and what hangs on it."""


@dataclass
class Arranger:
    """Furnishes one room, group by group. A group that finds no place leaves the room as it was, or with a part."""

    layout: Layout
    library: FurnitureLibrary
    max_triangles: int = 200_000
    """Of all pieces together."""
    max_objects: int = MAX_OBJECTS

    @property
    def rng(self) -> np.random.Generator:
        """The layout's source of randomness."""
        return self.layout.rng

    def pick(
        self, use: str, accept: Callable[[ModelCard], bool] = lambda card: True, copies: int = 1
    ) -> ModelCard | None:
        """A random model for a use.

        Args:
            use: what it is for.
            accept: says which models will do.
            copies: how many of it are wanted; that many must fit into ``max_triangles``.

        Returns:
            The model, None if the library has none that will do.
        """
        cards = [card for card in self.library.models(use) if accept(card)]
        left = self.max_triangles - self.triangles()
        for index in self.rng.permutation(len(cards)):
            if self.library.triangles(cards[index]) * copies <= left:
                return cards[index]
        return None

    def triangles(self) -> int:
        """Triangles of all pieces so far."""
        return sum(self.library.triangles(piece.card) for piece in self.layout.placements)

    def chance(self, probability: float) -> bool:
        """True with this probability."""
        return bool(self.rng.random() < probability)

    def perhaps(self, probability: float, furnish: Callable, *what, **how) -> None:
        """Puts a group or a piece into the room with a probability: ``furnish(self, *what, **how)``."""
        if self.chance(probability):
            furnish(self, *what, **how)

    def count(self) -> int:
        """Objects with a class so far, cushions aside."""
        return sum(piece.card.category not in (None, "cushion") for piece in self.layout.placements)

    def full(self) -> bool:
        """Whether the room has as many objects with a class as a room should."""
        return self.count() >= self.max_objects

    def wall_behind(self, piece: Placement) -> tuple[Wall, float]:
        """The wall that a piece has its back to, and where along it the middle of the piece is."""
        wall = min(self.layout.room.walls(), key=lambda w: abs(np.sin((w.yaw_rad - piece.yaw_rad) / 2)))
        return wall, float((np.array([piece.x_m, piece.y_m]) - wall.origin) @ wall.along)

    def along_wall(self, use: str, **how) -> Placement | None:
        """A random model for a use with its back to a wall; tries several models."""
        for _ in range(4):
            card = None if self.full() else self.pick(use)
            piece = None if card is None else self.layout.against_wall(card, **how)
            if piece is not None:
                return piece
        return None

    def small(self, use: str, **how) -> Placement | None:
        """A thing without a class along a wall, if it finds a place soon."""
        card = self.pick(use)
        return None if card is None else self.layout.against_wall(card, **{"tries": 15, **how})

    def hang(self, use: str, elevation_m: float, **how) -> Placement | None:
        """Hangs a thing on a wall, its underside at a height."""
        card = self.pick(use, lambda card: elevation_m + card.size_m[2] < self.layout.room.height_m - 0.02)
        if card is None:
            return None
        return self.layout.against_wall(
            card,
            **{"elevation_m": elevation_m, "gap_m": HUNG_GAP_M, "tries": 40, "ignore_zones": self.layout.zones, **how},
        )

    def decorate(self, support: Placement, uses: tuple[str, ...], probability: float) -> None:
        """Small things on top of a piece, each with a probability."""
        half = np.array(support.card.size_m[:2]) / 2
        for use in uses:
            card = self.pick(use) if self.chance(probability) else None
            if card is None or (card.category is not None and self.full()):
                continue
            for _ in range(6):
                yaw = float(self.rng.uniform(-np.pi, np.pi))
                if use in ("desk_thing", "worktop_thing"):
                    yaw = float(self.rng.normal(0, 0.25 if use == "desk_thing" else 0.05))
                slack = half - np.abs(rotation(yaw)) @ np.array(card.size_m[:2]) / 2
                if np.any(slack < 0):
                    continue
                right, back = self.rng.uniform(-1.0, 1.0, 2) * slack
                if use == "desk_thing":
                    back = min(0.1 * half[1], slack[1])
                elif use == "worktop_thing":
                    back = slack[1] - min(0.03, slack[1])
                if self.layout.on_top(card, support, float(right), float(back), yaw):
                    break

    def rug_before(self, piece: Placement, use: str = "rug") -> None:
        """Notes where a rug lies before a piece; a room has one of a kind."""
        card = self.pick(use) if self.chance(0.75) else None
        if card is None or any(rug.card.use == use for rug in self.layout.rugs):
            return
        x, y = piece.at(0.0, -piece.card.size_m[1] / 2 - (0.25 if use == "rug" else 0.1 + card.size_m[1] / 2))
        turned = use == "rug" and self.chance(0.8)
        rug = Placement(card, x, y, piece.yaw_rad + (0.5 * np.pi if turned else 0.0))
        x0, y0, x1, y1 = rug.box.bounds()
        low, high = np.array(self.layout.room.low_m) + 0.1, np.array(self.layout.room.high_m) - 0.1
        if np.any(high - low < [x1 - x0, y1 - y0]):
            return
        shift = np.maximum(low - [x0, y0], 0) - np.maximum([x1, y1] - high, 0)
        self.layout.rugs.append(Placement(card, float(x + shift[0]), float(y + shift[1]), rug.yaw_rad))
