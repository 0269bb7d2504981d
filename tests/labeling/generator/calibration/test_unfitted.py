"""Labels without anything that was fitted to ground truth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labeling.core.episode_labels import EpisodeLabels
from labeling.generator.calibration.detector_calibration import DetectorCalibration, calibration_of
from labeling.generator.calibration.unfitted import UNFITTED_OBJECTS, calibration_for
from labeling.generator.objects.object_posterior import PlaceObservations
from labeling.generator.propagate import propagate
from labeling.generator.settings.presets import PRESETS

from ...synthetic_room import make_episode


@given(st.lists(st.tuples(st.floats(0.03, 0.97), st.floats(0.03, 0.97)), min_size=1, max_size=6))
def test_the_odds_of_a_category_are_those_of_its_highest_confidence(looks):
    confidence = {
        name: np.array(values) for name, values in zip(("bed", "chair"), zip(*looks, strict=True), strict=True)
    }
    far = np.arange(3 * len(looks), dtype=float).reshape(-1, 3) + 1
    found = UNFITTED_OBJECTS.posterior(PlaceObservations(confidence, np.full(len(looks), 0.2), far))
    odds = {name: max(values) / (1 - max(values)) for name, values in confidence.items()}
    assert found == pytest.approx({name: one / (1 + sum(odds.values())) for name, one in odds.items()})


@pytest.mark.parametrize("preset", ["default", "unfitted", "paper", "released"])
def test_only_who_asks_for_nothing_fitted_gets_it(preset):
    fitted = preset == "default"
    assert (calibration_for("compact", PRESETS[preset]).objects is UNFITTED_OBJECTS) != fitted
    for name, value in {"class_sizes": True, "calibrate": True}.items():
        changed = replace(PRESETS["unfitted"], **{name: value})
        assert calibration_for("compact", changed) is calibration_of("compact")


def test_what_is_fitted_has_no_say_in_unfitted_labels():
    """Spoilt models of all that is fitted change nothing."""
    episode, config = make_episode(3, num_views=4, size=(48, 64), num_objects=3), PRESETS["unfitted"]
    found = calibration_for("compact", config)
    spoilt = DetectorCalibration(
        found.objects,
        replace(found.labels, knots=np.zeros_like(found.labels.knots)),
        replace(found.sizes, weight=-7.0, intercept=9.0),
    )
    labels, again = (propagate(episode, episode.detections, config, one) for one in (found, spoilt))
    assert labels.labels
    assert _told(labels) == _told(again)
    seen = [one for one in episode.detections or () if one.confidence >= PRESETS["unfitted"].min_posterior]
    assert {one.category for one in labels.labels} <= {one.category for one in seen}


def _told(labels: EpisodeLabels) -> list:
    return [(one.view_index, one.category, one.confidence, int(one.modal.sum())) for one in labels.labels]
