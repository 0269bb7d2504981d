"""Frustum PointNets on disk: their spec in the header."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec

from labeling.core.detector import DetectorError
from labeling.detectors3d.frustum_pointnet import FrustumNet, FrustumSpec
from labeling.training.weights import load_weights, read_header, save_weights

SPEC_KEY, ABOUT_KEY = "frustum_net", "about"


def save_network(path: Path, network: FrustumNet, about: Mapping[str, Any]) -> None:
    """Writes a network atomically.

    Args:
        path: of the file.
        network: what to write.
        about: where it comes from, as JSON.
    """
    save_weights(path, network, {SPEC_KEY: json.dumps(asdict(network.spec)), ABOUT_KEY: json.dumps(about)})


def load_network(path: Path) -> FrustumNet:
    """Reads a network, on the CPU, in evaluation mode.

    Raises:
        DetectorError: if the file is missing, damaged, or holds something else.
    """
    network = FrustumNet(_spec(read_header(path, SPEC_KEY, "labeling.train3d"), path))
    load_weights(path, network, f"a frustum PointNet for {', '.join(network.spec.categories)}")
    return network.eval()


def _spec(text: str, path: Path) -> FrustumSpec:
    try:
        spec = msgspec.json.decode(text, type=FrustumSpec)
    except msgspec.MsgspecError as error:
        raise DetectorError(f"{path}: the description of its network is damaged ({error})") from None
    sizes = [side for template in spec.sizes_m for side in template]
    if not (
        spec.categories
        and len(spec.sizes_m) == len(spec.categories)
        and all(0 < side < float("inf") for side in sizes)
        and 0 < spec.width <= 8
        and 0 < spec.num_points <= 1_000_000
    ):
        raise DetectorError(f"{path}: the description of its network makes no sense")
    return spec
