"""Training a memory: GRNN and the 2-D baseline on pictures, C-N3D on contrast."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.networks.weights import MEMORY_FILE, Memory, build_memory, save_memory
from labeling.memory.settings.memory_spec import MemorySpec
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.memory.view_prediction.contrast import contrast_losses
from labeling.memory.view_prediction.evaluation import evaluate
from labeling.memory.view_prediction.losses import pixel_loss
from labeling.memory.view_prediction.samples import Sample, ViewSamples, collate
from labeling.memory.view_prediction.scenes import SmallScene, joined_digest
from labeling.training import loop
from labeling.training.checkpoint import Progress

VALIDATION_SCENES, VALIDATION_TARGETS = 8, 4
"""At most; the same views each time."""


class MemoryTask(loop.TrainingTask[Sample, Memory]):
    """Training a memory from random weights."""

    config: TrainMemoryConfig
    weights_file = MEMORY_FILE

    def __init__(
        self,
        spec: MemorySpec,
        scenes: Sequence[SmallScene],
        validation: Sequence[SmallScene],
        config: TrainMemoryConfig,
        device: str = "cpu",
        about: Mapping[str, Any] | None = None,
    ) -> None:
        """Makes the network, and sets its training up.

        Args:
            spec: of the network.
            scenes: to learn from.
            validation: to choose the best by; if empty, the last is kept.
            config: settings of training.
            device: where to train.
            about: written into the weights: where they come from.

        Raises:
            UsageError: if settings make no sense.
        """
        config.check()
        self.config, self.validation, self.about = config, list(validation)[:VALIDATION_SCENES], about or {}
        torch.manual_seed(config.seed)  # of weights
        self.network = build_memory(spec).to(device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate)
        self.dataset = ViewSamples(scenes, config.inputs, config.targets, config.batch_size, config.seed)
        self.collate = collate
        self.score_name = "pixel_r1" if spec.model == "cn3d" else "psnr"
        self.identity = {
            "network": asdict(spec),
            "train": asdict(config),
            "scenes": [one.name for one in scenes],
            "validation": [one.name for one in self.validation],
            "data": [joined_digest(one.digest for one in part) for part in (scenes, self.validation)],
        }

    def losses(self, batch: Sample, step: int) -> dict[str, Tensor]:
        """Of pixels, or of contrast in 2-D and 3-D."""
        inputs, targets = batch.inputs.to(self.device), batch.targets.to(self.device)
        if isinstance(self.network, Cn3d):
            generator = torch.Generator().manual_seed(1_000_003 * self.config.seed + step)
            return contrast_losses(self.network, Sample(inputs, targets), self.config, generator)
        return {"pixels": pixel_loss(self.network(inputs, targets), targets.rgb, self.config.pixel_loss)}

    def learning_rate(self, progress: Progress) -> float:
        """Falls along a cosine."""
        share = progress.iteration / self.config.iterations
        return loop.scheduled_rate(self.config.learning_rate, progress.iteration, progress=share)

    def validate(self, progress: Progress) -> dict[str, Any]:
        """Figures of views of the validation scenes, from as many inputs as there are at most."""
        if not self.validation:
            return {}
        scores = evaluate(self.network, self.validation, self.config.inputs, VALIDATION_TARGETS, self.device)
        return {name: float(np.mean(values)) for name, values in scores.items()}

    def save(self, path: Path, progress: Progress) -> None:
        """Writes the weights, and where they come from."""
        figures = progress.history[-1].get(self.score_name)
        trained = {"iteration": progress.iteration, "seed": self.config.seed, self.score_name: figures}
        save_memory(path, self.network, {**self.about, "around": self.config.around, "trained": trained})

    def summary(self, record: Mapping[str, Any], progress: Progress) -> str:
        """Loss and validation figures."""
        line = f"step {record['iteration']}: loss {record['loss']:.4f}"
        if "psnr" in record:
            line += f", views {record['psnr']:.2f} dB, L1 {record['l1']:.4f}, {100 * record['view_r1']:.0f} % retrieved"
        elif "pixel_r1" in record:
            line += f", {100 * record['pixel_r1']:.1f} % of pixels retrieved, {100 * record['view_r1']:.0f} % of views"
        return line
