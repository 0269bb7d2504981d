"""GRNN's egomotion: a view's volume is turned to every azimuth and elevation and compared with the memory.

Source: Tung et al. 2019, "Egomotion estimation and stabilization"; thesis 2.1.1. The camera is taken to look at the
middle of the grid from a known distance, so that two angles are all that is unknown. One liberty: the paper's plain
inner product is greatest where two views see the same part of the grid, whatever is there; here volumes are compared,
and normalised, over what both have seen.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from labeling.memory.lifting.stabilisation import warp
from labeling.memory.settings.grid_spec import GridSpec

TEMPERATURE = 0.02
"""Of the softmax over correlations, which lie in [-1, 1]."""
LEAST_ENERGY = 5.0
"""Sum of squares over what both have seen, below which a correlation does not count in full: a few voxels agree by
chance."""


@dataclass(frozen=True)
class RotationSearch:
    """What a search over azimuths and elevations has found."""

    correlation: Float[Tensor, "b a e"]
    """With the memory, in [-1, 1]."""
    probability: Float[Tensor, "b a e"]
    """Softmax of it."""
    aligned: Float[Tensor, "b c z y x"]
    """The volumes of all bins, weighted by probability: stabilised."""

    def best(self) -> Int[Tensor, "b 2"]:
        """Index of the azimuth and of the elevation with the highest correlation."""
        flat = self.correlation.flatten(1).argmax(dim=1)
        elevations = self.correlation.shape[2]
        return torch.stack([flat // elevations, flat % elevations], dim=1)


def gaze_rotation(azimuth_rad: float, elevation_rad: float) -> Float[Tensor, "3 3"]:
    """Axes of a camera that looks along a heading and downwards, as columns: forward, left, up."""
    a, e = torch.tensor(azimuth_rad, dtype=torch.float64), torch.tensor(elevation_rad, dtype=torch.float64)
    zero, one = torch.zeros_like(a), torch.ones_like(a)
    turn = torch.stack([a.cos(), -a.sin(), zero, a.sin(), a.cos(), zero, zero, zero, one]).reshape(3, 3)
    tilt = torch.stack([e.cos(), zero, e.sin(), zero, one, zero, -e.sin(), zero, e.cos()]).reshape(3, 3)
    return (turn @ tilt).float()


def camera_in_gaze_grid(distance_m: float) -> Float[Tensor, "4 4"]:
    """Pose of a camera in the grid that is aligned with its own gaze: at -x, looking at the origin."""
    pose = torch.eye(4)
    # OpenCV axes (right, down, forward) in forward, left, up.
    pose[:3, :3] = torch.tensor([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    pose[0, 3] = -distance_m
    return pose


def search_rotation(
    memory: Float[Tensor, "b c z y x"],
    memory_seen: Float[Tensor, "b 1 z y x"],
    view: Float[Tensor, "b c z y x"],
    view_seen: Float[Tensor, "b 1 z y x"],
    azimuths_rad: Float[Tensor, "a"],
    elevations_rad: Float[Tensor, "e"],
    spec: GridSpec,
) -> RotationSearch:
    """Finds how a view's volume is to be turned to fit the memory.

    Args:
        memory: what is known.
        memory_seen: 1 where it is: occupied or free; ones for the paper's inner product.
        view: volume of one view, in the grid that is aligned with its gaze (``camera_in_gaze_grid``).
        view_seen: likewise.
        azimuths_rad: headings to try, relative to the memory's +X, counter-clockwise from above.
        elevations_rad: to try: how far the camera looks down.
        spec: of both grids.

    Returns:
        Correlation of every bin, and the stabilised volume.
    """
    turned, scores = [], []
    for azimuth in azimuths_rad.tolist():
        for elevation in elevations_rad.tolist():
            new_to_old = torch.eye(4)
            new_to_old[:3, :3] = gaze_rotation(azimuth, elevation).T
            both = warp(torch.cat([view, view_seen], dim=1), new_to_old.to(view).expand(len(view), 4, 4), spec)
            turned.append(both[:, :-1])
            scores.append(correlation(memory, memory_seen, both[:, :-1], both[:, -1:]))
    shape = (len(view), len(azimuths_rad), len(elevations_rad))
    score = torch.stack(scores, dim=1)
    probability = (score / TEMPERATURE).softmax(dim=1)
    aligned = sum(probability[:, number, None, None, None, None] * one for number, one in enumerate(turned))
    assert isinstance(aligned, Tensor)
    return RotationSearch(score.reshape(shape), probability.reshape(shape), aligned)


def correlation(
    one: Float[Tensor, "b c z y x"],
    one_seen: Float[Tensor, "b 1 z y x"],
    other: Float[Tensor, "b c z y x"],
    other_seen: Float[Tensor, "b 1 z y x"],
) -> Float[Tensor, "b"]:
    """Inner product of two volumes, normalised over what both have seen; in [-1, 1], near 0 if that is little."""
    product = (one * other).flatten(1).sum(dim=1)
    energies = [(a.square() * seen).flatten(1).sum(dim=1) for a, seen in ((one, other_seen), (other, one_seen))]
    return product / (energies[0] * energies[1]).sqrt().clamp(min=LEAST_ENERGY)
