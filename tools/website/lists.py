"""Lists as GitHub reads them: they may follow a paragraph without an empty line between, which MkDocs asks for."""

import re

_FENCED = re.compile(r"(^ *```.*?^ *```)", re.MULTILINE | re.DOTALL)
_BEGINNING = re.compile(r"^((?! *(?:[-*]|\d+\.) )\S.*\n)(?=(?:-|1\.) )", re.MULTILINE)


def lists_apart(markdown: str) -> str:
    """The text with an empty line before every list; code is left as it is.

    Args:
        markdown: lists in it are not indented.
    """
    parts = _FENCED.split(markdown)
    # Every second part is code.
    return "".join(part if number % 2 else _BEGINNING.sub(r"\1\n", part) for number, part in enumerate(parts))
