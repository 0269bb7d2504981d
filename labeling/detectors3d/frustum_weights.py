"""Frustum PointNets on disk: safetensors with the spec in the header. Nothing is pickled."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from labeling.core.detector import DetectorError
from labeling.detectors3d.frustum_pointnet import FrustumNet, FrustumSpec
from labeling.io.formats.atomic import atomic_file

SPEC_KEY, ABOUT_KEY = "frustum_net", "about"


def save_network(path: Path, network: FrustumNet, about: dict[str, Any]) -> None:
    """Writes a network atomically.

    Args:
        path: of the file.
        network: what to write.
        about: where it comes from, as JSON.
    """
    from safetensors.torch import save_file

    tensors = {name: value.detach().cpu().contiguous() for name, value in network.state_dict().items()}
    with atomic_file(path) as temporary:
        metadata = {SPEC_KEY: json.dumps(asdict(network.spec)), ABOUT_KEY: json.dumps(about)}
        save_file(tensors, temporary, metadata=metadata)
        temporary.chmod(0o644)  # safetensors keeps its files to their owner


def load_network(path: Path) -> FrustumNet:
    """Reads a network, on the CPU, ready to estimate.

    Raises:
        DetectorError: if the file is missing, damaged, or holds something else.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
    except FileNotFoundError:
        raise DetectorError(f"{path}: no such file; give the folder of a labeling.train3d run") from None
    except (SafetensorError, OSError) as error:
        raise DetectorError(f"{path}: is damaged or no safetensors file ({error})") from None
    if SPEC_KEY not in metadata:
        raise DetectorError(f"{path}: holds no frustum PointNet; make one with labeling.train3d")
    network = FrustumNet(_spec(metadata[SPEC_KEY], path))
    wanted = network.state_dict()
    for name in sorted(wanted.keys() | tensors.keys()):
        if name not in wanted or name not in tensors or wanted[name].shape != tensors[name].shape:
            raise DetectorError(f"{path}: its tensors are not those of the network that it says it holds ({name})")
        if not bool(torch.isfinite(tensors[name].float()).all()):
            raise DetectorError(f"{path}: {name} holds NaN or infinity")
    network.load_state_dict(tensors)
    return network.eval()


def _spec(text: str, path: Path) -> FrustumSpec:
    try:
        content = json.loads(text)
        spec = FrustumSpec(
            categories=tuple(str(name) for name in content["categories"]),
            sizes_m=tuple((float(a), float(b), float(c)) for a, b, c in content["sizes_m"]),
            width=float(content["width"]),
            num_points=int(content["num_points"]),
        )
    except (ValueError, KeyError, TypeError) as error:
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
