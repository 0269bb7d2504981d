"""Labels the episodes of a scene as one recording."""

import hashlib
from collections.abc import Collection, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from labeling.cluster.cluster_config import HERE, ClusterConfig, JobFiles
from labeling.cluster.jobs import run_jobs
from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError, SbmError
from labeling.generator.calibration.unfitted import calibration_for
from labeling.generator.label_jobs import EpisodeResult, Job, fingerprint, kept_apart, taken
from labeling.generator.propagate import propagate
from labeling.generator.sharing.joined_episodes import EpisodePart, join_episodes, split_labels
from labeling.generator.sharing.scene_groups import scene_groups, scene_of
from labeling.generator.sources import Sources
from labeling.io.label_records import EpisodeRecord
from labeling.runtime.code_digest import code_digest
from labeling.runtime.process_pool import Outcome, WorkerDiedError

Read = TypeVar("Read")

MAX_EPISODES = 8
"""Most episodes of a scene that are labelled together, so that voxels stay fine; more are divided into groups."""
FINER = 4
"""A scene has as many more voxels than one episode as it has episodes, but at most so many times as many."""
MAX_PIXELS = 64_000_000
"""Most pixels of all views of a group (200 views of 640x480), to bound memory; larger ones are labelled one by one."""


def label_scenes(
    job: Job, folders: Sequence[Path], workers: int, where: ClusterConfig = HERE
) -> Generator[EpisodeResult, None, None]:
    """Labels the episodes of each scene together.

    Args:
        job: what to do.
        folders: the episodes.
        workers: processes side by side. What comes out is the same for any number.
        where: this machine or a cluster, whose nodes get a scene each.

    Yields:
        How it went with each episode, scene by scene. Closing the generator ends the workers.
    """
    known = []
    for folder in folders:
        try:
            scene_of(folder)
        except EpisodeFormatError as error:
            yield job.failed(folder, error)
        else:
            known.append(folder)
    groups = groups_to_label(known)
    work = GroupJob(job).label_group
    if not where.is_local:
        files = JobFiles(job.out, job.files_of, job.common_files(where))
        kept, missing = kept_apart(groups, GroupJob(job).kept, job.begin)
        with closing(run_jobs(work, missing, workers, where=where, files=files, ordered=True)) as outcomes:
            for outcome in outcomes:
                for results in taken(kept):
                    yield from results
                yield from _results_of(job, outcome)
        for results in taken(kept):
            yield from results
        return
    if min(workers, len(groups)) == 1:
        for group in groups:
            yield from work(group)
        return
    with closing(run_jobs(work, groups, workers, threads=None, ordered=True)) as outcomes:
        for outcome in outcomes:
            yield from _results_of(job, outcome)


def _results_of(job: Job, outcome: Outcome[Any, list[EpisodeResult]]) -> list[EpisodeResult]:
    """How it went with the episodes of a group, also where its process was lost or its files did not travel."""
    if isinstance(outcome.error, WorkerDiedError):
        return [job.failed(folder, SbmError(f"{folder}: {outcome.error}")) for folder in outcome.job]
    if isinstance(outcome.error, SbmError | OSError):
        return [job.failed(folder, outcome.error) for folder in outcome.job]
    return outcome.result()


def groups_to_label(folders: Sequence[Path]) -> list[list[Path]]:
    """Groups of episodes to label together: those of one scene, divided evenly if more than ``MAX_EPISODES``.

    Raises:
        EpisodeFormatError: if an ``episode.json`` is malformed.
    """
    return [part for group in scene_groups(folders) for part in _parts(group)]


