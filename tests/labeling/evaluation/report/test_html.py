"""The report: self-contained, safe against what files hold, worst cases first, outlines where the masks are."""

import base64
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labeling.core.masks import mask_iou
from labeling.evaluation.compare import Case, evaluate_label_set
from labeling.evaluation.report.html import write_report
from labeling.evaluation.report.pictures import Overlay, mask_path, panel, shorten, thumbnail, thumbnail_size
from labeling.evaluation.report.view_panels import choose_worst
from labeling.formats.atomic import write_json
from labeling.generator.sources import DETECTIONS_FOLDER, detections_record

VOID = {"meta", "br", "img", "link", "input"}


class Page(HTMLParser):
    """Collects elements and texts, and checks that every element is closed in order."""

    def __init__(self, text: str):
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def report_of(scene, **options) -> tuple[str, Page]:
    write_report(scene.root / "report.html", evaluate_label_set(scene.labels), **options)
    text = (scene.root / "report.html").read_text(encoding="utf-8")
    return text, Page(text)


def test_the_page_is_whole_and_needs_nothing_else(scene):
    for name in ("a", "b"):
        scene.add_episode(name)
    scene.write_labels()
    text, page = report_of(scene)
    for address in re.findall(r"""(?:href|src)\s*=\s*["']?([^"'\s>]*)""", text):
        assert address.startswith(("data:image/jpeg;base64,", "#"))
    assert not {"iframe", "link", "object"} & {name for name, _ in page.elements}
    assert not re.search(r"url\(|@import", text)
    (script,) = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; script-src 'sha256-{digest}';" in text  # no other script may run
    kept = {image["id"] for image in page.all("image")}
    used = [use["href"] for use in page.all("use")]
    assert {f"#{name}" for name in kept} == set(used)
    assert len(kept) == 4  # each view's picture once, though it is shown in the worst cases and in its episode


def test_every_view_shows_detector_labels_and_truth_side_by_side(scene):
    scene.add_episode("one")
    scene.write_labels(lambda truth: (truth.category, 0.77, truth.modal) if truth.view_index == 0 else None)
    _, page = report_of(scene, max_worst=0)
    names = [svg["aria-label"] for svg in page.all("svg") if svg.get("role") == "img" and "class" not in svg]
    assert names == [
        f"{panel_name}, one, view {view}"
        for view in (0, 1)
        for panel_name in ("Detector", "Pseudo-labels", "Ground truth")
    ]
    assert page.texts.count("chair 0.77") == 1
    assert page.texts.count("plant 0.80") == 2
    assert "chair 0.90, IoU 0.50 with ground truth" in page.texts
    assert "chair 0.30, stands for no object of this category" in page.texts


def test_the_detector_shown_is_the_one_that_the_labels_were_made_from(scene):
    episode = scene.add_episode("one")
    scene.write_labels(summary={"dataset": "../dataset", "sources": {"detections": "found.json"}})
    found = [replace(one, category="plant", confidence=0.66) for one in episode.detections[:1]]
    kept = scene.labels / DETECTIONS_FOLDER / "one.json"
    write_json(kept, detections_record(episode, tuple(found), {"origin": "found.json"}))
    _, page = report_of(scene, max_worst=0)
    assert page.texts.count("plant 0.66") == 1
    assert "chair 0.30" not in page.texts


def test_an_object_has_one_colour_in_all_panels(scene):
    scene.add_episode("one")
    scene.write_labels()
    text, _ = report_of(scene, max_worst=0)
    colours = {
        name: set(re.findall(rf'stroke="(#\w+)"[^>]*><title>{name}[^<]*(?:IoU|, object)', text))
        for name in ("chair", "plant")
    }
    assert all(len(found) == 1 for found in colours.values())
    assert colours["chair"] != colours["plant"]


