"""Weights on disk: what the system refuses is an error of the system, and nothing lies beside the file."""

import errno
from pathlib import Path

import pytest
import torch

from labeling.training.weights import save_tensors


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device that is always full")
def test_a_full_disk_is_an_error_of_the_system():
    with pytest.raises(OSError, match="No space left") as raised:
        save_tensors({"a": torch.zeros(2)}, Path("/dev/full"))
    assert raised.value.errno == errno.ENOSPC


def test_a_file_is_written_straight_to_its_place(tmp_path, monkeypatch):
    seen = []
    write_bytes = Path.write_bytes
    monkeypatch.setattr(
        Path, "write_bytes", lambda self, data: seen.append(list(tmp_path.iterdir())) or write_bytes(self, data)
    )
    save_tensors({"a": torch.arange(3)}, tmp_path / "weights.safetensors", {"made": "here"})
    assert seen == [[]]
    from safetensors import safe_open

    with safe_open(tmp_path / "weights.safetensors", "pt") as file:
        assert file.metadata() == {"made": "here"}
        assert file.get_tensor("a").tolist() == [0, 1, 2]
