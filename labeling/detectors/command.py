"""What the commands that run detectors on recorded episodes have in common."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, TypeVar

import tyro

from labeling.core.errors import SbmError
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.cli import progress_bar, showing_stages

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
    recording: tyro.conf.OmitArgPrefixes[RecordingConfig] = field(default_factory=RecordingConfig)

    def run_on_episodes(self, detect: Callable[[Path], Found | None], summary: Callable[[list[Found]], str]) -> None:
        """Runs on all episodes with a progress bar, and prints what was found. Episodes that fail do not stop others.

        Args:
            detect: takes the folder of an episode; returns what it found, None if it had been there before.
            summary: words for all that was found.

        Raises:
            SbmError: if there is no episode; and, after all the others are done, if any episode failed.
        """
        from tqdm import tqdm

        from labeling.io.episodes import find_episodes

        folders = find_episodes(self.dataset, self.recording)
        done: list[Found] = []
        failed = passed_over = 0
        for folder in (bar := progress_bar(folders, "episode", desc="detecting")):
            try:
                with showing_stages(bar):
                    found = detect(folder)
            except SbmError as error:
                tqdm.write(f"error: {error}", file=sys.stderr)
                failed += 1
                continue
            if found is None:
                passed_over += 1
            else:
                done.append(found)
        print(summary(done) + (f"; {passed_over} were done already" if passed_over else ""))
        if failed:
            raise SbmError(f"{failed} of {len(folders)} episodes failed, for the reasons above")
