from dataclasses import dataclass, replace

import pytest

from labeling.core.errors import UsageError
from labeling.runtime.ranges import (
    NonNegative,
    PictureHeight,
    Positive,
    PositiveShare,
    Share,
    ShareBelowOne,
    check_ranges,
)


@dataclass(frozen=True)
class Base:
    batch_size: Positive[int] = 1
    name: str = "free"


@dataclass(frozen=True)
class Settings(Base):
    patience: NonNegative[int] = 0
    flip: Share[float] = 1.0
    average: ShareBelowOne[float] = 0.0
    edge_m: Positive[float] | None = None
    threshold: PositiveShare[float] = 1.0
    size: PictureHeight | None = None


def test_what_lies_within_its_range_is_accepted():
    check_ranges(Settings())
    check_ranges(Settings(size=32))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"batch_size": 0}, "--batch-size must be above 0, not 0"),  # inherited
        ({"batch_size": float("inf")}, "--batch-size must be above 0, not inf"),
        ({"patience": -1}, "--patience must be 0 or more, not -1"),
        ({"flip": 1.5}, r"--flip must lie in \[0, 1\], not 1.5"),
        ({"flip": float("nan")}, "--flip must lie in"),
        ({"edge_m": 0.0}, "--edge-m must be above 0, not 0.0"),
        ({"threshold": 0.0}, "--threshold must lie above 0 and at most at 1, not 0.0"),
        ({"average": 1.0}, "--average must be at least 0 and below 1, not 1.0"),
        ({"size": 31}, "--size must be at least 32 pixels, not 31"),
    ],
)
def test_what_does_not_is_refused_by_name(change, message):
    with pytest.raises(UsageError, match=message):
        check_ranges(replace(Settings(), **change))
