"""A campaign: trials one after the other until time is over, each kept as a line, and what they come to."""

import itertools
import json
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign.campaign_config import CampaignConfig
from experiments.campaign.corruptions import Job, make_corruption
from experiments.campaign.disturbances import FAULTS, KILLED, KILLS, WRITERS, Disturbance, Undisturbed, undisturbed
from experiments.campaign.inputs import make_inputs
from experiments.campaign.loop import Loop
from experiments.campaign.soak import growth_mb_per_1000, soak
from experiments.campaign.trial import FINE, MOST_MEMORY_MB, PATIENCE_S
from labeling.formats.atomic import write_json
from labeling.runtime.cli import progress_bar
from labeling.runtime.process_pool import PerProcess, run_jobs
from labeling.runtime.run_folder import claim_run_folder

KINDS = ("corruptions", "kills", "faults", "loop")
"""Campaigns of trials; a soak has none."""
SURVIVED = (*FINE, "survived")
SETTINGS_FILE = "settings.json"


def run_campaign(config: CampaignConfig) -> dict[str, Any]:
    """Does what has not been done, writes OUT/campaign.json and returns it.

    Raises:
        UsageError: if OUT holds trials of another seed or of other code.
        SbmError: if a command fails on valid input, or a disk cannot be mounted.
    """
    from labeling.runtime.provenance import experiment_provenance, git_commit

    # Trials of other code or of another seed must not be counted as those of this.
    claim_run_folder(config.out, SETTINGS_FILE, {"seed": config.seed, "commit": git_commit()}, results="trials")
    inputs = config.out / "inputs"
    if set(config.kinds) - {"soak", "loop"}:
        make_inputs(inputs)
    for kind in config.kinds:
        if kind == "soak":
            _soak(config)
        else:
            file = config.out / f"{kind}.jsonl"
            done = read_lines(file)
            trials = {"corruptions": _corruptions, "loop": _loops}.get(kind, _disturbances)
            with progress_bar(desc=kind, unit="trial", initial=len(done)) as bar:
                for line in trials(kind, config, inputs, {one["number"] for one in done}):
                    with file.open("a", encoding="utf-8") as lines:  # after what a kill may have cut off
                        lines.write("\n" * (not _ends_a_line(file)) + json.dumps(line) + "\n")
                    bar.update()
    summary = {
        "seed": config.seed,
        "limits": {"seconds": PATIENCE_S, "memory_mb": MOST_MEMORY_MB},
        **experiment_provenance(),
        **{kind: summed(read_lines(config.out / f"{kind}.jsonl")) for kind in KINDS},
    }
    summary["loop"]["kills"] = sum(line["kills"] for line in read_lines(config.out / "loop.jsonl"))
    soaked = config.out / "soak.json"
    if soaked.is_file():
        summary["soak"] = json.loads(soaked.read_text())
    write_json(config.out / "campaign.json", summary)
    return summary


def read_lines(file: Path) -> list[dict[str, Any]]:
    """The trials in a file, but for a last line that was cut off by a kill."""
    if not file.is_file():
        return []
    found = []
    for line in file.read_text(encoding="utf-8").splitlines():
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def _ends_a_line(file: Path) -> bool:
    data = file.read_bytes() if file.is_file() else b""
    return not data or data.endswith(b"\n")


def summed(trials: list[dict[str, Any]]) -> dict[str, Any]:
    """Outcomes by command, and the trials that were not survived."""
    outcomes: dict[str, Counter[str]] = {}
    for trial in trials:
        outcomes.setdefault(trial["subject"], Counter())[trial["outcome"]] += 1
    kept = ("number", "subject", "what", "outcome")
    return {
        "trials": len(trials),
        "survived": sum(trial["outcome"] in SURVIVED for trial in trials),
        "outcomes": {name: dict(sorted(found.items())) for name, found in sorted(outcomes.items())},
        "not_survived": [{name: trial[name] for name in kept} for trial in trials if trial["outcome"] not in SURVIVED],
    }


def table(summary: dict[str, Any]) -> str:
    """The outcomes as text: a line for each command, then the trials that were not survived."""
    lines = []
    for kind in KINDS:
        found = summary[kind]
        if not found["trials"]:
            continue
        lines.append(f"{kind}: {found['survived']} of {found['trials']} survived")
        for name, outcomes in found["outcomes"].items():
            lines.append(f"  {name:38} " + ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items()))
        lines += [f"  not survived: {one['number']} {one['subject']}: {one['what']}: {one['outcome']}"
                  for one in found["not_survived"]]  # fmt: skip
    if "soak" in summary:
        found = summary["soak"]
        lines.append(
            f"soak: {found['resets']} resets; {found['growth_mb_per_1000']:+.2f} MB for 1000 resets; "
            f"{found['last_mb']:.0f} MB at the end, {found['closed_mb']:.0f} MB once closed"
        )
    return "\n".join(lines)


def _numbers(config: CampaignConfig, done: set[int]) -> Iterator[int]:
    """Numbers of trials that have not been done, until time is over."""
    end = time.monotonic() + 60.0 * config.minutes
    for number in itertools.count():
        if number >= config.trials or time.monotonic() > end:
            return
        if number not in done:
            yield number


def _corruptions(kind: str, config: CampaignConfig, inputs: Path, done: set[int]) -> Iterator[dict[str, Any]]:
    failing = config.out / "failing"
    jobs = (Job(number, config.seed, inputs, failing) for number in _numbers(config, done))
    work = PerProcess(make_corruption)
    with closing(run_jobs(work, jobs, config.workers, always_spawn=True)) as outcomes:
        for outcome in outcomes:
            if outcome.error is not None:
                line = {"subject": "?", "what": "?", "outcome": "died", "told": str(outcome.error)}
            else:
                found = outcome.result()
                what = "; ".join(f"{name}: {what}" for name, what in found.done.items())
                line = {"subject": found.subject, "what": what, **asdict(found.trial)}
            yield {"number": outcome.job.number, **line}


def _disturbances(kind: str, config: CampaignConfig, inputs: Path, done: set[int]) -> Iterator[dict[str, Any]]:
    chosen: tuple[Disturbance, ...] = KILLS if kind == "kills" else FAULTS
    subjects = KILLED if kind == "kills" else WRITERS
    expected: dict[str, Undisturbed] = {}
    for number in _numbers(config, done):
        rng = np.random.default_rng([config.seed, number])
        subject = subjects[number % len(subjects)]
        if subject.name not in expected:
            expected[subject.name] = undisturbed(subject, inputs)
        disturb = chosen[int(rng.integers(len(chosen)))]
        yield {"number": number, **asdict(disturb(subject, inputs, expected[subject.name], rng))}


def _loops(kind: str, config: CampaignConfig, inputs: Path, done: set[int]) -> Iterator[dict[str, Any]]:
    loop = Loop(config.out / "loop")
    for number in _numbers(config, done):
        rng = np.random.default_rng([config.seed, number])
        yield {"number": number, **asdict(loop.disturbed(rng))}


def _soak(config: CampaignConfig) -> None:
    with progress_bar(soak(config.minutes, config.seed), desc="soak", unit="sample") as samples:
        *found, closed = samples
    content = {
        "resets": closed.resets,
        "growth_mb_per_1000": growth_mb_per_1000(found),
        "last_mb": found[-1].pss_mb,
        "closed_mb": closed.pss_mb,
        "samples": [asdict(one) for one in found],
    }
    write_json(config.out / "soak.json", content)
