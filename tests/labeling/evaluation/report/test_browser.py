"""The report in a browser: its script runs under its own policy, and its filters do what they say."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labeling.core.types import Box3d
from labeling.evaluation.compare import evaluate_label_set
from labeling.evaluation.report.errors import KINDS, kinds_of
from labeling.evaluation.report.html import write_report
from labeling.generate import main as generate
from labeling.inspection.scene import read_scenes
from labeling.io.episodes import write_episode
from labeling.metrics.matching import match

from ...synthetic_room import make_episode

REPORT = """
const words = [];
const say = (...what) => words.push(...what.map(String));
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


@pytest.fixture
def said(browser_page):
    """What a script says in a page, opened anew at one of its tabs."""

    def said(report: Path, script: str, width_px: int = 1200, tab: str = "views") -> list[str]:
        browser_page.open(f"{report.as_uri()}#{tab}", width_px, 900, settle_s=0)
        return browser_page.script(f"(async () => {{ {REPORT} {script} return words; }})()")

    return said


def test_the_script_runs_under_the_policy_of_the_page(report: Path, said) -> None:
    (text,) = said(report, "say(document.documentElement.outerHTML);")
    assert '<b class="confidence-value">0.20</b>' in text
    assert not re.search(r'id="filter"[^>]*hidden', text)


@pytest.mark.slow
def test_confidence_hides_what_is_less_sure_and_show_all_brings_it_back(report: Path, said) -> None:
    count = "seen('g.one[data-confidence=\"0.1000\"]').length"
    script = f"say({count}); document.getElementById('all').click(); say({count});"
    default, everything = said(report, script)
    assert default == "0"
    assert int(everything) > 0


def test_category_and_kind_leave_only_what_they_name(report: Path, said) -> None:
    script = "set('category', 'chair'); say(seen('g.one').every((one) => one.dataset.category === 'chair'));"
    assert said(report, script) == ["true"]
    script = "set('kind', 'right'); say(seen('.view').length > 0, seen('g.one').filter((one) =>"
    script += " !['right', 'truth', 'missed'].includes(one.dataset.kind)).length);"
    assert said(report, script) == ["true", "0"]
    assert said(report, "set('kind', 'duplicate'); say(seen('.view').length);") == ["0"]


@pytest.mark.parametrize(
    "tab",
    [pytest.param("figures", marks=pytest.mark.nightly), "views", pytest.param("scene", marks=pytest.mark.nightly)],
)
def test_a_phone_needs_no_scrolling_to_the_side(report: Path, said, tab: str) -> None:
    script = "say(document.documentElement.scrollWidth, window.innerWidth, seen('.tab').length, seen('.tab')[0].id);"
    wide, window, *open_tabs = said(report, script, 500, tab)
    assert int(wide) <= int(window)
    assert open_tabs == ["1", f"tab-{tab}"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("confidence", "category"),
    [
        pytest.param(0, "", marks=pytest.mark.nightly),
        pytest.param(0.5, "", marks=pytest.mark.nightly),
        (0.35, "chair"),
        (1, ""),
    ],
)
def test_figures_are_those_of_the_confidence_and_category_asked_for(report: Path, said, confidence, category) -> None:
    evaluation = evaluate_label_set(report.parent / "labels")
    wanted = [f"[data-method='{method}'][data-error='{kind}']" for method in ("detector", "labels") for kind in KINDS]
    wanted += [f"[data-method='labels'][data-figure='{name}']" for name in ("precision", "recall", "mean_iou")]
    script = f"set('category', '{category}'); set('confidence', {confidence});"
    script += f"say(...{json.dumps(wanted)}.map((one) => document.querySelector(one).textContent));"
    found = said(report, script, tab="figures")
    truths = [item for one in evaluation.episodes for item in one.truths]
    expected: list[str] = []
    detections = [item for one in evaluation.episodes for item in one.detections]
    for predictions in (detections, evaluation.labels.modal):
        kept = [item for item in predictions if item.confidence >= confidence]
        matches = match(kept, truths)
        of = [
            kind
            for item, kind in zip(kept, kinds_of(kept, truths, matches), strict=True)
            if category in ("", item.category)
        ]
        ious = [one.iou for one in matches if category in ("", truths[one.truth].category)]
        of += ["missed" for iou in ious if iou < 0.5]
        expected += [str(of.count(kind)) for kind in KINDS]
    claims = len(of) - of.count("missed")
    expected.append(f"{of.count('right') / claims:.3f}" if claims else "\u2013")
    expected += [f"{of.count('right') / len(ious):.3f}", f"{sum(ious) / len(ious):.3f}"]
    assert found == expected


