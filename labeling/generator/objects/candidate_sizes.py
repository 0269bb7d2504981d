"""Posteriors of segmented candidates, once their size has had its say."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Int32

from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import Candidate
from labeling.generator.objects.object_sizes import SizeModel, measure_sizes


def with_sizes(
    cloud: Cloud, candidates: Sequence[Candidate], owner: Int32[np.ndarray, "n"], model: SizeModel
) -> list[Candidate]:
    """Candidates whose posterior knows their size; those without a posterior, and without points, are as they were.

    Args:
        cloud: the points of all views.
        candidates: objects.
        owner: which of them each point belongs to, -1 for none.
        model: sizes of categories.
    """
    sizes = measure_sizes(cloud.points, owner, range(len(candidates)))
    return [
        one if one.posterior is None or size is None else replace(one, posterior=model.posterior(one.posterior, size))
        for one, size in zip(candidates, sizes, strict=True)
    ]
