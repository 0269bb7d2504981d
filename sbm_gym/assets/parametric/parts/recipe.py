"""How builtin models for one use are made."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sbm_gym.assets.parametric.parts.shapes import Size

Range = tuple[float, float]


@dataclass(frozen=True)
class Recipe:
    """How models for one use are made."""

    name: str
    size_m: tuple[Range, Range, Range]
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
