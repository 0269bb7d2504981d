"""Which models a scene shows: those of catalogues, with builtin ones of what they lack, and each split its own.

Where a class has enough models, some are kept for photographs, which detectors are pre-trained on: no world shows
them. Others are held out: only worlds for validation and testing show them. Builtin models of photographs
are kept apart by their seeds instead, see sbm_gym.photographs.models.
"""

import functools
import hashlib
from collections.abc import Callable, Mapping, Sequence

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard, default_library
from sbm_gym.assets.models.classes import (
    COCO_CATEGORIES,
    FROM_SEEDS,
    FROM_SEEDS_IN_STREETS,
    OUTDOOR_CATEGORIES,
    USES,
)
from sbm_gym.assets.models.model import FurnitureModel
from sbm_gym.assets.parametric.builtin import BUILTIN, BuiltinLibrary

HELD_OUT_SHARE = 0.3
"""Share of a use's models that is kept out of training."""
ENOUGH_MODELS = 9
"""Classes with fewer models share them between photographs and worlds."""
RESERVED_SHARE = 0.4
"""Share of a use's models that is kept for photographs, where its class has enough."""


def _rank(purpose: str, model_id: str) -> bytes:
    """Sorts models in an order that looks random and is the same everywhere."""
    return hashlib.sha256(f"{purpose}: {model_id}".encode()).digest()


@functools.cache
def kept_apart() -> frozenset[str]:
    """Classes of which photographs and worlds show different models: those COCO knows and that have enough."""
    count = dict.fromkeys(COCO_CATEGORIES + OUTDOOR_CATEGORIES, 0)
    for use in USES.values():
        if use.category in count:
            count[use.category] += len(use.models)
    return frozenset(category for category, models in count.items() if models >= ENOUGH_MODELS)


@functools.cache
def reserved_models() -> tuple[str, ...]:
    """Ids of the models that are kept for photographs; what is installed plays no part."""
    found = []
    for use in USES.values():
        if use.category in kept_apart():
            # This word keeps four cars and two small plants for worlds that are light enough to come often.
            ranked = sorted(use.models, key=functools.partial(_rank, "snapshot"))
            found += ranked[: round(RESERVED_SHARE * len(ranked))]
    return tuple(found)


def held_out(cards: Sequence[ModelCard]) -> frozenset[str]:
    """Ids of the models of one use that training does not show.

    Builtin models are without number, so each is decided by itself. Of a catalogue's models a fixed share is taken, at
    least one; where a use has a single model there is nothing to take.

    Args:
        cards: all models of the use.
    """
    rank = functools.partial(_rank, "held out")
    made = [card.model_id for card in cards if card.library == BUILTIN]
    chosen = {name for name in made if int.from_bytes(rank(name)[:6], "big") < HELD_OUT_SHARE * 2**48}
    listed = sorted((card.model_id for card in cards if card.library != BUILTIN), key=rank)
    if len(listed) >= 2:
        chosen |= set(listed[: max(1, round(HELD_OUT_SHARE * len(listed)))])
    return frozenset(chosen)


def too_small(library: FurnitureLibrary) -> tuple[str, ...]:
    """Classes with so few models that training and test scenes show the same ones."""
    found: dict[str, bool] = {}
    for use, described in USES.items():
        cards = library.models(use)
        if described.category is not None and cards:
            split = 0 < len(held_out(cards)) < len(cards)
            found[described.category] = found.get(described.category, False) or split
    return tuple(category for category, split in found.items() if not split)


class SelectedModels:
    """Some models of another library. Implements ``FurnitureLibrary``."""

    def __init__(
        self, library: FurnitureLibrary, select: Callable[[str, tuple[ModelCard, ...]], tuple[ModelCard, ...]]
    ):
        """Selects from a library.

        Args:
            library: all models.
            select: those that are taken, given a use and all models for it.
        """
        self._library, self._select = library, select
        self._cards: dict[str, tuple[ModelCard, ...]] = {}

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models for a use that are taken; empty if there are none."""
        if use not in self._cards:
            self._cards[use] = self._select(use, self._library.models(use))
        return self._cards[use]

    def load(self, card: ModelCard) -> FurnitureModel:
        """The model of a card that ``models`` gave."""
        return self._library.load(card)

    def triangles(self, card: ModelCard) -> int:
        """How many triangles the model of a card has."""
        return self._library.triangles(card)


def models_of_scene(library: FurnitureLibrary, held_out_scene: bool, unseen_models: bool) -> FurnitureLibrary:
    """The models that a scene may show: those that belong to training, or those that do not.

    Uses without a class are shared: nothing is labelled in their name. A use with a single model belongs to training if
    its class has other models that do not, and is shared otherwise (`too_small` names those classes).

    Args:
        library: all models.
        held_out_scene: whether it is a scene for validation or testing.
        unseen_models: whether other scenes do without the models that those show.
    """
    if not (held_out_scene or unseen_models):
        return library

    def select(use: str, cards: tuple[ModelCard, ...]) -> tuple[ModelCard, ...]:
        category = USES[use].category
        if category is None:
            return cards
        kept_out = held_out(cards)
        if 0 < len(kept_out) < len(cards):
            return tuple(card for card in cards if (card.model_id in kept_out) == held_out_scene)
        return cards if not held_out_scene or category in too_small(library) else ()

    return SelectedModels(library, select)


class MixedLibrary:
    """A library's models, and builtin ones for some uses. Implements ``FurnitureLibrary``."""

    def __init__(self, library: FurnitureLibrary, builtin: Mapping[str, int] = FROM_SEEDS, instead: bool = False):
        """Mixes.

        Args:
            library: what builtin models join.
            builtin: how many there are of them, by use.
            instead: whether they stand in for the library's instead of following them.
        """
        self._library, self._count, self._instead = library, builtin, instead
        self._builtin = BuiltinLibrary(seed=0, variants=max(builtin.values()))

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models for a use, the library's first."""
        listed = self._library.models(use)
        if use not in self._count:
            return listed
        made = self._builtin.models(use)[: self._count[use]]
        return made if self._instead else listed + made

    def load(self, card: ModelCard) -> FurnitureModel:
        """The model of a card that ``models`` gave."""
        return self._of(card).load(card)

    def triangles(self, card: ModelCard) -> int:
        """How many triangles the model of a card has."""
        return self._of(card).triangles(card)

    def _of(self, card: ModelCard) -> FurnitureLibrary:
        return self._builtin if card.library == BUILTIN else self._library


@functools.cache
def worlds_library() -> SelectedModels:
    """What worlds are furnished from: the installed catalogues without the models kept for photographs.

    Raises:
        MissingAssetsError: if no catalogue is installed.
    """
    reserved = frozenset(reserved_models())
    return SelectedModels(default_library(), lambda _, cards: tuple(c for c in cards if c.model_id not in reserved))


@functools.cache
def indoor_library() -> MixedLibrary:
    """What interiors are furnished from: the installed catalogues with builtin models of what they lack.

    Raises:
        MissingAssetsError: if no catalogue is installed.
    """
    return MixedLibrary(worlds_library())


@functools.cache
def town_library() -> MixedLibrary:
    """What towns are furnished from: the installed catalogues with builtin models for what is too heavy there.

    Raises:
        MissingAssetsError: if no catalogue is installed.
    """
    return MixedLibrary(worlds_library(), FROM_SEEDS_IN_STREETS, instead=True)
