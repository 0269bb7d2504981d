"""The report in a browser: its script runs under its own policy, and its filters do what they say."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from labeling.evaluation.compare import evaluate_label_set
from labeling.evaluation.report.html import write_report

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="needs chromium or chrome")
REPORT = """
const say = (...what) => document.title = [document.title.split("|")[0], ...what].join("|");
const seen = (selector) => [...document.querySelectorAll(selector)].filter((one) => one.closest("[hidden]") === null);
const set = (id, value) => {
  const input = document.getElementById(id);
  input.value = value;
  input.dispatchEvent(new Event("input"));
};
"""
"""What a test may say in the page: ``say``, ``seen`` and ``set``."""


@pytest.fixture
def report(scene) -> Path:
    scene.add_episode("one")
    scene.write_labels(lambda truth: (truth.category, 0.9 if truth.category == "chair" else 0.1, truth.modal))
    write_report(scene.root / "report.html", evaluate_label_set(scene.labels))
    return scene.root / "report.html"


def page_after(report: Path, script: str = "", width_px: int = 1200) -> str:
    """The page as the browser has it in the end; what ``script`` says stands in its title."""
    path = report
    if script:
        # Only the page's own script may run, so that another needs a page without that policy.
        text = re.sub(r"<meta http-equiv[^>]*>", "", report.read_text(encoding="utf-8"))
        path = report.with_name("tried.html")
        path.write_text(text.replace("</body>", f"<script>{REPORT}{script}</script></body>"), encoding="utf-8")
    assert BROWSER is not None
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--window-size={width_px},900", "--dump-dom"]
    command += [f"--user-data-dir={report.parent / 'browser'}", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def said(report: Path, script: str, width_px: int = 1200) -> list[str]:
    found = re.search(r"<title>(.*?)</title>", page_after(report, script, width_px), re.DOTALL)
    assert found is not None
    return found.group(1).split("|")[1:]


def test_the_script_runs_under_the_policy_of_the_page(report: Path) -> None:
    text = page_after(report)
    assert '<b id="confidence-value">0.20</b>' in text
    assert not re.search(r'id="filter"[^>]*hidden', text)


def test_confidence_hides_what_is_less_sure_and_show_all_brings_it_back(report: Path) -> None:
    count = "seen('g.one[data-confidence=\"0.1000\"]').length"
    script = f"say({count}); document.getElementById('all').click(); document.title += '|' + {count};"
    default, everything = said(report, script)
    assert default == "0"
    assert int(everything) > 0


def test_category_and_kind_leave_only_what_they_name(report: Path) -> None:
    script = "set('category', 'chair'); say(seen('g.one').every((one) => one.dataset.category === 'chair'));"
    assert said(report, script) == ["true"]
    script = "set('kind', 'right'); say(seen('.view').length > 0, seen('g.one').filter((one) =>"
    script += " !['right', 'truth', 'missed'].includes(one.dataset.kind)).length);"
    assert said(report, script) == ["true", "0"]
    assert said(report, "set('kind', 'duplicate'); say(seen('.view').length);") == ["0"]


def test_a_phone_needs_no_scrolling_to_the_side(report: Path) -> None:
    wide, window = said(report, "say(document.documentElement.scrollWidth, window.innerWidth);", 500)
    assert int(wide) <= int(window)
