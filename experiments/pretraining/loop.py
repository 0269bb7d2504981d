"""Pre-trains ``compact``: cosine over a number of steps or a span of time, small views first."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from experiments.pretraining.augmentation import PretrainAugmentConfig, stream
from labeling.core.errors import UsageError
from labeling.core.masks import MASK_THRESHOLD
from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.detectors.finetuning.dataset import Batch
from labeling.detectors.finetuning.training import MaskRcnnTask
from labeling.detectors.networks.mask_rcnn import Network
from labeling.detectors.networks.network_detector import NetworkDetector
from labeling.detectors.networks.weights import save_network
from labeling.detectors.scoring import evaluate
from labeling.runtime.ranges import Positive, Share, ShareBelowOne
from labeling.training import loop
from labeling.training.checkpoint import Progress
from labeling.training.config import TrainingConfig

WEIGHTS_FILE = "pretrained.safetensors"
MIN_SIDE_PX = 64
_LONGEST_STEP_S = 60.0
"""Whatever takes longer was a pause: a process that was stopped, a machine that slept."""
_VALIDATION_PICTURES = 200
"""Held-out photographs that are scored on the way."""


@dataclass(frozen=True)
class PretrainConfig(TrainingConfig):
    """How long and how fast the network learns."""

    iterations: Positive[int] = 6000
    """Batches at most."""
    minutes: Positive[float] = 90.0
    """Time for training; the learning rate reaches its end when either time or batches are used up. Runs that must be
    the same on every machine need more minutes than they take."""
    batch_size: Positive[int] = 16
    """Views in a batch."""
    learning_rate: Positive[float] = 1e-3
    """Of AdamW; the trunk, which knows ImageNet, learns at a third of it."""
    weight_decay: float = 0.01
    warmup: int = 100
    """Batches over which the learning rate rises."""
    sides: tuple[tuple[int, ...], ...] = ((128,), (128, 160), (160, 192), (192, 224))
    """Sides of views in each quarter of training, pixels: small ones teach more a minute, large ones more detail."""
    average: ShareBelowOne[float] = 0.995
    """Decay per batch of the running average of the weights, which is what is kept."""
    frozen_stages: int = 4
    """So many parts of the trunk stay as ImageNet made them; see ``Network.freeze``."""
    settle: Share[float] = 0.9
    """From this share of training on batch normalisation keeps its statistics."""
    checkpoint_minutes: Positive[float] = 4.0
    """Between checkpoints."""
    validate_every: Positive[int] = 250
    """Batches between looks at held-out photographs, which steer nothing."""

    def check(self) -> None:
        """Refuses settings that make no sense.

        Raises:
            UsageError: naming the setting.
        """
        super().check()
        if not self.sides or any(side < MIN_SIDE_PX for sides in self.sides for side in sides):
            raise UsageError(f"--sides must be {MIN_SIDE_PX} pixels or more, not {self.sides}")


class PretrainTask(MaskRcnnTask):
    """Pre-training on rendered photographs. An epoch ends when a checkpoint is due, or normalisation is to settle."""

    config: PretrainConfig
    weights_file = WEIGHTS_FILE

    def __init__(
        self,
        network: Network,
        photographs: Sequence[AnnotatedPicture],
        held_out: Sequence[AnnotatedPicture],
        config: PretrainConfig,
        views: PretrainAugmentConfig,
    ) -> None:
        """Sets a pre-training up.

        Args:
            network: trunk with ImageNet weights, the rest random; changed.
            photographs: to learn from.
            held_out: scored at times; nothing is chosen by them.
            config: settings of training.
            views: settings of augmentation.

        Raises:
            UsageError: if settings make no sense, or there is no photograph.
        """
        config.check()
        if not photographs:
            raise UsageError("there is no photograph to train on")
        super().__init__(network, config.average)
        self.config, self.photographs, self.views = config, photographs, views
        self.validation = list(held_out[:: max(len(held_out) // _VALIDATION_PICTURES, 1)])
        self.optimizer = make_optimizer(network, config)
        # A run may be given more or less time on the way.
        free = ("minutes", "iterations", "checkpoint_minutes", "validate_every")
        fixed = {name: value for name, value in asdict(config).items() if name not in free}
        self.identity = {"train": fixed, "views": asdict(views), "photographs": len(photographs)}

    def share_done(self, progress: Progress) -> float:
        """Of all steps or of all of the time, whichever is more."""
        return share_of_training(progress, self.config)

    def is_finished(self, progress: Progress) -> bool:
        """When all steps or all of the time is used up."""
        return share_of_training(progress, self.config) >= 1.0

    def batches(self, progress: Progress) -> Iterator[Batch]:
        """Up to the next checkpoint. Time goes by while they are trained on: validation and pauses cost none."""
        unsettled = share_of_training(progress, self.config) < self.config.settle
        self.network.frozen_statistics = not unsettled
        return self._timed_batches(progress, unsettled)

    def _timed_batches(self, progress: Progress, unsettled: bool) -> Iterator[Batch]:
        config, began, self._last = self.config, progress.minutes, time.monotonic()
        batches = stream(
            self.photographs,
            self.network.spec.categories,
            self.views,
            config.batch_size,
            config.seed,
            progress.iteration,
            lambda step: side_of(self._share_of_training(progress), step, config),
        )
        for batch in batches:
            yield batch
            share = self._share_of_training(progress)
            is_due = progress.minutes - began >= config.checkpoint_minutes
            if is_due or share >= 1.0 or (unsettled and share >= config.settle):
                return

    def _share_of_training(self, progress: Progress) -> float:
        """``share_of_training``, after adding the time since the last look at the clock."""
        now = time.monotonic()
        progress.minutes += min(now - self._last, _LONGEST_STEP_S) / 60
        self._last = now
        return share_of_training(progress, self.config)

    def learning_rate(self, progress: Progress) -> float:
        """Warm-up, then cosine over all steps or all of the time."""
        share, config = self._share_of_training(progress), self.config
        return loop.scheduled_rate(config.learning_rate, progress.iteration, config.warmup, share)

    def position(self, progress: Progress) -> dict[str, float]:
        """Steps and minutes."""
        return {"step": progress.iteration, "minutes": round(progress.minutes, 2)}

    def validate(self, progress: Progress) -> dict[str, Any]:
        """AP50 of masks on some of the held-out photographs, at times."""
        scored = max((past["step"] for past in progress.history if "ap50" in past), default=0)
        is_due = progress.iteration - scored >= self.config.validate_every or self.is_finished(progress)
        if not (self.validation and is_due):
            return {}
        detector = NetworkDetector(self.candidate, "pretraining", mask_threshold=MASK_THRESHOLD)
        return {"ap50": evaluate(detector, self.validation).mask_ap50 or 0.0}

    def save(self, path: Path, progress: Progress) -> None:
        """Writes the averaged weights."""
        save_network(path, self.candidate)

    def summary(self, record: Mapping[str, Any], progress: Progress) -> str:
        """All figures."""
        return ", ".join(f"{k} {v:.3f}" if isinstance(v, float) else f"{k} {v}" for k, v in record.items())


def share_of_training(progress: Progress, config: PretrainConfig) -> float:
    """Share of training that is over: of its batches or of its time, whichever is more."""
    return max(progress.iteration / config.iterations, progress.minutes / config.minutes)


def side_of(share: float, step: int, config: PretrainConfig) -> int:
    """Side of the square views of a batch, pixels, by the share of training that is over and the batch's number."""
    phase = min(int(share * len(config.sides)), len(config.sides) - 1)
    choices = config.sides[phase]
    return choices[int(np.random.default_rng((config.seed, 4, step)).integers(len(choices)))]


def make_optimizer(network: Network, config: PretrainConfig) -> torch.optim.Optimizer:
    """AdamW; the trunk learns more slowly, vectors (biases, normalisation) do not decay."""
    network.freeze(config.frozen_stages)
    trunk = {id(value) for value in network.backbone.trunk.parameters()}
    groups: dict[tuple[bool, bool], list[torch.Tensor]] = {}
    for value in network.parameters():
        if value.requires_grad:
            groups.setdefault((id(value) in trunk, value.ndim > 1), []).append(value)
    return torch.optim.AdamW(
        [
            {"params": values, "weight_decay": config.weight_decay if decays else 0.0, "share": 1 / 3 if known else 1.0}
            for (known, decays), values in groups.items()
        ],
        lr=config.learning_rate,
    )
