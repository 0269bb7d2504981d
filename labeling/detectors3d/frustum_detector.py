"""A frustum PointNet as a 3-D detector, and on disk with its spec in the header."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labeling.core.episode import Episode
from labeling.core.masks import box_xyxy
from labeling.core.types import Detection
from labeling.detectors3d.base import Detection3d
from labeling.detectors3d.frustum_dataset import resample_points
from labeling.detectors3d.frustum_pointnet import FrustumNet, FrustumSpec
from labeling.detectors3d.frustums import Frustum, make_frustum
from labeling.detectors3d.upright_boxes import decode_box
from labeling.training.weights import load_weights, read_spec, save_with_spec

SPEC_KEY = "frustum_net"
MIN_POINTS = 8
"""A frustum of fewer points gets no box."""
BATCH_SIZE = 32
"""Frustums at a time."""


class FrustumDetector:
    """Estimates a box for every detection of a category that the network knows."""

    def __init__(self, network: FrustumNet, name: str, digest: str = "", device: str = "cpu") -> None:
        self.name, self.digest, self.categories = name, digest, network.spec.categories
        self._network, self._device = network.to(device).eval(), device

    def lift(self, episode: Episode, detections: Sequence[Detection]) -> list[Detection3d]:
        """See ``labeling.detectors3d.base.Detector3d``.

        The confidence is the 2-D detection's times the mean probability of the points that were taken for the object's.
        """
        spec = self._network.spec
        kept: list[tuple[Detection, Frustum]] = []
        for one in detections:
            if one.category in spec.categories and one.mask.any():
                depth_m, camera = episode.depth_m[one.view_index], episode.camera(one.view_index)
                rng = np.random.default_rng(0)
                frustum = make_frustum(depth_m, camera, box_xyxy(one.mask), spec.num_points, rng)
                if len(frustum.points) >= MIN_POINTS:
                    kept.append((one, frustum))
        found: list[Detection3d] = []
        for start in range(0, len(kept), BATCH_SIZE):
            some = kept[start : start + BATCH_SIZE]
            clouds = [frustum.points for _, frustum in some]
            chosen = [resample_points(len(points), spec.num_points, np.random.default_rng(0)) for points in clouds]
            points = np.stack([points[order] for points, order in zip(clouds, chosen, strict=True)])
            numbers = torch.tensor([spec.categories.index(one.category) for one, _ in some])
            with torch.inference_mode():
                output = self._network(torch.from_numpy(points).to(self._device), numbers.to(self._device))
                boxes = self._network.boxes(output).cpu().numpy()
                scores = _mean_probability(output.logits).cpu().numpy()
            for (one, frustum), box, score in zip(some, boxes, scores, strict=True):
                world = frustum.to_world(decode_box(box))
                found.append(Detection3d(one.view_index, one.category, one.confidence * float(score), world))
        return found


def _mean_probability(logits: torch.Tensor) -> torch.Tensor:
    """Over the points taken for the object's; the highest where there are none."""
    probability = logits.sigmoid()
    own = (logits > 0).to(probability.dtype)
    count = own.sum(dim=1)
    return torch.where(count > 0, (probability * own).sum(dim=1) / count.clamp(min=1), probability.amax(dim=1))


def save_network(path: Path, network: FrustumNet, about: Mapping[str, Any]) -> None:
    """Writes a network atomically.

    Args:
        path: of the file.
        network: what to write.
        about: where it comes from, as JSON.
    """
    save_with_spec(path, network, SPEC_KEY, about)


def load_network(path: Path) -> FrustumNet:
    """Reads a network, on the CPU, in evaluation mode.

    Raises:
        DetectorError: if the file is missing, damaged, or holds something else.
    """
    network = FrustumNet(read_spec(path, SPEC_KEY, FrustumSpec, "labeling.train3d"))
    load_weights(path, network, f"a frustum PointNet for {', '.join(network.spec.categories)}")
    return network.eval()
