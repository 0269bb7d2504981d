"""Takes the screenshots of docs/pictures: report, viewer, site and help, in a headless Chromium.

    python -m experiments.demo --out out/demo
    python tools/screenshots.py --labels out/demo/labels

Needs Chromium or Chrome on the path, and the extras that development needs (viser for the viewer, MkDocs for the site).
"""

import argparse
import html
import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tools.browser import Page, browser  # noqa: E402

MAX_BYTES = 300_000
COLOURS = (256, 128, 64)
"""Tried one after the other until a picture is small enough; then smaller pictures are."""
TERMINAL = """<body style="margin:0;background:#1f2430"><pre style="margin:0;padding:18px 22px;color:#d8dee9;
font:14px/1.35 'DejaVu Sans Mono',monospace"><span style="color:#8fbcbb">$ %s</span>\n%s</pre></body>"""


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
