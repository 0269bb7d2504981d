"""A frustum PointNet as a 3-D detector."""

from collections.abc import Sequence

import numpy as np
import torch

from labeling.core.episode import Episode
from labeling.core.masks import box_xyxy
from labeling.core.types import Detection
from labeling.detectors3d.base import Detection3d
from labeling.detectors3d.frustum_dataset import resample_points
from labeling.detectors3d.frustum_pointnet import FrustumNet
from labeling.detectors3d.frustums import make_frustum
from labeling.detectors3d.upright_boxes import decode_box

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
        frustums, kept = [], []
        for one in detections:
            if one.category not in spec.categories or not one.mask.any():
                continue
            depth_m, camera, rng = (
                episode.depth_m[one.view_index],
                episode.camera(one.view_index),
                np.random.default_rng(0),
            )
            frustum = make_frustum(depth_m, camera, box_xyxy(one.mask), spec.num_points, rng)
            if len(frustum.points) >= MIN_POINTS:
                frustums.append(frustum)
                kept.append(one)
        found: list[Detection3d] = []
        for start in range(0, len(kept), BATCH_SIZE):
            some = range(start, min(start + BATCH_SIZE, len(kept)))
            chosen = [resample_points(len(frustums[i].points), spec.num_points, np.random.default_rng(0)) for i in some]
            points = np.stack([frustums[i].points[order] for i, order in zip(some, chosen, strict=True)])
            numbers = torch.tensor([spec.categories.index(kept[i].category) for i in some])
            with torch.inference_mode():
                output = self._network(torch.from_numpy(points).to(self._device), numbers.to(self._device))
                boxes = self._network.boxes(output).cpu().numpy()
                trust = _mean_probability(output.logits).cpu().numpy()
            for i, box, share in zip(some, boxes, trust, strict=True):
                world = frustums[i].to_world(decode_box(box))
                one = kept[i]
                found.append(Detection3d(one.view_index, one.category, one.confidence * float(share), world))
        return found


def _mean_probability(logits: torch.Tensor) -> torch.Tensor:
    """Over the points taken for the object's; the highest where there are none."""
    probability = logits.sigmoid()
    own = (logits > 0).to(probability.dtype)
    count = own.sum(dim=1)
    return torch.where(count > 0, (probability * own).sum(dim=1) / count.clamp(min=1), probability.amax(dim=1))
