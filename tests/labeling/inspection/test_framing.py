"""What the viewer of label sets looks at: from where, in which colours, and under which names."""

import inspect
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.geometry import intrinsics_from_fov, look_at, project
from labeling.core.types import Box3d
from labeling.core.views import Camera
from labeling.formats.ply import hues, read_ply, write_ply
from labeling.inspection.colouring import COLOURINGS, TINT, object_colours, point_colours, true_colours
from labeling.inspection.framing import SURE, below, cut_height_m, opening_view
from labeling.inspection.object_table import object_table
from labeling.inspection.scene import LabelledScene, SceneObject, together
from labeling.inspection.short_names import short_name
from labeling.inspection.viewer import SceneViewer, choices

ROOM_M, CEILING_M, EYE_M = 5.0, 2.6, 1.5


def box_at(x: float, y: float, height_m: float = 1.0) -> Box3d:
    return Box3d(np.array([x, y, height_m / 2]), np.array([0.6, 0.8, height_m]), np.eye(3))


def thing(number: int, category: str, confidence: float, box: Box3d) -> SceneObject:
    red, green, blue = hues(np.array([number]))[0].tolist()
    title = f"{number} {category} {confidence:.2f}"
    return SceneObject(number, title, box, (red, green, blue), category, confidence, number, (0, 2), "view 2 (0.97)")


def room(name: str = "room", place: tuple[str, str] | None = None) -> LabelledScene:
    """Floor and ceiling of a room with three boxes, whose points are labelled, and two cameras."""
    rng = np.random.default_rng(7)
    objects = (
        thing(1, "chair", 0.9, box_at(1, 1)),
        thing(2, "table", 0.5, box_at(-1, 0.5, 0.7)),
        thing(3, "chair", 0.1, box_at(0, -1.5)),
    )
    flat = np.c_[rng.uniform(-ROOM_M / 2, ROOM_M / 2, (400, 2)), np.zeros(400)]
    on_objects = [one.box.corners() for one in objects]
    points = np.concatenate([flat, flat + np.array([0, 0, CEILING_M]), *on_objects])
    labels = np.concatenate([np.zeros(800, np.int32), *(np.full(8, one.number, np.int32) for one in objects)])
    true = rng.uniform(0, 1, (len(points), 3))
    seen = np.where((labels > 0)[:, None], (1 - TINT) * true + TINT * hues(labels), true)
    colours = np.rint(255 * seen).astype(np.uint8)
    poses = [look_at(np.array([x, -2.0, EYE_M]), np.array([0.0, 0.0, 0.8])) for x in (-0.5, 0.5)]
    cameras = tuple(Camera.from_fov(pose, (48, 64), 1.0) for pose in poses)
    return LabelledScene(name, points, colours, labels, objects, cameras, place)


# Where it looks from --------------------------------------------------------------------------------------------------


def test_the_ceiling_is_left_out_and_all_else_is_shown() -> None:
    scene = room()
    in_the_ceiling = thing(4, "fridge", 0.05, replace(box_at(1, 1), centre_m=np.array([1.0, 1.0, CEILING_M])))
    scene = replace(scene, objects=(*scene.objects, in_the_ceiling))  # hardly believed, so that it has no say
    assert EYE_M <= cut_height_m(scene) < CEILING_M
    kept = below(scene, cut_height_m(scene))
    np.testing.assert_array_equal(kept, scene.points[:, 2] < CEILING_M)


def test_objects_are_shown_whole_whatever_is_cut_off() -> None:
    scene = room()
    assert below(scene, -1.0)[scene.labels > 0].all()
    assert not below(scene, -1.0)[scene.labels == 0].any()


@settings(max_examples=30)
@given(st.floats(-200, 200), st.floats(-200, 200), st.floats(0, 6.28), st.floats(0.4, 1.4))
def test_the_opening_view_shows_every_sure_box_from_the_side_of_the_cameras(x, y, yaw, fov_rad) -> None:
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    shift = np.array([x, y, 0.0])
    scene = room()
    poses = [np.eye(4), np.eye(4)]
    for pose, camera in zip(poses, scene.cameras, strict=True):
        pose[:3, :3], pose[:3, 3] = turn @ camera.camera_to_world[:3, :3], turn @ camera.camera_to_world[:3, 3] + shift
    moved = replace(
        scene,
        objects=tuple(
            replace(one, box=Box3d(turn @ one.box.centre_m + shift, one.box.extent_m, turn)) for one in scene.objects
        ),
        cameras=tuple(replace(camera, camera_to_world=pose) for camera, pose in zip(scene.cameras, poses, strict=True)),
    )
    position, target = opening_view(moved, fov_rad)
    corners = np.concatenate([one.box.corners() for one in moved.objects if one.confidence >= SURE])
    pixels, depth_m = project(corners, intrinsics_from_fov(1000, 1000, fov_rad), look_at(position, target))
    assert (depth_m > 0).all()
    assert pixels.min() >= -0.5
    assert pixels.max() <= 999.5
    assert position[2] > cut_height_m(moved)
    towards = np.mean([pose[:2, 3] for pose in poses], axis=0) - target[:2]
    assert (position[:2] - target[:2]) @ towards > 0


def test_a_scene_without_objects_points_or_cameras_has_a_view() -> None:
    empty = LabelledScene("e", np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0, np.int32), (), ())
    position, target = opening_view(empty, 0.8)
    assert np.isfinite([*position, *target]).all()
    assert np.isfinite(cut_height_m(empty))


