"""How builtin models for each use are made, read from ``recipes.toml`` beside this module."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sbm_gym.assets.parametric.furniture import (
    beds,
    cabinets,
    couches,
    lamps,
    plants,
    screens,
    seating,
    shelves,
    small_things,
    tables,
    wall_things,
)
from sbm_gym.assets.parametric.kitchen_bath import appliances, bathroom, kitchen
from sbm_gym.assets.parametric.parts.shapes import Size
from sbm_gym.assets.parametric.towns import street_furniture, trees, two_wheelers, vehicles

_FURNITURE = (beds, cabinets, couches, lamps, plants, screens, seating, shelves, small_things, tables, wall_things)
_KITCHEN_BATH = (appliances, bathroom, kitchen)
_TOWNS = (street_furniture, trees, two_wheelers, vehicles)


@dataclass(frozen=True)
class Recipe:
    """How models for one use are made."""

    name: str
    size_m: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    """Least and greatest width, depth and height."""
    build: Callable[..., None]
    """Adds the parts to a kit, given the kit, a source of randomness and the size, then the style if there is one."""
    supports: bool = False
    """Whether other things can stand on top."""
    square: float = 0.0
    """How often the depth equals the width (round tables, lamps)."""
    free: bool = False
    """The shape decides its size within the ranges, instead of being stretched to a drawn one."""
    adjust: Callable[..., Size] | None = None
    """Mends sizes that do not go together, given the size, then the style if there is one."""
    style: Callable[[np.random.Generator], Any] | None = None
    """Draws what all models of one family share, whatever their use; None for models that stand alone."""


def _read_recipes() -> dict[str, Recipe]:
    modules = {m.__name__.rpartition(".")[2]: m for m in (*_FURNITURE, *_KITCHEN_BATH, *_TOWNS)}
    recipes = {}
    for use, entry in tomllib.loads(Path(__file__).with_name("recipes.toml").read_text(encoding="utf-8")).items():
        for role in ("build", "adjust", "style"):
            if role in entry:
                module, _, function = entry[role].partition(".")
                entry[role] = getattr(modules[module], function)
        recipes[use] = Recipe(**entry)
    return recipes


RECIPES = _read_recipes()
"""Every use that builtin models serve."""
