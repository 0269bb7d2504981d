"""The viewer of label sets: what it lists, what its controls leave, films and files."""

import itertools
import json
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from labeling.core.errors import UsageError
from labeling.core.types import GroundTruth
from labeling.generate import main as generate
from labeling.inspect import main
from labeling.inspection.framing import below, opening_view
from labeling.inspection.scene import SceneObject, TrueObject, read_scenes, together
from labeling.inspection.view_thumbnails import thumbnails
from labeling.inspection.viewer import SceneViewer
from labeling.io.episodes import read_episode, write_episode

from ..synthetic_room import make_episode
from .test_framing import box_at


@pytest.fixture(scope="module")
def labels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("viewer")
    for seed in (1, 2):
        made = make_episode(seed, num_views=3, size=(48, 64), num_objects=3, confident_share=2.0)
        write_episode(root / "data" / made.name, replace(made, metadata={"world": "W", "scene": "s"}))
    assert generate([str(root / "data"), "--out", str(root / "labels")]) == 0
    return root / "labels"


def test_objects_know_their_views_and_sources(labels: Path) -> None:
    for scene in read_scenes(labels):
        assert scene.place == ("W", "s")
        episode = read_episode(labels.parent / "data" / scene.name)
        assert scene.objects
        assert episode.detections is not None
        for one in scene.objects:
            assert set(one.views) <= set(range(episode.num_views))
            said = re.fullmatch(r"view (\d) \((.*)\)", one.source)
            assert said is not None
            confidences = [f"{d.confidence:.2f}" for d in episode.detections if d.view_index == int(said.group(1))]
            assert said.group(2) in confidences