def _parts(group: Sequence[Path]) -> list[list[Path]]:
    count = -(-len(group) // MAX_EPISODES)
    episodes = iter(group)
    return [list(islice(episodes, (len(group) + k) // count)) for k in range(count)]


@dataclass(frozen=True)
class GroupJob:
    """Labels groups of episodes that show one scene each."""

    job: Job
    """What is the same for all episodes."""

    def label_group(self, folders: Sequence[Path]) -> list[EpisodeResult]:
        """Labels the episodes of a group together, or reads the records of an earlier run.

        An episode that cannot be read, or has nothing to be labelled from, fails alone. If picture sizes or detectors
        differ, the group is larger than ``MAX_PIXELS``, or one of them makes labels of all impossible, each episode is
        labelled by itself, and its result says why; so does that of one which nothing was left to be joined with.
        """
        if len(folders) == 1:
            return [_alone(self.job.label_episode(folders[0]), _why_single(folders[0]))]
        failed: dict[Path, EpisodeResult] = {}
        marks: dict[Path, str] = {}
        for folder in folders:
            try:
                marks[folder] = fingerprint(folder, self.job.label, list(self.job.inputs))
            except OSError as error:
                failed[folder] = self.job.failed(folder, error)
        marks = _joint_marks(marks)
        records, unreadable = self._left(marks)
        failed |= unreadable
        if any(record is None for record in records.values()):
            read: dict[Path, tuple[Episode, Sources]] = {}
            for folder in marks:
                try:
                    read[folder] = _result(self.job.read(folder))
                except Exception as error:  # whatever is wrong with one episode, the others are labelled
                    failed[folder] = self.job.failed(folder, error)
                if (why := _why_apart(read.values())) is not None:
                    del read
                    return self._one_by_one(folders, failed, why)
            try:
                records = self._label(read, marks, failed)
            except Exception as error:  # of which episode it is shows when each is labelled alone
                told = " ".join(f"{type(error).__name__}: {error}".split())
                del read
                return self._one_by_one(folders, failed, f"this failed ({told})")
        return self._results(folders, records, failed)

    def _results(
        self,
        folders: Sequence[Path],
        records: "dict[Path, EpisodeRecord | None]",
        failed: dict[Path, EpisodeResult],
    ) -> list[EpisodeResult]:
        """How it went with a group, in the order of its folders."""
        together = tuple(folder.resolve().name for folder in records)
        labelled = {
            folder: EpisodeResult(folder.resolve().name, self.job.relative(folder), record, labelled_with=together)
            for folder, record in records.items()
        }
        if len(labelled) == 1:
            labelled = {folder: _alone(one, "these could not be labelled") for folder, one in labelled.items()}
        return [failed.get(folder) or labelled[folder] for folder in folders]

    def _one_by_one(self, folders: Sequence[Path], failed: dict[Path, EpisodeResult], why: str) -> list[EpisodeResult]:
        return [failed.get(folder) or _alone(self.job.label_episode(folder), why) for folder in folders]

    def kept(self, folders: Sequence[Path]) -> list[EpisodeResult] | None:
        """What an earlier run has left of a group, if that still fits all of it."""
        if len(folders) == 1:
            found = self.job.kept(folders[0])
            return None if found is None else [_alone(found, _why_single(folders[0]))]
        try:
            marks = {folder: fingerprint(folder, self.job.label, list(self.job.inputs)) for folder in folders}
        except OSError:  # whoever labels it tells
            return None
        records, failed = self._left(_joint_marks(marks))
        if any(record is None for record in records.values()):
            return None
        return self._results(folders, records, failed)

    def _left(self, marks: dict[Path, str]) -> "tuple[dict[Path, EpisodeRecord | None], dict[Path, EpisodeResult]]":
        """What an earlier run has left of a group, and which of its episodes cannot be read, as they could not then.

        If all that have no record are such, the others need not be labelled anew, and the records are theirs alone.
        Otherwise there is a record, or None, for every episode.
        """
        records = {folder: self.job.finished(folder.resolve().name, mark) for folder, mark in marks.items()}
        missing = [folder for folder, record in records.items() if record is None]
        if len(missing) == len(records):
            return records, {}
        failed: dict[Path, EpisodeResult] = {}
        for folder in missing:
            try:
                _result(self.job.read(folder))
            except Exception as error:  # whatever is wrong with it, the others have been labelled without it
                failed[folder] = self.job.failed(folder, error)
            else:
                return records, {}
        return {folder: record for folder, record in records.items() if record is not None}, failed

    def _label(
        self,
        read: dict[Path, tuple[Episode, Sources]],
        marks: dict[Path, str],
        failed: dict[Path, EpisodeResult],
    ) -> "dict[Path, EpisodeRecord | None]":
        """Labels episodes that were read and writes their records; those that cannot be written go to ``failed``."""
        if not read:
            return {}
        episodes, sources = zip(*read.values(), strict=True)
        views, detections = join_episodes(episodes, [one.detections for one in sources])
        config = self.job.label
        config = replace(config, max_voxels=min(len(episodes), FINER) * config.max_voxels)
        labels = propagate(views, detections, config, calibration_for(sources[0].detector, config))
        names = [one.name for one in episodes]
        records: dict[Path, EpisodeRecord | None] = {}
        for (folder, (episode, found)), part in zip(
            read.items(), split_labels(labels, [one.num_views for one in episodes]), strict=True
        ):
            try:
                records[folder] = self.job.write(episode, found, part.labels, marks[folder], _Origins(part, names))
            except OSError as error:
                failed[folder] = self.job.failed(folder, error)
        return records


@dataclass(frozen=True)
class _Origins:
    """Adds to a record from which other episode of the scene objects and sources of labels come."""

    part: EpisodePart
    names: Sequence[str]
    """Names of the episodes that were joined."""

    def __call__(self, record: EpisodeRecord) -> EpisodeRecord:
        origins = {
            number: {"episode": self.names[episode], "instance_id": instance_id}
            for number, (episode, instance_id) in self.part.origins.items()
        }
        sources = (self.names[episode] for episode in self.part.source_episodes)
        return replace(
            record,
            objects=tuple(replace(one, shared_from=origins.get(one.instance_id)) for one in record.objects),
            labels=tuple(
                replace(one, source_episode=None if name == record.name else name)
                for one, name in zip(record.labels, sources, strict=True)
            ),
        )


def _why_apart(read: Collection[tuple[Episode, Sources]]) -> str | None:
    """Why these episodes cannot be joined into one recording; None if they can."""
    if len({episode.size for episode, _ in read}) > 1:
        return "their pictures differ in size"
    if len({sources.detector for _, sources in read}) > 1:
        return "their detections are of different detectors"
    if sum(episode.depth_m.size for episode, _ in read) > MAX_PIXELS:
        return f"all their views have more than {MAX_PIXELS:,} pixels"
    return None


def _why_single(folder: Path) -> str:
    """Why a group has this one episode only."""
    return "its episode.json names no scene" if scene_of(folder) is None else "there is no other one here"


def _alone(result: EpisodeResult, why: str) -> EpisodeResult:
    """A result that says that its episode was labelled by itself."""
    return replace(result, labelled_alone=f"labelled by itself, not with other episodes of its scene: {why}")


def _joint_marks(marks: dict[Path, str]) -> dict[Path, str]:
    """Fingerprints that change with any episode of the group, and with the code that joins them."""
    common = [code_digest(__name__), *marks.values()]
    return {folder: hashlib.sha256("\n".join([mark, *common]).encode()).hexdigest() for folder, mark in marks.items()}


def _result(steps: Generator[int, None, Read]) -> Read:
    """Runs a generator to its end; returns its return value."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
