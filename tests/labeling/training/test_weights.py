"""Weights on disk where the disk says no."""

import errno

import pytest
import torch

from labeling.training.weights import save_tensors


def test_a_full_disk_is_an_error_of_the_system(monkeypatch, tmp_path) -> None:
    import safetensors.torch

    def full(*arguments, **named):
        raise safetensors.SafetensorError("Error while serializing: I/O error: No space left on device (os error 28)")

    monkeypatch.setattr(safetensors.torch, "save_file", full)
    with pytest.raises(OSError, match="No space left") as told:
        save_tensors({"a": torch.zeros(2)}, tmp_path / "weights.safetensors")
    assert told.value.errno == errno.ENOSPC
