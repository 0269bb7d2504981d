"""Writes any recording as an episode: ``python -m labeling.convert FOLDER --out EPISODE``."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from labeling.core.errors import UsageError
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.cli import make_main, progress_bar, showing_stages
from labeling.runtime.help import CommandHelp


@dataclass(frozen=True)
class ConvertConfig:
    """Writes a recording as an episode: undistorted PNG pictures, depth in millimetres and in colour's pixels.

    ``labeling.generate`` reads recordings as they are; converting is for those with lens distortion, for thinning out
    long ones for good, and for tools that know only one format. Masks that lie beside the recording come along.
    """

    recording_folder: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FOLDER")]]
    """A nerfstudio, Record3D, Polycam, TUM RGB-D or ScanNet folder."""
    out: Path
    """The episode to write; it must not exist yet."""
    undistort: bool = False
    """Remove lens distortion (k1 k2 p1 p2 k3) from colour, depth and masks."""
    recording: tyro.conf.OmitArgPrefixes[RecordingConfig] = field(default_factory=RecordingConfig)


def run(config: ConvertConfig) -> None:
    """Converts one recording.

    Raises:
        SbmError: if it is malformed or the target is in use. Nothing is written then.
    """
    from labeling.io.episodes import read_episode, write_episode

    config.recording.check()
    if config.out.exists():
        raise UsageError(f"--out {config.out}: exists already; give a new folder")
    with progress_bar(total=1, unit="recording", desc="converting") as bar, showing_stages(bar):
        episode = read_episode(config.recording_folder, config.recording, undistort=config.undistort)
        try:
            write_episode(config.out, episode)
        except OSError as error:
            raise UsageError(f"--out {config.out}: cannot be written ({error})") from None
    for note in episode.notes:
        print(f"note: {note}")
    height_px, width_px = episode.size
    print(f"{episode.num_views} views of {width_px}x{height_px} pixels: {config.out}")


HELP = CommandHelp(
    examples=(
        ("RECORDING --undistort --out EPISODE", "a recording with lens distortion"),
        ("RECORDING --every 10 --out EPISODE", "every tenth frame of a long one"),
    ),
)
main = make_main("labeling.convert", ConvertConfig, run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
