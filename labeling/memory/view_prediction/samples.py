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


class BatchDraws:
    """Which scene each sample is of, and how many views the scenes of its batch have: functions of its number."""

    def __init__(self, num_views: Sequence[int], batch_size: int, seed: int) -> None:
        """Draws nothing yet.

        Args:
            num_views: of each scene.
            batch_size: samples in a batch.
            seed: of all that is drawn.
        """
        self.num_views, self.batch_size, self.seed = num_views, batch_size, seed

    def scene(self, number: int) -> tuple[int, np.random.Generator]:
        """The scene of a sample, and the generator that draws the rest of it."""
        rng = np.random.default_rng([self.seed, 2, number])
        return int(rng.integers(len(self.num_views))), rng

    def fewest_views(self, number: int) -> int:
        """Of the scenes of the batch that a sample is in."""
        first = number // self.batch_size * self.batch_size
        return min(self.num_views[self.scene(one)[0]] for one in range(first, first + self.batch_size))

    def count(self, number: int, most: int) -> int:
        """From one to so many, the same for all samples of a batch."""
        return 1 + int(np.random.default_rng([self.seed, 1, number // self.batch_size]).integers(most))


class ViewSamples(Dataset):
    """Samples to learn from: number -> ``Sample``."""

    def __init__(self, scenes: Sequence[SmallScene], inputs: int, targets: int, batch_size: int, seed: int) -> None:
        """Draws nothing yet.

        Args:
            scenes: to learn from.
            inputs: views that go into a memory at most; fewer in a batch with a scene that has too few.
            targets: views that are predicted from it; likewise.
            batch_size: scenes in a batch; all of them have equally many views of either kind.
            seed: of all that is drawn.
        """
        self.scenes, self.inputs, self.targets = scenes, inputs, targets
        self.draws = BatchDraws([scene.num_views for scene in scenes], batch_size, seed)

    def __getitem__(self, number: int) -> Sample:
        """Views of one scene; of the targets first there are fewer where its batch has too few views."""
        fewest = self.draws.fewest_views(number)
        most_targets = min(self.targets, fewest - 1)
        count = self.draws.count(number, min(self.inputs, fewest - most_targets))
        place, rng = self.draws.scene(number)
        scene = self.scenes[place]
        inputs, targets = split_views(scene.num_views, count, most_targets, rng)
        return Sample(scene.views(inputs, inputs[0]), scene.views(targets, inputs[0]))


def collate(samples: Sequence[Sample]) -> Sample:
    """A batch."""
    return Sample(concatenated([one.inputs for one in samples]), concatenated([one.targets for one in samples]))
