"""C-N3D's memory: the mean of all views' volumes over what each has seen.

Source: Harley et al. 2020, section 3.1, "Latent map update"; thesis 2.3.1.
"""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class RunningMean:
    """Volumes summed up so far, and how often each voxel was seen. Does not depend on the order of views."""

    total: Float[Tensor, "b c z y x"]
    weight: Float[Tensor, "b 1 z y x"]

    @classmethod
    def of(cls, volume: Float[Tensor, "b c z y x"], weight: Float[Tensor, "b 1 z y x"]) -> "RunningMean":
        """After one view.

        Args:
            volume: of the view.
            weight: of each of its voxels: 0 where it has not seen anything.
        """
        return cls(volume * weight, weight)

    def updated(self, volume: Float[Tensor, "b c z y x"], weight: Float[Tensor, "b 1 z y x"]) -> "RunningMean":
        """After another view."""
        return RunningMean(self.total + volume * weight, self.weight + weight)

    def mean(self) -> Float[Tensor, "b c z y x"]:
        """The memory: 0 where nothing was seen."""
        return self.total / self.weight.clamp(min=1e-6)


def mean_over_views(
    volumes: Float[Tensor, "b v c z y x"], weights: Float[Tensor, "b v 1 z y x"]
) -> Float[Tensor, "b c z y x"]:
    """The same of all views at once."""
    return RunningMean((volumes * weights).sum(dim=1), weights.sum(dim=1)).mean()
