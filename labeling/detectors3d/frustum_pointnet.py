"""Frustum PointNet: which points of a frustum are the object's, where its middle is, and the box of all of it.

Source: Qi et al. 2018, "Frustum PointNets for 3D Object Detection from RGB-D Data", v1 (PointNet backbone), after
section 4 and appendix A. Two liberties: headings are known within half a turn (``labeling.detectors3d.upright_boxes``),
and all layers can be made narrower.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import torch
from torch import Tensor, nn

from labeling.core.errors import UsageError
from labeling.detectors3d.upright_boxes import HALF_TURN

HEADINGS = 6
"""Bins of half a turn; their width is that of the paper, 30 degrees."""
OBJECT_POINTS = 512
"""Points of the object that its box is estimated from. Source: the paper's appendix."""
MOMENTUM = 0.1
"""Share of a batch in the running statistics of normalisation. Source: PyTorch's default."""
ANCHORS = 3
"""Numbers per size template: length, width, height."""


@dataclass(frozen=True)
class FrustumSpec:
    """What a network knows; written into its weights."""

    categories: tuple[str, ...]
    sizes_m: tuple[tuple[float, float, float], ...]
    """For each category the size template that residuals are relative to: length, width, height."""
    width: float = 1.0
    """Channels of every layer relative to the paper's."""
    num_points: int = 1024
    """Of a frustum. Source: thesis 5.2.2 (field notes)."""

    def __post_init__(self) -> None:
        """Checks what a file may say.

        Raises:
            UsageError: if it makes no sense.
        """
        sizes = [side for template in self.sizes_m for side in template]
        if not (
            self.categories
            and len(self.sizes_m) == len(self.categories)
            and all(0 < side < float("inf") for side in sizes)
            and 0 < self.width <= 8
            and 0 < self.num_points <= 1_000_000
        ):
            raise UsageError(
                f"a frustum PointNet knows categories, a size above 0 m of each, a width above 0 and up to 8, and one "
                f"to a million points, not {self.categories}, {self.sizes_m}, {self.width} and {self.num_points}"
            )


@dataclass(frozen=True)
class FrustumOutput:
    """What the network says about a batch of frustums, in their frames."""

    logits: Tensor
    """(b, n): above 0 for points of the object."""
    first_centre: Tensor
    """(b, 3): after the T-Net."""
    centre: Tensor
    """(b, 3)"""
    heading_scores: Tensor
    """(b, HEADINGS)"""
    heading_residuals: Tensor
    """(b, HEADINGS): in half bins, from the bins' middles."""
    size_scores: Tensor
    """(b, k): of each size template."""
    size_residuals: Tensor
    """(b, k, 3): relative to the template."""


