"""A headless browser that is spoken to by its developer tools' protocol: for screenshots, and for tests of pages."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
START_S, LOAD_S = 60.0, 60.0


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
        """What an expression gives in the page; if it is a promise, what that gives in the end.

        Raises:
            RuntimeError: if the expression throws.
        """
        found = self.send("Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in found:
            thrown = found["exceptionDetails"]
            raise RuntimeError(thrown.get("exception", {}).get("description", thrown["text"]))
        return found["result"].get("value")

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
            time.sleep(0.02)  # the browser is another process
        time.sleep(settle_s)  # scripts draw after the page has loaded, and say nothing when they have

    def picture(self) -> bytes:
        """What the window shows, as PNG."""
        return base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])


def find_browser() -> str | None:
    """The first of ``BROWSERS`` that is installed."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


@contextmanager
def browser() -> Iterator[Page]:
    """A page of a headless browser, which is ended afterwards.

    Raises:
        FileNotFoundError: if there is no browser.
        RuntimeError: if it does not start.
    """
    from websockets.sync.client import connect

    program = find_browser()
    if program is None:
        raise FileNotFoundError(
            f"no browser; looked for {', '.join(BROWSERS)} on the path. On Debian or Ubuntu: apt-get install chromium"
        )
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [program, "--headless=new", "--no-sandbox", "--hide-scrollbars", f"--user-data-dir={profile}"]
        command += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # WebGL where there is no GPU
        command += ["--remote-debugging-port=0", "about:blank"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            # No pings: the browser is ours, and a thread that sends them draws from ``random`` in the midst of others.
            address = _address(Path(profile) / "DevToolsActivePort")
            with connect(address, max_size=None, ping_interval=None) as socket:
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
        time.sleep(0.1)  # another process: its file is all there is to wait on
    raise RuntimeError(f"the browser did not start within {START_S:g} seconds")
