"""What photographs show: catalogue models kept for them, and builtin models from seeds that no world draws."""

import colorsys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
from sbm_gym.assets.models.classes import COCO_CATEGORIES, OUTDOOR_CATEGORIES, USES, VEHICLE_PAINT
from sbm_gym.assets.models.model import FurnitureModel, Surface
from sbm_gym.assets.parametric.builtin import BUILTIN, RECIPES, builtin_card, builtin_model
from sbm_gym.assets.scene_models import kept_apart, reserved_models

SPLITS = ("train", "val")
CATEGORIES = COCO_CATEGORIES + OUTDOOR_CATEGORIES
"""The classes that photographs are annotated with; whatever else they show has no name."""
BUILTIN_SEEDS = {"train": (2**31, 2**31 + 2**30), "val": (2**31 + 2**30, 2**32)}
"""Seeds of the builtin models of each split. Worlds draw theirs from 0 .. 2**31 - 1."""
VAL_SHARE = 0.25
"""Share of the models kept for photographs that only held-out ones show, at least one where a use has two."""
_HUE_SHIFT = {"plant": 0.03, "toilet": 0.02, "tv": 0.02, "fridge": 0.06}
"""How far hues may turn where a class has its own colours; the others take any hue."""
_AS_THEY_ARE = ("street_tree", "park_tree")
"""Uses whose models keep their colours."""
_RESTYLED = 0.5
"""Share of models that a set shows in other colours."""


def catalogue_models(use: str, split: str) -> tuple[str, ...]:
    """Catalogue models that photographs of a split may show, whether installed or not.

    Args:
        use: what they are for, a key of ``USES``.
        split: one of ``SPLITS``.

    Returns:
        Models of a class that has enough are those kept for photographs, each in one split; other classes and things
        without a class share their models with worlds and between splits.
    """
    described = USES[use]
    if described.category not in kept_apart():
        return described.models
    # ``reserved_models`` lists those of one use in an order that looks random.
    kept = [model_id for model_id in reserved_models() if model_id in set(described.models)]
    held_out = max(round(VAL_SHARE * len(kept)), 1) if len(kept) > 1 else 0
    return tuple(kept[:held_out] if split == "val" else kept[held_out:])


class PhotographLibrary:
    """The models of one set: catalogue models of its split, about as many builtin ones, half of them in new colours.

    Implements ``FurnitureLibrary``.
    """

    def __init__(self, catalogue: FurnitureLibrary | None, split: str, seed: Sequence[int]):
        """Offers models to one set.

        Args:
            catalogue: installed models; None for builtin ones only.
            split: one of ``SPLITS``.
            seed: decides builtin models and colours.
        """
        self._catalogue, self._split, self._seed = catalogue, split, tuple(seed)
        self._cards: dict[str, tuple[ModelCard, ...]] = {}
        self._models: dict[str, FurnitureModel] = {}

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models for a use, in a fixed order; empty if there are none."""
        if use not in self._cards:
            allowed = set(catalogue_models(use, self._split))
            listed = () if self._catalogue is None else self._catalogue.models(use)
            found = [card for card in listed if card.model_id in allowed]
            if use in RECIPES:
                seeds = self._generator(use).integers(*BUILTIN_SEEDS[self._split], max(len(found), 2))
                found += [builtin_card(use, int(seed)) for seed in seeds]
            self._cards[use] = tuple(found)
        return self._cards[use]

    def load(self, card: ModelCard) -> FurnitureModel:
        """The model of a card that ``models`` gave, in the colours that it has in this set."""
        if card.model_id not in self._models:
            if card.library == BUILTIN:
                model = builtin_model(card.use, int(card.model_id.rpartition("-")[2]))
            else:
                assert self._catalogue is not None
                model = self._catalogue.load(card)
            rng = self._generator(card.model_id)
            own = card.model_id in VEHICLE_PAINT or card.use in _AS_THEY_ARE
            if rng.random() < _RESTYLED and not own:
                model = restyled(model, rng, _HUE_SHIFT.get(card.category or "", 0.5))
            self._models[card.model_id] = model
        return self._models[card.model_id]

    def triangles(self, card: ModelCard) -> int:
        """How many triangles the model of a card has; colours change nothing."""
        if card.library == BUILTIN:
            return self.load(card).num_triangles
        assert self._catalogue is not None
        return self._catalogue.triangles(card)

    def _generator(self, name: str) -> np.random.Generator:
        return np.random.default_rng((*self._seed, *name.encode()))


def restyled(model: FurnitureModel, rng: np.random.Generator, hue_shift: float) -> FurnitureModel:
    """A model in other colours: hues turned alike, other saturation and brightness; pictures get a tint.

    Args:
        model: as it was.
        rng: draws the colours.
        hue_shift: greatest turn of hues, 0.5 for any.
    """
    turn, pale, bright = rng.uniform(-hue_shift, hue_shift), rng.uniform(0.5, 1.3), rng.uniform(0.75, 1.25)
    tint = 1.0 - rng.uniform(0.0, 0.5) * np.array(colorsys.hsv_to_rgb(rng.random(), min(2 * hue_shift, 1.0), 1.0))

    def other(surface: Surface) -> Surface:
        *rgb, alpha = surface.rgba
        if surface.texture is not None:
            rgb = [float(c) for c in np.clip(np.array(rgb) * tint / tint.max(), 0.0, 1.0)]
        else:
            hue, saturation, value = colorsys.rgb_to_hsv(*rgb)
            rgb = colorsys.hsv_to_rgb((hue + turn) % 1.0, min(saturation * pale, 1.0), min(value * bright, 1.0))
        return replace(surface, rgba=(rgb[0], rgb[1], rgb[2], alpha))

    return replace(model, surfaces=tuple(other(surface) for surface in model.surfaces))
