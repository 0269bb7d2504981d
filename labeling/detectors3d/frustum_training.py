"""Trains a frustum PointNet on objects with 3-D boxes."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labeling.core.box_overlap import box_iou_3d
from labeling.core.errors import UsageError
from labeling.detectors3d.config import Augment3dConfig, Train3dConfig
from labeling.detectors3d.frustum_dataset import FrustumDataset, collate, unaugmented
from labeling.detectors3d.frustum_detector import BATCH_SIZE, save_network
from labeling.detectors3d.frustum_losses import FrustumBatch, frustum_losses
from labeling.detectors3d.frustum_pointnet import FrustumNet, FrustumSpec
from labeling.detectors3d.frustum_samples import FrustumSample, category_names, median_sizes
from labeling.detectors3d.upright_boxes import decode_box
from labeling.training import loop
from labeling.training.checkpoint import Progress


@dataclass(frozen=True)
class BoxScores:
    """How good boxes are, given the 2-D box of every object."""

    objects: int
    mean_iou: float
    right_at_25: float
    """Share of objects whose box has an IoU of at least .25."""
    right_at_50: float
    points_iou: float
    """Of the object's points among the frustum's."""


class FrustumTask(loop.TrainingTask[FrustumBatch, FrustumNet]):
    """Training a frustum PointNet from random weights."""

    config: Train3dConfig
    dataset: FrustumDataset
    score_name = "mean_iou"

    def __init__(
        self,
        samples: Sequence[FrustumSample],
        validation: Sequence[FrustumSample],
        config: Train3dConfig,
        augmentation: Augment3dConfig,
        device: str = "cpu",
        about: Mapping[str, Any] | None = None,
    ) -> None:
        """Makes the network, and sets its training up.

        Args:
            samples: to learn from; categories and median sizes of those that are sure enough are the network's.
            validation: to choose the best by, by mean IoU, if they are sure enough; if empty, the last is kept and
                training does not stop early.
            config: settings of training.
            augmentation: settings of augmentation.
            device: where to train.
            about: written into the weights: where they come from.

        Raises:
            UsageError: if settings make no sense, no object is sure enough to learn from, or no validation object
                is of a category that is learnt.
        """
        config.check()
        augmentation.check()
        samples, validation = (
            [one for one in some if one.weight >= config.least_confidence] for some in (samples, validation)
        )
        if not samples:
            raise UsageError(
                f"no label has a score of {config.least_confidence:g} or more to learn from; lower --least-confidence, "
                "or give labels of more episodes"
            )
        names = category_names(samples)
        known = [one for one in validation if one.category in names]
        if validation and not known:
            raise UsageError(
                f"validation: none of its objects is a {' or a '.join(names)}, nothing to choose a network by"
            )
        self.dataset = FrustumDataset(samples, names, config.num_points, augmentation, config.seed, config.trust_scores)
        self.config, self.validation, self.about = config, known, about or {}
        self.collate, self.workers, self.patience = collate, config.workers, config.patience if known else 0
        torch.manual_seed(config.seed)  # of weights and dropout
        spec = FrustumSpec(names, median_sizes(samples, names), config.width, config.num_points)
        self.network = FrustumNet(spec).to(device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate)
        self.identity = {
            "network": asdict(spec),
            "train": {name: value for name, value in asdict(config).items() if name not in ("patience", "workers")},
            "augment": asdict(augmentation),
            "objects": [len(samples), len(known)],
        }

    def losses(self, batch: FrustumBatch, step: int) -> dict[str, torch.Tensor]:
        """Terms of the multi-task loss."""
        batch = FrustumBatch(**{name: value.to(self.device) for name, value in vars(batch).items()})
        return frustum_losses(self.network, self.network(batch.points, batch.category), batch)

    def learning_rate(self, progress: Progress) -> float:
        """Falls along a cosine."""
        share = progress.iteration / self.config.iterations
        return loop.scheduled_rate(self.config.learning_rate, progress.iteration, progress=share)

    def validate(self, progress: Progress) -> dict[str, Any]:
        """Overlap of boxes."""
        return asdict(evaluate(self.network, self.validation, self.device)) if self.validation else {}

    def save(self, path: Path, progress: Progress) -> None:
        """Writes the weights, and where they come from."""
        mean_iou = progress.history[-1].get("mean_iou")
        trained = {"iteration": progress.iteration, "seed": self.config.seed, "mean_iou": mean_iou}
        save_network(path, self.network, {**self.about, "trained": trained})

    def summary(self, record: Mapping[str, Any], progress: Progress) -> str:
        """Loss and overlap."""
        line = f"step {record['iteration']}: loss {record['loss']:.3f}"
        if "mean_iou" in record:
            right = f"{100 * record['right_at_25']:.0f} % of boxes right at .25"
            best = f"best IoU {progress.best:.3f} at step {progress.best_iteration}"
            line += f", IoU {record['mean_iou']:.3f}, {right}, {best}"
        return line


def evaluate(network: FrustumNet, samples: Sequence[FrustumSample], device: str | torch.device = "cpu") -> BoxScores:
    """How good the boxes are that a network finds, given the 2-D box of every object.

    Args:
        network: whose categories contain those of the samples.
        samples: at least one.
        device: where to run.
    """
    was_training = network.training
    network.eval()
    overlaps, points = [], []
    for start in range(0, len(samples), BATCH_SIZE):
        some = samples[start : start + BATCH_SIZE]
        batch = collate([unaugmented(one, network.spec.categories, network.spec.num_points) for one in some])
        with torch.inference_mode():
            output = network(batch.points.to(device), batch.category.to(device))
            found = network.boxes(output).cpu().numpy()
        foreground, predicted = batch.foreground.numpy() > 0, output.logits.cpu().numpy() > 0
        shared, either = (foreground & predicted).sum(axis=1), (foreground | predicted).sum(axis=1)
        points += list(shared / np.maximum(1, either))
        overlaps += [
            box_iou_3d(decode_box(one), decode_box(true)) for one, true in zip(found, batch.boxes.numpy(), strict=True)
        ]
    network.train(was_training)
    iou = np.array(overlaps)
    return BoxScores(
        objects=len(samples),
        mean_iou=float(iou.mean()),
        right_at_25=float(np.mean(iou >= 0.25)),
        right_at_50=float(np.mean(iou >= 0.5)),
        points_iou=float(np.mean(points)),
    )
