"""Takes the screenshots of docs/pictures: report, viewer, site and help, in a headless Chromium.

    python -m experiments.demo --out out/demo
    python tools/screenshots.py --labels out/demo/labels

Needs Chromium or Chrome on the path, and the extras that development needs (viser for the viewer, MkDocs for the site).
"""

import argparse
import base64
import html
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
MAX_BYTES = 300_000
COLOURS = (256, 128, 64)
"""Tried one after the other until a picture is small enough; then smaller pictures are."""
START_S, LOAD_S = 60.0, 60.0
TERMINAL = """<body style="margin:0;background:#1f2430"><pre style="margin:0;padding:18px 22px;color:#d8dee9;
font:14px/1.35 'DejaVu Sans Mono',monospace"><span style="color:#8fbcbb">$ %s</span>\n%s</pre></body>"""


class Page:
    """A page of a browser that is spoken to by its developer tools' protocol."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._number = socket, 0

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """Calls a method of the protocol and returns its result.

        Raises:
            RuntimeError: if the browser says that it failed.
        """
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": params}))
        while True:
            answer = json.loads(self._socket.recv(timeout=LOAD_S))
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error'].get('message')}")
                return answer["result"]

    def script(self, code: str) -> Any:
        """What an expression gives in the page."""
        return self.send("Runtime.evaluate", expression=code, returnByValue=True)["result"].get("value")

    def open(self, address: str, width_px: int, height_px: int, settle_s: float = 1.0) -> None:
        """Shows an address in a window of this size, and waits until it has been drawn."""
        self.send(
            "Emulation.setDeviceMetricsOverride", width=width_px, height=height_px, deviceScaleFactor=1, mobile=False
        )
        self.send("Page.navigate", url="about:blank")
        self.send("Page.navigate", url=address)
        end = time.monotonic() + LOAD_S
        while self.script("location.href !== 'about:blank' && document.readyState") != "complete":
            if time.monotonic() > end:
                raise RuntimeError(f"{address}: not loaded within {LOAD_S:g} seconds")
            time.sleep(0.1)
        time.sleep(settle_s)

    def picture(self) -> bytes:
        """What the window shows, as PNG."""
        return base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])


@contextmanager
def browser() -> Iterator[Page]:
    """A page of a headless browser, which is ended afterwards.

    Raises:
        FileNotFoundError: if there is no browser.
        RuntimeError: if it does not start.
    """
    from websockets.sync.client import connect

    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise FileNotFoundError(
            f"no browser to take screenshots with; looked for {', '.join(BROWSERS)} on the path. "
            "On Debian or Ubuntu: apt-get install chromium"
        )
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [program, "--headless=new", "--no-sandbox", "--hide-scrollbars", f"--user-data-dir={profile}"]
        command += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # WebGL where there is no GPU
        command += ["--remote-debugging-port=0", "about:blank"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            with connect(_address(Path(profile) / "DevToolsActivePort"), max_size=None) as socket:
                page = Page(socket)
                page.send("Page.enable")
                yield page
        finally:
            process.terminate()
            process.wait(timeout=30)


def _address(file: Path) -> str:
    """Of the first page, once the browser has written on which port it listens."""
    from urllib.request import urlopen

    end = time.monotonic() + START_S
    while time.monotonic() < end:
        if file.is_file() and (lines := file.read_text().split()):
            with urlopen(f"http://127.0.0.1:{lines[0]}/json/list") as answer:
                pages = [one for one in json.load(answer) if one["type"] == "page"]
            if pages:
                return pages[0]["webSocketDebuggerUrl"]
        time.sleep(0.1)
    raise RuntimeError(f"the browser did not start within {START_S:g} seconds")


def small_png(picture: bytes) -> bytes:
    """The picture with fewer colours, and smaller if that is not enough, in at most ``MAX_BYTES``."""
    from PIL import Image

    whole = Image.open(io.BytesIO(picture)).convert("RGB")
    for shrunk in (1.0, 0.8, 0.65, 0.5):
        size = round(shrunk * whole.width), round(shrunk * whole.height)
        for colours in COLOURS:
            found = io.BytesIO()
            scaled = whole if shrunk == 1.0 else whole.resize(size, Image.Resampling.LANCZOS)
            # Octrees keep the colours of thin lines.
            few = scaled.quantize(colours, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
            few.save(found, format="PNG", optimize=True)
            if len(found.getvalue()) <= MAX_BYTES:
                return found.getvalue()
    raise RuntimeError(f"a screenshot cannot be made smaller than {MAX_BYTES:,} bytes")


def shoot_report(page: Page, labels: Path) -> dict[str, bytes]:
    """The three tabs of a report, and how a phone shows it."""
    address = (labels / "report.html").resolve().as_uri()
    shots = {}
    for tab, height_px in (("figures", 1150), ("views", 900), ("scene", 900)):
        page.open(f"{address}#{tab}", 1200, height_px)
        shots[f"report_{tab}"] = page.picture()
    page.open(f"{address}#figures", 400, 800)
    shots["report_phone"] = page.picture()
    return shots


def shoot_viewer(page: Page, labels: Path) -> dict[str, bytes]:
    """The viewer with its controls, as it opens."""
    from labeling.inspection.scene import read_scenes
    from labeling.inspection.viewer import SceneViewer

    viewer = SceneViewer(labels, read_scenes(labels)[:1], "127.0.0.1", 8080)
    try:
        page.open(viewer.address, 1400, 850, settle_s=12.0)
        viewer.cameras.value = False  # they hide the room on a picture this small
        page.script("document.querySelectorAll('.mantine-Notification-closeButton').forEach((one) => one.click())")
        time.sleep(3.0)
        return {"viewer": page.picture()}
    finally:
        page.send("Page.navigate", url="about:blank")
        viewer.server.stop()


def shoot_site(page: Page, labels: Path) -> dict[str, bytes]:
    """The page of an environment, of a site built anew."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", folder]
        environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT)}
        subprocess.run(command, cwd=ROOT, env=environment, check=True)
        page.open((Path(folder) / "environments" / "indoor.html").as_uri(), 1200, 900)
        return {"site": page.picture()}


