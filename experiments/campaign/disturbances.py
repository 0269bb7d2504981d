"""Kills and faults: commands that write are killed at a random moment, or find no room, no right, or another writer.

Each must say so in one line where it can, and the same command, given again, must end with the very same files.
"""

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.campaign.inputs import ENV, TINY_BOXES, TINY_MEMORY
from experiments.campaign.processes import Ended, kill, leftovers, start, tree_digest, wait
from experiments.campaign.subjects import TUNING, Subject

_LABELS = ("{in}", "--out", "{out}")
_TRAINING = ("--env", ENV, "--hyperparams", "{in}/ppo.yaml", "--scenes", "1", "--validation-scenes", "1")
_TRAINING += ("--eval-episodes", "1", "--eval-every", "25", "--compare-episodes", "0", "--processes", "1")
WRITERS = (
    Subject("label", "labeling.generate", _LABELS, "episodes", (), resumes=True),
    Subject("label with two workers", "labeling.generate", (*_LABELS, "--workers", "2"), "episodes", (), resumes=True),
    Subject(
        "record",
        "agents.collect",
        ("--env", ENV, "--episodes", "3", "--size", "32", "--out", "{out}"),
        "episodes",
        (),
        resumes=True,
    ),
    Subject("convert", "labeling.convert", ("{in}/room", "--out", "{out}"), "tum", ()),
    Subject("fine-tune", "labeling.finetune", ("{in}/set", *TUNING, "--out", "{out}"), "labels", (), resumes=True),
    Subject("train", "agents.train", (*_TRAINING, "--out", "{out}"), "policy", (), resumes=True),
)
"""Commands that write, with small work."""
KILLED = (
    *WRITERS,
    Subject(
        "detect",
        "labeling.detect",
        ("{in}", "--detector", "compact", "--device", "cpu", "--replace"),
        "episodes",
        (),
        resumes=True,
        writes_beside=True,
    ),
    Subject(
        "find 3-D boxes",
        "labeling.detect3d",
        ("{in}/episodes", "--detector", "{in}/run", "--device", "cpu"),
        "boxes",
        (),
        resumes=True,
        writes_beside=True,
    ),
    Subject(
        "evaluate labels",
        "labeling.evaluate",
        ("{in}/set", "--dataset", "{in}/episodes"),
        "labels",
        (),
        resumes=True,
        writes_beside=True,
    ),
    Subject(
        "write labels for other tools",
        "labeling.convert",
        ("{in}/set", "--dataset", "{in}/episodes", "--to", "yolo-segment", "--out", "{out}"),
        "labels",
        (),
    ),
    Subject("train boxes", "labeling.train3d", ("{in}/set", *TINY_BOXES, "--out", "{out}"), "labels", (), resumes=True),
    Subject(
        "train a memory",
        "labeling.train_memory",
        ("{in}", *TINY_MEMORY, "--out", "{out}"),
        "episodes",
        (),
        resumes=True,
    ),
    Subject(
        "compare policies",
        "agents.evaluate",
        ("--policies", "ring", "random", "--env", ENV, "--scenes", "1", "--episodes", "2", "--out", "{out}"),
        "episodes",
        (),
        resumes=True,
    ),
    Subject(
        "take photographs",
        "sbm_gym.photographs.__main__",
        ("--count", "8", "--size", "64", "--builtin", "--out", "{out}"),
        "episodes",
        (),
        resumes=True,
    ),
    Subject(
        "install furniture",
        "sbm_gym.assets.__main__",
        ("install",),
        "furniture",
        (),
        resumes=True,
        environment=(("SBM_FURNITURE", "{in}/library.sh3f"), ("SBM_CACHE", "{out}")),
    ),
)
"""Those that are killed; some of them write beside what they read, which a full disk or a second writer cannot be given
to."""


@dataclass(frozen=True)
class Undisturbed:
    """What a command gives that nothing disturbs."""

    seconds: float
    files: dict[str, str]
    """Digests of the files that are the same in two runs; others hold times."""


@dataclass(frozen=True)
class Disturbed:
    """What came of one disturbance."""

    subject: str
    what: str
    outcome: str
    """``survived``, or what was wrong."""
    told: str
    """What the command said at the end."""


