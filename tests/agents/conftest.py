"""Lets the tests of this folder import their helper modules."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "sbm_gym"))
