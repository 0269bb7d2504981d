"""What all command lines of the project have in common: options from a dataclass, errors in one line, exit codes."""

import contextlib
import errno
import functools
import os
import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

import tyro

from labeling.core.errors import SbmError
from labeling.runtime.extras import missing_extra
from labeling.runtime.help import NOTHING, CommandHelp, asks_for_help, help_text
from labeling.runtime.interrupts import STOPPING, exit_when_told, heed_lost_stops
from labeling.runtime.start_up import INTERRUPTED

Config = TypeVar("Config")

BAD_INPUT = 2
_NAME: ContextVar[str | None] = ContextVar("_NAME", default=None)
"""What the user typed to call the command, where that is not ``python -m``."""


def progress_bar(items: Any = None, unit: str = "batch", **options: Any) -> Any:
    """The items, with a bar on stderr from the third second on (``tqdm``, which takes the options)."""
    from tqdm import tqdm

    return tqdm(items, unit=unit, delay=2.0, leave=False, file=sys.stderr, **options)


@contextmanager
def showing_stages(bar: Any) -> Iterator[None]:
    """Shows the stages that this thread reports (``labeling.runtime.progress``) beside a progress bar."""
    from labeling.runtime.progress import progress_reported_to

    def show(stage: str) -> None:
        if bar.disable:
            return
        bar.set_postfix_str(stage, refresh=False)
        now_s = time.time()
        if now_s - bar.start_t > bar.delay and now_s - bar.last_print_t > bar.mininterval:
            bar.last_print_t = now_s
            bar.refresh()

    with progress_reported_to(show):
        yield


def say_next(what: str, module: str, *words: object) -> None:
    """Prints what to do next with what a command has written, as a command line that can be typed as it stands.

    >>> say_next("look at them", "labeling.inspect", "MY LABELS", "--view")
    look at them: python -m labeling.inspect 'MY LABELS' --view
    """
    print(printable(f"{what}: {shlex.join(['python', '-m', module, *map(str, words)])}"))


def printable(text: str) -> str:
    """Text that may hold names from files of others, for a terminal: control characters are spelled, not obeyed."""
    return "".join(one if one.isprintable() or one in "\n\t" else repr(one)[1:-1] for one in text)


@contextmanager
def called_as(name: str) -> Iterator[None]:
    """Help and messages in the block call the command by another name than that of its module."""
    token = _NAME.set(name)
    try:
        yield
    finally:
        _NAME.reset(token)


def make_main(
    name: str,
    config_type: type[Config],
    run: Callable[[Config], object],
    resumes: bool = True,
    about: CommandHelp = NOTHING,
) -> Callable[..., int]:
    """The ``main`` of ``python -m name``; takes a command line, by default ``sys.argv``, and returns the exit code.

    Args:
        name: of the module.
        config_type: see ``run_command``, as for the others.
        run: does the work.
        resumes: whether the same command, given again, goes on with what is missing.
        about: groups of options, and examples.
    """
    return functools.partial(run_command, config_type, run, f"python -m {name}", resumes=resumes, about=about)


def run_command(
    config_type: type[Config] | Any,
    run: Callable[[Config], object],
    prog: str,
    arguments: list[str] | None = None,
    description: str | None = None,
    start: Config | None = None,
    resumes: bool = True,
    about: CommandHelp = NOTHING,
) -> int:
    """Parses the command line into a config and runs it.

    Args:
        config_type: frozen dataclass of options; its docstrings are the help text. For subcommands a union of such,
            each annotated with ``tyro.conf.subcommand``.
        run: does the work; what it returns is ignored. Raises ``SbmError`` where something about the input is wrong.
        prog: how the command is called, for the help text.
        arguments: the command line; ``sys.argv`` if None.
        description: of a command with subcommands, for the help text.
        start: defaults that differ from those of ``config_type``; ``tyro.MISSING`` stands for what must be given.
        resumes: whether the same command, given again, goes on with what is missing; else it begins anew.
        about: groups of options, and examples, for the help text.

    Returns:
        The exit code: 0; 2 if something about the input is wrong or an extra is not installed, after one line on
        stderr, also where the system refuses to read or write something (a full disk, a folder that may not be written
        to); 128 + n after one line if a signal n told it to stop (130 for Ctrl-C, 143 for SIGTERM, 129 for SIGHUP),
        once temporary files are removed.
    """
    prog = _NAME.get() or prog
    given: dict[str, Any] = {} if start is None else {"default": start}
    words = sys.argv[1:] if arguments is None else arguments
    again = "the same command " + ("goes on with what is missing" if resumes else "begins anew")
    try:
        if asks_for_help(words):
            print(help_text(config_type, prog, about, words, description, given), flush=True)
            sys.exit(0)
        config = tyro.cli(config_type, prog=prog, args=arguments, description=description, **given)
        with exit_when_told(), heed_lost_stops(), _threads_in_one_line():
            run(config)
        sys.stdout.flush()
    except (SbmError, ModuleNotFoundError) as error:
        told = error if isinstance(error, SbmError) else missing_extra(error, prog)
        if told is None:
            raise
        print(f"error: {printable(str(told))}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f"interrupted; {again}", file=sys.stderr)
        return INTERRUPTED
    except SystemExit as told:
        names = {128 + number: number.name for number in STOPPING}
        if told.code not in names:
            raise
        # The terminal that is told may be gone.
        with contextlib.suppress(OSError):
            print(f"ended by {names[told.code]}; {again}", file=sys.stderr)
        return told.code
    except BrokenPipeError:
        # Whoever read the output has closed it (`... | head`). Python would complain once more when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        print(f"error: {printable(refusal(error))}", file=sys.stderr)
        return BAD_INPUT
    return 0


@contextlib.contextmanager
def _threads_in_one_line() -> Iterator[None]:
    """What the system refuses to other threads, such as those that write curves, is one line and no traceback."""
    before = threading.excepthook

    def tell(given: threading.ExceptHookArgs) -> None:
        if isinstance(given.exc_value, OSError):
            print(f"note: {printable(refusal(given.exc_value))}", file=sys.stderr)
        else:
            before(given)

    threading.excepthook = tell
    try:
        yield
    finally:
        threading.excepthook = before


def refusal(error: OSError) -> str:
    """What the system has refused, in one sentence: what, with which file, and what to do."""
    file = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
    advice = {
        errno.ENOSPC: "; make room, or give a place on another disk",
        errno.EDQUOT: "; make room, or give a place on another disk",
        errno.EROFS: "; give another place to write to",
        errno.EACCES: "; change its permissions, or give another place",
        errno.EMFILE: "; raise the limit of open files (ulimit -n)",
    }.get(error.errno or 0, "")
    return f"{file}{error.strerror or error}{advice}"
