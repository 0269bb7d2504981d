"""Corrupted inputs: every command on copies of a valid input of which one file or two are spoilt."""

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.campaign.damage import damage
from experiments.campaign.subjects import SUBJECTS, files_of
from experiments.campaign.trial import FINE, Trial, run_trial


@dataclass(frozen=True)
class Job:
    """One corruption."""

    number: int
    seed: int
    inputs: Path
    """See ``make_inputs``."""
    failing: Path
    """Inputs that a command did not survive are kept here."""


@dataclass(frozen=True)
class Found:
    """What came of it."""

    number: int
    subject: str
    done: dict[str, str]
    """What was done to which file."""
    trial: Trial


def make_corruption() -> Callable[[Job], Found]:
    """Made once in each process; returns what does the jobs. Modules are imported by the first of each kind."""
    return _corrupt


def _corrupt(job: Job) -> Found:
    rng = np.random.default_rng([job.seed, job.number])
    weights = np.array([subject.weight for subject in SUBJECTS])
    subject = SUBJECTS[int(rng.choice(len(SUBJECTS), p=weights / weights.sum()))]
    with tempfile.TemporaryDirectory(prefix="sbm_campaign_") as scratch:
        folder = Path(scratch)
        given, out = folder / "in", folder / "results" / "out"
        shutil.copytree(job.inputs / subject.inputs, given)
        done = damage(given, files_of(subject, given), rng)
        writes = given if subject.writes_beside else out
        if writes is out:
            out.parent.mkdir()
        spoilt = folder.parent / f"{folder.name}_spoilt"
        shutil.copytree(given, spoilt, symlinks=True, copy_function=_copy)
        try:
            trial = run_trial(
                subject.module, subject.command(given, out), folder, writes, subject.variables(given, out)
            )
            if trial.outcome not in FINE:
                target = job.failing / f"{job.number:05d}"
                shutil.rmtree(target, ignore_errors=True)
                shutil.copytree(spoilt, target, symlinks=True, copy_function=_copy)
        finally:
            shutil.rmtree(spoilt, ignore_errors=True)
    return Found(job.number, subject.name, done, trial)


def _copy(source: str, target: str) -> None:
    """Copies files; pipes are made anew."""
    import os
    import stat

    if stat.S_ISFIFO(Path(source).lstat().st_mode):
        os.mkfifo(target)
    else:
        shutil.copy2(source, target, follow_symlinks=False)
