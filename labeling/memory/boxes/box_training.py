"""Training a network to find boxes in a memory, from random weights or from those of a memory that has learnt."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from labeling.core.errors import UsageError
from labeling.detectors3d.upright_boxes import encode_box
from labeling.memory.boxes.box_detector import save_box_net
from labeling.memory.boxes.box_evaluation import evaluate
from labeling.memory.boxes.box_losses import box_losses
from labeling.memory.boxes.box_net import BoxNet
from labeling.memory.boxes.box_samples import BoxSample, BoxSamples, collate
from labeling.memory.boxes.box_targets import SIDES
from labeling.memory.boxes.labelled_scenes import LabelledScene, category_names
from labeling.memory.networks.weights import Memory, memory_digest
from labeling.memory.settings.box_settings import BoxSpec, TrainBoxesConfig
from labeling.memory.settings.memory_spec import MemorySpec
from labeling.memory.view_prediction.scenes import joined_digest
from labeling.training import loop
from labeling.training.checkpoint import Progress


class BoxTask(loop.TrainingTask[BoxSample, BoxNet]):
    """Training a network to find boxes in a memory."""

    config: TrainBoxesConfig
    score_name = "ap"

    def __init__(
        self,
        memory: MemorySpec | Memory,
        scenes: Sequence[LabelledScene],
        validation: Sequence[LabelledScene],
        config: TrainBoxesConfig,
        device: str = "cpu",
        about: Mapping[str, Any] | None = None,
    ) -> None:
        """Makes the network, and sets its training up.

        Args:
            memory: of random weights, of this kind and size; or one that has learnt, whose weights are begun with.
            scenes: to learn from; their categories are those of the network.
            validation: to choose the best by, by AP; if empty, the last is kept and training does not stop early.
            config: settings of training.
            device: where to train.
            about: written into the weights: where they come from.

        Raises:
            UsageError: if settings make no sense, or no object of the validation is of a category that is learnt.
        """
        config.check()
        names = category_names(scenes)
        if not names:
            raise UsageError("nothing to learn from: none of the objects with a 3-D box is to be found")
        if validation and not set(names) & set(category_names(validation)):
            raise UsageError(
                f"validation: none of its objects is a {' or a '.join(names)}, nothing to choose a network by"
            )
        learnt = None if isinstance(memory, MemorySpec) else memory
        views = min(config.views, max(one.scene.num_views for one in scenes))
        spec = BoxSpec(names, memory if isinstance(memory, MemorySpec) else memory.spec, views, config.around)
        self.config, self.validation, self.about = config, list(validation), about or {}
        self.workers, self.patience = config.workers, config.patience if validation else 0
        torch.manual_seed(config.seed)  # of weights
        self.network = BoxNet(spec)
        if learnt is not None:
            self.network.memory.load_state_dict(learnt.state_dict())
        _begin_with_sizes(self.network, scenes)
        self.network.to(device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate)
        self.dataset = BoxSamples(
            scenes, names, spec.memory.grid, config.views, config.batch_size, config.seed, config.trust_scores
        )
        self.collate = collate
        self.identity = {
            "network": asdict(spec),
            "begun": "random" if learnt is None else memory_digest(learnt),
            "train": {name: value for name, value in asdict(config).items() if name not in ("patience", "workers")},
            "scenes": [one.scene.name for one in scenes],
            "validation": [one.scene.name for one in validation],
            "data": [joined_digest(one.digest for one in part) for part in (scenes, validation)],
        }

    def losses(self, batch: BoxSample, step: int) -> dict[str, Tensor]:
        """Of heat maps, of boxes, and of filled voxels."""
        return box_losses(self.network(batch.views.to(self.device)), batch.targets.to(self.device))

    def learning_rate(self, progress: Progress) -> float:
        """Falls along a cosine."""
        share = progress.iteration / self.config.iterations
        return loop.scheduled_rate(self.config.learning_rate, progress.iteration, progress=share)

    def validate(self, progress: Progress) -> dict[str, Any]:
        """AP from as many views as there are at most."""
        return evaluate(self.network, self.validation, self.config.views, self.device) if self.validation else {}

    def save(self, path: Path, progress: Progress) -> None:
        """Writes the weights, and where they come from."""
        trained = {"iteration": progress.iteration, "seed": self.config.seed, "ap": progress.history[-1].get("ap")}
        save_box_net(path, self.network, {**self.about, "trained": trained})

    def summary(self, record: Mapping[str, Any], progress: Progress) -> str:
        """Loss and AP."""
        line = f"step {record['iteration']}: loss {record['loss']:.3f}"
        if "ap" in record:
            best = f"best at step {progress.best_iteration}"
            line += f", AP {100 * record['ap25']:.1f} at .25, {100 * record['ap50']:.1f} at .5, {best}"
        return line


def _begin_with_sizes(network: BoxNet, scenes: Sequence[LabelledScene]) -> None:
    """Says of every column that its box is as large as boxes are on average."""
    sides = np.array([encode_box(one.box)[3:6] for scene in scenes for one in scene.objects if not one.ignore])
    bias = network.head.numbers[-1].bias
    assert isinstance(bias, Tensor)
    with torch.no_grad():
        bias[SIDES] = torch.from_numpy(np.log(sides).mean(axis=0)).to(bias.dtype)
