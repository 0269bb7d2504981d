"""Speed against rivals, in one run: ``python -m experiments.bench NAME`` prints a table and writes OUT/NAME.json."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import tyro

from labeling.cli import run_command
from labeling.errors import UsageError

BENCHES = {
    "render": "experiments.bench_render",
    "labels": "experiments.bench_labels",
    "detect": "experiments.bench_detect",
    "env": "experiments.bench_env",
    "boxes": "experiments.bench_boxes",
}
"""Modules with a function ``rows(quick, say)`` that yields rows as they are measured, by the name of the bench. One
with a function ``draw(rows, folder)`` also makes pictures of them."""


@dataclass(frozen=True)
class Row:
    """One comparison. Without a rival, or with a limit instead of one, the last numbers say so."""

    what: str
    rival: str
    seconds: float
    rival_seconds: float | None
    wanted: str = ""
    """What the project promises about this row."""
    holds: bool | None = None
    """Whether it keeps the promise; None where there is none."""
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """How many times as fast as the rival."""
        return None if self.rival_seconds is None else self.rival_seconds / max(self.seconds, 1e-12)


@dataclass(frozen=True)
class BenchConfig:
    """Measures this project's code beside its rivals on this machine; ratios mean more than seconds."""

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
    from labeling.files import write_json

    unknown = [name for name in config.names if name not in BENCHES]
    if unknown:
        raise UsageError(f"there is no bench {unknown[0]!r}; benches are {', '.join(BENCHES)}")
    _choose_opengl()
    for name in config.names:
        module = import_module(BENCHES[name])
        rows = list(module.rows(config.quick, _say))
        config.out.mkdir(parents=True, exist_ok=True)
        write_json(
            config.out / f"{name}.json", {"bench": name, "machine": machine(), "rows": [as_json(r) for r in rows]}
        )
        if hasattr(module, "draw"):
            module.draw(rows, config.out)
        print(table(name, rows))


def _choose_opengl() -> None:
    """Names a kind of OpenGL that works here: ``mujoco.Renderer`` asks for one when mujoco is first imported."""
    import os

    from sbm_gym.rendering.gl_context import LIBRARIES, context_kind

    kind = context_kind()
    if kind in LIBRARIES:
        os.environ.setdefault("MUJOCO_GL", kind)


def as_json(row: Row) -> dict:
    """A row as it is written."""
    return {
        "what": row.what,
        "rival": row.rival,
        "seconds": row.seconds,
        "rival_seconds": row.rival_seconds,
        "ratio": row.ratio,
        "wanted": row.wanted,
        "holds": row.holds,
        "note": row.note,
    }


def ratio_text(row: Row) -> str:
    """How many times as fast as the rival, for people."""
    if row.ratio is None:
        return ""
    return f"{row.ratio:.1f}x" if row.ratio >= 0.95 else f"{row.ratio:.2g}x"


def row_of(content: dict) -> Row:
    """A row from how it was written."""
    return Row(**{name: value for name, value in content.items() if name != "ratio"})


def machine() -> dict:
    """What the numbers were measured on."""
    import os
    import platform

    return {"processor": platform.machine(), "cpus": len(os.sched_getaffinity(0)), "python": platform.python_version()}


def table(name: str, rows: list[Row]) -> str:
    """The rows as text, one a line."""
    cells = [("what", "ours", "rival", "theirs", "ratio", "wanted", "")]
    for row in rows:
        theirs = "" if row.rival_seconds is None else time_text(row.rival_seconds)
        verdict = {True: "holds; ", False: "MISSED; ", None: ""}[row.holds]
        verdict = (verdict + row.note).removesuffix("; ")
        cells.append((row.what, time_text(row.seconds), row.rival, theirs, ratio_text(row), row.wanted, verdict))
    widths = [max(len(line[column]) for line in cells) for column in range(len(cells[0]))]
    lines = ["  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip() for line in cells]
    return "\n".join([f"\n{name}", *lines])


def time_text(seconds: float) -> str:
    """Seconds for people."""
    return f"{1e3 * seconds:.1f} ms" if seconds < 1.0 else f"{seconds:.2f} s"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def median_seconds(work: Callable[[], object], repeats: int) -> float:
    """Median seconds of one call, after one that warms up. The median, since others may use the machine too."""
    import statistics
    import time

    work()
    seconds = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return statistics.median(seconds)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(BenchConfig, run, "python -m experiments.bench", arguments)


if __name__ == "__main__":
    sys.exit(main())
