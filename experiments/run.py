"""Experiments: ``python -m experiments.run NAME`` runs one, ``python -m experiments.run list`` names them all."""

import os
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import tyro

from experiments.cache.stages import Scale, Workplace
from labeling.core.errors import UsageError
from labeling.runtime.cli import run_command

TABLES = ("5_1", "5_1_wide", "5_2", "5_3", "5_3_wide", "5_4", "a_1", "a_2", "a_3")
EXPERIMENTS = {
    "label_ablation": "experiments.ablations.label_ablation",
    "label_modes": "experiments.ablations.label_modes",
    "fine_tuning": "experiments.tables.fine_tuning",
    "policy_evaluation": "experiments.tables.policy_evaluation",
    "policies": "experiments.tables.policies",
    "reward_ablation": "experiments.ablations.reward_ablation",
    "never_ending": "experiments.tables.never_ending:rooms",
    "never_ending_streets": "experiments.tables.never_ending:streets",
    "table_5_5": "experiments.tables.table_5_5",
    **{f"table_{number}": f"experiments.tables.thesis_tables:table_{number}" for number in TABLES},
}
"""Modules by the name of the experiment, or ``module:object``. Each has a ``DESCRIPTION``, a function
``run(workplace)`` that returns what is to be kept of it as JSON, and a function ``report(results, docs)`` that writes
the page about it."""


@dataclass(frozen=True)
class RunConfig:
    """Runs an experiment and writes its figures to RESULTS/NAME.json.

    What it has done so far is kept in the cache: killed and started again, it goes on where it was.
    """

    name: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="NAME")]]
    """Which experiment; "list" names them all."""
    scale: Scale = "quick"
    """How many episodes and settings: "smoke" to see that it runs, "quick" to see whether anything has changed, "full"
    to decide by."""
    seeds: int = 1
    """How many seeds each setting is run with (0, 1, ...)."""
    report: bool = False
    """Only write the page about it anew, from the figures that are there."""
    workers: int = 0
    """Processes at a time, of one thread each; 0 takes one per core."""
    cache: Path = Path("out/experiments")
    """Folder for recorded episodes and intermediate results; experiments share it."""
    results: Path = Path("experiments/results")
    """Folder for the figures."""
    docs: Path = Path("docs")
    """Folder for the page."""


def run(config: RunConfig) -> None:
    """Runs an experiment, or writes its page, or lists all.

    Raises:
        SbmError: if there is no such experiment, or it cannot run.
    """
    if config.name == "list":
        for name, module in EXPERIMENTS.items():
            print(f"{name:20} {_find(module).DESCRIPTION}")
        return
    if config.name not in EXPERIMENTS:
        raise UsageError(f"there is no experiment {config.name!r}; experiments are {', '.join(EXPERIMENTS)}")
    if config.seeds < 1 or config.workers < 0:
        raise UsageError("--seeds must be 1 or more, --workers 0 or more")
    experiment = _find(EXPERIMENTS[config.name])
    if not config.report:
        _run_one(experiment, config)
    for path in experiment.report(config.results, config.docs):
        print(path)


def _find(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(module), name) if name else import_module(module)


def _run_one(experiment: Any, config: RunConfig) -> None:
    from labeling.io.formats.atomic import write_json
    from labeling.runtime.provenance import experiment_provenance

    workplace = Workplace(
        scale=config.scale,
        seeds=tuple(range(config.seeds)),
        workers=config.workers or len(os.sched_getaffinity(0)),
        cache=config.cache,
    )
    found = experiment.run(workplace)
    path = config.results / f"{config.name}.json"
    content = {
        "experiment": config.name,
        "description": experiment.DESCRIPTION,
        "scale": config.scale,
        "seeds": list(workplace.seeds),
        **experiment_provenance(),
        **found,
    }
    write_json(path, content)
    print(path)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(RunConfig, run, "python -m experiments.run", arguments)


if __name__ == "__main__":
    sys.exit(main())