# Colours --------------------------------------------------------------------------------------------------------------


def test_true_colours_are_those_before_the_cloud_was_tinted(tmp_path: Path) -> None:
    assert inspect.signature(write_ply).parameters["tint"].default == TINT
    rng = np.random.default_rng(3)
    true, labels = rng.uniform(0, 1, (200, 3)), rng.integers(0, 6, 200)
    write_ply(tmp_path / "cloud.ply", np.zeros((200, 3)), true, labels, np.ones(200))
    cloud = read_ply(tmp_path / "cloud.ply")
    colours = np.stack([cloud[name] for name in ("red", "green", "blue")], axis=1)
    scene = replace(room(), points=np.zeros((200, 3)), colours=colours, labels=labels.astype(np.int32))
    np.testing.assert_allclose(true_colours(scene), true, atol=0.5 / 255 / (1 - TINT) + 1e-9)


@pytest.mark.parametrize("by", COLOURINGS)
def test_only_objects_that_are_shown_are_tinted(by: str) -> None:
    scene = room()
    true = np.rint(255 * true_colours(scene)).astype(np.uint8)
    found = point_colours(scene, by, [2], object_colours(scene, by))
    tinted = np.any(found != true, axis=1)
    assert not tinted[scene.labels != 2].any()
    assert tinted[scene.labels == 2].all() == (by != "true colour")
    if by == "object":
        np.testing.assert_allclose(found[scene.labels == 2], scene.colours[scene.labels == 2], atol=2)


def test_classes_share_a_colour_and_confidence_goes_from_red_to_green() -> None:
    scene = room()
    classes, sure = object_colours(scene, "class"), object_colours(scene, "confidence")
    assert classes[1] == classes[3] != classes[2]
    redness = [sure[one.number][0] - sure[one.number][1] for one in sorted(scene.objects, key=lambda o: o.confidence)]
    assert redness == sorted(redness, reverse=True)
    for value, expected in ((0.0, (1, 0, 0)), (0.5, (1, 1, 0)), (1.0, (0, 1, 0))):
        one = replace(scene.objects[0], confidence=value, consistency=1 - value)
        assert object_colours(replace(scene, objects=(one,)), "confidence")[1] == expected
        one = replace(scene.objects[0], confidence=1 - value, consistency=value)
        assert object_colours(replace(scene, objects=(one,)), "consistency")[1] == expected
    assert object_colours(scene, "consistency")[1] == (0.5, 0.5, 0.5)  # nothing known


# What there is to choose ----------------------------------------------------------------------------------------------


def test_episodes_of_a_scene_can_be_seen_together() -> None:
    scenes = [room("a", ("Indoor", "flat")), room("b"), room("c", ("Indoor", "flat")), room("d", ("Indoor", "attic"))]
    found = choices(scenes)
    assert {name: [scene.name for scene in parts] for name, parts in found.items()} == {
        "a": ["a"],
        "b": ["b"],
        "c": ["c"],
        "d": ["d"],
        "Indoor flat: 2 episodes": ["a", "c"],
    }
    both = together(found["Indoor flat: 2 episodes"])
    assert [one.number for one in both.objects] == [1, 2, 3, 4, 5, 6]
    assert len(both.cameras) == 4
    for one in both.objects:
        np.testing.assert_array_equal(both.points[both.labels == one.number], one.box.corners())
    assert [one.source for one in both.objects][::3] == ["a: view 2 (0.97)", "c: view 2 (0.97)"]


@pytest.mark.slow
def test_many_episodes_of_a_scene_have_a_file_name_of_bounded_length(tmp_path: Path) -> None:
    parts = [
        room("flat_of_my_aunt_in_the_north_of_the_town_visit_" + str(number), ("homes", "flat")) for number in range(12)
    ]
    viewer = SceneViewer(tmp_path, parts, "127.0.0.1", 8080)
    files = viewer.write_html(tmp_path / "html")
    viewer.server.stop()
    assert len(set(files)) == 13
    assert all(file.is_file() for file in files)
    assert files[0].name == f"{parts[0].name}.html"


@given(st.text(max_size=300), st.text(max_size=300))
def test_short_names_are_short_and_differ_as_names_do(one: str, other: str) -> None:
    assert len(short_name(one).encode()) <= 150
    assert (short_name(one) == short_name(other)) == (one == other)
    assert short_name(one) == one or len(one.encode()) > 150


def cells_of(objects: tuple[SceneObject, ...]) -> list[list[str]]:
    """What the rows of their table say, without the row of headings."""
    rows = re.findall(r"<tr>(.*?)</tr>", object_table(objects))[1:]
    return [[unescape(cell) for cell in re.findall(r"<td[^>]*>(.*?)</td>", row)] for row in rows]


def test_the_table_says_class_confidence_views_consistency_and_source() -> None:
    one, two, _ = room().objects
    two = replace(two, views=(4,), source="", consistency=2 / 3)
    assert cells_of((one, two)) == [
        ["1", "chair", "0.90", "2", "", "view 2 (0.97)"],
        ["2", "table", "0.50", "1", "67%", ""],
    ]


def test_names_from_files_become_no_markup() -> None:
    evil = "<img src=x onerror=alert(1)>"
    objects = (replace(room().objects[0], category=evil, source=evil),)
    assert "<img" not in object_table(objects)
    assert cells_of(objects)[0][1::4] == [evil, evil]


# On a label set -------------------------------------------------------------------------------------------------------