class SharedMlp(nn.Sequential):
    """Fully connected layers, normalised over whatever comes before the channels: (..., c) -> (..., d).

    On (b, n, c) they are the layers that a PointNet applies to every point alike; as products of matrices they take two
    thirds of the time of 1x1 convolutions on a CPU.
    """

    def __init__(self, *channels: int) -> None:
        super().__init__(
            *(
                nn.Sequential(
                    nn.Linear(before, after, bias=False),
                    nn.BatchNorm1d(after, momentum=MOMENTUM),
                    nn.ReLU(inplace=True),
                )
                for before, after in pairwise(channels)
            )
        )

    def forward(self, input: Tensor) -> Tensor:
        """Goes through the layers."""
        return super().forward(input.flatten(0, -2)).unflatten(0, input.shape[:-1])

    def largest(self, points: Tensor) -> Tensor:
        """The largest output of all points in each channel: (b, n, c) -> (b, d), as ``forward(points).amax(dim=1)``.

        Normalising and rectifying keep the order of a channel, or turn it round where the weight is negative, so that
        only the largest sums go through both. The mean and the variance over all points follow from those of the
        layer's inputs. Channels are most there, so that training takes less time.
        """
        *before, last = cast("Iterable[nn.Sequential]", self)
        linear, norm, _ = cast("tuple[nn.Linear, nn.BatchNorm1d, nn.ReLU]", last)
        input = points.flatten(0, -2)
        for layer in before:
            input = layer(input)
        with torch.no_grad():
            signed = torch.where(norm.weight < 0, -1.0, 1.0)[:, None] * linear.weight
            of_each = nn.functional.linear(input, signed).unflatten(0, points.shape[:-1])
            first = of_each.shape[1] * torch.arange(len(of_each), device=input.device)
            place = of_each.max(dim=1).indices + first[:, None]  # sooner than by argmax
        chosen = input.index_select(0, place.flatten()).unflatten(0, place.shape)  # gradients add up in a fixed order
        largest = torch.einsum("bdc,dc->bd", chosen, linear.weight)
        if self.training:
            middle = input.mean(dim=0)
            apart = input - middle
            mean = linear(middle)
            variance = (linear(apart.T @ apart / len(input)).T * linear.weight).sum(dim=1)
            _follow(norm, mean, variance, len(input))
        else:
            mean, variance = norm.get_buffer("running_mean"), norm.get_buffer("running_var")
        return torch.relu((largest - mean) * torch.rsqrt(variance + norm.eps) * norm.weight + norm.bias)


class PointSegmentation(nn.Module):
    """Which points are the object's."""

    def __init__(self, num_categories: int, width: float) -> None:
        super().__init__()
        c64, c128, c256, c512, c1024 = (_channels(c, width) for c in (64, 128, 256, 512, 1024))
        self.local = SharedMlp(3, c64, c64, c64)
        self.whole = SharedMlp(c64, c128, c1024)
        # The layer after both are put together, in two parts: that of the whole is the same for all points.
        self.from_local = nn.Linear(c64, c512, bias=False)
        self.from_whole = nn.Linear(c1024 + num_categories, c512, bias=False)
        self.together = nn.Sequential(nn.BatchNorm1d(c512), nn.ReLU(inplace=True))
        self.head = nn.Sequential(SharedMlp(c512, c256, c128, c128), nn.Dropout(0.5), nn.Linear(c128, 1))

    def forward(self, points: Tensor, category: Tensor) -> Tensor:
        """Args: points (b, n, 3), category one-hot (b, k). Returns: logits (b, n)."""
        local = self.local(points)
        whole = self.from_whole(torch.cat([self.whole.largest(local), category], dim=1))
        both = self.from_local(local) + whole[:, None]
        return self.head(self.together(both.flatten(0, 1)).unflatten(0, both.shape[:2]))[..., 0]


class PointNet(nn.Module):
    """A PointNet with one output vector, as the T-Net and the box network are."""

    def __init__(self, shared: tuple[int, ...], full: tuple[int, ...], num_categories: int, outputs: int) -> None:
        super().__init__()
        self.shared = SharedMlp(3, *shared)
        self.full = SharedMlp(shared[-1] + num_categories, *full)
        self.last = nn.Linear(full[-1], outputs)

    def forward(self, points: Tensor, category: Tensor) -> Tensor:
        """Args: points (b, n, 3), category one-hot (b, k). Returns: (b, outputs)."""
        return self.last(self.full(torch.cat([self.shared.largest(points), category], dim=1)))


