"""Labelling the episodes of a dataset, one after the other or in several processes side by side."""

import contextlib
import multiprocessing
import signal
import traceback
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing import connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labeling.core.errors import SbmError
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.source_config import SourceConfig
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.threads import num_threads, threads_of_children
from labeling.runtime.worker_process import serve_parent

if TYPE_CHECKING:
    from multiprocessing.context import SpawnProcess

    from labeling.generator.label_writer import EpisodeResult

_PATIENCE_S = 10.0
"""So long a worker may take to clean up."""
_STOPPED = 143
"""Exit code of a worker that was told to stop (128 + SIGTERM)."""


@dataclass(frozen=True)
class Job:
    """What is the same for all episodes of a dataset."""

    dataset: Path
    out: Path
    """Folder of the label set."""
    recording: RecordingConfig = field(default_factory=RecordingConfig)
    sources: SourceConfig = field(default_factory=SourceConfig)
    label: LabelConfig = field(default_factory=LabelConfig)
    inputs: tuple[Any, ...] = ()
    """Whatever else decides what the labels are, as JSON; part of the fingerprint."""

    def label_episode(self, folder: Path) -> "EpisodeResult":
        """Labels one episode and writes its record and cloud, or takes what an earlier run has left."""
        from labeling.generator.label_writer import EpisodeResult, fingerprint
        from labeling.generator.settings.published_defects import with_amodal_boxes
        from labeling.generator.sources import DETECTIONS_FOLDER, find_sources
        from labeling.io.episodes import read_episode
        from labeling.io.file_names import cloud_file
        from labeling.io.formats.ply import write_ply
        from labeling.io.label_records import episode_record, read_record, write_record

        name = folder.resolve().name
        relative = self.relative(folder)
        record_file, points_file = self.out / "episodes" / f"{name}.json", cloud_file(self.out, name)
        try:
            mark = fingerprint(folder, self.label, list(self.inputs))
            record = read_record(record_file, mark)
            if record is None or not points_file.is_file():
                episode = read_episode(folder, self.recording, ground_truth=self.sources.reads_ground_truth)
                cache = self.out / DETECTIONS_FOLDER / f"{name}.json"
                sources = find_sources(folder, episode, relative, self.sources, self.label, cache)
                from labeling.generator.propagate import propagate

                labels = propagate(episode, sources.detections, self.label)
                cloud = labels.cloud
                write_ply(points_file, cloud.points, cloud.colours, cloud.instance_id, cloud.confidence)
                record = episode_record(episode, labels, mark, sources.origin, (*episode.notes, *sources.notes))
                if self.label.published.amodal_boxes:
                    record = with_amodal_boxes(record)
                write_record(record_file, record)
        except SbmError as error:
            return EpisodeResult(name, relative, None, str(error))
        except OSError as error:
            return EpisodeResult(name, relative, None, f"{folder}: cannot be read or written ({error})")
        return EpisodeResult(name, relative, record)

    def relative(self, folder: Path) -> str:
        """An episode's folder as seen from the dataset; ``.`` if it is the dataset."""
        return "." if folder == self.dataset else folder.relative_to(self.dataset).as_posix()


def label_all(job: Job, folders: Sequence[Path], workers: int) -> Generator["EpisodeResult", None, None]:
    """Labels episodes.

    Args:
        job: what to do.
        folders: the episodes.
        workers: processes side by side; with 1 the work is done in this one. What comes out is the same for any number.

    Yields:
        How it went with each episode, in their order. Whoever stops asking stops the workers.

    Raises:
        RuntimeError: if the program is at fault, as it would be without workers.
    """
    workers = min(workers, len(folders))
    if workers <= 1:
        yield from map(job.label_episode, folders)
        return
    crew = _Crew(job, workers)
    try:
        yield from crew.work(folders)
    finally:
        crew.stop()


class _Crew:
    """Worker processes, one episode each at a time."""

    def __init__(self, job: Job, size: int) -> None:
        self._job, self._threads = job, max(1, num_threads() // size)
        self._workers: dict[connection.Connection, SpawnProcess] = {}
        self._doing: dict[connection.Connection, int] = {}
        self._size = size

    def work(self, folders: Sequence[Path]) -> Iterator["EpisodeResult"]:
        """Hands out episodes as workers get free, and yields their states in order."""
        states: dict[int, EpisodeResult] = {}
        given, told = 0, 0
        while len(self._workers) < self._size:
            self._hire()
        while told < len(folders):
            for pipe in [pipe for pipe in self._workers if pipe not in self._doing]:
                if given < len(folders):
                    pipe.send(folders[given])
                    self._doing[pipe] = given
                    given += 1
            for pipe in connection.wait(list(self._doing)):
                assert isinstance(pipe, connection.Connection)
                index = self._doing.pop(pipe)
                try:
                    answer = pipe.recv()
                except (EOFError, ConnectionError):
                    answer = self._lost(pipe, folders[index])
                    self._hire()
                if isinstance(answer, str):
                    raise RuntimeError(f"{folders[index]}: a worker failed\n{answer}")
                states[index] = answer
            while told in states:
                yield states.pop(told)
                told += 1

    def stop(self) -> None:
        """Ends all workers and waits for them; files that they are writing disappear."""
        for pipe, process in self._workers.items():
            pipe.close()
            process.terminate()
        for process in self._workers.values():
            process.join(_PATIENCE_S)
            process.kill()
            process.join()
        self._workers.clear()
        self._doing.clear()

    def _hire(self) -> None:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(self._job, theirs), daemon=True)
        with threads_of_children(self._threads):
            process.start()
        theirs.close()
        self._workers[ours] = process

    def _lost(self, pipe: connection.Connection, folder: Path) -> "EpisodeResult":
        from labeling.generator.label_writer import EpisodeResult

        process = self._workers.pop(pipe)
        process.join()
        pipe.close()
        problem = f"{folder}: its worker process ended with exit code {process.exitcode}; memory may have run out"
        return EpisodeResult(
            folder.resolve().name, self._job.relative(folder), None, f"{problem} (try fewer --workers)"
        )


def _serve(job: Job, pipe: connection.Connection) -> None:
    """Labels the episodes that come through the pipe, until it closes."""
    signal.signal(signal.SIGTERM, _leave)
    serve_parent()
    import cv2

    cv2.setNumThreads(num_threads())
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            folder = pipe.recv()
            try:
                answer = job.label_episode(folder)
            except Exception:  # told by the process that a user sees
                answer = traceback.format_exc()
            pipe.send(answer)


def _leave(*_) -> None:
    raise SystemExit(_STOPPED)  # unwinds, so that temporary files are removed
