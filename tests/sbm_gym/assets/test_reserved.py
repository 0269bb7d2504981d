"""Models of photographs and models of worlds never meet where a class has enough."""

import numpy as np
import pytest

from sbm_gym.assets.catalog.library import default_library
from sbm_gym.assets.models.classes import COCO_CATEGORIES, FROM_SEEDS, NOVEL_CATEGORIES, OUTDOOR_CATEGORIES, USES
from sbm_gym.assets.parametric.builtin import BuiltinLibrary
from sbm_gym.assets.scene_models import (
    ENOUGH_MODELS,
    RESERVED_SHARE,
    MixedLibrary,
    indoor_library,
    kept_apart,
    too_small,
    worlds_library,
)
from sbm_gym.photographs.models import BUILTIN_SEEDS, SPLITS, PhotographLibrary, catalogue_models
from sbm_gym.worlds.towns.outdoor import MOVED_VEHICLES

KEPT_APART = [use for use, described in USES.items() if described.category in kept_apart()]


def models_of(category: str) -> set[str]:
    return {model for use in USES.values() if use.category == category for model in use.models}


def test_every_named_class_with_enough_models_is_kept_apart():
    for category in COCO_CATEGORIES + OUTDOOR_CATEGORIES:
        assert (category in kept_apart()) == (len(models_of(category)) >= ENOUGH_MODELS)
    assert not kept_apart() & set(NOVEL_CATEGORIES)


@pytest.mark.parametrize("use", KEPT_APART)
def test_photographs_and_worlds_share_no_model(use):
    train, val = (set(catalogue_models(use, split)) for split in SPLITS)
    worlds = {card.model_id for card in worlds_library().models(use)}
    assert not train & val
    assert not (train | val) & worlds
    assert train | val | worlds == set(USES[use].models)
    assert len(train | val) == round(RESERVED_SHARE * len(USES[use].models))
    assert train


@pytest.mark.parametrize("category", sorted(kept_apart()))
def test_every_class_kept_apart_has_models_in_all_three(category):
    uses = [use for use, described in USES.items() if described.category == category]
    for split in SPLITS:
        assert any(catalogue_models(use, split) for use in uses)
    # Worlds keep at least half, and enough to hold some back from training.
    assert 2 * sum(len(worlds_library().models(use)) for use in uses) >= len(models_of(category))


def test_worlds_can_still_hold_models_back_from_training():
    assert too_small(MixedLibrary(worlds_library())) == ()


def test_worlds_keep_enough_light_cars_for_visitors():
    library = worlds_library()
    light = [card for card in library.models("car") if library.load(card).num_triangles <= 16_000]
    assert len(light) >= MOVED_VEHICLES["car"]


def test_all_installed_models_of_other_classes_stay_in_worlds():
    for use in set(USES) - set(KEPT_APART):
        assert worlds_library().models(use) == default_library().models(use)


@pytest.mark.slow
def test_seeds_of_builtin_models_are_apart():
    """Worlds draw seeds below 2**31, photographs of either split above, from halves that do not meet."""

    def seeds(library, use):
        found = [card.model_id for card in library.models(use) if card.library == "builtin"]
        return {int(model_id.rpartition("-")[2]) for model_id in found}

    low, high = BUILTIN_SEEDS["train"], BUILTIN_SEEDS["val"]
    assert 2**31 <= low[0] < low[1] <= high[0] < high[1]
    for number in range(20):
        for split in SPLITS:
            drawn = seeds(PhotographLibrary(None, split, (0, number)), "dining_chair" if number % 2 else "couch")
            assert all(BUILTIN_SEEDS[split][0] <= seed < BUILTIN_SEEDS[split][1] for seed in drawn)
        for use in ("couch", *FROM_SEEDS):
            assert max(seeds(BuiltinLibrary(number), use)) < 2**31
    assert all(int(seed) < 2**31 for use in FROM_SEEDS for seed in seeds(indoor_library(), use))


@pytest.mark.slow
def test_recoloured_models_keep_their_shape():
    plain = default_library()
    library = PhotographLibrary(plain, "train", (3, 4))
    changed = 0
    for use in ("couch", "car", "floor_plant", "tv"):
        for card in library.models(use):
            if card.library == "builtin":
                continue
            before, after = plain.load(card), library.load(card)
            assert library.load(card) is after
            for old, new in zip(before.surfaces, after.surfaces, strict=True):
                assert new.vertices_m is old.vertices_m
                assert new.rgba[3] == old.rgba[3]
                assert np.all((np.array(new.rgba) >= 0) & (np.array(new.rgba) <= 1))
                changed += new.rgba != old.rgba
    assert changed
