"""Views in which objects are not where they were: they look through most of them.

What stands in one episode and not in others of its scene may be too thin, or seen by too few, to be told from what
stands still. What is left of it where it has gone are patches of the ground.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Int, Int32
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
STILL_SHOWN = 0.25
"""What has moved is there in a view that shows this share of the voxels that its sources show (their median): it has
voxels in all places where it was for a while, and a view that shows it in one looks through those of the others.
"""


def gone_objects(
    cloud: Cloud,
    views: RgbdViews,
    owner: Int32[np.ndarray, "n"],
    objects: Sequence[LabelledObject],
    moves: Bool[np.ndarray, "k"] | None = None,
) -> Bool[np.ndarray, "v k"]:
    """Which objects each view shows to be gone; never one that it is a source of.

    Args:
        cloud: the points.
        views: those that the cloud was made from.
        owner: the object that each point belongs to, -1 for none.
        objects: in that order.
        moves: which of them have moved, if any have.
    """
    num_objects = len(objects)
    owned = np.flatnonzero(owner >= 0)

    def count_in(view: int) -> Int[np.ndarray, "2 k"]:
        through = looked_through(cloud, views, owned, view)
        hits = _hits(cloud.voxel_of_pixel[view], owner, num_objects)
        return np.array([hits, np.bincount(owner[owned[through]], minlength=num_objects)])

    hits, misses = np.stack(in_threads(count_in, range(views.num_views)), axis=1)
    gone = (misses >= MIN_MISSES) & (misses > MISSES_PER_HIT * hits)
    for k, one in enumerate(objects):
        sources = sorted({source.view_index for source in one.sources})
        if moves is not None and moves[k] and sources:
            gone[hits[:, k] >= max(1.0, STILL_SHOWN * np.median(hits[sources, k])), k] = False
        gone[sources, k] = False
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
