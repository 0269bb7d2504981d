"""What tests of all packages share."""

import ctypes
import functools
import gc
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

from labeling.runtime.threads import THREAD_VARIABLES

from .imports import checked_by_jaxtyping

# Workers of pytest-xdist share the cores: threads of one would wait for those of the others. Before numba is imported.
if "PYTEST_XDIST_WORKER_COUNT" in os.environ:
    share = max(1, len(os.sched_getaffinity(0)) // int(os.environ["PYTEST_XDIST_WORKER_COUNT"]))
    for variable in THREAD_VARIABLES:
        os.environ.setdefault(variable, str(share))
# Array shapes in signatures are checked while tests run. Before the first test module is imported.
install_import_hook(checked_by_jaxtyping(), "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))")

ROOT = Path(__file__).resolve().parents[1]

# Shells start background jobs with Ctrl-C ignored, and programs inherit that; tests that interrupt programs need it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


GROWTH_BYTES = 100 * 2**20
"""By how much a worker may grow before memory is collected."""
resident_before = 0


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """Collects what a test left behind where that is much: environments and networks lie in circles of references."""
    yield
    if resident_bytes() > resident_before + GROWTH_BYTES:
        give_memory_back()


@pytest.fixture(scope="module", autouse=True)
def caches_are_emptied(request: pytest.FixtureRequest) -> Iterator[None]:
    """Empties a test module's own caches after its last test.

    Set up before the other fixtures of a module, and so taken down after them.
    """
    yield
    for value in vars(request.module).values():
        if isinstance(value, functools._lru_cache_wrapper) and value.__module__ == request.module.__name__:
            value.cache_clear()
    give_memory_back()


def give_memory_back() -> None:
    """Collects garbage, and returns what C's allocator keeps of it."""
    global resident_before
    gc.collect()
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)
    resident_before = resident_bytes()


def resident_bytes() -> int:
    """Memory of this process; 0 where the system does not tell it."""
    sizes = Path("/proc/self/statm")
    return int(sizes.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if sizes.exists() else 0


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
