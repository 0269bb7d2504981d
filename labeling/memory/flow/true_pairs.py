"""Pairs of views whose motion ground truth tells: what a supervised rival of made-up motion learns from."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from labeling.core.episode import Episode
from labeling.memory.flow.flow_evaluation import true_flow
from labeling.memory.flow.flow_samples import FlowSample
from labeling.memory.flow.moved_pieces import FlowTruth
from labeling.memory.flow.view_pairs import read_pairs, view_pairs
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.settings.memory_spec import SceneSize
from labeling.memory.view_prediction.scenes import SmallScene


@dataclass(frozen=True)
class TruePair:
    """A pair of views, and the true flow from either to the other."""

    pair: SmallScene
    truths: tuple[FlowTruth, FlowTruth]
    """From the first view on, and from the second; sparse tensors, as most voxels are empty."""

    @property
    def name(self) -> str:
        """Of the episode."""
        return self.pair.name

    @property
    def digest(self) -> str:
        """Of the views as they were recorded."""
        return self.pair.digest

    @classmethod
    def of(cls, episode: Episode, pair: SmallScene, grid: GridSpec) -> "TruePair":
        """Looks the flow up.

        Raises:
            UsageError: if the episode has no ground truth of masks or motion.
        """
        forwards, backwards = (true_flow(episode, one, grid) for one in (pair, pair.chosen((1, 0))))
        return cls(pair, (_sparse(forwards), _sparse(backwards)))

    def sample(self, backwards: bool = False) -> FlowSample:
        """As it is learnt from, begun from either of the views."""
        pair = self.pair.chosen((1, 0)) if backwards else self.pair
        truth = self.truths[backwards]
        dense = FlowTruth(truth.flow_m.to_dense(), truth.moves.to_dense(), truth.known.to_dense())
        return FlowSample(pair.views([0], 0), pair.views([1], 0), dense)


def _sparse(truth: FlowTruth) -> FlowTruth:
    return FlowTruth(truth.flow_m.to_sparse(), truth.moves.to_sparse(), truth.known.to_sparse())


def read_true_pairs(datasets: Sequence[Path], spec: SceneSize) -> tuple[list[list[TruePair]], list[str]]:
    """Pairs of views of all episodes of some datasets, with true flow; see ``read_view_pairs``.

    Raises:
        EpisodeFormatError: if a dataset is none, or no episode of all is left.
        UsageError: if an episode has no ground truth of masks or motion.
    """

    def with_truth(episode: Episode) -> list[TruePair]:
        pairs = view_pairs(episode.name, episode, spec)
        return [TruePair.of(episode, pair, spec.grid) for pair in pairs]

    return read_pairs(datasets, with_truth, ground_truth=True)