def test_worst_cases_come_first(scene):
    """Labels get better from view to view and episode to episode; the page lists them in that order."""
    share = {("a", 0): 2, ("a", 1): 5, ("b", 0): 1, ("b", 1): 4}
    for name in ("a", "b"):
        scene.add_episode(name)
    chairs = iter(sorted(share))

    def partial(truth):
        if truth.category == "plant":
            return truth.category, 0.9, truth.modal
        mask = truth.modal.copy()
        mask[:, 2 + share[next(chairs)] :] = False
        return truth.category, 0.9, mask

    scene.write_labels(partial, amodal=lambda truth: (truth.category, 0.9, truth.modal))
    evaluation = evaluate_label_set(scene.labels)
    worst = choose_worst(evaluation.cases, 10)
    assert [case.view for case in worst] == sorted(share, key=lambda view: share[view])
    assert [case.pseudo_label_iou for case in worst] == [pytest.approx(share[case.view] / 8) for case in worst]
    text, _ = report_of(scene)
    headings = re.findall(r"(\w+) in (\w), view (\d) <span[^>]*>· pseudo-label IoU <b>([\d.]+)", text)
    assert headings == [
        ("chair", name, str(view), f"{share[name, view] / 8:.2f}")
        for name, view in sorted(share, key=lambda view: share[view])
    ]


def test_choose_worst_shows_a_view_once():
    cases = [Case(("a", view), "chair", 1, 10, 0.0, iou) for view, iou in ((0, 0.1), (0, 0.2), (1, 0.3))]
    assert choose_worst(cases, 5) == (cases[0], cases[2])
    assert choose_worst(cases, 1) == (cases[0],)
    assert choose_worst(cases, 0) == ()


@pytest.mark.slow
@pytest.mark.parametrize(("max_views", "max_worst"), [(0, 0), (1, 5), (3, 1), (100, 2)])
def test_no_more_views_than_asked_for(scene, max_views, max_worst):
    for number in range(4):
        scene.add_episode(f"e{number}")
    scene.write_labels()
    text, page = report_of(scene, max_views=max_views, max_worst=max_worst)
    assert text.count('<div class="panels">') <= max_views
    assert len(page.all("image")) <= max_views
    assert text.count('<span class="rank">') == min(max_views, max_worst)
    for number in range(4):
        assert f"<td>e{number}</td>" in text  # the table has all episodes all the same


def test_nothing_from_files_becomes_markup(scene):
    evil = "<script>alert(\"1\")</script>&<b onclick='x'>"
    episode = scene.add_episode("one")
    scene.add_episode(
        "one",
        ground_truth=tuple(replace(truth, category=evil) for truth in episode.ground_truth),
        detections=tuple(replace(detection, category=evil) for detection in episode.detections),
        categories=(evil,),
    )
    scene.write_labels(summary={"dataset": "../dataset", "config": {evil: evil}})
    text, page = report_of(scene)
    assert text.count("<script") == 1
    assert evil in {option["value"] for option in page.all("option")}
    assert not page.all("b") or all("onclick" not in attributes for attributes in page.all("b"))
    assert "onclick" not in {key for _, attributes in page.elements for key in attributes}
    assert evil in page.texts
    assert any(json.dumps(evil)[1:-1] in text for text in page.texts)  # the provenance


def test_text_that_is_no_unicode_does_not_stop_the_report(scene):
    scene.add_episode("one")
    scene.write_labels(summary={"dataset": "../dataset", "config": "\ud800"})
    text, _ = report_of(scene)
    assert r"\ud800" in text


def test_what_is_undefined_is_shown_as_such(scene):
    scene.add_episode("one", detections=None)
    scene.write_labels(lambda truth: None)
    text, page = report_of(scene)
    assert "Detector (none ran here)" in text
    assert any("the detector's figures are undefined" in one for one in page.texts)
    assert "the label set holds no label" in text
    assert "nan" not in text.lower().replace("provenance", "")


def test_a_failed_write_leaves_the_old_report(scene, monkeypatch):
    scene.add_episode("one")
    scene.write_labels()
    before, _ = report_of(scene)
    evaluation = evaluate_label_set(scene.labels)
    (scene.dataset / "one" / "rgb" / "000.png").unlink()
    with pytest.raises(ValueError, match=r"000\.png"):
        write_report(scene.root / "report.html", evaluation)
    assert (scene.root / "report.html").read_text(encoding="utf-8") == before


