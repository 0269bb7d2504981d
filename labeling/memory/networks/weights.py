"""Memories on disk: weights with the network's spec in the header."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.networks.grnn import Grnn
from labeling.memory.networks.tower import Tower
from labeling.memory.settings.memory_spec import MemorySpec
from labeling.training.weights import load_weights, read_spec, save_with_spec

MEMORY_FILE = "memory.safetensors"
SPEC_KEY = "memory"
Memory = Grnn | Cn3d | Tower


def build_memory(spec: MemorySpec) -> Memory:
    """A network of random weights."""
    return {"grnn": Grnn, "cn3d": Cn3d, "tower": Tower}[spec.model](spec)


def save_memory(path: Path, network: Memory, about: Mapping[str, Any]) -> None:
    """Writes a network atomically.

    Args:
        path: of the file.
        network: what to write.
        about: where it comes from, as JSON.
    """
    save_with_spec(path, network, SPEC_KEY, about)


def load_memory(path: Path) -> Memory:
    """Reads a network, on the CPU, in evaluation mode.

    Args:
        path: the file, or the folder of a run.

    Raises:
        DetectorError: if the file is missing, damaged, or holds something else.
    """
    file = path / MEMORY_FILE if path.is_dir() else path
    spec = read_spec(file, SPEC_KEY, MemorySpec, "labeling.train_memory")
    network = build_memory(spec)
    load_weights(file, network, f"a memory of kind {spec.model}")
    return network.eval()


def memory_digest(memory: Memory) -> str:
    """Tells memories that have learnt something else apart."""
    found = hashlib.sha256()
    for value in memory.state_dict().values():
        found.update(value.detach().cpu().contiguous().numpy().tobytes())
    return found.hexdigest()
