"""Scores of predicted views of held-out scenes."""

import zlib
from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.networks.view_batch import Cameras, Views
from labeling.memory.networks.weights import Memory
from labeling.memory.view_prediction.scenes import SmallScene
from labeling.memory.view_prediction.scores import l1, picture_distances, psnr, retrieved, ssim

RETRIEVED_PIXELS = 256
"""Of each view, that are to be found again among those of all views of the scene."""
Predict = Callable[[Views, Cameras], Float[Tensor, "t 3 h w"]]
"""Pictures of cameras, from views of one scene."""
Scores = dict[str, list[float]]
"""By figure, a value for each predicted view."""


def drawn_views(scene: SmallScene, inputs: int, targets: int) -> tuple[list[int], list[int]]:
    """Views to remember and to predict of a scene that is not learnt from: by its name, the same whoever predicts.

    With more inputs come views in addition, and targets stay the same.
    """
    rng = np.random.default_rng(zlib.crc32(scene.name.encode()))
    order = rng.permutation(scene.num_views).tolist()
    count = min(targets, scene.num_views - 1)
    return order[count : count + inputs], order[:count]


def score_pictures(predict: Predict, scenes: Sequence[SmallScene], inputs: int, targets: int) -> Scores:
    """Scores of predicted pictures.

    Args:
        predict: what is scored.
        scenes: held out.
        inputs: views that are given.
        targets: views of each scene that are predicted; the right one of them is to be found by its prediction.

    Returns:
        ``l1``, ``psnr``, ``ssim``, and ``view_r1``: 1 where the true view nearest to the prediction is the right one.
    """
    found: Scores = {name: [] for name in ("l1", "psnr", "ssim", "view_r1")}
    for scene in scenes:
        given, asked = drawn_views(scene, inputs, targets)
        true = scene.views(asked, given[0])
        predicted = predict(scene.views(given, given[0]), true).cpu()
        rgb = true.rgb[0]
        found["l1"] += l1(predicted, rgb).tolist()
        found["psnr"] += psnr(predicted, rgb).tolist()
        found["ssim"] += ssim(predicted, rgb).tolist()
        found["view_r1"] += retrieved(picture_distances(predicted, rgb)).astype(float).tolist()
    return found


def score_features(
    network: Cn3d, scenes: Sequence[SmallScene], inputs: int, targets: int, device: torch.device | str = "cpu"
) -> Scores:
    """Scores of predicted features.

    Returns:
        ``pixel_r1``: share of a view's pixels whose top-down feature is nearest to the bottom-up one of the same pixel,
        of ``RETRIEVED_PIXELS`` of each view of the scene; ``chance`` of that; and ``view_r1`` as for pictures.
    """
    found: Scores = {name: [] for name in ("pixel_r1", "chance", "view_r1")}
    for scene in scenes:
        given, asked = drawn_views(scene, inputs, targets)
        true = scene.views(asked, given[0]).to(device)
        with torch.inference_mode():
            top_down = network(scene.views(given, given[0]).to(device), true)[0].cpu()
            bottom_up = network.look(true.rgb)[0].cpu()
        found["view_r1"] += retrieved(picture_distances(top_down, bottom_up)).astype(float).tolist()
        count = min(RETRIEVED_PIXELS, top_down.shape[2] * top_down.shape[3])
        places = np.random.default_rng(8).permutation(top_down.shape[2] * top_down.shape[3])[:count]
        top, bottom = (maps.flatten(2)[:, :, places].movedim(1, 2).flatten(0, 1) for maps in (top_down, bottom_up))
        right = (top @ bottom.T).argmax(dim=1) == torch.arange(len(top))
        found["pixel_r1"] += right.float().reshape(len(asked), count).mean(dim=1).tolist()
        found["chance"] += [1 / len(top)] * len(asked)
    return found


def predictor(network: Memory, device: torch.device | str = "cpu") -> Predict:
    """A network that decodes pictures, as what ``score_pictures`` scores."""

    def predict(views: Views, cameras: Cameras) -> Float[Tensor, "t 3 h w"]:
        asked = Cameras(cameras.intrinsics.to(device), cameras.camera_to_grid.to(device), cameras.size)
        with torch.inference_mode():
            return network(views.to(device), asked)[0].sigmoid().cpu()

    return predict


def evaluate(
    network: Memory, scenes: Sequence[SmallScene], inputs: int, targets: int, device: torch.device | str = "cpu"
) -> Scores:
    """Scores of a network of any kind; see ``score_pictures`` and ``score_features``."""
    was_training = network.training
    network.eval()
    try:
        if isinstance(network, Cn3d):
            return score_features(network, scenes, inputs, targets, device)
        return score_pictures(predictor(network, device), scenes, inputs, targets)
    finally:
        network.train(was_training)
