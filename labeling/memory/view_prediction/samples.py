"""Which views go into a memory and which are to be predicted: functions of a seed and the sample's number."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from torch.utils.data import Dataset

from labeling.memory.networks.view_batch import Views
from labeling.memory.view_prediction.scenes import SmallScene, concatenated


@dataclass(frozen=True)
class Sample:
    """Views of one scene, and views to be predicted from them."""

    inputs: Views
    targets: Views


def split_views(num_views: int, inputs: int, targets: int, rng: np.random.Generator) -> tuple[list[int], list[int]]:
    """Draws views to remember and others to predict; fewer targets, then fewer inputs, where there are too few."""
    order = rng.permutation(num_views).tolist()
    inputs = min(inputs, num_views - 1)
    return order[:inputs], order[inputs : inputs + targets]


class ViewSamples(Dataset):
    """Samples to learn from: number -> ``Sample``."""

    def __init__(self, scenes: Sequence[SmallScene], inputs: int, targets: int, batch_size: int, seed: int) -> None:
        self.scenes, self.batch_size, self.seed = scenes, batch_size, seed
        fewest = min(scene.num_views for scene in scenes)
        self.targets = min(targets, fewest - 1)
        self.inputs = min(inputs, fewest - self.targets)

    def __getitem__(self, number: int) -> Sample:
        """All samples of a batch have equally many inputs."""
        count = 1 + int(np.random.default_rng([self.seed, 1, number // self.batch_size]).integers(self.inputs))
        rng = np.random.default_rng([self.seed, 2, number])
        scene = self.scenes[int(rng.integers(len(self.scenes)))]
        inputs, targets = split_views(scene.num_views, count, self.targets, rng)
        return Sample(scene.views(inputs, inputs[0]), scene.views(targets, inputs[0]))


def collate(samples: Sequence[Sample]) -> Sample:
    """A batch."""
    return Sample(concatenated([one.inputs for one in samples]), concatenated([one.targets for one in samples]))
