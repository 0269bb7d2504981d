"""The worlds that experiments speak of, and the detector in their loops."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass


DETECTOR = "compact"


WORLDS = {"rooms": "sbm_gym/Indoor-v0", "streets": "sbm_gym/Outdoor-v0"}
