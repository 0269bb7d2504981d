"""Docstrings as Markdown: examples are blocks of code, and lists are lists."""

import re
from typing import Any

import griffe

from tools.website.lists import lists_apart

_DOCTEST = re.compile(r"^( *)>>> .*(?:\n\1(?! *$).+)*", re.MULTILINE)


def fenced(docstring: str) -> str:
    """The docstring with fences around its doctests, whose output would be read as Markdown otherwise."""
    return _DOCTEST.sub(lambda found: f"{found[1]}```pycon\n{found[0]}\n{found[1]}```", docstring)


class Doctests(griffe.Extension):
    """Called by mkdocstrings for everything that it reads."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Fences the doctests of an object's docstring, and sets its lists apart."""
        if obj.docstring is not None:
            obj.docstring.value = lists_apart(fenced(obj.docstring.value))
