"""Checks a label set, and shows it: ``python -m labeling.inspect LABELS [--view] [--html|--pictures|--film DIR]``."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from labeling.core.errors import UsageError
from labeling.runtime.cli import printable, run_command
from labeling.runtime.help import CommandHelp

PROBLEMS = 1
"""Exit code if anything is wrong with the label set."""


@dataclass(frozen=True)
class InspectConfig:
    """Checks a label set and prints one line per problem.

    Looks for ids that lead nowhere, empty masks, boxes that leave the picture or do not fit their mask, one object
    found twice, scores out of range, missing clouds and pictures; notes categories without labels. The exit code is 0
    if all is well, 1 if there are problems, 2 if the label set cannot be read.
    """

    labels: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="LABELS")]]
    """The label set: what ``labeling.generate`` wrote to its ``--out``."""
    view: bool = False
    """Open a viewer in the browser: segmented clouds, objects, cameras with their pictures and masks (needs the
    ``viewer`` extra)."""
    host: str = "127.0.0.1"
    """Of the viewer's address; 0.0.0.0 lets other machines look, too."""
    port: int = 8080
    """Of the viewer's address; the next free one if it is in use."""
    html: Path | None = None
    """Write each episode's scene as one HTML file into this folder; needs no server to look at (needs the ``viewer``
    extra)."""
    film: Path | None = None
    """Write a film of every episode, in which the camera circles what was found, as a GIF into this folder; needs no
    screen (needs the ``video`` extra)."""
    pictures: Path | None = None
    """Write pictures of every episode's cloud and boxes into this folder; needs no screen."""
    viewpoints: int = 3
    """How many of them from around the objects, besides the one from above."""


def run(config: InspectConfig) -> list[str]:
    """Checks and shows a label set; returns the problems.

    Raises:
        SbmError: if it cannot be read.
    """
    from labeling.inspection.checks import inspect_label_set

    if config.viewpoints < 0 or not 0 < config.port < 65536:
        raise UsageError("--viewpoints is 0 or more, and --port lies between 1 and 65535")
    notes: list[str] = []
    problems = inspect_label_set(config.labels, notes)
    for line in [*problems, *(f"note: {note}" for note in notes)]:
        print(printable(line))
    print(f"{len(problems)} problem{'' if len(problems) == 1 else 's'}" if problems else "no problem found")
    if config.pictures is not None or config.film is not None or config.html is not None or config.view:
        _show(config)
    return problems


def _show(config: InspectConfig) -> None:
    from labeling.inspection.scene import read_scenes

    scenes = read_scenes(config.labels)
    if config.pictures is not None:
        from labeling.inspection.pictures import write_pictures

        try:
            files = [file for scene in scenes for file in write_pictures(scene, config.pictures, config.viewpoints)]
        except OSError as error:
            raise UsageError(f"--pictures {config.pictures}: cannot be written ({error})") from None
        print(f"{len(files)} pictures: {config.pictures}")
    if config.film is not None:
        from labeling.inspection.orbit import write_orbit

        try:
            films = [write_orbit(scene, config.film) for scene in scenes]
        except OSError as error:
            raise UsageError(f"--film {config.film}: cannot be written ({error})") from None
        print(f"{len(films)} films: {config.film}")
    if config.html is not None or config.view:
        from labeling.inspection.viewer import SceneViewer, wait

        viewer = SceneViewer(config.labels, scenes, config.host, config.port)
        if config.html is not None:
            try:
                files = viewer.write_html(config.html)
            except OSError as error:
                raise UsageError(f"--html {config.html}: cannot be written ({error})") from None
            print(f"{len(files)} scenes as HTML: {config.html}")
        if config.view:
            print(f"viewer: {viewer.address} (Ctrl-C ends it)", flush=True)
            _open_browser(viewer.address)
            wait()


def _open_browser(address: str) -> None:
    """Opens an address where there is a desktop; a browser for terminals would take this one over."""
    if sys.platform in ("darwin", "win32") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        import webbrowser

        webbrowser.open(address)


HELP = CommandHelp(
    examples=(
        ("LABELS", "is the label set whole?"),
        ("LABELS --view", "look at it in 3-D, in a browser"),
        ("LABELS --view --host 0.0.0.0 --port 9000", "from another machine"),
        ("LABELS --html SCENES", "a file a scene, to send around"),
        ("LABELS --pictures PICTURES", "pictures of its clouds and boxes"),
        ("LABELS --film FILMS", "the camera circles each scene, as a GIF"),
    ),
)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    problems: list[str] = []
    code = run_command(
        InspectConfig,
        lambda config: problems.extend(run(config)),
        "python -m labeling.inspect",
        arguments,
        resumes=False,
        about=HELP,
    )
    return code or (PROBLEMS if problems else 0)


if __name__ == "__main__":
    sys.exit(main())
