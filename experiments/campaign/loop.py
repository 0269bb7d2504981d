"""The never-ending loop left to itself: killed again and again, started anew as a supervisor would, until it is done.

It must end with the figures of a loop that nothing disturbed.
"""

import json
import shutil
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign.processes import Ended, kill, start, wait
from labeling.core.errors import SbmError

NAME = "never-ending loop"
RESTARTS = 200
"""Times that a loop is started at most."""
LEAST_S, MOST_S = 2.0, 60.0
"""A loop lives so long before it is killed."""
ELSEWHERE = ("made_on", "machine")
"""What results tell of day and machine."""


@dataclass(frozen=True)
class Outlived:
    """What came of one loop."""

    subject: str
    what: str
    kills: int
    outcome: str
    """``survived``, or what was wrong."""
    told: str
    """What it said at the end."""


class Loop:
    """Runs the loop in one folder, always the same, as names of folders are part of what is written."""

    def __init__(self, folder: Path) -> None:
        """Does nothing yet.

        Args:
            folder: emptied by each run.
        """
        self._folder = folder
        self._expected: dict[str, Any] | None = None

    def undisturbed(self) -> dict[str, Any]:
        """Its figures when nothing disturbs it; run once.

        Raises:
            SbmError: if it fails.
        """
        if self._expected is None:
            self._clear()
            ended = wait(self._start(), 3600.0)
            if ended.code != 0:
                raise SbmError(f"{NAME}: fails undisturbed: {ended.told[-500:]}")
            self._expected = self._figures()
        return self._expected

    def disturbed(self, rng: np.random.Generator) -> Outlived:
        """Kills it at random moments until it is done."""
        expected = self.undisturbed()
        self._clear()
        numbers = [signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT]
        outcome, kills, told = "does not end", 0, ""
        while kills < RESTARTS:
            moment_s, number = float(rng.uniform(LEAST_S, MOST_S)), int(rng.choice(numbers))
            ended = wait_up_to(self._start(), moment_s, number)
            told = ended.told[-2000:]
            if "Traceback" in ended.told:
                outcome = f"traceback at signal {number}"
                break
            if ended.code == 0:
                outcome = "survived" if self._figures() == expected else "other figures"
                break
            if ended.code == 2:
                outcome = "cannot go on"
                break
            kills += 1
        return Outlived(NAME, f"{kills} kills", kills, outcome, told)

    def _start(self) -> "subprocess.Popen[str]":
        places = [f"--{name}={self._folder / name}" for name in ("cache", "results", "docs")]
        return start("experiments.run", ["never_ending", "--scale", "smoke", "--workers", "1", *places])

    def _clear(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def _figures(self) -> dict[str, Any]:
        content = json.loads((self._folder / "results" / "never_ending.json").read_text())
        return {name: value for name, value in content.items() if name not in ELSEWHERE}


def wait_up_to(process: "subprocess.Popen[str]", seconds: float, number: int) -> Ended:
    """Waits for the end of a process, and after so many seconds sends it a signal and waits on."""
    try:
        _, told = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        kill(process, number)
        return wait(process)
    except BaseException:
        kill(process)
        raise
    return Ended(process.returncode, told, seconds)
