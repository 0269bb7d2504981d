"""Mask R-CNNs on disk: their spec in the header, matrices and kernels in half precision."""

from pathlib import Path

from labeling.detectors.networks.mask_rcnn import Network, build_network
from labeling.detectors.networks.spec import NetworkSpec
from labeling.training.weights import load_weights, read_header, save_weights

SPEC_KEY = "network"


def save_network(path: Path, network: Network, spec: NetworkSpec | None = None) -> None:
    """Writes a network atomically.

    Args:
        path: of the file.
        network: what to write.
        spec: what to write into the header; by default the network's own.
    """
    save_weights(path, network, {SPEC_KEY: (spec or network.spec).as_json()}, half_precision=True)


def read_spec(path: Path) -> NetworkSpec:
    """What network a file holds.

    Raises:
        DetectorError: if it is missing, damaged, or no network.
    """
    return NetworkSpec.from_json(read_header(path, SPEC_KEY, "labeling.finetune"), str(path))


def load_network(path: Path) -> Network:
    """Reads a network, in single precision on the CPU.

    Raises:
        DetectorError: if the file is missing or damaged, or its tensors do not fit the network it says it holds.
    """
    spec = read_spec(path)
    network = build_network(spec)
    names = ", ".join(spec.names[:5])
    load_weights(path, network, f"{spec.architecture} with {len(spec.categories)} categories ({names}, ...)")
    return network