class FrustumNet(nn.Module):
    """The three networks, one after the other."""

    sizes_m: Tensor
    """(k, 3): the size templates."""

    def __init__(self, spec: FrustumSpec) -> None:
        super().__init__()
        self.spec = spec
        k, width = len(spec.categories), spec.width
        c128, c256, c512 = (_channels(c, width) for c in (128, 256, 512))
        self.segmentation = PointSegmentation(k, width)
        self.centre_net = PointNet((c128, c128, c256), (c256, c128), k, 3)
        self.box_net = PointNet((c128, c128, c256, c512), (c512, c256), k, 3 + 2 * HEADINGS + k * (1 + ANCHORS))
        self.register_buffer("sizes_m", torch.tensor(spec.sizes_m, dtype=torch.float32).reshape(k, 3))

    def forward(self, points: Tensor, category: Tensor) -> FrustumOutput:
        """Estimates boxes.

        Args:
            points: (b, n, 3), in the frustum frame, in random order.
            category: (b,), index into ``spec.categories``.
        """
        known = nn.functional.one_hot(category, len(self.spec.categories)).to(points.dtype)
        logits = self.segmentation(points, known)
        chosen = object_points(points, logits.detach())
        middle = chosen.mean(dim=1)
        own = chosen - middle[:, None]
        shift = self.centre_net(own, known)
        found = self.box_net(own - shift[:, None], known)
        k = len(self.spec.categories)
        centre, heading_scores, heading_residuals, size_scores, size_residuals = found.split(
            [3, HEADINGS, HEADINGS, k, k * ANCHORS], dim=1
        )
        first = middle + shift
        return FrustumOutput(
            logits=logits,
            first_centre=first,
            centre=first + centre,
            heading_scores=heading_scores,
            heading_residuals=heading_residuals,
            size_scores=size_scores,
            size_residuals=size_residuals.reshape(-1, k, ANCHORS),
        )

    def boxes(self, output: FrustumOutput) -> Tensor:
        """The likeliest boxes: (b, 7), as ``labeling.detectors3d.upright_boxes`` writes them."""
        rows = torch.arange(len(output.centre), device=output.centre.device)
        heading, size = output.heading_scores.argmax(dim=1), output.size_scores.argmax(dim=1)
        angle = bin_to_heading(heading, output.heading_residuals[rows, heading])
        sides = self.sizes_m[size] * (1 + output.size_residuals[rows, size]).clamp(min=0.05)
        return torch.cat([output.centre, sides, torch.remainder(angle, HALF_TURN)[:, None]], dim=1)


def object_points(points: Tensor, logits: Tensor) -> Tensor:
    """The points that are the object's, repeated or cut off at ``OBJECT_POINTS``; the likeliest one if none is.

    Args:
        points: (b, n, 3)
        logits: (b, n)
    """
    logits = torch.where(logits == logits.amax(dim=1, keepdim=True), logits.abs() + 1e-6, logits)
    own = logits > 0
    order = torch.argsort(own.to(torch.uint8), dim=1, descending=True, stable=True)
    turn = torch.arange(OBJECT_POINTS, device=points.device)[None] % own.sum(dim=1, keepdim=True)
    chosen = order.gather(1, turn)
    return points.gather(1, chosen[:, :, None].expand(-1, -1, 3))


def bin_to_heading(bin_index: Tensor, residual: Tensor) -> Tensor:
    """Radians, from a bin and a residual in half bins."""
    return (bin_index + 0.5 * residual) * (HALF_TURN / HEADINGS)


def heading_to_bin(heading_rad: Tensor) -> tuple[Tensor, Tensor]:
    """The other way round: the bin whose middle is nearest, and the residual in half bins, in [-1, 1]."""
    place = heading_rad * (HEADINGS / HALF_TURN)
    nearest = torch.round(place)
    return torch.remainder(nearest, HEADINGS).long(), 2 * (place - nearest)


@torch.no_grad()
def _follow(norm: nn.BatchNorm1d, mean: Tensor, variance: Tensor, count: int) -> None:
    """Has the running statistics of a normalisation follow those of a batch of so many, as it does itself."""
    norm.get_buffer("num_batches_tracked").add_(1)
    norm.get_buffer("running_mean").lerp_(mean, MOMENTUM)
    norm.get_buffer("running_var").lerp_(variance * (count / (count - 1)), MOMENTUM)


def _channels(of_paper: int, width: float) -> int:
    return max(8, round(of_paper * width))
