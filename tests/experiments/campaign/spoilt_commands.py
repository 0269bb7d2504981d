"""Commands with faults, for the campaign to find."""

import time
from pathlib import Path

HELD = []


def main(arguments: list[str]) -> int:
    what, folder, out = arguments[0], Path(arguments[1]), Path(arguments[2])
    if what == "raises":
        raise ZeroDivisionError("nobody catches this")
    if what == "hangs":
        while True:
            time.sleep(0.01)
    if what == "greedy":
        HELD.append(bytearray(100 * 2**20))
        HELD.clear()
    if what == "outside":
        (folder / "elsewhere.txt").write_text("")
    if what == "half-written":
        out.mkdir(parents=True)
        (out.parent / ".out.1234").write_text("")
    if what == "silent":
        return 2
    if what == "tells":
        import os

        print(os.environ["SBM_CAMPAIGN"])
    if what == "refused":
        import sys

        print("error: the file is damaged", file=sys.stderr)
        return 2
    return 0
