"""Numbers in plain text files: time stamps, poses, camera matrices."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from labeling.core.errors import EpisodeFormatError
from labeling.formats.checked_json import read_text

MAX_BYTES = 64_000_000


def read_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and words of the lines of a file that hold more than a comment (``#``).

    Raises:
        EpisodeFormatError: if the file is missing or is not text.
    """
    if path.is_file() and path.stat().st_size > MAX_BYTES:
        raise EpisodeFormatError(f"{path}: {path.stat().st_size} bytes are more than the {MAX_BYTES} accepted")
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split("#", 1)[0].replace(",", " ").split()
        if words:
            yield number, words


def real_numbers(path: Path, line: int, words: list[str], finite: bool = True) -> list[float]:
    """The numbers of one line.

    Raises:
        EpisodeFormatError: naming file and line.
    """
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        raise EpisodeFormatError(f"{path}: line {line}: expected numbers, not {' '.join(words)[:40]!r}") from None
    if finite and not np.all(np.isfinite(numbers)):
        raise EpisodeFormatError(f"{path}: line {line}: holds NaN or infinity")
    return numbers


def read_matrix(path: Path, finite: bool = True) -> np.ndarray:
    """A matrix, one row a line; with ``finite=False`` it may hold NaN and infinity.

    Raises:
        EpisodeFormatError: naming file and line.
    """
    rows = [real_numbers(path, line, words, finite) for line, words in read_rows(path)]
    if not rows or len({len(row) for row in rows}) != 1:
        raise EpisodeFormatError(f"{path}: expected a matrix, but its lines hold {[len(row) for row in rows]} numbers")
    return np.array(rows)
