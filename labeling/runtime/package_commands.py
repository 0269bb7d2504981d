"""``python -m PACKAGE``: which commands a package has, and what each does."""

import ast
import difflib
import functools
import re
import shutil
import sys
import textwrap
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from labeling.runtime.cli import BAD_INPUT
from labeling.runtime.help import MAX_WIDTH, asks_for_help

_RUNS = re.compile(r"^if __name__ ==", re.MULTILINE)
"""Stands in every module that can be run."""


def make_main(package: str) -> Callable[..., int]:
    """The ``main`` of ``python -m package``; takes a command line, by default ``sys.argv``, and returns the exit code.

    Args:
        package: its name, such as "labeling".
    """
    return functools.partial(_say, package)


def _say(package: str, arguments: list[str] | None = None) -> int:
    words = sys.argv[1:] if arguments is None else arguments
    if words and not asks_for_help(words):
        near = difflib.get_close_matches(words[0], [name.partition(".")[2] for name in commands(package)], 1)
        hint = f"did you mean python -m {package}.{near[0]}?" if near else f"python -m {package} lists its commands"
        print(f"error: {package} is a package, and takes no {words[0]!r}; {hint}", file=sys.stderr)
        return BAD_INPUT
    print(overview(package))
    return 0


def commands(package: str) -> dict[str, str]:
    """The commands of a package, as ``python -m`` takes them, and what each does.

    Read from the first lines of their source, so that nothing heavy is loaded.
    """
    folder = _folder(package)
    paths = sorted([*folder.glob("*.py"), *folder.glob("*/__main__.py")], key=lambda path: path.as_posix())
    found = {}
    for path in paths:
        source = path.read_text(encoding="utf-8")
        if path.parent / path.name != folder / "__main__.py" and _RUNS.search(source):
            name = path.parent.name if path.name == "__main__.py" else path.stem
            found[f"{package}.{name}"] = _does(ast.get_docstring(ast.parse(source)) or "")
    return dict(sorted(found.items()))


def _folder(package: str) -> Path:
    spec = find_spec(package)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent


def _does(docstring: str) -> str:
    """What a module does: its first line, up to where that says how to call it."""
    return re.split(r":? *``(?:python -m|sbm) ", docstring.partition("\n")[0])[0].replace("`", "").rstrip(".")


def overview(package: str) -> str:
    """What ``python -m package`` prints: what the package is for, and its commands."""
    docstring = ast.get_docstring(ast.parse((_folder(package) / "__init__.py").read_text(encoding="utf-8"))) or ""
    found = commands(package)
    column = max(map(len, found)) + 4
    width = min(shutil.get_terminal_size().columns, MAX_WIDTH)
    rows = [
        textwrap.fill(f"  {name:{column - 2}}{does}", width, subsequent_indent=" " * column, break_on_hyphens=False)
        for name, does in found.items()
    ]
    lines = [
        f"usage: python -m {package}.COMMAND ...",
        "",
        textwrap.fill(docstring.partition("\n\n")[0].replace("``", ""), width),
        "",
        "commands:",
        *rows,
        "",
        f"python -m {package}.COMMAND --help tells of one; sbm lists those of all packages by short names.",
    ]
    return "\n".join(lines)
