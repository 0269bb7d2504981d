"""What tests of all packages share."""

import os
import signal
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Shells start background jobs with Ctrl-C ignored, and programs inherit that; tests that interrupt programs need it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def apc_shelf() -> Path:
    """The real capture that lies beside the project's own checkouts.

    It is not part of the repository: elsewhere the tests on it are skipped, and SBM_REQUIRE_CAPTURE=1 makes its absence
    a failure.
    """
    folder = (ROOT / ".." / "shared" / "data" / "apc_shelf").resolve()
    if not (folder / "transforms.json").is_file():
        if os.environ.get("SBM_REQUIRE_CAPTURE"):
            pytest.fail(f"the real capture is not at {folder}")
        pytest.skip(f"needs the real capture at {folder}")
    return folder
