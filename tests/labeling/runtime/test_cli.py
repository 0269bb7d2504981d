"""What commands print."""

import shlex
from pathlib import Path

from labeling.runtime.cli import say_next


def test_what_to_do_next_can_be_typed_as_it_stands(capsys):
    say_next("look at them", "labeling.inspect", Path("MY LABELS"), "--view")
    (line,) = capsys.readouterr().out.splitlines()
    what, _, command = line.partition(": ")
    assert what == "look at them"
    assert shlex.split(command) == ["python", "-m", "labeling.inspect", "MY LABELS", "--view"]
