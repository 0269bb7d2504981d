"""Runs experiments, such as the thesis' tables: ``python -m experiments.run NAME``; ``list`` names them."""

import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from experiments.cache.registry import experiments
from experiments.cache.stages import RunContext, Scale
from labeling.cluster.cluster_config import ClusterConfig
from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp


@dataclass(frozen=True)
class RunConfig:
    """Runs an experiment and writes its figures to RESULTS/NAME.json.

    What it has done so far is kept in the cache: killed and started again, it goes on where it was.
    """

    name: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="NAME")]]
    """Which experiment; "list" names them all."""
    scale: Scale = "quick"
    """How many episodes and settings: "smoke" to see that it runs, "quick" to see whether anything has changed (three
    quarters of an hour), "standard" to decide by (hours), "full" with the thesis' own training."""
    seeds: int = 1
    """How many seeds each setting is run with (0, 1, ...)."""
    rounds: int | None = None
    """How many rounds the never-ending loop goes, such as more than it has gone already; else as the scale says."""
    report: bool = False
    """Only write the page about it anew, from the figures that are there."""
    workers: int = 0
    """Processes at a time, of one thread each; 0 takes one per core."""
    where: tyro.conf.OmitArgPrefixes[ClusterConfig] = field(default_factory=ClusterConfig)
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
    from experiments.cache.origin import origin
    from experiments.pages.markdown import write_page
    from labeling.formats.atomic import write_json

    known = experiments()
    if config.name == "list":
        for name, experiment in known.items():
            print(f"{name:20} {experiment.description}")
        return
    if config.name not in known:
        raise UsageError(f"there is no experiment {config.name!r}; experiments are {', '.join(known)}")
    if config.seeds < 1 or config.workers < 0:
        raise UsageError("--seeds must be 1 or more, --workers 0 or more")
    chosen = known[config.name]
    if config.rounds is not None and (config.rounds < 1 or not chosen.has_rounds):
        loops = ", ".join(name for name, one in known.items() if one.has_rounds)
        raise UsageError(f"--rounds must be 1 or more, and is for loops: {loops}")
    _check_place(config)
    if not config.report:
        cores = len(os.sched_getaffinity(0)) if config.where.is_local else 1  # of a cluster: all that there are
        context = RunContext(
            scale=config.scale,
            seeds=tuple(range(config.seeds)),
            workers=config.workers or cores,
            cache=config.cache,
            where=config.where,
            rounds=config.rounds,
        )
        made = origin()  # before the run: code may be edited while it lasts
        results, path = chosen.run(context), config.results / f"{config.name}.json"
        about = {"experiment": config.name, "description": chosen.description, "scale": config.scale}
        write_json(path, {**about, "seeds": list(context.seeds), **made, **results})
        print(path)
    for page in chosen.pages:
        print(*write_page(page, config.results, config.docs), sep="\n")


def _check_place(config: RunConfig) -> None:
    """Refuses a cluster that is not there, or a cache that is called otherwise on its nodes, before any work is done.

    Raises:
        UsageError: saying which.
    """
    from labeling.cluster.ray_connection import check_reachable

    if config.where.is_local:
        return
    if config.where.shared is None and config.cache.is_absolute():
        raise UsageError(
            f"--cache {config.cache}: with --cluster give it as seen from the folder that the command is started in "
            "(names of detectors in it are part of what is written), or --shared"
        )
    check_reachable(config.where.cluster)


HELP = CommandHelp(
    examples=(
        ("list", "name all experiments"),
        ("table_5_3 --scale quick --seeds 3", "detectors before and after, in unseen homes"),
        ("table_5_3 --report", "only its page anew"),
    ),
)
main = make_main("experiments.run", RunConfig, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
