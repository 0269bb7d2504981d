"""Fine-tunes a Mask R-CNN on annotated pictures."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.detectors.finetuning.dataset import Batch, ReplayDataset, collate, to_device
from labeling.detectors.networks.losses import with_training_losses
from labeling.detectors.networks.mask_rcnn import Network, channels_last
from labeling.detectors.networks.network_detector import NetworkDetector
from labeling.detectors.networks.weights import save_network
from labeling.detectors.scoring import evaluate
from labeling.training import loop
from labeling.training.checkpoint import Progress


class MaskRcnnTask(loop.TrainingTask[Batch, Network]):
    """What fine-tuning and pre-training share: a Mask R-CNN, its losses, and a running average of its weights."""

    def __init__(self, network: Network, average: float) -> None:
        """Takes a network on its device, and the decay of its running average per batch; 0: none."""
        self.network, self.average = channels_last(with_training_losses(network)), average
        self.averaged = copy.deepcopy(network).requires_grad_(False).eval() if average else None

    def losses(self, batch: Batch, step: int) -> dict[str, torch.Tensor]:
        """Of proposals and heads; anchors are sampled as the number of the step says."""
        torch.manual_seed(self.config.seed * 1_000_003 + step)
        return self.network(*to_device(batch, self.device))


class FinetuneTask(MaskRcnnTask):
    """Fine-tuning on pseudo-labels or ground truth, with source pictures replayed among them."""

    config: FinetuneConfig
    dataset: ReplayDataset
    mixed_precision = True
    score_name = "mask_ap50"

    def __init__(
        self,
        network: Network,
        pictures: Sequence[AnnotatedPicture],
        validation: Sequence[AnnotatedPicture],
        config: FinetuneConfig,
        augmentation: AugmentConfig,
        replay: Sequence[AnnotatedPicture] = (),
        device: str = "cpu",
        about: Mapping[str, Any] | None = None,
        new_categories: tuple[str, ...] = (),
    ) -> None:
        """Sets a training up.

        Args:
            network: where to start; changed.
            pictures: to learn from. What is not annotated is background.
            validation: to choose the best by; if empty, the last is kept and training does not stop early.
            config: settings of training.
            augmentation: settings of augmentation.
            replay: source pictures to mix in, against forgetting.
            device: where to train.
            about: written into the weights: where they come from.
            new_categories: those of the network's that it had no name for when the source pictures taught it. Where
                these never name one, what is not annotated there is background or one of them.

        Raises:
            UsageError: if settings make no sense, or there is no picture.
        """
        config.check()
        augmentation.check()
        if augmentation.short_side_px is None:
            augmentation = replace(augmentation, short_side_px=network.spec.short_side_px)
        names, share = network.spec.categories, config.replay_share
        self.dataset = ReplayDataset(
            pictures,
            names,
            augmentation,
            config.seed,
            replay,
            share,
            new_categories,
            config.repeat_threshold,
            config.trust_scores,
        )
        self.config, self.validation, self.about = config, validation, about or {}
        network = network.to(torch.device(device))
        self.collate, self.workers, self.clip = collate, config.workers, config.clip
        self.patience = config.patience if validation else 0
        network.frozen_statistics = config.frozen_statistics
        network.freeze(config.frozen_stages)
        super().__init__(network, config.average)
        is_interpolated = config.interpolate < 1 and not new_categories
        self.start = copy.deepcopy(network.state_dict()) if is_interpolated else None
        self.optimizer = make_optimizer(network, config, bool(new_categories))
        # More iterations, patience or workers do not make it another run.
        fixed = {k: v for k, v in asdict(config).items() if k not in ("iterations", "patience", "workers")}
        if config.schedule == "cosine":
            fixed["iterations"] = config.iterations
        self.identity = {
            "started_from": self.about.get("started_from_digest"),
            "architecture": network.spec.architecture,
            "categories": list(names),
            "train": fixed,
            "augment": asdict(augmentation),
            "pictures": [len(pictures), len(replay), len(validation)],
            "objects": sum(len(picture.annotations) for picture in pictures),
        }

    @property
    def candidate(self) -> Network:
        """The network that is validated and kept: between the one at the start and the one that was learnt."""
        learnt = super().candidate
        if self.start is None:
            return learnt
        return interpolated(self.start, learnt, self.config.interpolate)

    def learning_rate(self, progress: Progress) -> float:
        """Warm-up, then constant or cosine over all iterations."""
        config, step = self.config, progress.iteration
        return loop.scheduled_rate(config.learning_rate, step, config.warmup, step / config.iterations, config.schedule)

    def validate(self, progress: Progress) -> dict[str, Any]:
        """AP of masks and boxes."""
        if not self.validation:
            return {}
        scores = asdict(evaluate(NetworkDetector(self.candidate, "training", device=self.device), self.validation))
        return {name: value for name, value in scores.items() if name not in ("pictures", "objects")}

    def save(self, path: Path, progress: Progress) -> None:
        """Writes the weights; the spec in their header says where they come from."""
        ap50 = progress.history[-1].get("mask_ap50")
        trained = {"iteration": progress.iteration, "seed": self.config.seed, "validation_ap50": ap50}
        network = self.candidate
        spec = network.spec
        save_network(path, network, replace(spec, about={**spec.about, **self.about, "trained": trained}))

    def summary(self, record: Mapping[str, Any], progress: Progress) -> str:
        """Loss and AP."""
        line = f"step {record['iteration']}: loss {record['loss']:.3f}"
        if "mask_ap50" in record:
            ap50, ap30 = (100 * (record[name] or 0) for name in ("mask_ap50", "mask_ap30"))
            best = f"best AP50 {100 * progress.best:.1f} at step {progress.best_iteration}"
            line += f", AP50 {ap50:.1f}, AP30 {ap30:.1f}, {best}"
        return line


def interpolated(start: Mapping[str, torch.Tensor], learnt: Network, share: float) -> Network:
    """A network whose weights lie between those of two others.

    Args:
        start: the weights of the one.
        learnt: the other, of the same architecture and categories; not changed.
        share: of the way from ``start`` to ``learnt``.

    Source: WiSE-FT, Wortsman et al., "Robust fine-tuning of zero-shot models" (2022).
    """
    between = copy.deepcopy(learnt).requires_grad_(False)
    with torch.no_grad():
        for name, value in between.state_dict().items():
            if value.is_floating_point():
                value.copy_(torch.lerp(start[name].to(value.device), value, share))
    return between


def make_optimizer(network: Network, config: FinetuneConfig, new_categories: bool = False) -> torch.optim.Optimizer:
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
