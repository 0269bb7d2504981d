"""Scene arithmetic: views of what A - B + C is, from views of A, B and C (thesis 2.6).

The memory of A without that of B and with that of C is to decode to the room in which what stands in B has been
exchanged for what stands in C. All of them are seen by the same cameras.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from labeling.memory.networks.grnn import Grnn
from labeling.memory.networks.tower import Tower
from labeling.memory.networks.view_batch import Cameras, Views
from labeling.memory.view_prediction.evaluation import Scores, drawn_views
from labeling.memory.view_prediction.reprojection import coloured_points, draw_points
from labeling.memory.view_prediction.scenes import SmallScene
from labeling.memory.view_prediction.scores import l1, picture_distances, psnr, retrieved, ssim

CHANGED = 0.1
"""A pixel has changed between A and the answer if one of its colours, in [0, 1], has by more."""
SAME_PLACE_M = 0.06
"""Points of A nearer to a point of B are what B shows, too."""


@dataclass(frozen=True, eq=False)
class Exchange:
    """Four scenes of the same room and the same cameras."""

    a: SmallScene
    b: SmallScene
    c: SmallScene
    answer: SmallScene
    """What A - B + C is."""


Combine = Callable[[Views, Views, Views, Cameras], Float[Tensor, "t 3 h w"]]
"""Pictures of cameras, from views of A, B and C."""


def combiner(network: Grnn | Tower, device: torch.device | str = "cpu") -> Combine:
    """What a network that decodes pictures makes of A - B + C in its memory."""

    def combine(a: Views, b: Views, c: Views, cameras: Cameras) -> Float[Tensor, "t 3 h w"]:
        asked = Cameras(cameras.intrinsics.to(device), cameras.camera_to_grid.to(device), cameras.size)
        with torch.inference_mode():
            if isinstance(network, Tower):
                first, second, third = (network.remember(one.to(device)) for one in (a, b, c))
                pictures = network.imagine(first - second + third, asked)
            else:
                known, without, added = (network.remember(one.to(device)) for one in (a, b, c))
                pictures = network.imagine(known.minus(without).plus(added), asked)
            return pictures[0].sigmoid().cpu()

    return combine


def combine_points(a: Views, b: Views, c: Views, cameras: Cameras) -> Float[Tensor, "t 3 h w"]:
    """The same without learning: coloured points of A that B does not show as well, and all of C, drawn."""
    from scipy.spatial import cKDTree

    (points, colours, sizes), (others, _, _), added = (coloured_points(one) for one in (a, b, c))
    new = cKDTree(others).query(points, distance_upper_bound=SAME_PLACE_M)[0] > SAME_PLACE_M
    return draw_points(
        np.concatenate([points[new], added[0]]),
        np.concatenate([colours[new], added[1]]),
        np.concatenate([sizes[new], added[2]]),
        cameras,
    )


def score_arithmetic(combine: Combine | None, exchanges: Sequence[Exchange], inputs: int, targets: int) -> Scores:
    """Scores of predicted pictures of the answer.

    Args:
        combine: what is scored; None for true pictures of A, as who does nothing would give.
        exchanges: held out.
        inputs: views of A, of B and of C that are given.
        targets: views of the answer that are predicted.

    Returns:
        ``l1``, ``psnr``, ``ssim`` and ``view_r1`` as ``score_pictures`` has them, and ``changed_l1``: L1 over pixels
        that differ between A and the answer, for views in which some do.
    """
    found: Scores = {name: [] for name in ("l1", "psnr", "ssim", "view_r1", "changed_l1")}
    for one in exchanges:
        given, asked = drawn_views(one.a, inputs, targets)
        before, true = (scene.views(asked, given[0]) for scene in (one.a, one.answer))
        rgb = true.rgb[0]
        if combine is None:
            predicted = before.rgb[0]
        else:
            a, b, c = (scene.views(given, given[0]) for scene in (one.a, one.b, one.c))
            predicted = combine(a, b, c, true).cpu()
        found["l1"] += l1(predicted, rgb).tolist()
        found["psnr"] += psnr(predicted, rgb).tolist()
        found["ssim"] += ssim(predicted, rgb).tolist()
        found["view_r1"] += retrieved(picture_distances(predicted, rgb)).astype(float).tolist()
        changed = (before.rgb[0] - rgb).abs().amax(dim=1) > CHANGED
        error = (predicted - rgb).abs().mean(dim=1)
        found["changed_l1"] += [float(error[k][changed[k]].mean()) for k in range(len(rgb)) if changed[k].any()]
    return found
