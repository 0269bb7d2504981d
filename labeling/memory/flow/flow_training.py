"""Training flow on a memory that has learnt: from made-up motion, and from features that are to match."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from labeling.core.errors import UsageError
from labeling.memory.flow.flow_detector import save_flow_net
from labeling.memory.flow.flow_evaluation import VoxelCounts, endpoint_errors, mean_or_zero
from labeling.memory.flow.flow_losses import flow_losses, matching_loss
from labeling.memory.flow.flow_net import FlowNet
from labeling.memory.flow.flow_samples import FlowSample, FlowSamples, Pair, collate, with_motion
from labeling.memory.flow.moved_pieces import FlowTruth
from labeling.memory.networks.tower import Tower
from labeling.memory.networks.weights import Memory, memory_digest
from labeling.memory.settings.flow_settings import FlowSpec, TrainFlowConfig
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.view_prediction.scenes import SmallScene, joined_digest
from labeling.training import loop
from labeling.training.checkpoint import Progress

PART, MOVING_SHARE = (12, 16, 16), 0.7
"""Voxels along z, y, x of a scene that a batch looks at: most of the rest stands still. And how often that is where
something moves."""
VALIDATION_PAIRS = 48
"""At most; the same made-up motion each time."""


def drawn_places(
    truth: FlowTruth, occupied: Float[Tensor, "b 1 z y x"], rng: np.random.Generator
) -> list[tuple[slice, slice, slice]]:
    """Where a batch is looked at: parts of at most ``PART`` voxels around one that moves, or else is occupied.

    Args:
        truth: of the batch.
        occupied: 1 where there is a surface.
        rng: draws voxels; of those that move ``MOVING_SHARE`` of the time, if any do.

    Returns:
        Slices along z, y, x, of each scene.
    """
    places = []
    for moves, filled in zip(truth.moves[:, 0] >= 0.5, occupied[:, 0] > 0, strict=True):
        chosen = torch.nonzero(moves if bool(moves.any()) and rng.random() < MOVING_SHARE else filled).numpy()
        shape = np.array(moves.shape)
        size = np.minimum(PART, shape)
        middle = chosen[int(rng.integers(len(chosen)))] if len(chosen) else shape // 2
        low = np.clip(middle - size // 2 + rng.integers(-3, 4, 3), 0, shape - size)
        places.append(tuple(slice(int(one), int(one + edge)) for one, edge in zip(low, size, strict=True)))
    return places


class FlowTask(loop.TrainingTask[FlowSample, FlowNet]):
    """Training the head of a flow network; its memory stays as it is."""

    config: TrainFlowConfig
    score_name = "f1"

    def __init__(
        self,
        memory: Memory,
        learn: Sequence[Sequence[Pair]],
        moving: Sequence[Sequence[SmallScene]],
        validation: Sequence[Sequence[Pair]],
        config: TrainFlowConfig,
        device: str = "cpu",
        about: Mapping[str, Any] | None = None,
    ) -> None:
        """Makes the network, and sets its training up.

        Args:
            memory: that has learnt; it is copied.
            learn: pairs of views, by episode, in which nothing moves: what motion is made up in; or pairs whose motion
                ground truth tells (``labeling.memory.flow.true_pairs``).
            moving: likewise of episodes in which things move, of which no motion is known; may be empty.
            validation: as ``learn``, to choose the best by; if empty, the last is kept.
            config: settings of training.
            device: where to train.
            about: written into the weights: where they come from.

        Raises:
            UsageError: if settings make no sense, there is nothing to learn from, or the memory has no volume.
        """
        config.check()
        spec = FlowSpec(memory.spec, config.width)
        assert not isinstance(memory, Tower), "FlowSpec refuses memories without a volume"
        pairs, held = ([one for own in part for one in own] for part in (learn, validation))
        real = [one for own in moving for one in own]
        if not pairs:
            raise UsageError("nothing to learn flow from: no pair of views of an episode in which nothing moves")
        self.config, self.about, self.grid = config, about or {}, spec.memory.grid
        torch.manual_seed(config.seed)  # of weights
        self.network = FlowNet(spec)
        self.network.memory.load_state_dict(memory.state_dict())
        self.network.to(device)
        self.optimizer = torch.optim.Adam(self.network.head.parameters(), lr=config.learning_rate)
        self.dataset, self.collate = FlowSamples(pairs, real, self.grid, config), collate
        chosen = held[:: max(1, len(held) // VALIDATION_PAIRS)][:VALIDATION_PAIRS]
        self.validation = [
            with_motion(one, False, self.grid, config, np.random.default_rng([config.seed, 1, number]))
            for number, one in enumerate(chosen)
        ]
        self.identity = {
            "network": asdict(spec),
            "memory": memory_digest(memory),
            "train": asdict(config),
            "episodes": [[one[0].name for one in part if one] for part in (learn, moving, validation)],
            "data": [joined_digest(one.digest for own in part for one in own) for part in (learn, moving, validation)],
            "motion": "made up" if isinstance(pairs[0], SmallScene) else "true",
        }

    def losses(self, batch: FlowSample, step: int) -> dict[str, Tensor]:
        """Of flow and of what moves where it is known, and of features everywhere."""
        before, after = self.network.both(batch.before.to(self.device), batch.after.to(self.device))
        places = drawn_places(batch.truth, before.occupied.cpu(), self._rng(step))
        before, after = before.cropped(places), after.cropped(places)
        z, y, x = before.occupied.shape[2:]
        part = GridSpec((z, y, x), self.grid.voxel_m)
        output = self.network.head(before, after, part)
        found = flow_losses(output, batch.truth.cropped(places).to(self.device), part)
        if self.config.matching:
            found["matching"] = self.config.matching * matching_loss(before, after, output.flow_m, part)
        return found

    def _rng(self, step: int) -> np.random.Generator:
        return np.random.default_rng([self.config.seed, 2, step])

    def learning_rate(self, progress: Progress) -> float:
        """Falls along a cosine."""
        share = progress.iteration / self.config.iterations
        return loop.scheduled_rate(self.config.learning_rate, progress.iteration, progress=share)

    @torch.inference_mode()
    def validate(self, progress: Progress) -> dict[str, Any]:
        """``f1`` of voxels that are said to move and where to; ``moving_m`` and ``standing_m``, errors of flow."""
        if not self.validation:
            return {}
        self.network.eval()
        counts, moving, standing = VoxelCounts(), [], []
        for sample in self.validation:
            before, after = self.network.both(sample.before.to(self.device), sample.after.to(self.device))
            output, truth = self.network.head(before, after, self.grid), sample.truth.to(self.device)
            counts.add(output, FlowSample(sample.before, sample.after, truth), before.occupied, self.grid)
            errors = endpoint_errors(output.flow_m, truth, before.occupied)
            moving.append(errors[0])
            standing.append(errors[1])
        return {"f1": counts.f1, "moving_m": mean_or_zero(moving), "standing_m": mean_or_zero(standing)}

    def save(self, path: Path, progress: Progress) -> None:
        """Writes the weights, and where they come from."""
        trained = {"iteration": progress.iteration, "seed": self.config.seed, "f1": progress.history[-1].get("f1")}
        save_flow_net(path, self.network, {**self.about, "trained": trained})

    def summary(self, record: Mapping[str, Any], progress: Progress) -> str:
        """Loss and validation figures."""
        line = f"step {record['iteration']}: loss {record['loss']:.3f}"
        if "f1" in record:
            line += (
                f", F1 of moving voxels {100 * record['f1']:.1f} %, flow errs by {100 * record['moving_m']:.1f} cm "
                f"where things move and {100 * record['standing_m']:.1f} cm elsewhere"
            )
        return line
