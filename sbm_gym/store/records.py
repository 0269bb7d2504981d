"""Typed records as JSON and arrays: dataclasses and named tuples of numbers, texts, arrays and other records."""

import dataclasses
import functools
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

Record = TypeVar("Record")

FEW = 16
"""Arrays of at most so many numbers are written into the JSON."""


def encode(kind: Any, value: Any, arrays: list[np.ndarray], find_class: Callable[[str], type | None]) -> Any:
    """Serialises a value.

    Args:
        kind: its annotated type.
        value: the value.
        arrays: larger arrays are appended; the JSON holds their indices.
        find_class: the class of a name, for values whose annotated type is a protocol; None if it is not allowed.

    Raises:
        TypeError: if it is, or holds, something that cannot be serialised.
    """
    if value is None:
        return None
    kind = _without_none(kind)
    if _is_array(kind):
        return _encode_array(np.asarray(value), arrays)
    origin = typing.get_origin(kind)
    if origin in (list, tuple):
        element = typing.get_args(kind)[0]
        return [encode(element, part, arrays, find_class) for part in value]
    if origin in (dict, Mapping):
        element = typing.get_args(kind)[1]
        return {name: encode(element, part, arrays, find_class) for name, part in value.items()}
    if _is_record(kind):
        return [encode(part, getattr(value, name), arrays, find_class) for name, part in _fields(kind).items()]
    if kind in (bool, int, float, str):
        return kind(value)
    if kind is bytes:
        return value.hex()
    name = type(value).__name__
    if find_class(name) is not type(value):
        raise TypeError(f"{name} cannot be kept where {kind} is asked for")
    return {name: encode(type(value), value, arrays, find_class)}


def decode(
    kind: type[Record], record: Any, arrays: Sequence[np.ndarray], find_class: Callable[[str], type | None]
) -> Record:
    """The value that ``encode`` has serialised; arguments as there.

    Raises:
        TypeError, ValueError, KeyError, IndexError: if the record is not of this kind.
    """
    return _decode(kind, record, arrays, find_class)


def _decode(kind: Any, record: Any, arrays: Sequence[np.ndarray], find_class: Callable[[str], type | None]) -> Any:
    if record is None:
        return None
    kind = _without_none(kind)
    if _is_array(kind):
        return arrays[record] if isinstance(record, int) else np.array(record[1], record[0]).reshape(record[2])
    origin = typing.get_origin(kind)
    if origin in (list, tuple):
        element = typing.get_args(kind)[0]
        return origin(_decode(element, part, arrays, find_class) for part in record)
    if origin in (dict, Mapping):
        element = typing.get_args(kind)[1]
        return {name: _decode(element, part, arrays, find_class) for name, part in record.items()}
    if _is_record(kind):
        fields = _fields(kind)
        return kind(
            *(_decode(part, one, arrays, find_class) for part, one in zip(fields.values(), record, strict=True))
        )
    if kind in (bool, int, float, str):
        return kind(record)
    if kind is bytes:
        return bytes.fromhex(record)
    ((name, fields),) = record.items()
    found = find_class(name)
    if found is None:
        raise TypeError(f"there is no {name} that could be read")
    return _decode(found, fields, arrays, find_class)


def _encode_array(value: np.ndarray, arrays: list[np.ndarray]) -> Any:
    if value.dtype.kind not in "biuf":
        raise TypeError(f"arrays of {value.dtype} cannot be kept")
    if value.size <= FEW:
        return [value.dtype.str, value.ravel().tolist(), list(value.shape)]
    arrays.append(np.ascontiguousarray(value))
    return len(arrays) - 1


def _without_none(kind: Any) -> Any:
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        kind, *others = [part for part in typing.get_args(kind) if part is not type(None)]
        if others:
            raise TypeError(f"{kind} or {others[0]} cannot be told apart in a record")
    return kind


def _is_array(kind: Any) -> bool:
    return kind is np.ndarray or hasattr(kind, "array_type")


def _is_record(kind: Any) -> bool:
    return dataclasses.is_dataclass(kind) or hasattr(kind, "_fields")


@functools.cache
def _fields(kind: Any) -> dict[str, Any]:
    """Names and types of the fields of a dataclass or named tuple, in order."""
    hints = typing.get_type_hints(kind)
    names = [field.name for field in dataclasses.fields(kind)] if dataclasses.is_dataclass(kind) else kind._fields
    return {name: hints[name] for name in names}
