"""Which views go into a memory and which are to be predicted: functions of a seed and the sample's number."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from torch.utils.data import Dataset

from labeling.memory.networks.view_batch import Views
from labeling.memory.view_prediction.scenes import SmallScene, beside_each_other, concatenated


@dataclass(frozen=True)
class Sample:
    """Views of scenes, views to be predicted from them, and views of others."""

    inputs: Views
    targets: Views
    others: Views | None = None
    """For each scene a few views, each of another scene and in the grid that stands there."""


def split_views(num_views: int, inputs: int, targets: int, rng: np.random.Generator) -> tuple[list[int], list[int]]:
    """Draws views to remember and others to predict; fewer targets, then fewer inputs, where there are too few."""
    order = rng.permutation(num_views).tolist()
    inputs = min(inputs, num_views - 1)
    return order[:inputs], order[inputs : inputs + targets]


class ViewSamples(Dataset):
    """Samples to learn from: number -> ``Sample``."""

    def __init__(
        self, scenes: Sequence[SmallScene], inputs: int, targets: int, batch_size: int, seed: int, others: int = 0
    ) -> None:
        """Sets up samples.

        Args:
            scenes: to learn from.
            inputs: views to remember, at most.
            targets: views to predict.
            batch_size: samples that have equally many inputs.
            seed: of all draws.
            others: how many views of other scenes come with each; none where there is one scene only.
        """
        self.scenes, self.batch_size, self.seed = scenes, batch_size, seed
        self.others = others if len(scenes) > 1 else 0
        fewest = min(scene.num_views for scene in scenes)
        self.targets = min(targets, fewest - 1)
        self.inputs = min(inputs, fewest - self.targets)

    def __getitem__(self, number: int) -> Sample:
        """All samples of a batch have equally many inputs."""
        count = 1 + int(np.random.default_rng([self.seed, 1, number // self.batch_size]).integers(self.inputs))
        rng = np.random.default_rng([self.seed, 2, number])
        which = int(rng.integers(len(self.scenes)))
        scene = self.scenes[which]
        inputs, targets = split_views(scene.num_views, count, self.targets, rng)
        others = [self._view_elsewhere(which, rng) for _ in range(self.others)]
        return Sample(
            scene.views(inputs, inputs[0]),
            scene.views(targets, inputs[0]),
            beside_each_other(others) if others else None,
        )

    def _view_elsewhere(self, which: int, rng: np.random.Generator) -> Views:
        """A view of any scene but one."""
        scene = self.scenes[(which + 1 + int(rng.integers(len(self.scenes) - 1))) % len(self.scenes)]
        view = int(rng.integers(scene.num_views))
        return scene.views([view], view)


def collate(samples: Sequence[Sample]) -> Sample:
    """A batch."""
    others = [one.others for one in samples if one.others is not None]
    return Sample(
        concatenated([one.inputs for one in samples]),
        concatenated([one.targets for one in samples]),
        concatenated(others) if others else None,
    )
