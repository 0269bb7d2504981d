"""Labelling the episodes of a dataset, one after the other or in several processes side by side."""

import hashlib
import json
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from labeling.cluster.cluster_config import HERE, ClusterConfig, JobFiles
from labeling.cluster.jobs import run_jobs
from labeling.core.errors import SbmError
from labeling.formats.atomic import write_records
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.source_config import SourceConfig
from labeling.io.file_names import DETECTIONS_3D_FILE, RECORDS_FOLDER, SUMMARY_FILE, cloud_file
from labeling.io.folder_digest import folder_digest
from labeling.io.label_records import SCHEMA_VERSION, EpisodeRecord, as_json, episode_record, read_record
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.code_digest import code_digest
from labeling.runtime.process_pool import Outcome, WorkerDiedError
from labeling.runtime.provenance import package_versions
from labeling.runtime.threads import in_background, num_threads, one_beside

if TYPE_CHECKING:
    from labeling.core.episode import Episode
    from labeling.core.episode_labels import EpisodeLabels
    from labeling.generator.sources import Sources

Item = TypeVar("Item")
Found = TypeVar("Found")

LIBRARIES = ("numpy", "numba", "opencv-python-headless", "scipy", "hotcoco")
"""What the labels depend on."""
MAX_BESIDE_PX = 8_000_000
"""While an episode of more pixels is labelled no other one is kept in memory: 100 views of 320x240."""


DATA_ERRORS = (ValueError, ArithmeticError)
"""What numbers that make no sense lead to; other exceptions are faults of the program."""


@dataclass(frozen=True)
class EpisodeResult:
    """How it went with one episode."""

    name: str
    folder: str
    """Relative to the dataset; ``.`` if the dataset is the episode."""
    record: EpisodeRecord | None
    """What was labelled; None if the episode failed."""
    error: str | None = None
    labelled_with: tuple[str, ...] = ()
    """Names of the episodes of its scene that it was labelled together with, its own included; empty if alone."""
    labelled_alone: str | None = None
    """Why it was not labelled together with others of its scene, although it was asked for; a note for users."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about how it was labelled; none if it failed."""
        if self.record is None:
            return ()
        return (*self.record.notes, *(() if self.labelled_alone is None else (self.labelled_alone,)))