def changed_boxes(labels: Path, to: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    """A copy of the label set whose boxes are changed."""
    shutil.copytree(labels, to)
    file = to / "boxes_3d.json"
    content = json.loads(file.read_text())
    for box in content["boxes"]:
        change(box)
    file.write_text(json.dumps(content))
    return to


def test_objects_that_another_episode_found_name_it(labels: Path, tmp_path: Path) -> None:
    """As ``--share-scenes`` writes them."""
    shared = {"episode": "room_9", "instance_id": 4}
    copy = changed_boxes(labels, tmp_path / "labels", lambda box: box.update(shared_from=shared))
    sources = [one.source for scene in read_scenes(copy) for one in scene.objects]
    assert sources
    assert all(re.fullmatch(r"room_9, view \d \(.*\)", source) for source in sources)


def test_consistency_is_the_share_of_views_whose_surest_detection_agrees(labels: Path, tmp_path: Path) -> None:
    def vote(view: int, confidence: float, category: str) -> dict[str, Any]:
        return {"view_index": view, "confidence": confidence, "category": category}

    def give_sources(box: dict[str, Any]) -> None:
        own = box["category"]
        box["sources"] = [
            vote(0, 0.9, own),
            vote(0, 0.95, "x"),
            vote(1, 0.5, own),
            vote(1, 0.4, "x"),
            vote(2, 0.3, own),
        ]

    copy = changed_boxes(labels, tmp_path / "voted", give_sources)
    assert {one.consistency for scene in read_scenes(copy) for one in scene.objects} == {2 / 3}
    copy = changed_boxes(labels, tmp_path / "silent", lambda box: box.update(sources=[]))
    assert {one.consistency for scene in read_scenes(copy) for one in scene.objects} == {None}


def test_truth_is_what_stands_there_and_counts(labels: Path, tmp_path: Path) -> None:
    """Boxes of ignored objects, and of those that move, are left out."""
    here = tmp_path / "set"
    shutil.copytree(labels.parent, here)
    assert all(scene.truth == () for scene in read_scenes(here / "labels"))  # no boxes are known there
    made = read_episode(here / "data" / "room_1")
    seen = Counter(one.instance_id for one in made.ground_truth or ())
    (moving, times), (ignored, _), (standing, _) = seen.most_common()
    assert times > 1

    def with_box(one: GroundTruth) -> GroundTruth:
        moved = one.view_index if one.instance_id == moving else 0.0
        return replace(one, box_3d=box_at(one.instance_id + moved, 1.0), ignore=one.instance_id == ignored)

    shutil.rmtree(here / "data" / "room_1")
    truth = tuple(with_box(one) for one in made.ground_truth or ())
    write_episode(here / "data" / "room_1", replace(made, ground_truth=truth))
    first, second = read_scenes(here / "labels")
    assert second.truth == ()
    (one,) = first.truth
    assert one.category == next(t.category for t in truth if t.instance_id == standing)
    np.testing.assert_allclose(one.box.centre_m, box_at(standing, 1.0).centre_m)
    assert len(together([first, first]).truth) == 1


def test_pictures_show_masks_in_the_colours_of_their_objects(labels: Path) -> None:
    scene = read_scenes(labels)[0]
    episode = read_episode(labels.parent / "data" / scene.name)
    found = thumbnails(labels, scene.name, {one.instance_id: (1.0, 0.0, 0.0) for one in scene.objects})
    assert sorted(found) == [0, 1, 2]
    changed = {}
    for view, (picture, masked) in found.items():
        np.testing.assert_array_equal(picture, episode.rgb[view])
        under = np.any(masked != picture, axis=2)
        changed[view] = under.any()
        expected = np.rint(0.5 * picture[under] + [127.5, 0, 0])
        np.testing.assert_allclose(masked[under], expected, atol=1)
    labelled = {view for one in scene.objects for view in one.views}
    assert {view for view, any_mask in changed.items() if any_mask} == labelled


def test_an_address_of_another_machine_is_refused(labels: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("viser")
    assert main([str(labels), "--view", "--host", "203.0.113.7"]) == 2
    assert "--host 203.0.113.7: cannot be an address of this machine" in capsys.readouterr().err


@pytest.fixture
def viewer(labels: Path) -> Iterator[SceneViewer]:
    pytest.importorskip("viser")
    found = SceneViewer(labels, read_scenes(labels), "127.0.0.1", 18080)
    yield found
    found.server.stop()


def visible(viewer: SceneViewer, kind: str) -> set[int]:
    """Numbers of the objects whose box or title is shown."""
    handles = ((one.number, viewer.server.scene.get_handle_by_name(f"/{kind}/{one.number}")) for one in objects(viewer))
    return {number for number, handle in handles if handle is not None and handle.visible}


def objects(viewer: SceneViewer) -> tuple[SceneObject, ...]:
    return viewer.scene.objects


def cloud(viewer: SceneViewer) -> Any:
    return viewer.server.scene.get_handle_by_name("/cloud")


def test_controls_leave_what_they_say(viewer: SceneViewer) -> None:
    everything = {one.number for one in objects(viewer)}
    assert visible(viewer, "boxes") == visible(viewer, "titles") == everything
    limit = sorted(one.confidence for one in objects(viewer))[1] - 1e-6
    viewer.confidence.value = limit
    assert visible(viewer, "boxes") == {one.number for one in objects(viewer) if one.confidence >= limit}
    viewer.confidence.value = 0.0
    first = objects(viewer)[0]
    viewer.category.value = first.category
    assert visible(viewer, "titles") == {one.number for one in objects(viewer) if one.category == first.category}
    viewer.category.value = viewer.category.options[0]
    viewer.boxes.value = False
    assert (visible(viewer, "boxes"), visible(viewer, "titles")) == (set(), everything)


def test_the_height_cuts_the_cloud_and_the_list_unticks_objects(viewer: SceneViewer) -> None:
    scene = viewer.scene
    assert len(cloud(viewer).points) == below(scene, float(viewer.cut.value)).sum() < len(scene.points)
    viewer.cut.value = viewer.cut.max
    assert len(cloud(viewer).points) == len(scene.points)
    before = cloud(viewer).colors.copy()
    viewer._rows[1].value = False
    assert 1 not in visible(viewer, "boxes")
    np.testing.assert_array_equal(np.any(cloud(viewer).colors != before, axis=1), scene.labels == 1)


def test_cameras_carry_pictures_when_asked_to(viewer: SceneViewer) -> None:
    frustums = [frustum for *_, frustum in viewer._frustums]
    assert len(frustums) == 3
    assert all(frustum.image is None for frustum in frustums)
    viewer.pictures.value = True
    with_masks = [frustum.image for frustum in frustums]
    viewer.masks.value = False
    episode = read_episode(viewer._labels.parent / "data" / viewer.scene.name)
    for view, frustum in enumerate(frustums):
        np.testing.assert_array_equal(frustum.image, episode.rgb[view])
    assert any(np.any(one != frustum.image) for one, frustum in zip(with_masks, frustums, strict=True))
    viewer.cameras.value = False
    assert not any(frustum.visible for frustum in frustums)


@pytest.mark.parametrize("stretch", [1.0, 0.5])
def test_a_camera_s_pyramid_is_as_wide_as_its_picture(viewer: SceneViewer, stretch: float) -> None:
    camera = viewer.scene.cameras[0]
    intrinsics = np.diag([stretch, 1.0, 1.0]) @ camera.intrinsics
    viewer._parts = [replace(viewer.scene, cameras=(replace(camera, intrinsics=intrinsics),))]
    viewer._add_cameras()
    ((*_, frustum),) = viewer._frustums
    height_px, width_px = camera.size
    # Where the pyramid's corners lie in the picture, from its middle.
    up = np.tan(frustum.fov / 2)
    corner = intrinsics[:2, :2] @ np.array([up * frustum.aspect, up])
    np.testing.assert_allclose(corner, [width_px / 2, height_px / 2], rtol=1e-6)


def test_another_episode_takes_the_place_of_the_first(viewer: SceneViewer) -> None:
    viewer.episode.value = "W s: 2 episodes"
    assert len(viewer._frustums) == 6
    assert visible(viewer, "boxes") == {one.number for one in objects(viewer)}
    assert viewer.scene.name == "room_1 + room_2"
    viewer.episode.value = "room_2"
    assert viewer.scene.name == "room_2"
    assert len(viewer._frustums) == 3
    assert viewer.server.scene.get_handle_by_name("/cameras/5") is None


def test_true_boxes_stand_beside_labels_when_asked_for(labels: Path) -> None:
    pytest.importorskip("viser")
    truth = (TrueObject("chair", box_at(1, 1)), TrueObject("table", box_at(2, 1)))
    found = SceneViewer(labels, [replace(read_scenes(labels)[0], truth=truth)], "127.0.0.1", 18080)

    def shown() -> list[bool]:
        return [found.server.scene.get_handle_by_name(f"/truth/{number}").visible for number in (1, 2)]

    assert found.truth.visible
    assert shown() == [False, False]
    found.truth.value = True
    assert shown() == [True, True]
    np.testing.assert_allclose(
        np.unique(found.server.scene.get_handle_by_name("/truth/2").points.reshape(-1, 3), axis=0),
        np.unique((truth[1].box.corners() - found._origin_m).astype(np.float32), axis=0),
    )
    if "table" in found.category.options:
        found.category.value = "table"
        assert shown() == [False, True]
    found.server.stop()


def test_nothing_known_of_the_truth_can_be_shown(viewer: SceneViewer) -> None:
    assert not viewer.truth.visible


class Browser:
    """What a browser does for a film, or does not."""

    def __init__(self, answers: bool = True) -> None:
        self.answers, self.asked, self.files, self.said = answers, [], {}, []

    def get_render(self, height: int, width: int, **how: Any) -> np.ndarray:
        if not self.answers:
            raise TimeoutError
        self.asked.append(how)
        return np.full((height, width, 3), 4 * len(self.asked), np.uint8)

    def send_file_download(self, name: str, content: bytes) -> None:
        self.files[name] = content

    def add_notification(self, title: str, body: str, color: str) -> None:
        self.said.append(f"{title}: {body}")


def test_a_film_circles_what_the_viewer_shows(viewer: SceneViewer, tmp_path: Path) -> None:
    from PIL import Image

    browser = Browser()
    viewer._record(browser)
    places = np.array([one["position"] for one in browser.asked]) + viewer._origin_m
    position, target = opening_view(viewer.scene, browser.asked[0]["fov"])
    np.testing.assert_allclose(places[0], position, atol=1e-6)
    np.testing.assert_allclose(places[:, 2], position[2], atol=1e-6)
    np.testing.assert_allclose(places.mean(axis=0)[:2], target[:2], atol=1e-6)  # all the way round
    (name,) = browser.files
    (tmp_path / name).write_bytes(browser.files[name])
    with Image.open(tmp_path / name) as film:
        assert (name, film.n_frames, film.size) == ("room_1.gif", len(places), (480, 360))


def test_a_browser_that_draws_nothing_is_told_so(viewer: SceneViewer) -> None:
    browser = Browser(answers=False)
    viewer._record(browser)
    assert (browser.files, browser.said) == ({}, ["No film: the browser drew nothing"])


@pytest.mark.slow
def test_films_need_no_browser(labels: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every object that is sure is seen in its colour in most frames, and frames differ."""
    from PIL import Image

    assert main([str(labels), "--film", str(tmp_path / "films")]) == 0
    assert f"2 films: {tmp_path / 'films'}" in capsys.readouterr().out
    for scene in read_scenes(labels):
        with Image.open(tmp_path / "films" / f"{scene.name}.gif") as film:
            frames = []
            for number in range(0, film.n_frames, 6):
                film.seek(number)
                frames.append(np.asarray(film.convert("RGB")))
        assert len(frames) == 6
        assert all(np.mean(np.abs(one.astype(int) - other) > 40) > 0.01 for one, other in itertools.pairwise(frames))
        for one in scene.objects:
            pure = np.rint(255 * np.array([[one.colour]])).astype(np.uint8)
            expected = int(cv2.cvtColor(pure, cv2.COLOR_RGB2HSV)[0, 0, 0])
            counts = []
            for frame in frames:
                hue, saturation, _ = np.moveaxis(cv2.cvtColor(frame, cv2.COLOR_RGB2HSV).astype(int), 2, 0)
                apart = np.abs((hue - expected + 90) % 180 - 90)
                counts.append(((apart <= 10) & (saturation > 80)).sum())
            assert np.median(counts) > 100


def test_nothing_to_show_is_said(labels: Path) -> None:
    pytest.importorskip("viser")
    with pytest.raises(UsageError, match="no episode of this label set was labelled"):
        SceneViewer(labels, [], "127.0.0.1", 18080)


@pytest.mark.nightly
def test_a_file_of_a_scene_shows_its_objects_without_a_server(labels: Path, tmp_path: Path, browser_page) -> None:
    pytest.importorskip("viser")
    assert main([str(labels), "--html", str(tmp_path / "html")]) == 0
    assert sorted(path.name for path in (tmp_path / "html").iterdir()) == [
        "room_1.html",
        "room_1_room_2.html",
        "room_2.html",
    ]
    browser_page.open((tmp_path / "html" / "room_1.html").as_uri(), 900, 700, settle_s=20)
    picture = cv2.imdecode(np.frombuffer(browser_page.picture(), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert (picture < 245).any(axis=2).mean() > 0.05
    hue, saturation, _ = np.moveaxis(cv2.cvtColor(picture, cv2.COLOR_BGR2HSV).astype(int), 2, 0)
    for one in read_scenes(labels)[0].objects:
        pure = np.rint(255 * np.array([[one.colour]])).astype(np.uint8)
        expected = int(cv2.cvtColor(pure, cv2.COLOR_RGB2HSV)[0, 0, 0])
        apart = np.abs((hue - expected + 90) % 180 - 90)  # OpenCV's hues are half degrees
        assert ((apart <= 8) & (saturation > 100)).sum() > 300
