"""Models of photographs and models of worlds never meet where a class has enough."""

import pytest

from sbm_gym.assets.classes import COCO_CATEGORIES, NOVEL_CATEGORIES, OUTDOOR_CATEGORIES, USES
from sbm_gym.assets.library import default_library
from sbm_gym.assets.mixed import MixedLibrary
from sbm_gym.assets.reserved import ENOUGH_MODELS, RESERVED_SHARE, kept_apart, reserved_models, worlds_library
from sbm_gym.assets.unseen import too_small
from sbm_gym.worlds.outdoor import VISITORS

KEPT_APART = [use for use, described in USES.items() if described.category in kept_apart()]


def models_of(category: str) -> set[str]:
    return {model for use in USES.values() if use.category == category for model in use.models}


def test_every_named_class_with_enough_models_is_kept_apart():
    for category in COCO_CATEGORIES + OUTDOOR_CATEGORIES:
        assert (category in kept_apart()) == (len(models_of(category)) >= ENOUGH_MODELS)
    assert not kept_apart() & set(NOVEL_CATEGORIES)


@pytest.mark.parametrize("use", KEPT_APART)
def test_worlds_show_no_reserved_model(use):
    reserved = set(reserved_models()) & set(USES[use].models)
    worlds = {card.model_id for card in worlds_library().models(use)}
    assert not reserved & worlds
    assert reserved | worlds == set(USES[use].models)
    assert len(reserved) == round(RESERVED_SHARE * len(USES[use].models))


@pytest.mark.parametrize("category", sorted(kept_apart()))
def test_worlds_keep_at_least_half_of_every_class(category):
    uses = [use for use, described in USES.items() if described.category == category]
    assert 2 * sum(len(worlds_library().models(use)) for use in uses) >= len(models_of(category))


def test_worlds_can_still_hold_models_back_from_training():
    assert too_small(MixedLibrary(worlds_library())) == ()


def test_worlds_keep_enough_light_cars_for_visitors():
    library = worlds_library()
    light = [card for card in library.models("car") if library.load(card).num_triangles <= 16_000]
    assert len(light) >= VISITORS["car"]


def test_all_installed_models_of_other_classes_stay_in_worlds():
    for use in set(USES) - set(KEPT_APART):
        assert worlds_library().models(use) == default_library().models(use)