def fingerprint(folder: Path, config: LabelConfig, inputs: Any = None) -> str:
    """Changes whenever the labels of an episode might: with any input file, setting, library or generator module.

    Args:
        folder: the episode.
        config: settings of label generation.
        inputs: whatever else decides which views and masks are used, as JSON.
    """
    digest = hashlib.sha256()
    digest.update(
        json.dumps([SCHEMA_VERSION, asdict(config), package_versions(LIBRARIES), inputs], sort_keys=True).encode()
    )
    digest.update(code_digest("labeling.generator.label_jobs").encode())
    digest.update(folder_digest(folder, [DETECTIONS_3D_FILE]).encode())
    return digest.hexdigest()


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

    def label_episode(self, folder: Path) -> EpisodeResult:
        """Labels one episode and writes its record and cloud, or takes what an earlier run has left."""
        stages = self.stages(folder)
        return _finish(_advance(stages), stages)

    def stages(self, folder: Path) -> Generator[int, None, EpisodeResult]:
        """The same in three steps, which may be taken on different threads: reading, labelling, writing.

        Yields:
            Pixels of the episode, once it is read and once more when it is labelled.

        Returns:
            How it went; after the first step already if there is nothing to label.
        """
        name = folder.resolve().name
        try:
            mark = fingerprint(folder, self.label, list(self.inputs))
            record = self.finished(name, mark)
            if record is None:
                episode, sources = yield from self.read(folder)
                from labeling.generator.calibration.unfitted import calibration_for
                from labeling.generator.propagate import propagate

                calibration = calibration_for(sources.detector, self.label)
                labels = propagate(episode, sources.detections, self.label, calibration)
                yield episode.depth_m.size
                record = self.write(episode, sources, labels, mark)
        except Exception as error:  # whatever is wrong with one episode, the others are labelled
            return self.failed(folder, error)
        return EpisodeResult(name, self.relative(folder), record)

    def kept(self, folder: Path) -> EpisodeResult | None:
        """What an earlier run has left of an episode, if that still fits."""
        name = folder.resolve().name
        try:
            record = self.finished(name, fingerprint(folder, self.label, list(self.inputs)))
        except OSError:  # whoever labels it tells
            return None
        return None if record is None else EpisodeResult(name, self.relative(folder), record)

    def files_of(self, folders: Sequence[Path]) -> list[Path]:
        """What is read to label episodes."""
        from labeling.generator.sources import DETECTIONS_FOLDER

        names = (folder.resolve().name for folder in folders)
        return [*folders, *(self.out / DETECTIONS_FOLDER / f"{name}.json" for name in names)]

    def common_files(self, where: ClusterConfig) -> list[Path]:
        """What is read for all episodes.

        Raises:
            UsageError: if the detector's name means nothing on other machines.
        """
        from labeling.detectors.registry import NAMES

        detector = self.sources.detector
        named = [] if detector is None or detector in NAMES else where.files_named(detector)
        return [*named, *(path for path in (self.sources.detections, self.sources.annotations) if path is not None)]

    def finished(self, name: str, mark: str) -> EpisodeRecord | None:
        """The record of an episode that an earlier run has labelled, if it has this fingerprint."""
        record = read_record(self.record_file(name), mark)
        return record if cloud_file(self.out, name).is_file() else None

    def read(self, folder: Path) -> "Generator[int, None, tuple[Episode, Sources]]":
        """Reads an episode, and finds what it is to be labelled from.

        Yields:
            Its pixels, once it is read.

        Raises:
            SbmError: if it is malformed, or has nothing to be labelled from.
            OSError: if it cannot be read.
        """
        from labeling.generator.sources import DETECTIONS_FOLDER, find_sources
        from labeling.io.episodes import read_episode

        episode = read_episode(folder, self.recording, ground_truth=self.sources.reads_ground_truth)
        yield episode.depth_m.size
        cache = self.out / DETECTIONS_FOLDER / f"{folder.resolve().name}.json"
        return episode, find_sources(folder, episode, self.relative(folder), self.sources, self.label, cache)

    def write(
        self,
        episode: "Episode",
        sources: "Sources",
        labels: "EpisodeLabels",
        mark: str,
        complete: Callable[[EpisodeRecord], EpisodeRecord] = lambda record: record,
    ) -> EpisodeRecord:
        """Writes record and cloud of a labelled episode.

        What an earlier run has written goes first: its record would pass for that of the new cloud, and its
        ``label_set.json`` says that all is done.

        Args:
            episode: its views.
            sources: what it was labelled from.
            labels: what was found.
            mark: fingerprint of all that the labels depend on.
            complete: adds to the record what the labels do not say, before it is written.

        Raises:
            OSError: if a file cannot be written.
        """
        from labeling.formats.ply import write_ply
        from labeling.generator.calibration.unfitted import asks_for_nothing_fitted
        from labeling.generator.quality.unused_sources import notes_of_outlines, unused_sources
        from labeling.generator.settings.published_defects import with_amodal_boxes

        self.begin()
        self.record_file(episode.name).unlink(missing_ok=True)
        cloud = labels.cloud
        points = cloud.points, cloud.colours, cloud.instance_id, cloud.confidence
        with in_background(lambda: write_ply(cloud_file(self.out, episode.name), *points)) as written:
            warning = labels.poses and labels.poses.warning
            unused = unused_sources(sources.detections, labels, self.label)
            lost = notes_of_outlines(episode, unused, self.label)
            notes = (*episode.notes, *sources.notes, *([warning] if warning else []), *lost)
            is_asked = self.label.fuse_views and not asks_for_nothing_fitted(self.label)
            doubtful = sources.uncalibrated if is_asked else None
            record = complete(episode_record(episode, labels, mark, sources.origin, notes, len(unused), doubtful))
            written()
        if self.label.published.amodal_boxes:
            record = with_amodal_boxes(record)
        write_records(self.record_file(episode.name), as_json(record))
        return record

    def begin(self) -> None:
        """Removes ``label_set.json``, which is written anew once all episodes are labelled.

        Raises:
            OSError: if it is there and cannot be removed.
        """
        (self.out / SUMMARY_FILE).unlink(missing_ok=True)

    def failed(self, folder: Path, error: Exception) -> EpisodeResult:
        """What is said of an episode that could not be labelled."""
        if isinstance(error, SbmError):
            problem = str(error)
        elif isinstance(error, OSError):
            problem = f"{folder}: cannot be read or written ({error})"
        elif isinstance(error, MemoryError):
            problem = f"{folder}: cannot be labelled, as memory ran out; give fewer --workers, or record fewer views"
        elif isinstance(error, DATA_ERRORS):
            told = " ".join(str(error).split()) or type(error).__name__
            problem = f"{folder}: cannot be labelled ({told}); check its poses, intrinsics and depth unit"
        else:
            told = " ".join(f"{type(error).__name__}: {error}".split())
            problem = (
                f"{folder}: cannot be labelled, by a fault of this program ({told}{_place(error)}); report this line"
            )
        return EpisodeResult(folder.resolve().name, self.relative(folder), None, problem)

    def record_file(self, name: str) -> Path:
        """Where the record of an episode lies."""
        return self.out / RECORDS_FOLDER / f"{name}.json"

    def relative(self, folder: Path) -> str:
        """An episode's folder as seen from the dataset; ``.`` if it is the dataset."""
        return "." if folder == self.dataset else folder.relative_to(self.dataset).as_posix()


