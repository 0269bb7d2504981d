"""Records survive being written as JSON and arrays."""

import json
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from jaxtyping import Float

from sbm_gym.store.records import FEW, decode, encode


class Shape(Protocol): ...


@dataclass(frozen=True)
class Circle:
    radius_m: float


class Table(NamedTuple):
    rows: Float[np.ndarray, "..."]
    name: str


@dataclass(frozen=True)
class Drawing:
    number: int
    is_done: bool
    table: Table
    circles: tuple[Circle, ...]
    sizes: dict[str, Float[np.ndarray, "..."]]
    key: bytes
    note: str | None
    shape: Shape | None


numbers = st.floats(allow_nan=False)
some_array = arrays_of.arrays(np.float64, arrays_of.array_shapes(max_dims=3, max_side=5, min_side=0), elements=numbers)
drawings = st.builds(
    Drawing,
    number=st.integers(-(2**60), 2**60),
    is_done=st.booleans(),
    table=st.builds(Table, some_array, st.text()),
    circles=st.lists(st.builds(Circle, numbers)).map(tuple),
    sizes=st.dictionaries(st.text(), some_array),
    key=st.binary(),
    note=st.none() | st.text(),
    shape=st.none() | st.builds(Circle, numbers),
)


@given(drawings)
def test_records_come_back_as_they_were(drawing):
    arrays: list[np.ndarray] = []
    text = json.dumps(encode(Drawing, drawing, arrays, {"Circle": Circle}.get))
    assert all(array.size > FEW for array in arrays)
    back = decode(Drawing, json.loads(text), arrays, {"Circle": Circle}.get)
    # repr tells -0.0 from 0.0, and an array's shape and numbers to the last digit.
    with np.printoptions(threshold=10**6, floatmode="unique"):
        assert repr(back) == repr(drawing)
    assert back.table.rows.dtype == np.float64


def test_what_is_not_known_is_refused():
    unknown = Drawing(1, True, Table(np.zeros(3), ""), (), {}, b"", None, Circle(1.0))
    with pytest.raises(TypeError, match="Circle cannot be kept"):
        encode(Drawing, unknown, [], {}.get)
    with pytest.raises(TypeError, match="cannot be kept"):
        encode(Table, Table(np.array([object()]), ""), [], {}.get)
    with pytest.raises(TypeError, match="cannot be told apart"):
        encode(int | str, 1, [], {}.get)
    with pytest.raises(TypeError, match="there is no Circle"):
        decode(Drawing, [1, True, [["<f8", [], [0]], ""], [], {}, "", None, {"Circle": [1.0]}], [], {}.get)