def shoot_help(page: Page, labels: Path) -> dict[str, bytes]:
    """What ``sbm --help`` prints."""
    environment = {**os.environ, "COLUMNS": "100", "PYTHONPATH": str(ROOT), "TERM": "dumb"}
    command = [sys.executable, "-m", "experiments.sbm", "--help"]
    text = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True).stdout
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "help.html"
        file.write_text(TERMINAL % ("sbm --help", html.escape(text)), encoding="utf-8")
        page.open(file.as_uri(), 860, 36 + 19 * (2 + text.count("\n")))
        return {"help": page.picture()}


SHOTS: dict[str, Callable[[Page, Path], dict[str, bytes]]] = {
    "report": shoot_report,
    "viewer": shoot_viewer,
    "site": shoot_site,
    "help": shoot_help,
}


def main(arguments: list[str] | None = None) -> int:
    """Takes the screenshots that are asked for; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--labels", type=Path, default=ROOT / "out/demo/labels", help="an evaluated label set")
    parser.add_argument("--out", type=Path, default=ROOT / "docs/pictures", help="folder for the pictures")
    parser.add_argument("--only", nargs="+", choices=[*SHOTS], default=[*SHOTS], help="which to take")
    given = parser.parse_args(arguments)
    if {"report", "viewer"} & {*given.only} and not (given.labels / "report.html").is_file():
        parser.error(f"{given.labels} holds no report.html; python -m labeling.evaluate LABELS writes one")
    try:
        with browser() as page:
            for name in given.only:
                for shot, picture in SHOTS[name](page, given.labels).items():
                    file = given.out / f"screenshot_{shot}.png"
                    file.parent.mkdir(parents=True, exist_ok=True)
                    file.write_bytes(small_png(picture))
                    print(f"{file}: {file.stat().st_size / 1000:.0f} kB")
    except (FileNotFoundError, RuntimeError) as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