def _place(error: Exception) -> str:
    """Where an exception was raised, in words; empty if it does not know."""
    frames = traceback.extract_tb(error.__traceback__)
    return f" in {frames[-1].name}, line {frames[-1].lineno} of {Path(frames[-1].filename).name}" if frames else ""


def label_all(
    job: Job, folders: Sequence[Path], workers: int, where: ClusterConfig = HERE
) -> Generator[EpisodeResult, None, None]:
    """Labels episodes.

    Args:
        job: what to do.
        folders: the episodes.
        workers: processes side by side; with 1 the work is done in this one. What comes out is the same for any number.
        where: this machine or a cluster. On a cluster, what an earlier run has left comes before what is labelled next.

    Yields:
        How it went with each episode, in their order. Closing the generator ends the workers.
    """
    if not where.is_local:
        files = JobFiles(job.out, lambda folder: job.files_of([folder]), job.common_files(where))
        kept, missing = kept_apart(folders, job.kept, job.begin)
        with closing(run_jobs(job.label_episode, missing, workers, where=where, files=files, ordered=True)) as outcomes:
            for outcome in outcomes:
                yield from taken(kept)
                yield _result_of(job, outcome)
        yield from taken(kept)
        return
    if min(workers, len(folders)) == 1 and num_threads() > 1:
        yield from _label_here(job, folders)
        return
    with closing(run_jobs(job.label_episode, folders, workers, threads=None, ordered=True)) as outcomes:
        for outcome in outcomes:
            yield _result_of(job, outcome)


def _result_of(job: Job, outcome: Outcome[Path, EpisodeResult]) -> EpisodeResult:
    """How it went with an episode, also where its process was lost or its files did not travel."""
    if isinstance(outcome.error, WorkerDiedError):
        return job.failed(outcome.job, SbmError(f"{outcome.job}: {outcome.error}"))
    if isinstance(outcome.error, SbmError | OSError):
        return job.failed(outcome.job, outcome.error)
    return outcome.result()


def kept_apart(
    items: Iterable[Item], kept: Callable[[Item], Found | None], begin: Callable[[], None]
) -> tuple[list[Found], Iterator[Item]]:
    """Divides what is to be done from what has been done, while it is asked for.

    Args:
        items: all of it.
        kept: what has come of one, None if nothing has.
        begin: called before each that is to be done.

    Returns:
        What has come of those passed over so far, and an iterator over the others.
    """
    found: list[Found] = []

    def missing() -> Iterator[Item]:
        for item in items:
            if (one := kept(item)) is None:
                begin()
                yield item
            else:
                found.append(one)

    return found, missing()


def taken(found: list[Item]) -> Iterator[Item]:
    """Empties a list, first things first."""
    while found:
        yield found.pop(0)


def _label_here(job: Job, folders: Sequence[Path]) -> Generator[EpisodeResult, None, None]:
    """What ``label_all`` does in this process: another thread writes the last episode and reads the next meanwhile."""
    begun = [job.stages(folder) for folder in folders]
    with one_beside() as other:
        step, written = _advance(begun[0]), None
        for stages, following in zip(begun, [*begun[1:], None], strict=True):
            small = isinstance(step, EpisodeResult) or step <= MAX_BESIDE_PX
            read = other.submit(_advance, following) if following and small else None
            if not isinstance(step, EpisodeResult):
                step = _advance(stages)
            if written:
                yield written.result()
            written = other.submit(_finish, step, stages) if read else None
            if written is None:
                yield _finish(step, stages)
            if following:
                step = read.result() if read else _advance(following)


def _finish(step: int | EpisodeResult, stages: Generator[int, None, EpisodeResult]) -> EpisodeResult:
    """Takes all the steps that are left."""
    while not isinstance(step, EpisodeResult):
        step = _advance(stages)
    return step


def _advance(stages: Generator[int, None, EpisodeResult]) -> int | EpisodeResult:
    """Takes the next step."""
    try:
        return next(stages)
    except StopIteration as end:
        return end.value
