"""Memory that is used again for the next picture: fresh memory costs a page fault for every four kilobytes."""

import math

import numpy as np
from numpy.typing import DTypeLike


class ReusedArrays:
    """Arrays by name."""

    def __init__(self) -> None:
        """Starts empty."""
        self._arrays: dict[str, np.ndarray] = {}

    def take(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> np.ndarray:
        """An array with any content; the one taken before under this name is no longer valid."""
        size = math.prod(shape)
        if name not in self._arrays or len(self._arrays[name]) < size:
            self._arrays[name] = np.empty(size, dtype)
        return self._arrays[name][:size].reshape(shape)
