"""The builtin library: exact sizes, unit normals, varied by seed, the same for the same seed."""

import numpy as np
import pytest

from labeling.core.errors import UsageError
from sbm_gym.assets.catalog.library import default_library
from sbm_gym.assets.models.classes import COCO_CATEGORIES, FROM_SEEDS, NOVEL_CATEGORIES, USES
from sbm_gym.assets.parametric.builtin import RECIPES, BuiltinLibrary, builtin_card, builtin_model
from sbm_gym.assets.parametric.parts.paints import plain
from sbm_gym.assets.parametric.parts.shapes import Kit, corner_normals
from sbm_gym.assets.scene_models import held_out, indoor_library, models_of_scene, worlds_library

SEEDS = range(6)


@pytest.mark.slow
@pytest.mark.parametrize("use", list(RECIPES))
def test_bounds_are_the_stated_size_and_normals_are_unit(use):
    for seed in SEEDS:
        model = builtin_model(use, seed)
        vertices = np.concatenate([surface.vertices_m for surface in model.surfaces])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        np.testing.assert_allclose(high - low, model.size_m, atol=1e-5)
        np.testing.assert_allclose((low + high)[:2], 0, atol=1e-5)
        assert low[2] == pytest.approx(0, abs=1e-6)
        assert builtin_card(use, seed).size_m == model.size_m
        assert 10 <= model.num_triangles <= 7000
        for surface in model.surfaces:
            assert np.all(np.isfinite(surface.vertices_m))
            np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-4)
            assert (surface.texture is None) == (surface.texcoords is None)
            assert surface.faces.max() < len(surface.vertices_m)


@pytest.mark.parametrize("use", list(RECIPES))
def test_sizes_stay_in_their_ranges_and_seeds_differ(use):
    recipe = RECIPES[use]
    sizes = {builtin_card(use, seed).size_m for seed in range(12)}
    assert len(sizes) == 12
    for size in sizes:
        if recipe.adjust is None:
            for length, (low, high) in zip(size[::2], recipe.size_m[::2], strict=True):
                assert low - 0.03 <= length <= high + 0.03


@pytest.mark.parametrize("use", ["dining_chair", "double_bed", "floor_plant", "cushion"])
def test_the_same_seed_gives_the_same_model(use):
    first = builtin_model(use, 3)
    builtin_model.cache_clear()
    again = builtin_model(use, 3)
    assert first is not again
    for a, b in zip(first.surfaces, again.surfaces, strict=True):
        np.testing.assert_array_equal(a.vertices_m, b.vertices_m)
        np.testing.assert_array_equal(a.faces, b.faces)
        assert a.rgba == b.rgba


def test_normals_look_outward():
    """On closed convex things the normals agree with the direction from the middle."""
    kit = Kit()
    paint = plain((1, 0, 0))
    kit.box(paint, (0, 0, 0), (1, 2, 3), bevel=0.1, puff=0.05)
    model = kit.finish("box", (1.0, 2.0, 3.0))
    surface = model.surfaces[0]
    assert np.all(np.einsum("vk,vk->v", surface.vertices_m - [0, 0, 1.5], surface.normals) > 0)
    kit = Kit()
    kit.lathe(paint, [0, 1, 1, 0], [0, 0, 1, 1])
    surface = kit.finish("drum", (2.0, 2.0, 1.0)).surfaces[0]
    assert np.all(np.einsum("vk,vk->v", surface.vertices_m - [0, 0, 0.5], surface.normals) > 0)
    kit = Kit()
    kit.tube(paint, [(0, 0, 0), (0, 0, 1)], 0.2)
    surface = kit.finish("rod", (0.4, 0.4, 1.0)).surfaces[0]
    assert np.all(np.einsum("vk,vk->v", surface.vertices_m - [0, 0, 0.5], surface.normals) > 0)


def test_creases_stay_and_round_parts_are_smooth():
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]]], float)
    up = np.array([[[1, 0, 0], [1, 0, 1], [1, 1, 0]]], float)
    both = np.concatenate([square, up])
    np.testing.assert_allclose(corner_normals(both)[0], [[0, 0, 1]] * 3, atol=1e-12)
    smooth = corner_normals(both, np.pi)
    np.testing.assert_allclose(smooth[0, 0], [0, 0, 1], atol=1e-12)
    assert abs(smooth[0, 1, 2]) < 0.99


@pytest.mark.parametrize("use", ["dining_chair", "office_chair", "lounge_chair", "couch", "double_bed", "toilet"])
def test_backs_are_higher_than_fronts(use):
    for seed in SEEDS:
        model = builtin_model(use, seed)
        _, depth, height = model.size_m
        vertices = np.concatenate([surface.vertices_m for surface in model.surfaces])
        back = vertices[vertices[:, 1] > 0.1 * depth, 2].max()
        front = vertices[vertices[:, 1] < -0.3 * depth, 2].max()
        assert back > front + 0.02 * height


def test_every_indoor_class_is_there():
    library = BuiltinLibrary(5)
    served = {card.category for use in USES for card in library.models(use)}
    assert {*COCO_CATEGORIES, *NOVEL_CATEGORIES} <= served


def test_other_seeds_offer_other_models():
    first, second = BuiltinLibrary(1), BuiltinLibrary(2)
    assert first.models("couch") == BuiltinLibrary(1).models("couch")
    assert not {c.model_id for c in first.models("couch")} & {c.model_id for c in second.models("couch")}
    card = first.models("couch")[0]
    assert first.load(card).model_id == card.model_id


@pytest.mark.parametrize(("use", "seed"), [("spaceship", 0), ("couch", -1)])
def test_unknown_models_are_refused(use, seed):
    with pytest.raises(UsageError, match="builtin"):
        builtin_model(use, seed)


def test_foreign_cards_are_refused():
    with pytest.raises(UsageError, match="not a builtin model"):
        BuiltinLibrary().load(default_library().models("couch")[0])


def test_catalogues_are_joined_by_what_they_lack():
    library = indoor_library()
    for use, count in FROM_SEEDS.items():
        assert len(library.models(use)) == len(default_library().models(use)) + count
        card = library.models(use)[-1]
        assert library.load(card).model_id == card.model_id
    assert library.models("couch") == worlds_library().models("couch")


@pytest.mark.parametrize("library", [indoor_library(), BuiltinLibrary(3, variants=24)], ids=["mixed", "builtin"])
def test_parts_share_no_model_and_cover_all(library):
    training, rest = (models_of_scene(library, held_out_scene, unseen_models=True) for held_out_scene in (False, True))
    for use, described in USES.items():
        a, b = ({card.model_id for card in part.models(use)} for part in (training, rest))
        everything = {card.model_id for card in library.models(use)}
        if described.category is None:
            assert a == b == everything
        else:
            assert not a & b or len(everything) == 1
            assert a | b == everything
            assert held_out(library.models(use)) >= b or len(everything) == 1
