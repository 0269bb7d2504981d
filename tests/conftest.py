"""What tests of all packages share."""

import atexit
import contextlib
import ctypes
import functools
import gc
import os
import resource
import shutil
import signal
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from jaxtyping import install_import_hook

from labeling.runtime.threads import THREAD_VARIABLES

from .imports import checked_by_jaxtyping

# Workers of pytest-xdist share the cores: threads of one would wait for those of the others. Before numba is imported.
if "PYTEST_XDIST_WORKER_COUNT" in os.environ:
    share = max(1, len(os.sched_getaffinity(0)) // int(os.environ["PYTEST_XDIST_WORKER_COUNT"]))
    for variable in THREAD_VARIABLES:
        os.environ.setdefault(variable, str(share))
# Many tests start programs: what the first has compiled to bytecode serves the others and the next run, also where the
# shell is told to keep none, as containers often are. Workers inherit it.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# C's allocator keeps what threads of tests have freed in pools of their own; two of them hold less than one for each
# thread. What has a megabyte or more is given back when it is freed: by default the bound rises with what is freed, so
# that a worker keeps what its largest test has used. Read when a process starts, and so by workers and programs.
os.environ.setdefault("MALLOC_ARENA_MAX", "2")
os.environ.setdefault("MALLOC_MMAP_THRESHOLD_", "1048576")
# Compiled scenes go to a folder of this session, which all its processes share; converted furniture is the user's.
if "PYTEST_XDIST_WORKER" not in os.environ:
    from sbm_gym.store.cache_folder import cache_folder

    session_cache = Path(tempfile.mkdtemp(prefix="sbm-tests-"))
    atexit.register(shutil.rmtree, session_cache, ignore_errors=True)
    furniture = cache_folder() / "furniture"
    furniture.mkdir(parents=True, exist_ok=True)
    (session_cache / "furniture").symlink_to(furniture.resolve(), target_is_directory=True)
    os.environ["SBM_CACHE"] = str(session_cache)
# Array shapes in signatures are checked while tests run. Before the first test module is imported.
install_import_hook(checked_by_jaxtyping(), "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))")

# How long an example takes says nothing of whether the code is right, and much of what else the machine is doing.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")

ROOT = Path(__file__).resolve().parents[1]

# Shells start background jobs with Ctrl-C ignored, and programs inherit that; tests that interrupt programs need it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


GROWTH_BYTES = 50 * 2**20
"""By how much a worker may grow before memory is collected."""
MIB = 2**20
resident_before = 0
peaks: dict[str, int] = {}
"""By how many bytes each test raised the greatest memory of this process."""


def pytest_collection_finish() -> None:
    """Leaves what has been imported so far out of every later search for garbage."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Notes by how much a test raises the greatest memory of this process."""
    before = peak_bytes()
    result = yield
    if peak_bytes() > before:
        peaks[item.nodeid] = peak_bytes() - before
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """Collects what a test left behind where that is much: environments and networks lie in circles of references."""
    yield
    if resident_bytes() > resident_before + GROWTH_BYTES:
        give_memory_back()


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Workers of pytest-xdist send their peaks to the process that reports."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["memory"] = peak_bytes(), peaks


workers: dict[str, tuple[int, dict[str, int]]] = {}
"""Greatest memory of each worker that has ended, and which tests raised it, by the worker's name."""


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Takes what a worker sent; one that crashed sends nothing."""
    if "memory" in getattr(node, "workeroutput", {}):
        workers[node.gateway.id] = node.workeroutput["memory"]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Says how much memory each worker took, and which tests raised it most."""
    if not workers:
        return
    found = ", ".join(f"{peak / 2**30:.2f} GB" for _, (peak, _) in sorted(workers.items()))
    terminalreporter.write_line(f"peak memory per worker: {found}; raised most by")
    raised = [(grown, test, name) for name, (_, peaks) in workers.items() for test, grown in peaks.items()]
    for grown, test, name in sorted(raised, reverse=True)[:5]:
        terminalreporter.write_line(f"{grown / MIB:6.0f} MB in {name}: {test}")


@pytest.fixture(scope="module", autouse=True)
def caches_are_emptied(request: pytest.FixtureRequest) -> Iterator[None]:
    """Empties a test module's own caches after its last test, and those that furniture and worlds keep models in.

    Set up before the other fixtures of a module, and so taken down after them.
    """
    yield
    for value in list(vars(request.module).values()):
        if isinstance(value, functools._lru_cache_wrapper) and value.__module__ == request.module.__name__:
            value.cache_clear()
    # Lists: threads that tests left behind may be importing.
    for name in [name for name in list(sys.modules) if name.startswith(("sbm_gym.assets.", "sbm_gym.worlds."))]:
        for value in list(vars(sys.modules[name]).values()):
            if isinstance(value, functools._lru_cache_wrapper) and value.cache_parameters()["maxsize"]:
                value.cache_clear()
    if resident_bytes() > resident_before + GROWTH_BYTES:
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


def peak_bytes() -> int:
    """Greatest memory of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


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


@pytest.fixture(scope="session")
def browser_page() -> Iterator[Any]:
    """A page of a headless browser, one for all tests of a worker; a ``tools.browser.Page``."""
    sys.path.insert(0, str(ROOT))
    from tools.browser import browser, find_browser

    if find_browser() is None:
        pytest.skip("needs chromium or chrome")
    with browser() as page:
        yield page


@pytest.fixture(scope="session")
def ray_cluster() -> Iterator[Any]:
    """Two nodes of one core each, on this machine; a ``ray.cluster_utils.Cluster``."""
    pytest.importorskip("ray", reason="needs the extra 'cluster'")
    from ray.cluster_utils import Cluster

    from labeling.cluster.ray_connection import connect

    # Ray's processes are otherwise as polite as can be, which takes minutes beside others.
    os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        cluster.add_node(num_cpus=1)
    # Ray's processes look for modules in the folder that this process had when it connected; a test may be elsewhere.
    with contextlib.chdir(ROOT):
        connect(str(cluster.address))
    yield cluster
    import ray

    ray.shutdown()
    cluster.shutdown()
