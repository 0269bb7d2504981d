"""Films show what the detector says of each view."""

import gymnasium as gym
import numpy as np

from experiments.figures.films import SHOWN, SURE, UNSURE, DetectionsDrawn, with_detections
from labeling.core.types import Detection


def detection(confidence: float, rows: slice, columns: slice) -> Detection:
    mask = np.zeros((24, 32), bool)
    mask[rows, columns] = True
    return Detection(view_index=0, category="chair", confidence=confidence, mask=mask)


def test_outlines_lie_where_masks_of_another_size_do():
    rgb = np.full((96, 128, 3), 100, np.uint8)
    sure, unsure = detection(0.95, slice(2, 20), slice(1, 12)), detection(0.6, slice(4, 20), slice(20, 30))
    faint = detection(SHOWN - 0.01, slice(0, 24), slice(13, 18))
    drawn = with_detections(rgb, [sure, unsure, faint])
    assert (rgb == 100).all()
    for colour, left, right in ((SURE, 4, 48), (UNSURE, 80, 120)):
        rows, columns = np.nonzero((drawn == colour).all(axis=2))
        assert abs(columns.min() - left) <= 2
        assert abs(columns.max() - right) <= 2
        assert len(rows) > 80
    assert (drawn[:, 56:70] == 100).all()


class Still(gym.Env):
    """Shows the same picture always; one detection before the first step, none after."""

    render_mode = "rgb_array"

    def reset(self, **options):
        return 0, {"detections": [detection(0.95, slice(4, 20), slice(4, 20))]}

    def step(self, action):
        return 0, 0.0, False, False, {"detections": []}

    def render(self):
        return np.full((24, 32, 3), 100, np.uint8)


def test_each_picture_has_the_detections_of_its_own_view():
    env = DetectionsDrawn(Still())
    env.reset()
    assert (env.render() == SURE).all(axis=2).any()
    env.step(0)
    assert (env.render() == 100).all()
