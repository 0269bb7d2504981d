"""What every process does first that works for another."""

import multiprocessing
import os
import signal
import threading


def serve_parent() -> None:
    """Leaves Ctrl-C to the process that started this one, and ends this one when that is gone, however it went.

    To be called in a spawned process, by its main thread. It is ended by SIGTERM, so that a handler may clean up.
    """
    # Ctrl-C reaches all processes of a terminal; the first one decides, and ends the others in its own time.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
