"""What the commands that run detectors on recorded episodes have in common."""

import os
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, TypeVar

import tyro

from labeling.cluster.cluster_config import ClusterConfig, JobFiles
from labeling.cluster.jobs import run_jobs
from labeling.core.errors import SbmError, UsageError
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.cli import printable, progress_bar, refusal, showing_stages
from labeling.runtime.process_pool import Outcome, Work

Found = TypeVar("Found")


@dataclass(frozen=True)
class DetectionCommand:
    """Options of a command that runs detectors on episodes."""

    dataset: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="EPISODES")]]
    """An episode, or a folder of episodes."""
    detector: str
    """Which detector."""
    device: str | None = None
    """cpu, cuda, ...; by default a GPU if there is one."""
    where: tyro.conf.OmitArgPrefixes[ClusterConfig] = field(default_factory=ClusterConfig)
    recording: tyro.conf.OmitArgPrefixes[RecordingConfig] = field(default_factory=RecordingConfig)

    def run_on_episodes(
        self,
        detect: Work[Path, Found | None],
        summary: Callable[[list[Found]], str],
        named: Sequence[str],
        last: str,
        is_done: Callable[[Path], bool] = lambda folder: False,
    ) -> None:
        """Runs on all episodes with a progress bar, and prints what was found. Episodes that fail do not stop others.

        Args:
            detect: takes the folder of an episode; returns what it found, None if it had been there before. For a
                cluster it must be picklable.
            summary: words for all that was found.
            named: detectors that may be files.
            last: the file of an episode that is written last.
            is_done: whether an episode need not travel to a cluster.

        Raises:
            SbmError: if there is no episode; and, after all the others are done, if any episode failed.
        """
        from tqdm import tqdm

        from labeling.io.episodes import find_episodes

        folders = find_episodes(self.dataset, self.recording)
        missing = folders if self.where.is_local else [folder for folder in folders if not _passes(is_done, folder)]
        done: list[Found] = []
        failed, passed_over = 0, len(folders) - len(missing)
        bar = progress_bar(total=len(missing), unit="episode", desc="detecting")
        with bar, showing_stages(bar), closing(self._run(detect, missing, named, last)) as outcomes:
            for outcome in outcomes:
                bar.update()
                if isinstance(outcome.error, SbmError | OSError):
                    told = _words(outcome.job, outcome.error)
                    tqdm.write(f"error: {printable(told)}", file=sys.stderr)
                    failed += 1
                elif (found := outcome.result()) is None:
                    passed_over += 1
                else:
                    done.append(found)
        print(summary(done) + (f"; {passed_over} were done already" if passed_over else ""))
        if failed:
            raise SbmError(f"{failed} of {len(folders)} episodes failed, for the reasons above")

    def _run(
        self, detect: Work[Path, Found | None], folders: Sequence[Path], named: Sequence[str], last: str
    ) -> Generator[Outcome[Path, Found | None], None, None]:
        linked = [folder for folder in folders if folder.is_symlink()]
        if linked and not self.where.is_local and self.where.shared is None:
            raise UsageError(f"{linked[0]}: is a link, and with --cluster results go where it lies; give its own place")
        common = [] if self.where.is_local else self.where.files_named(*named)
        files = JobFiles(self.dataset, lambda folder: [folder], common, last=(last,))
        return run_jobs(detect, folders, 1, where=self.where, files=files, gpus=True)


def check_writable(folder: Path) -> None:
    """Refuses an episode that results cannot be written into, before a detector has looked at it for minutes.

    Raises:
        UsageError: if its folder may not be written to.
    """
    if not os.access(folder, os.W_OK):
        raise UsageError(f"{folder}: cannot be written to; change its permissions, or copy the episode elsewhere")


def _passes(is_done: Callable[[Path], bool], folder: Path) -> bool:
    """Whether an episode is done; of one that cannot be read, whoever detects in it tells."""
    try:
        return is_done(folder)
    except (SbmError, OSError):
        return False


def _words(folder: Path, error: SbmError | OSError) -> str:
    """What was wrong with an episode, in one sentence."""
    return f"{folder}: cannot be read or written ({refusal(error)})" if isinstance(error, OSError) else str(error)
