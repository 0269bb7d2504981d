"""Training a network: ``train_one_epoch`` and ``evaluate``, two plain functions.

Source: torchvision's references/detection. An epoch here is the stretch between two validations.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from labeling.core.detector import Detector
from labeling.core.errors import SbmError
from labeling.core.rle import encode_mask
from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.detectors.finetuning.batches import Batch, to_device
from labeling.detectors.finetuning.train_config import TrainConfig
from labeling.detectors.networks.calibration import fit_calibration, outcomes
from labeling.detectors.networks.mask_rcnn import Network
from labeling.detectors.networks.network_detector import NetworkDetector
from labeling.detectors.networks.spec import Calibration
from labeling.metrics.mask_ap import average_precision
from labeling.metrics.matching import MaskInstance


@dataclass(frozen=True)
class Scores:
    """How well a detector does on annotated pictures; in [0, 1], None where undefined."""

    mask_ap50: float | None
    mask_ap30: float | None
    box_ap50: float | None
    box_ap30: float | None
    per_class_ap50: dict[str, float | None]
    """Of masks, as ``per_class_ap30``."""
    per_class_ap30: dict[str, float | None]
    pictures: int
    objects: int


def train_one_epoch(
    network: Network,
    optimizer: torch.optim.Optimizer,
    stream: Iterable[Batch],
    rate: Callable[[int], float],
    first: int,
    config: TrainConfig,
    averaged: Network | None = None,
    scaler: torch.amp.GradScaler | None = None,
    on_step: Callable[[int, dict[str, float]], None] = lambda step, losses: None,
) -> dict[str, float]:
    """Takes one step for each batch.

    Args:
        network: on its device; left in training mode.
        optimizer: of its parameters; a group with a ``share`` learns at that share of the rate.
        stream: batches.
        rate: learning rate at a step.
        first: number of the first step. Each step seeds torch's generator with it, so that a run that goes on from a
            checkpoint samples the same anchors as one that was never stopped.
        config: settings.
        averaged: network that holds the running average, if there is to be one.
        scaler: for mixed precision on CUDA.
        on_step: told the step and its losses.

    Returns:
        Mean of each loss.

    Raises:
        SbmError: if the loss is no longer a number.
    """
    device = network.device
    network.train()
    total: dict[str, float] = {}
    steps = 0
    for step, batch in enumerate(stream, start=first):
        torch.manual_seed(config.seed * 1_000_003 + step)
        for group in optimizer.param_groups:
            group["lr"] = rate(step) * group.get("share", 1.0)
        pictures, sizes, targets = to_device(batch, device)
        with torch.autocast(device.type, torch.float16, enabled=scaler is not None):
            losses = network(pictures, sizes, targets)
            loss = torch.stack([value.float() for value in losses.values()]).sum()
        if not bool(torch.isfinite(loss)):
            raise SbmError(f"training broke down in step {step}: the loss is {loss.item()}; lower --learning-rate")
        optimizer.zero_grad(set_to_none=True)
        scale = scaler or torch.amp.GradScaler(device.type, enabled=False)
        scale.scale(loss).backward()
        scale.unscale_(optimizer)
        torch.nn.utils.clip_grad_norm_(network.parameters(), config.clip)
        scale.step(optimizer)
        scale.update()
        if averaged is not None:
            _follow(averaged, network, min(config.average, (1 + step) / (10 + step)))
        values = {name: float(value.detach()) for name, value in losses.items()} | {"loss": float(loss.detach())}
        for name, value in values.items():
            total[name] = total.get(name, 0.0) + value
        steps += 1
        on_step(step, values)
    return {name: value / max(1, steps) for name, value in total.items()}


@torch.no_grad()
def _follow(averaged: Network, network: Network, decay: float) -> None:
    for mean, value in zip(averaged.state_dict().values(), network.state_dict().values(), strict=True):
        if value.is_floating_point():
            mean.lerp_(value, 1 - decay)
        else:
            mean.copy_(value)


def evaluate(
    detector: Detector,
    pictures: Sequence[AnnotatedPicture],
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> Scores:
    """Scores a detector: ranked AP of masks and boxes, over the categories that it and the annotations share.

    Args:
        detector: any.
        pictures: with ground truth, or whatever is to count as such.
        progress: wraps the sequence of batches, to draw a progress bar.
    """
    truths, found = detect_all(detector, pictures, progress)
    masks, boxes = (average_precision(found, truths, (0.5, 0.3), kind) for kind in ("mask", "box"))
    return Scores(
        mask_ap50=masks.mean[0.5],
        mask_ap30=masks.mean[0.3],
        box_ap50=boxes.mean[0.5],
        box_ap30=boxes.mean[0.3],
        per_class_ap50={name: ap[0.5] for name, ap in masks.per_class.items()},
        per_class_ap30={name: ap[0.3] for name, ap in masks.per_class.items()},
        pictures=len(pictures),
        objects=sum(not truth.ignore for truth in truths),
    )


def detect_all(
    detector: Detector,
    pictures: Sequence[AnnotatedPicture],
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> tuple[list[MaskInstance], list[MaskInstance]]:
    """Ground truth and findings of all pictures, of the categories that the detector has names for.

    Findings of categories that are annotated nowhere are left out: nothing is known about them.
    """
    known = None if detector.categories is None else set(detector.categories)
    truths = [
        MaskInstance(index, one.category, one.rle, ignore=one.ignore)
        for index, picture in enumerate(pictures)
        for one in picture.annotations
        if known is None or one.category in known
    ]
    shared = {truth.category for truth in truths}
    found: list[MaskInstance] = []
    for group in progress(list(_groups(pictures, detector.batch_size))):
        rgb = np.stack([pictures[index].rgb() for index in group])
        for index, detections in zip(group, detector.detect(rgb), strict=True):
            found.extend(
                MaskInstance(index, category, encode_mask(mask), float(score))
                for category, score, mask in zip(
                    detections.categories, detections.scores, detections.masks, strict=True
                )
                if category in shared and mask.any()
            )
    return truths, found


def calibrate(network: Network, pictures: Sequence[AnnotatedPicture], device: str = "cpu") -> Calibration:
    """The calibration that makes a network's confidences the share of its detections that are right, on pictures it
    was not trained on.

    Its own calibration is disregarded. Save with ``network.spec.with_calibration(...)``.
    """
    raw = NetworkDetector(network, "calibration", device=device, calibration=Calibration())
    truths, found = detect_all(raw, pictures)
    return fit_calibration(*outcomes(found, truths))


def _groups(pictures: Sequence[AnnotatedPicture], size: int) -> Iterable[list[int]]:
    """Indices of pictures of one size, so many at a time."""
    of_size: dict[tuple[int, int], list[int]] = {}
    for index, picture in enumerate(pictures):
        of_size.setdefault(picture.size, []).append(index)
    for indices in of_size.values():
        for start in range(0, len(indices), size):
            yield indices[start : start + size]


def make_optimizer(network: Network, config: TrainConfig, new_categories: bool = False) -> torch.optim.Optimizer:
    """The optimizer; vectors (biases, normalisation) do not decay.

    Args:
        network: to train.
        config: settings.
        new_categories: whether the last layers of the heads learn categories from the start, at a rate of their own.
    """
    groups = []
    for last in (False, True):
        found = [
            value for name, value in network.named_parameters() if value.requires_grad and ("predictor" in name) == last
        ]
        share = config.new_rate if last and new_categories else 1.0
        groups += [
            {"params": [one for one in found if one.ndim > 1], "weight_decay": config.weight_decay, "share": share},
            {"params": [one for one in found if one.ndim <= 1], "weight_decay": 0.0, "share": share},
        ]
    if config.optimizer == "adamw":
        return torch.optim.AdamW(groups, lr=config.learning_rate)
    return torch.optim.SGD(groups, lr=config.learning_rate, momentum=0.9)


def learning_rate(step: int, config: TrainConfig) -> float:
    """Rises linearly during the warm-up; then stays, or falls as a cosine to a hundredth."""
    rise = min(1.0, (step + 1) / config.warmup) if config.warmup else 1.0
    if config.schedule == "constant":
        return config.learning_rate * rise
    share = min(1.0, step / config.iterations)
    return config.learning_rate * rise * (0.01 + 0.99 * 0.5 * (1 + float(np.cos(np.pi * share))))
