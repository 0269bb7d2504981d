"""The dense CRF over the points that objects may reach: unary potentials, and two Gaussian pairwise kernels.

Source: thesis equation 4.1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from labeling.core.episode_labels import Scale
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import Candidate
from labeling.generator.segment.active_points import ActivePoints
from labeling.generator.segment.mean_field import Kernel
from labeling.generator.segment.permutohedral_lattice import build_lattice, lattice_of_blocks
from labeling.generator.segment.unary_potentials import UNREACHABLE_LOG_ODDS, object_log_odds
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.published_defects import ConstantKernel


@dataclass(frozen=True, eq=False)
class ObjectCrf:
    """Potentials of all objects of an episode."""

    log_odds: Float32[np.ndarray, "n k"]
    """Unary potentials: of every object at every point, against the background."""
    active: ActivePoints
    """Where each object can be at all."""
    kernels: list[Kernel]
    """Pairwise terms between the active points of an object."""
    iterations: int
    """Mean-field updates."""

    @classmethod
    def of(cls, cloud: Cloud, candidates: Sequence[Candidate], scale: Scale, config: LabelConfig) -> "ObjectCrf":
        """The CRF of some objects.

        Args:
            cloud: the points.
            candidates: the objects.
            scale: of the episode.
            config: weights and widths.
        """
        return cls._of(cloud, candidates, scale, config)

    @classmethod
    def _of(
        cls,
        cloud: Cloud,
        candidates: Sequence[Candidate],
        scale: Scale,
        config: LabelConfig,
        numbers: Sequence[int] | None = None,
    ) -> "ObjectCrf":
        """The same of objects that are not numbered from 0."""
        log_odds = object_log_odds(cloud, candidates, config, numbers)
        active = ActivePoints.of(log_odds > UNREACHABLE_LOG_ODDS)
        return cls(log_odds, active, crf_kernels(cloud, active, scale.object_m, config), config.iterations)

    def merged(
        self,
        groups: Sequence[Sequence[int]],
        cloud: Cloud,
        candidates: Sequence[Candidate],
        scale: Scale,
        config: LabelConfig,
    ) -> "ObjectCrf":
        """The CRF after some objects have become one; what is known of the others is kept.

        Args:
            groups: for each new object which of the old ones it is.
            cloud: the points.
            candidates: the new objects.
            scale: of the episode.
            config: weights and widths.
        """
        if config.published.empty_kernel:
            return ObjectCrf.of(cloud, candidates, scale, config)
        joined = [new for new, group in enumerate(groups) if len(group) > 1]
        numbers = [groups[new][0] for new in joined]
        changed = self._of(cloud, [candidates[new] for new in joined], scale, config, numbers)
        parts = [
            (changed, joined.index(new)) if len(group) > 1 else (self, group[0]) for new, group in enumerate(groups)
        ]
        log_odds = np.stack([one.log_odds[:, k] for one, k in parts]).T
        kernels = []
        for number, kernel in enumerate(self.kernels):
            lattices = [(one.kernels[number].filter, k) for one, k in parts]
            kernels.append(Kernel(lattice_of_blocks(lattices), kernel.weight))  # type: ignore[arg-type]
        return ObjectCrf(log_odds, ActivePoints.of(log_odds > UNREACHABLE_LOG_ODDS), kernels, self.iterations)

    def marginals(self, exclusive: bool) -> Float32[np.ndarray, "n k"]:
        """Probability of every object at every point.

        Args:
            exclusive: one multi-label CRF in which objects compete for points; False: one binary CRF per object.
        """
        return self.active.marginals(self.log_odds, self.kernels, self.iterations, exclusive)


def crf_kernels(cloud: Cloud, active: ActivePoints, object_m: float, config: LabelConfig) -> list[Kernel]:
    """An appearance kernel (position and colour) and a smoothness kernel (position alone).

    Args:
        cloud: the points.
        active: which of them may belong to which object; objects are blocks that do not see each other's points.
        object_m: size of a typical object, metres.
        config: weights and widths.
    """
    if config.published.empty_kernel:
        return [Kernel(ConstantKernel(active.block_start), config.smoothness_weight)]
    appearance_m = config.appearance_width_m or config.appearance_width * object_m
    smoothness_m = config.smoothness_width_m or config.smoothness_width_voxels * cloud.voxel_m
    points, kernels = cloud.points[active.point], []
    if config.appearance_weight > 0:
        colours = cloud.colours[active.point] / config.appearance_colour
        features = np.concatenate([points / appearance_m, colours], axis=1)
        kernels.append(Kernel(build_lattice(features, active.block_start), config.appearance_weight))
    if config.smoothness_weight > 0:
        kernels.append(Kernel(build_lattice(points / smoothness_m, active.block_start), config.smoothness_weight))
    return kernels
