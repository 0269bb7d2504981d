"""Memories on disk: weights with the network's spec in the header."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.networks.grnn import Grnn
from labeling.memory.networks.tower import Tower
from labeling.memory.settings.grid_spec import Around
from labeling.memory.settings.memory_spec import MemorySpec
from labeling.training.weights import ABOUT_KEY, load_weights, read_spec, save_with_spec

MEMORY_FILE = "memory.safetensors"
SPEC_KEY, TRAINED_BY = "memory", "labeling.train_memory"
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
    file = _file(path)
    spec = read_spec(file, SPEC_KEY, MemorySpec, TRAINED_BY)
    network = build_memory(spec)
    load_weights(file, network, f"a memory of kind {spec.model}")
    return network.eval()


@dataclass(frozen=True)
class _About:
    """What is read of where a memory comes from."""

    around: Around = "fixated"
    """Not said by the earliest runs, whose grid stood there."""


def read_around(path: Path) -> Around:
    """What the grid of a memory stood around when it was trained.

    Args:
        path: as for ``load_memory``.

    Raises:
        DetectorError: if the file is missing or damaged, or says something else.
    """
    return read_spec(_file(path), ABOUT_KEY, _About, TRAINED_BY).around


def _file(path: Path) -> Path:
    return path / MEMORY_FILE if path.is_dir() else path


def memory_digest(memory: Memory) -> str:
    """Tells memories that have learnt something else apart."""
    found = hashlib.sha256()
    for value in memory.state_dict().values():
        found.update(value.detach().cpu().contiguous().numpy().tobytes())
    return found.hexdigest()
