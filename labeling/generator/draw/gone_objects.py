"""Views in which objects are not where they were: they look through most of them.

What stands in one episode and not in others of its scene may be too thin, or seen by too few, to be told from what
stands still. What is left of it where it has gone are patches of the ground.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Int32
from numba import njit

from labeling.core.episode_labels import LabelledObject
from labeling.core.views import RgbdViews
from labeling.generator.cloud.free_space import looked_through
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.runtime.threads import in_threads

MISSES_PER_HIT = 2.5
"""An object is gone if a view looks through more than so many of its voxels for each that it shows. Chosen in training
towns and homes: from one on, plants are taken for gone where they let much be seen."""
MIN_MISSES = 8
"""A view that looks through fewer tells nothing."""


def gone_objects(
    cloud: Cloud, views: RgbdViews, owner: Int32[np.ndarray, "n"], objects: Sequence[LabelledObject]
) -> Bool[np.ndarray, "v k"]:
    """Which objects each view shows to be gone; never one that it is a source of.

    Args:
        cloud: the points.
        views: those that the cloud was made from.
        owner: the object that each point belongs to, -1 for none.
        objects: in that order.
    """
    num_objects = len(objects)
    owned = np.flatnonzero(owner >= 0)

    def gone_in(view: int) -> Bool[np.ndarray, "k"]:
        through = looked_through(cloud, views, owned, view)
        misses = np.bincount(owner[owned[through]], minlength=num_objects)
        hits = _hits(cloud.voxel_of_pixel[view], owner, num_objects)
        return (misses >= MIN_MISSES) & (misses > MISSES_PER_HIT * hits)

    gone = np.array(in_threads(gone_in, range(views.num_views))).reshape(views.num_views, num_objects)
    for k, one in enumerate(objects):
        gone[[source.view_index for source in one.sources], k] = False
    return gone


@njit(cache=True, nogil=True)
def _hits(voxels, owner, num_objects):  # pragma: no cover - compiled
    """How many voxels of each object a view shows: (k,) int64, for (h, w) int32 and (n,) int32."""
    hits = np.zeros(num_objects, np.int64)
    seen = np.zeros(len(owner), np.bool_)
    height, width = voxels.shape
    for y in range(height):
        for x in range(width):
            voxel = voxels[y, x]
            if voxel >= 0 and owner[voxel] >= 0 and not seen[voxel]:
                seen[voxel] = True
                hits[owner[voxel]] += 1
    return hits
