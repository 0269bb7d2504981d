"""An option that must be known before the command line is parsed, since the defaults of others depend on it."""

import sys
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TypeVar

Name = TypeVar("Name", bound=str)


def named_option(arguments: Sequence[str] | None, flag: str, names: Iterable[Name]) -> Name:
    """The name that is given with a flag, the last where it is given several times.

    Args:
        arguments: the command line; ``sys.argv`` if None.
        flag: such as ``--preset``.
        names: that there are; the first stands for none of them. What else is given is told by the parser, with the
            names there are.

    Example:
        >>> named_option(["EPISODES", "--preset", "paper"], "--preset", ("default", "paper"))
        'paper'
        >>> named_option(["--preset=papr"], "--preset", ("default", "paper"))
        'default'
    """
    words = sys.argv[1:] if arguments is None else arguments
    given = [
        after if word == flag else word.removeprefix(f"{flag}=")
        for word, after in pairwise([*words, ""])
        if word == flag or word.startswith(f"{flag}=")
    ]
    known = list(names)
    return next((name for name in known if name in given[-1:]), known[0])
