"""The builtin library: furniture made from a seed, with nothing to download and no end to its variety."""

import functools
import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from labeling.errors import UsageError
from sbm_gym.assets.builtin_models import household, seating, street, tables
from sbm_gym.assets.builtin_models.shapes import Kit
from sbm_gym.assets.classes import USES
from sbm_gym.assets.library import ModelCard
from sbm_gym.assets.model import FurnitureModel

BUILTIN = "builtin"
"""Name of the library, and first part of its models' ids."""
Range = tuple[float, float]
Size = tuple[float, float, float]


@dataclass(frozen=True)
class Recipe:
    """How models for one use are made."""

    category: str | None
    size_m: tuple[Range, Range, Range]
    """Least and greatest width, depth and height."""
    build: Callable[[Kit, np.random.Generator, Size], None]
    name: str
    supports: bool = False
    """Whether other things can stand on top."""
    square: float = 0.0
    """How often the depth equals the width (round tables, lamps)."""
    free: bool = False
    """The shape decides its size within the ranges, instead of being stretched to a drawn one."""
    adjust: Callable[[Size], Size] | None = None
    """Mends sizes that do not go together."""


def _fridge_size(size: Size) -> Size:
    """Only tall fridges are wide."""
    width, depth, height = size
    return (0.9 if height > 1.75 and width > 0.66 else width), depth, height


def _recipes() -> dict[str, Recipe]:
    def of(use: str, size, build, name: str, **more) -> tuple[str, Recipe]:
        return use, Recipe(USES[use].category, size, build, name, **more)

    s, t, o, v = seating, tables, household, street
    return dict(
        [
            of("dining_chair", ((0.40, 0.50), (0.44, 0.54), (0.78, 1.02)), s.dining_chair, "chair"),
            of("office_chair", ((0.58, 0.70), (0.58, 0.70), (0.88, 1.20)), s.office_chair, "office chair"),
            of("lounge_chair", ((0.68, 0.92), (0.72, 0.90), (0.72, 0.98)), s.lounge_chair, "armchair"),
            of("couch", ((1.45, 2.30), (0.80, 0.98), (0.72, 0.92)), s.couch, "couch"),
            of("beanbag", ((0.72, 0.98), (0.76, 1.02), (0.58, 0.86)), s.beanbag, "beanbag"),
            of("cushion", ((0.30, 0.54), (0.26, 0.54), (0.10, 0.18)), s.cushion, "cushion", free=True),
            of("leaning_cushion", ((0.30, 0.54), (0.15, 0.40), (0.25, 0.58)), s.leaning_cushion, "cushion", free=True),
            of(
                "dining_table",
                ((0.9, 1.9), (0.75, 0.95), (0.72, 0.77)),
                t.dining_table,
                "table",
                supports=True,
                square=0.35,
            ),
            of(
                "coffee_table",
                ((0.6, 1.2), (0.5, 0.65), (0.32, 0.48)),
                t.coffee_table,
                "coffee table",
                supports=True,
                square=0.3,
            ),
            of("desk", ((1.05, 1.65), (0.58, 0.78), (0.72, 0.76)), t.desk, "desk", supports=True),
            of("double_bed", ((1.42, 1.85), (2.06, 2.18), (0.8, 1.25)), t.bed, "double bed"),
            of("single_bed", ((0.92, 1.05), (2.04, 2.12), (0.75, 1.1)), t.single_bed, "single bed"),
            of("nightstand", ((0.38, 0.55), (0.34, 0.46), (0.42, 0.62)), t.nightstand, "nightstand", supports=True),
            of("shelf", ((0.6, 1.5), (0.27, 0.38), (0.75, 2.1)), t.shelf, "shelf"),
            of("cupboard", ((0.9, 1.8), (0.55, 0.64), (1.85, 2.2)), t.cupboard, "wardrobe"),
            of("dresser", ((0.75, 1.4), (0.42, 0.5), (0.75, 1.0)), t.dresser, "chest of drawers", supports=True),
            of("tv_stand", ((1.1, 1.8), (0.38, 0.46), (0.38, 0.58)), t.tv_stand, "television cabinet", supports=True),
            of("office_cabinet", ((0.4, 0.5), (0.5, 0.62), (0.7, 1.35)), t.office_cabinet, "filing cabinet"),
            of("kitchen_unit", ((0.45, 0.9), (0.62, 0.64), (0.88, 0.92)), t.kitchen_unit, "kitchen unit"),
            of("fridge", ((0.56, 0.72), (0.62, 0.74), (0.86, 2.0)), o.fridge, "fridge", adjust=_fridge_size),
            of("toilet", ((0.37, 0.45), (0.62, 0.74), (0.74, 0.86)), o.toilet, "toilet"),
            of("tv", ((0.75, 1.25), (0.2, 0.28), (0.5, 0.82)), o.tv, "television"),
            of("wall_tv", ((0.8, 1.35), (0.07, 0.09), (0.48, 0.78)), o.wall_tv, "wall television"),
            of("floor_plant", ((0.5, 0.9), (0.5, 0.9), (0.9, 1.8)), o.plant, "plant", square=1.0),
            of("small_plant", ((0.2, 0.36), (0.2, 0.36), (0.25, 0.5)), o.plant, "small plant", square=1.0),
            of("floor_lamp", ((0.36, 0.5), (0.36, 0.5), (1.4, 1.75)), o.floor_lamp, "standard lamp", square=1.0),
            of("table_lamp", ((0.2, 0.34), (0.2, 0.34), (0.34, 0.6)), o.table_lamp, "table lamp", square=1.0),
            of("desk_lamp", ((0.14, 0.18), (0.3, 0.42), (0.36, 0.5)), o.desk_lamp, "desk lamp"),
            of("hanging_lamp", ((0.28, 0.5), (0.28, 0.5), (0.6, 0.9)), o.hanging_lamp, "hanging lamp", square=1.0),
            of("rug", ((1.5, 2.4), (1.1, 1.7), (0.01, 0.014)), o.rug, "rug"),
            of("radiator", ((0.6, 1.3), (0.1, 0.14), (0.5, 0.66)), o.radiator, "radiator"),
            of("bin", ((0.22, 0.34), (0.22, 0.34), (0.3, 0.62)), o.waste_bin, "bin", square=1.0),
            of("washbasin", ((0.48, 0.7), (0.42, 0.5), (0.92, 1.0)), o.washbasin, "washbasin"),
            of("bathtub", ((1.5, 1.75), (0.7, 0.78), (0.54, 0.6)), o.bathtub, "bathtub"),
            of("table_thing", ((0.08, 0.28), (0.08, 0.28), (0.1, 0.34)), o.table_thing, "vase or bowl", square=1.0),
            of("car", ((1.74, 1.96), (3.7, 4.8), (1.42, 1.7)), v.car, "car"),
            of("van", ((2.0, 2.2), (4.9, 5.9), (2.1, 2.6)), v.van, "van"),
            of("truck", ((2.3, 2.5), (6.2, 9.0), (2.9, 3.6)), v.truck, "lorry"),
            of("bus", ((2.5, 2.7), (9.5, 12.0), (2.95, 3.2)), v.bus, "bus"),
            of("motorcycle", ((0.7, 0.85), (1.9, 2.2), (1.1, 1.25)), v.motorcycle, "motorcycle"),
            of("bicycle", ((0.52, 0.64), (1.68, 1.85), (1.0, 1.12)), v.bicycle, "bicycle"),
            of("street_tree", ((3.2, 5.5), (3.2, 5.5), (5.5, 9.0)), v.tree, "tree", square=1.0),
            of("park_tree", ((3.0, 5.0), (3.0, 5.0), (4.5, 8.0)), v.tree, "tree", square=1.0),
            of("street_light", ((0.3, 0.42), (1.2, 1.9), (5.0, 7.0)), v.street_light, "street lamp"),
            of("bench", ((1.5, 2.0), (0.6, 0.72), (0.8, 0.92)), v.bench, "bench"),
            of("litter_bin", ((0.42, 0.55), (0.42, 0.55), (0.8, 1.0)), v.litter_bin, "litter bin", square=1.0),
            of("traffic_cone", ((0.28, 0.4), (0.28, 0.4), (0.45, 0.75)), v.traffic_cone, "traffic cone", square=1.0),
            of("cafe_table", ((0.6, 0.8), (0.6, 0.8), (0.7, 0.75)), v.cafe_table, "cafe table", square=1.0),
            of("cafe_chair", ((0.4, 0.46), (0.46, 0.54), (0.82, 0.92)), v.cafe_chair, "cafe chair"),
            of("parasol", ((2.0, 2.8), (2.0, 2.8), (2.3, 2.6)), v.parasol, "parasol", square=1.0),
            of("fountain", ((3.0, 4.0), (3.0, 4.0), (1.6, 2.2)), v.fountain, "fountain", square=1.0),
            of("desk_thing", ((0.17, 0.3), (0.14, 0.24), (0.06, 0.14)), o.desk_thing, "books or pens"),
        ]
    )