def test_a_hundred_detections_are_not_all_drawn(scene):
    episode = scene.add_episode("one")
    scene.add_episode("one", detections=episode.detections * 30)
    scene.write_labels()
    text, page = report_of(scene)
    assert "16 of 90 drawn" in text
    # What stands for an object is drawn, however many others there are.
    assert any(text.startswith("plant 0.80, IoU 0.50") for text in page.texts)


# Pictures ------------------------------------------------------------------------------------------------------------


@given(st.integers(1, 3000), st.integers(1, 3000))
def test_thumbnails_are_small_and_keep_their_shape(height_px, width_px):
    small_height_px, small_width_px = thumbnail_size(height_px, width_px)
    assert 1 <= small_height_px <= height_px
    assert 1 <= small_width_px <= min(width_px, 480)
    scale = min(1.0, (320 * 240 / (height_px * width_px)) ** 0.5, 480 / width_px)
    assert abs(small_height_px - height_px * scale) < 1
    assert abs(small_width_px - width_px * scale) < 1


def test_thumbnails_hold_the_picture():
    rgb = np.zeros((480, 640, 3), np.uint8)
    rgb[:, :320] = (200, 30, 60)
    kind, content = thumbnail("view", rgb)["data_uri"].split(",")
    assert kind == "data:image/jpeg;base64"
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    assert decoded.shape == (240, 320, 3)
    np.testing.assert_allclose(decoded[120, 80, ::-1].astype(int), (200, 30, 60), atol=6)


def rasterise(path: str, height_px: int, width_px: int) -> np.ndarray:
    """Fills SVG path data by the even-odd rule, as a browser does, with the outline itself counted as inside."""
    polygons = [
        np.array([[float(value) for value in point.split()] for point in part.rstrip("Z").split("L")])
        for part in path.split("M")[1:]
    ]
    canvas = np.zeros((height_px, width_px), np.uint8)
    points = [np.rint(polygon - 0.5).astype(np.int32) for polygon in polygons]
    cv2.fillPoly(canvas, points, 1)
    return canvas.astype(bool)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_outlines_follow_the_mask(seed):
    rng = np.random.default_rng(seed)
    mask = cv2.GaussianBlur(rng.random((60, 80)), (0, 0), 6) > 0.5
    assume(mask.sum() > 50)
    assert mask_iou(rasterise(mask_path(mask, 1.0), 60, 80), mask) > 0.9


def test_outlines_keep_holes():
    mask = np.ones((40, 40), bool)
    mask[10:30, 10:30] = False
    assert mask_path(mask, 1.0).count("M") == 2
    assert not rasterise(mask_path(mask, 1.0), 40, 40)[15:25, 15:25].any()


@given(hnp.arrays(bool, (6, 9)), st.sampled_from([1.0, 0.5, 0.1]))
def test_any_mask_with_a_pixel_has_an_outline(mask, scale):
    path = mask_path(mask, scale)
    assert bool(path) == mask.any()
    assert "nan" not in path


@given(hnp.arrays(bool, (3, 20, 30)), st.text(max_size=40))
def test_panels_are_well_formed_and_tags_stay_inside(masks, tag):
    overlays = [Overlay(mask, "#123456", tag, tag) for mask in masks]
    page = Page(panel("picture", (20, 30), overlays, tag))
    assert page.all("use") == [{"href": "#picture"}]
    boxes = page.all("rect")
    assert len(boxes) == sum(mask.any() for mask in masks)
    for box in boxes:
        assert float(box["x"] or "nan") >= 0
        assert float(box["x"] or "nan") + float(box["width"] or "nan") <= 30.1


def test_tags_do_not_cover_each_other():
    mask = np.zeros((240, 320), bool)
    mask[50:100, 50:100] = True
    page = Page(panel("p", (240, 320), [Overlay(mask, "#123456", f"object {i}", "") for i in range(8)], "panel"))
    tops = sorted(float(box["y"] or "nan") for box in page.all("rect"))
    assert min(np.diff(tops)) >= 13


@given(st.text(), st.integers(3, 30))
def test_shorten_keeps_both_ends(text, most):
    short = shorten(text, most)
    assert len(short) <= most
    assert short == text or (text.startswith(short.split("…")[0]) and "…" in short)
