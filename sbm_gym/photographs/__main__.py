"""Photographs of furniture and vehicles with masks, to pre-train detectors on: ``python -m sbm_gym.photographs``."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp


@dataclass(frozen=True)
class PhotographsConfig:
    """Takes photographs as COCO would have them and writes them as a COCO folder: canonical views of furniture and
    vehicles at eye level, with the mask of every object that has a class.

    The models are kept apart from those in worlds wherever a class has enough, and held-out photographs (--split val)
    show other ones than those to train on. Killed and started again, it goes on where it was.
    """

    out: Path
    """Folder for annotations.json and images/."""
    count: int = 6000
    """How many photographs."""
    split: Literal["train", "val"] = "train"
    """Photographs to train on, or held-out ones."""
    seed: int = 0
    """Decides everything that is drawn at random."""
    size: int = 192
    """Side of a square picture, pixels; landscapes and portraits have as many pixels."""
    workers: int = 1
    """Processes."""
    builtin: bool = False
    """Only models made from seeds, for machines without furniture libraries."""
    sheet: Path | None = None
    """Also draw a contact sheet with all masks into this PNG."""
    sheet_count: int = 96
    """How many photographs it shows."""


def _run(config: PhotographsConfig) -> None:
    from labeling.core.errors import UsageError
    from sbm_gym.photographs.album import AlbumSettings, make_album

    if config.sheet_count < 1:
        raise UsageError(f"--sheet-count must be at least 1, not {config.sheet_count}")
    settings = AlbumSettings(config.split, config.seed, config.size, config.builtin)
    make_album(config.out, settings, config.count, config.workers)
    print(f"{config.count} photographs in {config.out}")
    if config.sheet is not None:
        from sbm_gym.photographs.sheet import draw_sheet

        draw_sheet(config.out, config.sheet_count, config.sheet)
        print(config.sheet)


HELP = CommandHelp(
    examples=(
        ("--out PHOTOGRAPHS/train --split train --count 6000 --workers 2", "pictures to train on"),
        (
            "--out PHOTOGRAPHS/val --split val --count 600 --sheet sheet.png",
            "others to validate on",
        ),
    ),
)
main = make_main("sbm_gym.photographs", PhotographsConfig, _run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
