"""The builtin library: furniture made from a seed, with nothing to download and no end to its variety."""

import functools
import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np

from labeling.core.errors import UsageError
from sbm_gym.assets.catalog.library import ModelCard
from sbm_gym.assets.models.classes import USES
from sbm_gym.assets.models.model import FurnitureModel
from sbm_gym.assets.parametric.parts.shapes import Kit, Size
from sbm_gym.assets.parametric.recipes import RECIPES, Recipe

BUILTIN = "builtin"
"""Name of the library, and first part of its models' ids."""
FAMILIES = 64
"""How many families there are of models that go together, such as kitchens; a seed's remainder says which it is of."""
OFFERED_FAMILIES = 3
"""How many of them one library offers."""


def model_id(use: str, seed: int) -> str:
    """The name of a builtin model."""
    return f"{BUILTIN}#{use}-{seed}"


def _generator(use: str, seed: int) -> np.random.Generator:
    if use not in RECIPES:
        raise UsageError(f"there is no builtin model for {use!r}; uses are {', '.join(RECIPES)}")
    if seed < 0:
        raise UsageError(f"a builtin model's seed is a whole number of at least 0, not {seed}")
    word = int.from_bytes(hashlib.sha256(use.encode()).digest()[:8], "little")
    return np.random.default_rng((word, seed))


@functools.lru_cache(maxsize=256)
def _style(draw: Callable[[np.random.Generator], Any], family: int) -> Any:
    return draw(np.random.default_rng((int.from_bytes(b"family", "big"), family)))


def _shared(recipe: Recipe, seed: int) -> tuple[Any, ...]:
    """The style that a recipe's models share within their family, if they do."""
    return () if recipe.style is None else (_style(recipe.style, seed % FAMILIES),)


def family(card: ModelCard) -> str:
    """What a model goes together with: others of its catalogue, or builtin ones of one style."""
    number = card.model_id.rpartition("-")[2]
    return f"{BUILTIN} {int(number) % FAMILIES}" if card.library == BUILTIN else card.library


def _draw_size(recipe: Recipe, rng: np.random.Generator, shared: tuple[Any, ...]) -> Size:
    width, depth, height = (round(float(rng.uniform(low, high)), 3) for low, high in recipe.size_m)
    size = width, width if rng.random() < recipe.square else depth, height
    return size if recipe.adjust is None else recipe.adjust(size, *shared)


@functools.lru_cache(maxsize=1024)
def builtin_model(use: str, seed: int) -> FurnitureModel:
    """Makes a model; the same use and seed give the same model anywhere.

    Args:
        use: what it is for, a key of ``RECIPES``.
        seed: at least 0.

    Raises:
        UsageError: if there is no such use, or the seed is negative.
    """
    kit, size = _parts(use, seed)
    return kit.finish(model_id(use, seed), size)


@functools.lru_cache(maxsize=256)
def _parts(use: str, seed: int) -> tuple[Kit, Size]:
    """The parts of a model, and its size: enough to choose by, at a third of what finishing it takes."""
    rng = _generator(use, seed)
    recipe = RECIPES[use]
    shared = _shared(recipe, seed)
    size = _draw_size(recipe, rng, shared)
    kit = Kit()
    recipe.build(kit, rng, size, *shared)
    return kit, kit.extent_m() if recipe.free else size


@functools.lru_cache(maxsize=8192)
def builtin_triangles(use: str, seed: int) -> int:
    """How many triangles a model has, without finishing it.

    Raises:
        UsageError: if there is no such use, or the seed is negative.
    """
    return _parts(use, seed)[0].num_triangles


@functools.lru_cache(maxsize=8192)
def builtin_card(use: str, seed: int) -> ModelCard:
    """What is known about a model without making it.

    Raises:
        UsageError: if there is no such use, or the seed is negative.
    """
    rng = _generator(use, seed)
    recipe = RECIPES[use]
    size = _parts(use, seed)[1] if recipe.free else _draw_size(recipe, rng, _shared(recipe, seed))
    return ModelCard(
        model_id=model_id(use, seed),
        use=use,
        category=USES[use].category,
        size_m=size,
        top_m=size[2] if recipe.supports else None,
        name=recipe.name,
        creator="made from a seed",
        licence="MIT",
        library=BUILTIN,
    )


class BuiltinLibrary:
    """Models made from seeds. What it offers depends on ``seed`` alone: another seed, other furniture."""

    def __init__(self, seed: int = 0, variants: int = 12):
        """Offers ``variants`` models for every use.

        Args:
            seed: which models; at least 0.
            variants: how many models for each use; at least 1.
        """
        if seed < 0 or variants < 1:
            raise UsageError(f"the builtin library needs seed >= 0 and variants >= 1, not {seed} and {variants}")
        self.seed, self.variants = seed, variants

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models for a use, in a fixed order; empty if it is not served."""
        if use not in RECIPES:
            return ()
        word = hashlib.sha256(f"{use}/{self.seed}".encode()).digest()
        seeds = np.random.default_rng(int.from_bytes(word[:8], "little")).integers(0, 2**31, self.variants)
        if RECIPES[use].style is not None:
            # Whatever the use, the same few families, so that each has something of everything.
            families = np.random.default_rng(self.seed).choice(FAMILIES, OFFERED_FAMILIES, replace=False)
            seeds += families[np.arange(self.variants) % OFFERED_FAMILIES] - seeds % FAMILIES
        return tuple(builtin_card(use, int(seed)) for seed in seeds)

    def load(self, card: ModelCard) -> FurnitureModel:
        """The model of a card that ``models`` gave.

        Raises:
            UsageError: if the card is another library's.
        """
        return builtin_model(*_use_and_seed(card))

    def triangles(self, card: ModelCard) -> int:
        """How many triangles the model of a card has."""
        return builtin_triangles(*_use_and_seed(card))


def _use_and_seed(card: ModelCard) -> tuple[str, int]:
    library, _, name = card.model_id.partition("#")
    use, _, seed = name.rpartition("-")
    if library != BUILTIN or not seed.isdigit():
        raise UsageError(f"{card.model_id!r} is not a builtin model")
    return use, int(seed)
