"""The connection to a Ray cluster."""

import logging
import signal
import socket
import sys
import threading
import warnings

from labeling.core.errors import UsageError

REACH_S = 10.0
"""So long a cluster may take to answer."""


def connect(address: str) -> None:
    """Connects to a cluster and says so on stderr, with the link to its dashboard; does nothing if that was done.

    Raises:
        UsageError: if there is none, or it cannot be used.
        ModuleNotFoundError: if the extra 'cluster' is not installed.
    """
    import ray

    if ray.is_initialized():
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    check_reachable(address)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            context = ray.init(address, logging_level=logging.ERROR, log_to_driver=False)
    except Exception as error:  # whatever Ray raises: it has no class of its own for this
        told = str(error).strip().splitlines() or [type(error).__name__]
        advice = "; start one with: ray start --head" if address == "auto" else ""
        raise UsageError(f"--cluster {address}: cannot be reached ({told[0].rstrip('.')}){advice}") from None
    finally:
        if threading.current_thread() is threading.main_thread():
            for number, handler in before.items():  # Ray puts its own there
                signal.signal(number, handler)
    nodes = [node for node in ray.nodes() if node["Alive"]]
    cores = sum(int(node["Resources"].get("CPU", 0)) for node in nodes)
    link = getattr(context, "dashboard_url", None)
    tell(f"cluster: {len(nodes)} nodes, {cores} cores" + (f"; dashboard: http://{link}" if link else ""))


def check_reachable(address: str) -> None:
    """Refuses an address where nobody listens: Ray itself tries for minutes.

    Raises:
        UsageError: saying what is wrong with it.
    """
    if address == "auto":
        return
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        raise UsageError(f"--cluster must be local, auto, HOST:PORT or ray://HOST:PORT, not {address!r}")
    try:
        socket.create_connection((host.strip("[]"), int(port)), REACH_S).close()
    except (OSError, OverflowError) as error:
        raise UsageError(f"--cluster {address}: nobody answers there ({error})") from None


def tell(words: str) -> None:
    """Says something on stderr, above a progress bar."""
    from tqdm import tqdm

    tqdm.write(words, file=sys.stderr)
