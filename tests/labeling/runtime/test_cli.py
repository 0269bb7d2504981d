"""What commands print."""

import errno
import os
import shlex
import threading
from dataclasses import dataclass
from pathlib import Path

from labeling.runtime.cli import run_command, say_next


@dataclass(frozen=True)
class Nothing:
    """A command without options."""


def test_what_to_do_next_can_be_typed_as_it_stands(capsys):
    say_next("look at them", "labeling.inspect", Path("MY LABELS"), "--view")
    (line,) = capsys.readouterr().out.splitlines()
    what, _, command = line.partition(": ")
    assert what == "look at them"
    assert shlex.split(command) == ["python", "-m", "labeling.inspect", "MY LABELS", "--view"]


def test_what_the_system_refuses_to_another_thread_is_one_line(capsys):
    def write_curves() -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "curves")

    def work(_: Nothing) -> None:
        thread = threading.Thread(target=write_curves)
        thread.start()
        thread.join()

    before = threading.excepthook
    assert run_command(Nothing, work, "program", []) == 0
    assert threading.excepthook is before
    told = capsys.readouterr().err
    assert told == "note: curves: No space left on device; make room, or give a place on another disk\n"
