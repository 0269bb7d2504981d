"""Networks on disk: safetensors with the spec in the header. Nothing is pickled."""

import hashlib
from pathlib import Path

import torch

from labeling.core.detector import DetectorError
from labeling.detectors.networks.mask_rcnn import Network, build_network
from labeling.detectors.networks.spec import NetworkSpec
from labeling.io.formats.atomic import atomic_file

SPEC_KEY = "network"


def save_network(path: Path, network: Network, spec: NetworkSpec | None = None) -> None:
    """Writes a network atomically, matrices and kernels in half precision.

    Vectors (biases, statistics of normalisation) stay in single precision: they are small, and a variance below what
    half precision can hold would become 0.

    Args:
        path: of the file.
        network: what to write.
        spec: what to write beside it; by default the network's own.
    """
    from safetensors.torch import save_file

    tensors = {
        name: value.detach().to("cpu", torch.float16 if value.is_floating_point() and value.ndim > 1 else value.dtype)
        for name, value in network.state_dict().items()
    }
    with atomic_file(path) as temporary:
        save_file(
            {name: value.contiguous() for name, value in tensors.items()},
            temporary,
            metadata={SPEC_KEY: (spec or network.spec).as_json()},
        )
        temporary.chmod(0o644)  # safetensors keeps its files to their owner


def read_spec(path: Path) -> NetworkSpec:
    """What network a file holds.

    Raises:
        DetectorError: if it is missing, damaged, or no network.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
    except FileNotFoundError:
        raise DetectorError(f"{path}: no such file") from None
    except (SafetensorError, OSError) as error:
        raise DetectorError(f"{path}: is damaged or no safetensors file ({error})") from None
    if SPEC_KEY not in metadata:
        raise DetectorError(f"{path}: holds tensors, but does not say of which network; make it with labeling.finetune")
    return NetworkSpec.from_json(metadata[SPEC_KEY], str(path))


def load_network(path: Path) -> Network:
    """Reads a network, in single precision on the CPU.

    Raises:
        DetectorError: if the file is missing or damaged, or its tensors do not fit the network it says it holds.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    spec = read_spec(path)
    network = build_network(spec)
    try:
        tensors = load_file(path)
    except (SafetensorError, OSError) as error:
        raise DetectorError(f"{path}: is damaged ({error})") from None
    wanted = network.state_dict()
    wrong = sorted(
        name
        for name in wanted.keys() | tensors.keys()
        if name not in wanted or name not in tensors or wanted[name].shape != tensors[name].shape
    )
    if wrong:
        raise DetectorError(
            f"{path}: its tensors are not those of {spec.architecture} with {len(spec.categories)} categories "
            f"({', '.join(spec.names[:5])}, ...): {wrong[0]} and {len(wrong) - 1} more do not fit"
        )
    bad = next((name for name, value in tensors.items() if not bool(torch.isfinite(value.float()).all())), None)
    if bad is not None:
        raise DetectorError(f"{path}: {bad} holds NaN or infinity")
    network.load_state_dict({name: value.to(wanted[name].dtype) for name, value in tensors.items()})
    return network


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
