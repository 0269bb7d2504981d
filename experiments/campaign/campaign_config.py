"""Options of a campaign."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from labeling.runtime.ranges import Count, NonNegative

Kind = Literal["corruptions", "kills", "faults", "soak", "loop"]


@dataclass(frozen=True)
class CampaignConfig:
    """Spoils inputs, kills commands, fills disks and waits, and counts what the project does not survive.

    corruptions: every command on small valid inputs of which a file or two are spoilt. kills: commands that write are
    killed at random moments, then told to go on; their files must be those of a run that nothing disturbed. faults:
    full and read-only disks, two writers at once, a clock that jumps (disks are mounted, which takes root). soak:
    episodes without end, whose memory must stay flat. loop: the never-ending loop at its smallest scale, killed every
    half minute or so and started again until it is done, as often as there is time.
    """

    kinds: tyro.conf.Positional[tuple[Kind, ...]] = ("corruptions", "kills", "faults", "soak", "loop")
    """What to do, in this order."""
    minutes: NonNegative[float] = 10.0
    """For each kind; what has begun is finished."""
    trials: Count = 1_000_000
    """Of each kind at most, those of earlier runs counted."""
    seed: int = 0
    """Decides everything but the moments of kills, which depend on the machine."""
    workers: Count = 1
    """Corruptions at a time."""
    out: Path = Path("out/campaign")
    """Folder for inputs, results and the inputs that a command did not survive."""