def undisturbed(subject: Subject, inputs: Path) -> Undisturbed:
    """Runs a command twice.

    Raises:
        SbmError: if it fails.
    """
    from labeling.core.errors import SbmError

    digests, seconds = [], 0.0
    for _ in range(2):
        with tempfile.TemporaryDirectory(prefix="sbm_campaign_") as scratch:
            given, out = _places(Path(scratch), subject, inputs)
            ended = wait(_start(subject, given, out))
            if ended.code != 0:
                raise SbmError(f"{subject.name}: fails undisturbed: {ended.told[-500:]}")
            digests.append(tree_digest(out))
            seconds = ended.seconds
    same = {name: digest for name, digest in digests[0].items() if digests[1].get(name) == digest}
    return Undisturbed(seconds, same)


def killed(subject: Subject, inputs: Path, expected: Undisturbed, rng: np.random.Generator) -> Disturbed:
    """Kills a command once or twice at random moments, then lets it finish."""
    with tempfile.TemporaryDirectory(prefix="sbm_campaign_") as scratch:
        given, out = _places(Path(scratch), subject, inputs)
        moments, number = [], int(rng.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
        for _ in range(1 + int(rng.random() < 0.3)):
            process = _start(subject, given, out)
            moments.append(float(rng.uniform(0.2, 1.0)) * expected.seconds)
            with suppress(subprocess.TimeoutExpired):
                process.wait(moments[-1])
            if process.poll() is None:
                kill(process, number)
            ended = wait(process, 30.0)
            if ended.code is None:
                return Disturbed(subject.name, "kill", f"does not end at signal {number}", ended.told[-2000:])
            if "Traceback" in ended.told:
                return Disturbed(subject.name, "kill", f"traceback at signal {number}", ended.told[-2000:])
            if not subject.resumes and out.exists():
                shutil.rmtree(out)
        what = f"signal {number} after " + " and ".join(f"{moment:.2f} s" for moment in moments)
        return _finished(subject, given, out, expected, what)


def starved(subject: Subject, inputs: Path, expected: Undisturbed, rng: np.random.Generator) -> Disturbed:
    """Gives a command a disk with hardly any room, then more."""
    with tempfile.TemporaryDirectory(prefix="sbm_campaign_") as scratch, tempfile.TemporaryDirectory() as disk:
        room_kb = int(rng.choice([4, 16, 64, 256, 1024]))
        _mount(f"size={room_kb}k", disk)
        try:
            given, out = _places(Path(scratch), subject, inputs)
            small = Path(disk) / "out"
            ended = wait(_start(subject, given, small))
            problem = _refusal(ended)
            left = leftovers(small)
        finally:
            subprocess.run(["umount", disk], check=True)
        what = f"a disk of {room_kb} KB"
        if problem or left:
            return Disturbed(subject.name, what, problem or f"left {left[0]}", ended.told[-2000:])
        return _finished(subject, given, out, expected, what)


def shut_out(subject: Subject, inputs: Path, expected: Undisturbed, rng: np.random.Generator) -> Disturbed:
    """Gives a command a place that it may not write to, then another."""
    with tempfile.TemporaryDirectory(prefix="sbm_campaign_") as scratch, tempfile.TemporaryDirectory() as disk:
        given, out = _places(Path(scratch), subject, inputs)
        if rng.random() < 0.5:
            what, place = "a place below a file", Path(scratch) / "file" / "out"
            place.parent.write_text("")
            ended = wait(_start(subject, given, place))
        else:
            what = "a read-only disk"
            _mount("ro", disk)
            try:
                ended = wait(_start(subject, given, Path(disk) / "out"))
            finally:
                subprocess.run(["umount", disk], check=True)
        problem = _refusal(ended, must_fail=True)
        if problem:
            return Disturbed(subject.name, what, problem, ended.told[-2000:])
        return _finished(subject, given, out, expected, what)


def joined(subject: Subject, inputs: Path, expected: Undisturbed, rng: np.random.Generator) -> Disturbed:
    """Starts a command twice at once, with the same place to write to."""
    with tempfile.TemporaryDirectory(prefix="sbm_campaign_") as scratch:
        given, out = _places(Path(scratch), subject, inputs)
        processes = [_start(subject, given, out)]
        time.sleep(float(rng.uniform(0.0, 0.3)) * expected.seconds)
        processes.append(_start(subject, given, out))
        for process in processes:
            ended = wait(process)
            if problem := _refusal(ended):
                return Disturbed(subject.name, "two at once", problem, ended.told[-2000:])
        if not subject.resumes and out.exists():
            shutil.rmtree(out)
        return _finished(subject, given, out, expected, "two at once")


CLOCK = """
import random, time
_time, _jump = time.time, random.Random(0)
time.time = lambda: _time() + _jump.choice([0.0, -7200.0, 7200.0, -3.0e7])
"""


def confused(subject: Subject, inputs: Path, expected: Undisturbed, rng: np.random.Generator) -> Disturbed:
    """Runs a command with a clock that jumps by hours, to and fro."""
    with tempfile.TemporaryDirectory(prefix="sbm_campaign_") as scratch:
        given, out = _places(Path(scratch), subject, inputs)
        (Path(scratch) / "sitecustomize.py").write_text(CLOCK)
        paths = os.pathsep.join(filter(None, [scratch, os.environ.get("PYTHONPATH", ""), str(Path.cwd())]))
        ended = wait(_start(subject, given, out, {"PYTHONPATH": paths}))
        if ended.code != 0:
            return Disturbed(subject.name, "a clock that jumps", f"exit code {ended.code}", ended.told[-2000:])
        return _compared(subject, out, expected, "a clock that jumps", ended)


Disturbance = Callable[[Subject, Path, Undisturbed, np.random.Generator], Disturbed]
KILLS: tuple[Disturbance, ...] = (killed,)
FAULTS: tuple[Disturbance, ...] = (starved, shut_out, joined, confused)


def _places(scratch: Path, subject: Subject, inputs: Path) -> tuple[Path, Path]:
    """A copy of the input, and where to write."""
    given, out = scratch / "in", scratch / "results" / "out"
    if not given.exists():
        shutil.copytree(inputs / subject.inputs, given)
        out.parent.mkdir()
    return given, given if subject.writes_beside else out


def _start(subject: Subject, given: Path, out: Path, more: dict[str, str] | None = None) -> "subprocess.Popen[str]":
    return start(subject.module, subject.command(given, out), subject.variables(given, out) | (more or {}))


def _mount(options: str, disk: str) -> None:
    """Mounts an empty disk in memory.

    Raises:
        SbmError: if this user may not.
    """
    from labeling.core.errors import SbmError

    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", disk]
    if subprocess.run(command, capture_output=True, check=False).returncode != 0:
        raise SbmError("disks that are full or read-only are mounted, which this user may not do; run it as root")


def _refusal(ended: Ended, must_fail: bool = False) -> str:
    """What is wrong with how a command ended that could not write; empty if nothing is."""
    if ended.code is None:
        return "hangs"
    if "Traceback" in ended.told:
        return "traceback"
    if ended.code == 0:
        return "says nothing" if must_fail else ""
    if ended.code != 2 or "error:" not in ended.told:
        return f"exit code {ended.code}"
    return ""


def _finished(subject: Subject, given: Path, out: Path, expected: Undisturbed, what: str) -> Disturbed:
    """The same command once more, undisturbed: it must end with the same files."""
    ended = wait(_start(subject, given, out))
    if ended.code != 0:
        return Disturbed(subject.name, what, f"cannot go on: exit code {ended.code}", ended.told[-2000:])
    return _compared(subject, out, expected, what, ended)


def _compared(subject: Subject, out: Path, expected: Undisturbed, what: str, ended: Ended) -> Disturbed:
    found = tree_digest(out)
    other = sorted(name for name, digest in expected.files.items() if found.get(name) != digest)
    left = leftovers(out)
    outcome = f"{other[0]} differs" if other else f"left {left[0]}" if left else "survived"
    return Disturbed(subject.name, what, outcome, ended.told[-2000:])
