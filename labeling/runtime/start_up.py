"""Ctrl-C while a command still imports what it needs: one line, as later, instead of Python's traceback."""

import sys
from pathlib import Path
from types import TracebackType

INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 and the number of the signal."""

_PACKAGES = Path(__file__).parents[2]


def expect_interrupts() -> None:
    """Makes Ctrl-C end a command of this project with one line and code 130 until ``run_command`` takes care of it.

    To be called while a package is imported: ``sys.argv[0]`` then is ``-m`` for ``python -m PACKAGE.COMMAND``. Where
    others import the package nothing changes.
    """
    program = sys.argv[0] if getattr(sys, "argv", None) else ""
    if program == "-m" or Path(program).name == "sbm":
        sys.excepthook = _tell


def _tell(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
    program = Path(sys.argv[0])  # by now the file of the module that runs, unless its package is still imported
    ours = program.name in ("-m", "sbm") or _PACKAGES in program.parents
    if not ours or not issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, traceback)
        return
    print("interrupted before anything was done", file=sys.stderr)
    raise SystemExit(INTERRUPTED)
