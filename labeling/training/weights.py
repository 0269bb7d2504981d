"""Weights on disk: safetensors with the network's spec in the header. Nothing is pickled."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import torch
from torch import nn

from labeling.core.detector import DetectorError
from labeling.core.errors import SbmError, UsageError
from labeling.formats.atomic import atomic_file
from labeling.formats.regular_file import regular

ABOUT_KEY = "about"
"""Entry of the header that says where a network comes from."""
Spec = TypeVar("Spec")


def save_tensors(tensors: dict[str, torch.Tensor], path: Path, header: dict[str, str] | None = None) -> None:
    """Writes a safetensors file, not atomically.

    Raises:
        OSError: where the system refuses.
    """
    from safetensors.torch import save

    # Its own function for files writes beside the path, under a name that nobody would sweep up after a kill.
    path.write_bytes(save(tensors, metadata=header))


def save_weights(path: Path, network: nn.Module, header: Mapping[str, str], half_precision: bool = False) -> None:
    """Writes the weights of a network atomically.

    Args:
        path: of the file.
        network: on any device.
        header: the network's spec, and whatever else is to be known of it, as text.
        half_precision: of matrices and kernels. Vectors (biases, statistics of normalisation) stay in single precision:
            they are small, and a variance below what half precision can hold would become 0.
    """
    tensors = {}
    for name, value in network.state_dict().items():
        halve = half_precision and value.is_floating_point() and value.ndim > 1
        tensors[name] = value.detach().to("cpu", torch.float16 if halve else value.dtype).contiguous()
    with atomic_file(path) as temporary:
        save_tensors(tensors, temporary, dict(header))


def save_with_spec(path: Path, network: nn.Module, key: str, about: Mapping[str, Any]) -> None:
    """Writes a network atomically, its spec and where it comes from in the header.

    Args:
        path: of the file.
        network: what to write; its ``spec`` is a dataclass.
        key: of the spec in the header; ``read_spec`` takes the same.
        about: where it comes from, as JSON.
    """
    spec: Any = network.spec
    save_weights(path, network, {key: json.dumps(asdict(spec)), ABOUT_KEY: json.dumps(about)})


def read_spec(path: Path, key: str, kind: type[Spec], command: str) -> Spec:
    """What network a file holds.

    Args:
        path: of the file.
        key: of the spec in the header.
        kind: the spec's class.
        command: writes such files; for the message.

    Raises:
        DetectorError: if the file is missing or damaged, or describes no such network.
    """
    try:
        return msgspec.json.decode(read_header(path, key, command), type=kind)
    except (msgspec.MsgspecError, UsageError) as error:
        raise DetectorError(f"{path}: the description of its network is damaged ({error})") from None


def read_header(path: Path, key: str, command: str) -> str:
    """One entry of a file's header: what network it holds.

    Args:
        path: of the file.
        key: of the entry.
        command: writes such files; for the message.

    Raises:
        DetectorError: if the file is missing, damaged, or has no such entry.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(regular(path), framework="pt") as file:
            header = file.metadata() or {}
    except FileNotFoundError:
        raise DetectorError(f"{path}: no such file; give the folder of a {command} run") from None
    except (SafetensorError, OSError) as error:
        raise DetectorError(f"{path}: is damaged or no safetensors file ({error})") from None
    if key not in header:
        raise DetectorError(f"{path}: holds tensors, but does not say of which network; make it with {command}")
    return header[key]


def load_weights(path: Path, network: nn.Module, description: str) -> None:
    """Fills a network with weights, in the network's own precision.

    Args:
        path: of the file.
        network: built as its header says.
        description: of the network; for messages.

    Raises:
        DetectorError: if the file is damaged, or its tensors do not fit the network or are not finite.
    """
    wanted = network.state_dict()
    tensors = read_tensors(path, wanted, description, DetectorError)
    network.load_state_dict({name: value.to(wanted[name].dtype) for name, value in tensors.items()})


def read_tensors(
    path: Path, wanted: Mapping[str, torch.Tensor], description: str, error_class: type[SbmError]
) -> dict[str, torch.Tensor]:
    """The tensors of a file.

    Args:
        path: of the file.
        wanted: tensors of the names and shapes that must be in it.
        description: of the network they are of; for messages.
        error_class: of the errors.

    Raises:
        SbmError: if the file is missing or damaged, or its tensors do not fit or are not finite.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        tensors = load_file(regular(path))
    except FileNotFoundError:
        raise error_class(f"{path}: no such file") from None
    except (SafetensorError, OSError) as error:
        raise error_class(f"{path}: is damaged or no safetensors file ({error})") from None
    wrong = sorted(
        name
        for name in wanted.keys() | tensors.keys()
        if name not in wanted or name not in tensors or wanted[name].shape != tensors[name].shape
    )
    if wrong:
        raise error_class(
            f"{path}: its tensors are not those of {description}: {wrong[0]} and {len(wrong) - 1} more do not fit"
        )
    bad = next((name for name, value in tensors.items() if not bool(torch.isfinite(value.float()).all())), None)
    if bad is not None:
        raise error_class(f"{path}: {bad} holds NaN or infinity")
    return tensors


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
