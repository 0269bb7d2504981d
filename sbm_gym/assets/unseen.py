"""Models that only validation and test scenes show: a fixed part of every class that has enough models."""

import hashlib
from collections.abc import Sequence

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard, SelectedModels
from sbm_gym.assets.models.classes import USES
from sbm_gym.assets.parametric.builtin import BUILTIN

HELD_OUT_SHARE = 0.3
"""Share of a use's models that is kept out of training."""


def _rank(model_id: str) -> float:
    """A number in [0, 1) that looks random and is the same everywhere."""
    return int.from_bytes(hashlib.sha256(f"held out: {model_id}".encode()).digest()[:6], "big") / 2**48


def held_out(cards: Sequence[ModelCard]) -> frozenset[str]:
    """Ids of the models of one use that training does not show.

    Builtin models are without number, so each is decided by itself. Of a catalogue's models a fixed share is taken, at
    least one; where a use has a single model there is nothing to take.

    Args:
        cards: all models of the use.
    """
    listed = [card.model_id for card in cards if card.library != BUILTIN]
    chosen = {card.model_id for card in cards if card.library == BUILTIN and _rank(card.model_id) < HELD_OUT_SHARE}
    if len(listed) >= 2:
        chosen |= set(sorted(listed, key=_rank)[: max(1, round(HELD_OUT_SHARE * len(listed)))])
    return frozenset(chosen)


class PartLibrary(SelectedModels):
    """The models of a library that belong to training, or those that do not.

    Uses without a class are shared: nothing is labelled in their name. A use with a single model belongs to training if
    its class has other models that do not, and is shared otherwise (`too_small` names those classes).
    """

    def __init__(self, library: FurnitureLibrary, training: bool):
        """Takes a part of a library.

        Args:
            library: all models.
            training: whether to take the part that training may show.
        """
        super().__init__(library)
        self._training = training
        self._parts: dict[str, tuple[ModelCard, ...]] = {}

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models of this part for a use; empty if there are none."""
        if use not in self._parts:
            self._parts[use] = self._part(use)
        return self._parts[use]

    def _part(self, use: str) -> tuple[ModelCard, ...]:
        cards = self._library.models(use)
        category = USES[use].category
        if category is None:
            return cards
        kept_out = held_out(cards)
        if kept_out and len(kept_out) < len(cards):
            return tuple(card for card in cards if (card.model_id in kept_out) != self._training)
        if self._training or category in too_small(self._library):
            return cards
        return ()


def models_of_scene(library: FurnitureLibrary, held_out: bool, unseen_models: bool) -> FurnitureLibrary:
    """The models that a scene may show.

    Args:
        library: all models.
        held_out: whether it is one for validation or testing.
        unseen_models: whether other scenes do without the models that those show.
    """
    if held_out:
        return PartLibrary(library, training=False)
    return PartLibrary(library, training=True) if unseen_models else library


def too_small(library: FurnitureLibrary) -> tuple[str, ...]:
    """Classes with so few models that training and test scenes show the same ones."""
    found: dict[str, bool] = {}
    for use, described in USES.items():
        cards = library.models(use)
        if described.category is not None and cards:
            split = 0 < len(held_out(cards)) < len(cards)
            found[described.category] = found.get(described.category, False) or split
    return tuple(category for category, split in found.items() if not split)
