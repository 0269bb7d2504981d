"""Speed against baselines, in one run: ``python -m experiments.bench NAME`` prints a table and writes OUT/NAME.json."""

import os
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import tyro

from experiments.benchmarks.rows import as_json, machine, table
from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

BENCHES = {
    name: f"experiments.benchmarks.{name}"
    for name in ("render", "labels", "detect", "env", "policies", "scenes", "atlas", "boxes", "memory", "cluster")
}
"""Modules with a function ``measure(quick)`` that yields rows as they are measured, by the name of the bench. One
with a function ``draw(rows, folder)`` also makes pictures of them."""


@dataclass(frozen=True)
class BenchConfig:
    """Measures this project's code beside its baselines on this machine; ratios mean more than seconds."""

    names: tyro.conf.Positional[tuple[str, ...]] = tuple(BENCHES)
    """Which benches to run."""
    out: Path = Path("out/bench")
    """Folder for the results: one NAME.json for each bench."""
    quick: bool = False
    """Few repetitions and a small scene: to see that it runs, not to quote."""


def run(config: BenchConfig) -> None:
    """Runs benches, prints a table for each and writes its rows.

    Raises:
        SbmError: if there is no such bench, or one cannot run.
    """
    from labeling.formats.atomic import write_json
    from sbm_gym.rendering.gl.context import LIBRARIES, context_kind

    unknown = [name for name in config.names if name not in BENCHES]
    if unknown:
        raise UsageError(f"there is no bench {unknown[0]!r}; benches are {', '.join(BENCHES)}")
    kind = context_kind()
    if kind in LIBRARIES:  # mujoco.Renderer asks for a kind of OpenGL that works here when mujoco is first imported
        os.environ.setdefault("MUJOCO_GL", kind)
    for name in config.names:
        module = import_module(BENCHES[name])
        rows = list(module.measure(config.quick))
        content = {"bench": name, "machine": machine(), "rows": [as_json(row) for row in rows]}
        write_json(config.out / f"{name}.json", content)
        if hasattr(module, "draw"):
            module.draw(rows, config.out)
        print(table(name, rows))


HELP = CommandHelp(
    examples=(
        ("labels", "measure one"),
        ("", "measure all"),
    ),
)
main = make_main("experiments.bench", BenchConfig, run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
