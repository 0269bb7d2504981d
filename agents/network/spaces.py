"""Observation and action spaces as JSON, and what differs between two of them."""

import math
from typing import Any

import numpy as np
from gymnasium import spaces

PLAIN = ("uint8", "float32", "float64")
MAX_ENTRIES = 20_000_000
"""Of a described space; two pictures of 1920 x 1080 with depth have 17 million. A few bytes can claim gigabytes."""


def describe(space: spaces.Space) -> dict[str, Any]:
    """A space as JSON; bounds are numbers, or lists where they differ from entry to entry.

    Raises:
        ValueError: if it is no Box, no Dict of such and no MultiDiscrete.
    """
    if isinstance(space, spaces.Dict):
        return {"type": "Dict", "spaces": {name: describe(part) for name, part in space.spaces.items()}}
    if isinstance(space, spaces.MultiDiscrete):
        return {"type": "MultiDiscrete", "nvec": space.nvec.tolist()}
    if not isinstance(space, spaces.Box):
        raise ValueError(f"only Box and MultiDiscrete spaces and Dicts can be described, not {space}")
    return {
        "type": "Box",
        "shape": list(space.shape),
        "dtype": str(space.dtype),
        "low": _bound(space.low),
        "high": _bound(space.high),
    }


def _bound(bound: np.ndarray) -> float | list[Any]:
    # JSON has no infinity; the names that float() reads are text.
    def plain(value: float) -> Any:
        return value if np.isfinite(value) else str(value)

    if np.all(bound == bound.flat[0]):
        return plain(float(bound.flat[0]))
    return [plain(float(value)) for value in bound.ravel()]


def space_of(description: Any) -> spaces.Space:
    """The space that was described.

    Raises:
        ValueError: if it is no such description.
    """
    try:
        if description["type"] == "Dict":
            return spaces.Dict({str(name): space_of(part) for name, part in description["spaces"].items()})
        if description["type"] == "MultiDiscrete":
            counts = [int(count) for count in description["nvec"]]
            if not counts or min(counts) < 1 or max(counts) > MAX_ENTRIES:
                raise ValueError(f"no space has the choices {counts}")
            return spaces.MultiDiscrete(counts)
        if description["type"] != "Box" or description["dtype"] not in PLAIN:
            raise ValueError(f"no space is described by {description!r}")
        dtype: Any = np.dtype(description["dtype"])
        shape = tuple(int(size) for size in description["shape"])
        if not all(size > 0 for size in shape) or math.prod(shape) > MAX_ENTRIES:
            raise ValueError(f"no space has the shape {list(shape)}: expected 1 to {MAX_ENTRIES:,} entries")
        low, high = (_array(description[name], shape) for name in ("low", "high"))
        return spaces.Box(low.astype(dtype), high.astype(dtype), shape, dtype)
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f"no space is described by {description!r} ({error})") from None


def _array(bound: Any, shape: tuple[int, ...]) -> np.ndarray:
    values = np.asarray(bound, float)
    return np.full(shape, values) if values.ndim == 0 else values.reshape(shape)


def difference(wanted: spaces.Space, given: spaces.Space, name: str) -> str | None:
    """The first difference between what a checkpoint wants and an environment has, in words; None if there is none.

    Args:
        wanted: a space of the checkpoint; a Dict may lack parts that nothing in the network looks at.
        given: that of the environment.
        name: what to call them.
    """
    if isinstance(wanted, spaces.Dict) and isinstance(given, spaces.Dict):
        for key in wanted.spaces:
            if key not in given.spaces:
                return f"only the checkpoint has {name} {key!r}"
            found = difference(wanted[key], given[key], f"{name} {key!r}")
            if found:
                return found
        return None
    if wanted == given:
        return None
    if wanted.shape != given.shape:
        return f"{name} has shape {_shape(wanted)} in the checkpoint, {_shape(given)} in the env"
    return f"{name} is {wanted} in the checkpoint, {given} in the env"


def _shape(space: spaces.Space) -> str:
    return "x".join(map(str, space.shape or ())) or type(space).__name__
