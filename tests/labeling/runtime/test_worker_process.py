"""Workers end with the process that they work for, even if that is killed without a chance to tell them."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
PARENT = """
import multiprocessing, signal
from concurrent.futures import ProcessPoolExecutor
from labeling.runtime.worker_process import serve_parent

if __name__ == "__main__":
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), serve_parent) as pool:
        print(pool.submit(signal.getsignal, signal.SIGINT).result() is signal.SIG_IGN, flush=True)
        pool.submit(signal.pause)
        signal.pause()
"""


def test_workers_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True, env=environment) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "True\n", "Ctrl-C is left to the parent"
        parent.kill()
        # The worker holds the other end of this pipe, too: it ends when the worker does.
        parent.communicate(timeout=60)
