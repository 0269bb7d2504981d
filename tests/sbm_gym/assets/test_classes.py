"""The class map against the libraries that the project's set-up installs."""

import numpy as np
import pytest

from sbm_gym.assets.catalog.library import Home3dLibrary, default_library
from sbm_gym.assets.credits import credits_text
from sbm_gym.assets.models.classes import COCO_CATEGORIES, EXCLUDED, MAX_TRIANGLES, THINNED, USES


@pytest.fixture(scope="module")
def library() -> Home3dLibrary:
    return default_library()


def test_every_mapped_model_is_in_the_libraries(library):
    for use, described in USES.items():
        assert [card.model_id for card in library.models(use)] == list(described.models)


def test_no_model_has_two_uses_or_is_both_mapped_and_excluded():
    mapped = [model for described in USES.values() for model in described.models]
    assert len(mapped) == len(set(mapped))
    assert not set(mapped) & set(EXCLUDED)
    assert all(reason for reason in EXCLUDED.values())


def test_excluded_models_exist(library):
    known = {entry.model_id for source in library.libraries for entry in source.entries}
    assert set(EXCLUDED) <= known


def test_the_eight_classes_have_models(library):
    categories = [card.category for card in library.cards()]
    assert all(categories.count(category) >= 3 for category in COCO_CATEGORIES)


def assert_sizes_of_the_catalogue(library, use, cards):
    for card in cards:
        model = library.load(card)
        vertices = np.concatenate([surface.vertices_m for surface in model.surfaces])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        assert model.size_m == pytest.approx(card.size_m)
        # Thinned trees have fewer and larger leaves, and none near the ground.
        tolerance = 0.2 if use in THINNED else 0.01
        np.testing.assert_allclose(high - low, card.size_m, rtol=tolerance)
        np.testing.assert_allclose((low + high)[:2] / 2, 0, atol=tolerance * max(card.size_m))
        assert low[2] == pytest.approx(0, abs=0.01 * card.size_m[2])
        assert model.num_triangles <= (2 * THINNED[use] if use in THINNED else MAX_TRIANGLES)
        assert library.triangles(card) == model.num_triangles
        for surface in model.surfaces:
            np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-3)
            assert (surface.texture is None) == (surface.texcoords is None)
            if surface.texture is not None:
                assert max(surface.texture.shape[:2]) <= 512


@pytest.mark.parametrize("use", list(USES))
def test_converted_models_have_the_catalogues_size(library, use):
    assert_sizes_of_the_catalogue(library, use, library.models(use)[:1])


@pytest.mark.nightly
@pytest.mark.parametrize("use", list(USES))
def test_all_converted_models_have_the_catalogues_size(library, use):
    assert_sizes_of_the_catalogue(library, use, library.models(use))


@pytest.mark.parametrize("use", ["dining_chair", "office_chair", "lounge_chair", "couch", "double_bed", "toilet"])
def test_backs_are_higher_than_fronts(library, use):
    """Between their arms, chairs, couches, beds and toilets rise to the back: a model facing another way would not."""
    for card in library.models(use)[:8]:
        vertices = np.concatenate([surface.vertices_m for surface in library.load(card).surfaces])
        width, depth, height = card.size_m
        middle = vertices[np.abs(vertices[:, 0]) < 0.3 * width]
        back = middle[middle[:, 1] > 0.1 * depth, 2].max()
        front = middle[middle[:, 1] < -0.3 * depth, 2].max()
        assert back > front + 0.02 * height, card.model_id


def test_credits_name_creator_and_licence_of_every_model(library):
    text = credits_text(library)
    for card in library.cards():
        line = next(line for line in text.splitlines() if f"`{card.model_id}`" in line)
        assert card.creator in line
        assert card.licence in text