RECIPES: dict[str, Recipe] = _recipes()
"""Every use that the library can serve."""


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


def _draw_size(recipe: Recipe, rng: np.random.Generator) -> Size:
    width, depth, height = (round(float(rng.uniform(low, high)), 3) for low, high in recipe.size_m)
    size = width, width if rng.random() < recipe.square else depth, height
    return size if recipe.adjust is None else recipe.adjust(size)


@functools.lru_cache(maxsize=1024)
def builtin_model(use: str, seed: int) -> FurnitureModel:
    """Makes a model; the same use and seed give the same model anywhere.

    Args:
        use: what it is for, a key of ``RECIPES``.
        seed: at least 0.

    Raises:
        UsageError: if there is no such use, or the seed is negative.
    """
    rng = _generator(use, seed)
    recipe = RECIPES[use]
    size = _draw_size(recipe, rng)
    kit = Kit()
    recipe.build(kit, rng, size)
    return kit.finish(model_id(use, seed), kit.extent_m() if recipe.free else size)


@functools.lru_cache(maxsize=8192)
def builtin_card(use: str, seed: int) -> ModelCard:
    """What is known about a model without making it.

    Raises:
        UsageError: if there is no such use, or the seed is negative.
    """
    rng = _generator(use, seed)
    recipe = RECIPES[use]
    size = builtin_model(use, seed).size_m if recipe.free else _draw_size(recipe, rng)
    return ModelCard(
        model_id=model_id(use, seed),
        use=use,
        category=recipe.category,
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
        return tuple(builtin_card(use, int(seed)) for seed in seeds)

    def load(self, card: ModelCard) -> FurnitureModel:
        """The model of a card that ``models`` gave.

        Raises:
            UsageError: if the card is another library's.
        """
        library, _, name = card.model_id.partition("#")
        use, _, seed = name.rpartition("-")
        if library != BUILTIN or not seed.isdigit():
            raise UsageError(f"{card.model_id!r} is not a builtin model")
        return builtin_model(use, int(seed))