def test_bars_and_confusions_follow_the_slider(report: Path, said) -> None:
    """Plants' labels are of confidence .1: at .2 no label says plant, and all plants are missed."""
    rows = "[...document.querySelectorAll('table[data-method=labels] tbody tr')].map((row) => [row.dataset.row, "
    rows += "...[...row.cells].slice(1).map((cell) => cell.textContent || '0')].join(' '))"
    columns = "[...document.querySelectorAll('table[data-method=labels] th')].slice(1).map((one) => one.dataset.column)"
    bars = "[...document.querySelectorAll('rect.labels title')].map((one) => one.textContent).join(' ')"
    script = (
        f"const before = [{columns}.join(' '), {rows}.join('; '), {bars}]; set('confidence', 0);"
        f"say(...before, {rows}.join('; '), {bars});"
    )
    order, at_default, bars_at_default, at_zero, bars_at_zero = said(report, script, tab="figures")
    assert order == "chair plant background"
    assert at_default == "chair 2 0 0; plant 0 0 2; background 0 0 0"
    assert at_zero == "chair 2 0 0; plant 0 2 0; background 0 0 0"
    assert bars_at_default == "2 0 0 0 0 0 0 0 0 2"
    assert bars_at_zero == "0 0 0 0 0 0 0 0 0 4"


# The scene in 3-D ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def room_report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("room")
    made = make_episode(1, num_views=3, size=(48, 64), num_objects=3, confident_share=2.0)
    box = Box3d(np.array([0.0, 0.0, 0.6]), np.array([0.8, 0.8, 1.2]), np.eye(3))
    truth = tuple(replace(one, box_3d=box) for one in made.ground_truth or ())
    write_episode(root / "data" / made.name, replace(made, ground_truth=truth))
    assert generate([str(root / "data"), "--out", str(root / "labels")]) == 0
    write_report(root / "report.html", evaluate_label_set(root / "labels"))
    return root / "report.html"


PIXELS = """
const gl = document.querySelector("#scene-view canvas").getContext("webgl");
const drawn = () => new Promise((resolve) => requestAnimationFrame(() => {
  const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
  const pixels = new Uint8Array(4 * width * height), colours = new Map();
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  for (let index = 0; index < pixels.length; index += 4) {
    const colour = pixels.slice(index, index + 3).join(",");
    colours.set(colour, (colours.get(colour) || 0) + 1);
  }
  resolve(colours);
}));
const titles = () => [...document.querySelectorAll("#scene-view .titles span")].map((one) => one.textContent).join(";");
"""
"""``drawn``: how many pixels the scene has of each colour, after the next frame."""


@pytest.mark.slow
def test_the_scene_shows_points_and_boxes_of_what_confidence_leaves(room_report: Path, said) -> None:
    (scene,) = read_scenes(room_report.parent / "labels")
    everything = [one.title for one in scene.objects]
    least, second, *_ = sorted(one.confidence for one in scene.objects)
    limit = round(0.5 * (least + second), 2)
    kept = [one.title for one in scene.objects if one.confidence >= limit]
    script = """
    set("confidence", 0);
    const all = await drawn(), allTitles = titles();
    set("confidence", LIMIT);
    const surer = await drawn(), surerTitles = titles();
    set("scene-colour", "true");
    const plain = await drawn(), gone = (from, to) => [...from.keys()].filter((one) => !to.has(one)).length;
    say(allTitles, all.size > 50, gl.getError(), surerTitles, gone(all, surer) > 20, gone(surer, plain) > 20);
    """
    found = said(room_report, PIXELS + script.replace("LIMIT", str(limit)), tab="scene")
    assert found == [";".join(everything), "true", "0", ";".join(kept), "true", "true"]


def test_true_boxes_are_drawn_when_asked_for(room_report: Path, said) -> None:
    script = """
    const dark = (colours) => [...colours].filter(([colour]) => colour.split(",").every((value) => value < 33))
      .reduce((sum, [, count]) => sum + count, 0);
    set("confidence", 0);
    const before = dark(await drawn());
    document.getElementById("scene-truth").checked = true; set("confidence", 0);
    say(before, dark(await drawn()));
    """
    before, after = map(int, said(room_report, PIXELS + script, tab="scene"))
    assert after > before + 500


def test_a_label_set_without_clouds_says_why_there_is_no_scene(report: Path, said) -> None:
    (reason,) = said(report, "say(document.querySelector('#tab-scene').textContent.trim());", tab="scene")
    assert reason.startswith("No scene to show. ")
    assert "boxes_3d.json" in reason
