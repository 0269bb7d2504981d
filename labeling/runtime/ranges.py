"""Ranges of settings, written where the settings are: ``iterations: Positive[int] = 4000``."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar, get_args, get_type_hints

from labeling.core.errors import UsageError

Number = TypeVar("Number", int, float)


@dataclass(frozen=True)
class Range:
    """Which values a setting may have."""

    words: str
    """Completes "--setting must ..."."""
    allows: Callable[[Any], bool]


Positive = Annotated[Number, Range("be above 0", lambda value: 0 < value < math.inf)]
NonNegative = Annotated[Number, Range("be 0 or more", lambda value: 0 <= value < math.inf)]
Count = Annotated[int, Range("be at least 1", lambda value: value >= 1)]
Seed = Annotated[int, Range("lie from 0 to 2147483647", lambda value: 0 <= value < 2**31)]
PictureHeight = Annotated[int, Range("be at least 32 pixels", lambda value: value >= 32)]
Share = Annotated[Number, Range("lie in [0, 1]", lambda value: 0 <= value <= 1)]
PositiveShare = Annotated[Number, Range("lie above 0 and at most at 1", lambda value: 0 < value <= 1)]
ShareBelowOne = Annotated[Number, Range("be at least 0 and below 1", lambda value: 0 <= value < 1)]
Interval = Annotated[tuple[Number, Number], Range("be a range above 0: low, then high", lambda v: 0 < v[0] <= v[1])]


class Settings:
    """Base of dataclasses of settings, some of whose fields are annotated with a range."""

    def check(self) -> None:
        """Refuses settings outside of their ranges; see ``check_ranges``."""
        check_ranges(self)


def check_ranges(settings: Any) -> None:
    """Refuses settings outside of their ranges; None, where a setting may be None, is in any.

    Args:
        settings: instance of a dataclass, some of whose fields are annotated with a range.

    Raises:
        UsageError: naming the first such setting as its option is called, what it must be, and its value.
    """
    for name, hint in get_type_hints(type(settings), include_extras=True).items():
        value: Any = getattr(settings, name)
        ranges = [one for part in (hint, *get_args(hint)) for one in getattr(part, "__metadata__", ())]
        for allowed in ranges:
            if isinstance(allowed, Range) and value is not None and not allowed.allows(value):
                raise UsageError(f"--{name.replace('_', '-')} must {allowed.words}, not {value}")
