"""Time of labelling, compared with the thesis' way, by number of views and workers, and with lower bounds."""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from unittest import mock

import numpy as np

import labeling.generator.propagate
from experiments.benchmarks.label_rooms import first_views, open_room, record
from experiments.benchmarks.label_stages import stage_rows
from experiments.benchmarks.rows import PER_VIEW, Row, log, seconds_per_view, timed
from experiments.benchmarks.thesis_segmenter import ThesisSegmenter, check_installed
from experiments.figures.label_generator import draw_label_speed
from labeling.core.episode import Episode
from labeling.evaluation.compare import evaluate_label_set
from labeling.generate import GenerateConfig
from labeling.generate import run as generate
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.episodes import write_episode

VIEWS = 25
VIEW_COUNTS = (5, 25, 50, 100, 200)
FACTOR, EPISODE_FACTOR, SECONDS = 15.0, 10.0, 2.5
MEMORY_MB = {25: 1000.0, 200: 700.0}
"""Peak memory of a fresh process, by its number of views."""
MAX_EXPONENT = 1.1
"""Time grows with this power of the number of views at most: linear, and a tenth for larger clouds."""
WORKER_EPISODES = 48
"""Of a dozen, a third of the time of two workers is their start."""
WORKERS_FACTOR, FULL_USE = 1.5, 0.9
"""Two workers on two cores are so many times as fast as one, or one keeps this share of all cores busy already."""
_FRESH = (
    "import sys\n"
    "from pathlib import Path\n"
    "from labeling.generate import main\n"
    "code = main(sys.argv[1:])\n"
    # Not getrusage: that would count the memory of the process it was started from.
    "print(Path('/proc/self/status').read_text().partition('VmHWM:')[2].split()[0])\n"
    "sys.exit(code)\n"
)


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row.

    Args:
        quick: few views and repetitions.
    """
    check_installed()
    counts = VIEW_COUNTS[:3] if quick else VIEW_COUNTS
    repeats = 2 if quick else 7
    with tempfile.TemporaryDirectory() as folder:
        dataset = Path(folder)
        started = time.perf_counter()
        longest = record(open_room(), counts[-1], VIEWS)
        log(f"recorded {counts[-1]} views in {time.perf_counter() - started:.0f} s")
        for count in counts:
            write_episode(dataset / f"views_{count}", first_views(longest, count))
        yield from _baselines(dataset, repeats)
        yield from _fresh_processes(dataset, counts)
        yield from stage_rows(lambda out: _label(dataset / f"views_{VIEWS}", out), dataset / f"views_{VIEWS}", repeats)
        yield from _view_counts(dataset, counts, repeats)
        yield from _workers(dataset, longest)


def draw(rows: Sequence[Row], out: Path) -> None:
    """Draws the time for each view over the number of views."""
    draw_label_speed(seconds_per_view(rows), out / "labels_views.png")


def _label(episode: Path, out: Path, label: LabelConfig | None = None) -> float:
    """Labels one episode from files to files; returns seconds."""
    shutil.rmtree(out, ignore_errors=True)
    started = time.perf_counter()
    generate(GenerateConfig(dataset=episode, out=out, label=label or LabelConfig()))
    return time.perf_counter() - started


def _baselines(dataset: Path, repeats: int) -> Iterator[Row]:
    episode, out = dataset / f"views_{VIEWS}", dataset / "out"
    alone = LabelConfig(exclusive=False)

    def label_with(segment: Callable, config: LabelConfig) -> tuple[float, float]:
        """Seconds of an episode, and those of its segmentation."""
        spent = {"segmentation": 0.0}
        with mock.patch.object(labeling.generator.propagate, "_segment", timed(segment, spent, "segmentation")):
            return _label(episode, out, config), spent["segmentation"]

    own = labeling.generator.propagate._segment
    thesis_name = "thesis: SVC(probability=True) + pydensecrf2 per object"
    ways = {
        "ours": lambda: label_with(own, LabelConfig()),
        thesis_name: lambda: label_with(ThesisSegmenter(np.inf), alone),
        "the same in crops of 1 m (published code)": lambda: label_with(ThesisSegmenter(1.0), alone),
    }
    whole, segmenting = defaultdict(list), defaultdict(list)
    quality = {}
    _label(episode, out)
    # In turn, so that whatever else the machine does meets all of them.
    for turn in range(max(2, repeats // 2)):
        for name, way in ways.items():
            seconds, spent = way()
            whole[name].append(seconds)
            segmenting[name].append(spent)
            quality[name] = evaluate_label_set(out).metrics["pseudo_labels"]["mean_iou"]
        log(f"turn {turn + 1}: " + ", ".join(f"{min(times):.2f} s" for times in whole.values()))
    segmentation = f"segmentation (SVM, CRF) of 10 objects in {VIEWS} views 320x240"
    files = "the whole episode, files to files"
    for what, spent_by in ((segmentation, segmenting), (files, whole)):
        ours = min(spent_by["ours"])
        for name in list(ways)[1:]:
            theirs, target, holds = min(spent_by[name]), "", None
            if name == thesis_name:
                factor = FACTOR if what == segmentation else EPISODE_FACTOR
                target = f"{factor:g}x, IoU no lower"
                holds = bool(theirs >= factor * ours and quality["ours"] >= quality[name])
            note = f"mean IoU {quality['ours']:.3f}, theirs {quality[name]:.3f}"
            yield Row(what, name, ours, theirs, target, holds, note)
    ours = min(whole["ours"])
    note = f"median of {len(whole['ours'])}: {statistics.median(whole['ours']):.2f} s"
    yield Row(files, "limit", ours, None, f"< {SECONDS:g} s", ours < SECONDS, note)


def _fresh_processes(dataset: Path, counts: Sequence[int]) -> Iterator[Row]:
    """Time and memory of the command itself, interpreter and imports included."""
    for count in sorted({VIEWS, counts[-1]}):
        best, peak = np.inf, 0.0
        command = [sys.executable, "-c", _FRESH, str(dataset / f"views_{count}"), "--out", str(dataset / "fresh")]
        for _ in range(3):
            shutil.rmtree(dataset / "fresh", ignore_errors=True)
            started = time.perf_counter()
            result = subprocess.run(command, capture_output=True, text=True, check=True)
            best = min(best, time.perf_counter() - started)
            peak = max(peak, int(result.stdout.split()[-1]) / 1024)
        log(f"{count} views in a fresh process: {best:.2f} s, {peak:.0f} MB")
        limit = MEMORY_MB.get(count)
        target, holds = ("", None) if limit is None else (f"< {limit:g} MB", peak < limit)
        what = f"fresh process, {count} views: peak memory"
        yield Row(what, "limit", best, None, target, holds, megabytes=peak)


def _view_counts(dataset: Path, counts: Sequence[int], repeats: int) -> Iterator[Row]:
    seconds = {}
    for count in counts:
        seconds[count] = min(_label(dataset / f"views_{count}", dataset / "out") for _ in range(max(2, repeats // 2)))
        log(f"{count} views: {seconds[count]:.2f} s")
        yield Row(PER_VIEW.format(count), "none", seconds[count] / count, None)
    slope = float(np.polyfit(np.log(counts), np.log([seconds[count] for count in counts]), 1)[0])
    last = seconds[counts[-1]] / counts[-1]
    what, target = f"growth from {counts[0]} to {counts[-1]} views", f"exponent <= {MAX_EXPONENT:g}"
    note = f"exponent {slope:.2f}; a view of {counts[-1]} costs {last * VIEWS / seconds[VIEWS]:.2f} of one of {VIEWS}"
    yield Row(what, "linear", last, None, target, slope <= MAX_EXPONENT, note)


def _workers(dataset: Path, longest: Episode) -> Iterator[Row]:
    """One worker that has all threads beside two workers of one thread each, start of the processes included."""
    several = dataset / "several"
    for number in range(WORKER_EPISODES):
        write_episode(several / f"{number:02d}", first_views(longest, VIEWS))
    seconds, use = {1: np.inf, 2: np.inf}, {1: 0.0, 2: 0.0}
    for workers in (1, 2, 1, 2):
        shutil.rmtree(dataset / "out", ignore_errors=True)
        started, busy = time.perf_counter(), sum(os.times()[:4])
        generate(GenerateConfig(dataset=several, out=dataset / "out", workers=workers))
        spent, busy = time.perf_counter() - started, sum(os.times()[:4]) - busy
        if spent < seconds[workers]:
            seconds[workers], use[workers] = spent, busy / spent / len(os.sched_getaffinity(0))
        log(f"{workers} workers: {spent:.2f} s, {busy / spent / len(os.sched_getaffinity(0)):.0%} of all cores")
    target = f"{WORKERS_FACTOR:g}x, or one worker uses {FULL_USE:.0%} of the cores"
    holds = bool(seconds[1] >= WORKERS_FACTOR * seconds[2] or use[1] >= FULL_USE)
    what, baseline = f"{WORKER_EPISODES} episodes, --workers 2", "--workers 1 (its threads use all cores too)"
    note = f"two use {use[2]:.0%} of the cores, one {use[1]:.0%}"
    yield Row(what, baseline, seconds[2], seconds[1], target, holds, note)
