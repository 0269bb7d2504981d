"""Views in which objects are gone: what moves is not gone from those that show it in one of its places."""

from collections.abc import Sequence

import numpy as np

from labeling.core.episode_labels import LabelledObject, Source
from labeling.core.views import RgbdViews
from labeling.generator.cloud.voxel_cloud import build_cloud
from labeling.generator.draw.gone_objects import gone_objects

SIZE = (48, 96)
WALL_M, PLATE_M, VOXEL_M = 4.0, 2.0, 0.04
K = np.array([[60.0, 0, 47.5], [0, 60.0, 23.5], [0, 0, 1]])


def gone_from(plates: Sequence[slice], sources: Sequence[int], moves: bool) -> set[int]:
    """The views in which a plate is gone that stands in these columns of each view, before a wall."""
    depth_m = np.full((len(plates), *SIZE), WALL_M, np.float32)
    plate = np.zeros(depth_m.shape, bool)
    for view, columns in enumerate(plates):
        plate[view, 14:34, columns] = True
    depth_m[plate] = PLATE_M
    same = [np.repeat(one[None], len(plates), axis=0) for one in (K, np.eye(4))]
    views = RgbdViews(np.zeros((*depth_m.shape, 3), np.uint8), depth_m, *same)
    cloud = build_cloud(views, VOXEL_M)
    owner = np.full(cloud.num_points, -1, np.int32)
    owner[cloud.voxel_of_pixel[plate]] = 0
    known = tuple(Source(view, 0.9, "plate") for view in sources)
    thing = LabelledObject(instance_id=1, category="plate", confidence=1.0, box_3d=None, sources=known)
    (found,) = gone_objects(cloud, views, owner, [thing], np.array([moves])).T
    return set(np.flatnonzero(found).tolist())


PLACES = [slice(0, 16), slice(16, 32), slice(32, 48), slice(48, 64), slice(64, 80), slice(0, 0), slice(0, 3)]
"""It stands in a place of its own in five views, has left the sixth, and is cut off, but for a fifth, in the last."""


def test_what_moves_is_there_in_every_view_that_shows_it() -> None:
    """Four of its five places are free in each of these views."""
    assert gone_from(PLACES, sources=(1, 3), moves=True) == {5, 6}


def test_what_stands_is_gone_from_views_that_look_through_most_of_it() -> None:
    assert gone_from(PLACES, sources=(1, 3), moves=False) == {0, 2, 4, 5, 6}
