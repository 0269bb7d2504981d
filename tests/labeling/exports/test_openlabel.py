"""OpenLABEL files say what the label set says, in the form of ASAM OpenLABEL 1.0.0."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from msgspec import Meta

from labeling.convert import main
from labeling.core.errors import LabelFormatError
from labeling.core.types import Box3d
from labeling.core.views import Camera
from labeling.exports.openlabel import write_openlabel
from labeling.exports.outlines import outlines
from labeling.io.labelled_views import LabelledView, ViewLabel

# The standard, section 7: which fields there are, which must be there, and what they hold. What it leaves open is
# left out, and so is what labels have no use for (actions, events, relations, tags).
Uid = Annotated[str, Meta(pattern="^(-?[0-9]+|[0-9a-fA-F]{8}(-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12})$")]
FrameNumber = Annotated[str, Meta(pattern="^[0-9]+$")]


class Closed(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    pass


class Interval(Closed):
    frame_start: int
    frame_end: int


class Number(msgspec.Struct):
    val: float
    name: str = ""


class Attributes(Closed):
    num: list[Number] = []
    text: list[dict[str, Any]] = []
    boolean: list[dict[str, Any]] = []
    vec: list[dict[str, Any]] = []


class Bbox(msgspec.Struct):
    name: str
    val: Annotated[list[float], Meta(min_length=4, max_length=4)]
    attributes: Attributes
    coordinate_system: str | None = None


class Poly2d(msgspec.Struct):
    name: str
    val: list[float]
    mode: Literal["MODE_POLY2D_ABSOLUTE"]
    closed: bool
    hierarchy: Annotated[list[int], Meta(min_length=4, max_length=4)]


class Cuboid(msgspec.Struct):
    name: str
    val: Annotated[list[float], Meta(min_length=10, max_length=10)]
    coordinate_system: str


class ObjectData(Closed):
    bbox: list[Bbox] = []
    poly2d: list[Poly2d] = []
    cuboid: list[Cuboid] = []


class ObjectInFrame(Closed):
    object_data: ObjectData


class Pointer(msgspec.Struct):
    frame_intervals: list[Interval]
    type: Literal["bbox", "poly2d", "cuboid"]
    attribute_pointers: dict[str, Literal["num", "text", "boolean", "vec"]] = {}


class Object(Closed):
    name: str
    type: str
    frame_intervals: list[Interval] = []
    object_data: ObjectData | None = None
    object_data_pointers: dict[str, Pointer] = {}


class Pinhole(msgspec.Struct):
    width_px: int
    height_px: int
    camera_matrix: Annotated[list[float], Meta(min_length=12, max_length=12)]


class StreamProperties(msgspec.Struct):
    intrinsics_pinhole: Pinhole


class Stream(Closed):
    type: Literal["camera", "lidar", "radar", "gps_imu", "other"] | None = None
    uri: str | None = None
    description: str | None = None
    stream_properties: StreamProperties | None = None


class Matrix(Closed):
    matrix4x4: Annotated[list[float], Meta(min_length=16, max_length=16)]


class Transform(msgspec.Struct):
    src: str
    dst: str
    transform_src_to_dst: Matrix


class FrameProperties(msgspec.Struct):
    streams: dict[str, Stream]
    transforms: dict[str, Transform]


class Frame(Closed):
    frame_properties: FrameProperties
    objects: dict[Uid, ObjectInFrame]


class CoordinateSystem(msgspec.Struct):
    type: str
    parent: str
    children: list[str] = []


class About(msgspec.Struct):
    schema_version: Literal["1.0.0"]
    name: str | None = None


class Root(Closed):
    metadata: About
    coordinate_systems: dict[str, CoordinateSystem]
    streams: dict[str, Stream]
    frame_intervals: list[Interval]
    frames: dict[FrameNumber, Frame]
    objects: dict[Uid, Object]


class File(Closed):
    openlabel: Root


def read(path: Path) -> Root:
    return msgspec.json.decode(path.read_bytes(), type=File).openlabel


def frames_of(intervals: Sequence[Interval]) -> list[int]:
    return [frame for one in intervals for frame in range(one.frame_start, one.frame_end + 1)]


def turned(quaternion: Sequence[float], points: np.ndarray) -> np.ndarray:
    """Points turned by a unit quaternion (x, y, z, w): p + 2 w (v x p) + 2 v x (v x p)."""
    vector, scalar = np.array(quaternion[:3]), quaternion[3]
    across = np.cross(vector, points)
    return points + 2 * scalar * across + 2 * np.cross(vector, across)


def inside(polygons: Sequence[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """Pixels whose centres, at whole numbers, lie within an odd number of polygons: rays to the right count edges."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    odd = np.zeros(shape, bool)
    for polygon in polygons:
        for (x, y), (to_x, to_y) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            if y != to_y:
                crossing = x + (rows - y) * (to_x - x) / (to_y - y)
                odd ^= ((y > rows) != (to_y > rows)) & (columns < crossing)
    return odd


@pytest.fixture(scope="module")
def written(labels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("openlabel") / "out"
    assert main([str(labels), "--to", "openlabel", "--out", str(out)]) == 0
    return out


def test_a_file_for_each_episode_in_the_form_of_the_standard(written: Path, views: list[LabelledView]) -> None:
    assert sorted(path.name for path in written.iterdir()) == ["images", "room_1.json", "room_2.json"]
    for episode in ("room_1", "room_2"):
        root = read(written / f"{episode}.json")
        assert root.metadata.name == episode
        assert root.coordinate_systems["camera"].parent == "world"
        assert root.coordinate_systems["world"].children == ["camera"]
        there = [view for view in views if view.episode == episode]
        assert sorted(map(int, root.frames)) == frames_of(root.frame_intervals) == [view.index for view in there]
        for uid, found in root.objects.items():
            in_frames = sorted(int(number) for number, frame in root.frames.items() if uid in frame.objects)
            assert in_frames == frames_of(found.frame_intervals)
            assert in_frames == frames_of(found.object_data_pointers["box"].frame_intervals)
        assert {uid for frame in root.frames.values() for uid in frame.objects} == root.objects.keys()


def test_frames_hold_the_labels_and_the_cameras(written: Path, views: list[LabelledView]) -> None:
    for view in views:
        root = read(written / f"{view.episode}.json")
        frame = root.frames[str(view.index)]
        stream = frame.frame_properties.streams["camera"]
        assert stream.uri is not None
        assert stream.stream_properties is not None
        picture = cv2.imread(str(written / stream.uri))
        assert picture is not None
        np.testing.assert_array_equal(picture[..., ::-1], view.rgb)
        pinhole = stream.stream_properties.intrinsics_pinhole
        matrix = np.array(pinhole.camera_matrix).reshape(3, 4)
        assert (pinhole.height_px, pinhole.width_px) == view.rgb.shape[:2]
        (transform,) = frame.frame_properties.transforms.values()
        assert (transform.src, transform.dst) == ("camera", "world")
        pose = np.array(transform.transform_src_to_dst.matrix4x4).reshape(4, 4)
        np.testing.assert_allclose(pose, view.camera.camera_to_world)
        np.testing.assert_allclose(matrix[:, :3], view.camera.intrinsics)
        np.testing.assert_array_equal(matrix[:, 3], 0)
        assert frame.objects.keys() == {str(label.instance_id) for label in view.labels}
        for label in view.labels:
            data = frame.objects[str(label.instance_id)].object_data
            polygons = [np.array(one.val).reshape(-1, 2) for one in data.poly2d]
            np.testing.assert_array_equal(inside(polygons, label.mask.shape), label.mask)
            (box,) = data.bbox
            x, y, width, height = box.val
            rows, columns = np.nonzero(label.mask)
            corners = [x - width / 2, y - height / 2, x + width / 2, y + height / 2]
            assert corners == [columns.min() - 0.5, rows.min() - 0.5, columns.max() + 0.5, rows.max() + 0.5]
            assert [(one.name, one.val) for one in box.attributes.num] == [("confidence", label.confidence)]
            assert root.objects[str(label.instance_id)].type == label.category


def test_cuboids_are_the_boxes_of_the_label_set(written: Path, views: list[LabelledView]) -> None:
    count = 0
    for view in views:
        objects = read(written / f"{view.episode}.json").objects
        for label in view.labels:
            data = objects[str(label.instance_id)].object_data
            assert (data is None) == (label.box_3d is None)
            if data is None or label.box_3d is None:
                continue
            (cuboid,) = data.cuboid
            assert cuboid.coordinate_system == "world"
            signs = np.array([[a, b, c] for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (-0.5, 0.5)])
            corners = turned(cuboid.val[3:7], signs * cuboid.val[7:]) + cuboid.val[:3]
            np.testing.assert_allclose(corners, label.box_3d.corners(), atol=1e-9)
            count += 1
    assert count > 3


@settings(max_examples=60)
@given(hnp.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_outlines_hold_the_pixels_of_any_mask_and_no_others(mask: np.ndarray) -> None:
    found = outlines(mask)
    np.testing.assert_array_equal(inside([one.points_px - 0.5 for one in found], mask.shape), mask)
    for one in found:
        assert len(one.points_px) >= 3
        if one.parent is not None:
            around = found[one.parent]
            assert around.parent is None
            assert (one.points_px.min(axis=0) >= around.points_px.min(axis=0)).all()
            assert (one.points_px.max(axis=0) <= around.points_px.max(axis=0)).all()


def view_of(index: int, *labels: tuple[int, str]) -> LabelledView:
    mask = np.zeros((6, 8), bool)
    mask[1:4, 2:5] = True
    camera = Camera.from_fov(np.eye(4), (6, 8), 1.0)
    box = Box3d(np.zeros(3), np.ones(3), np.eye(3))
    found = tuple(ViewLabel(number, category, 0.5, mask, box) for number, category in labels)
    return LabelledView("room", index, np.zeros((6, 8, 3), np.uint8), camera, found)


@given(st.sets(st.integers(0, 9), min_size=1), st.text(min_size=1).filter(lambda text: text.isprintable()))
@settings(max_examples=10)
def test_intervals_hold_the_views_of_an_object_whatever_it_is_called(
    tmp_path_factory: pytest.TempPathFactory, seen: set[int], category: str
) -> None:
    out = tmp_path_factory.mktemp("out")
    write_openlabel(out, [view_of(index, (3, category)) for index in sorted(seen)])
    found = read(out / "room.json").objects["3"]
    assert found.type == category
    assert frames_of(found.frame_intervals) == sorted(seen)
    after = zip(found.frame_intervals, found.frame_intervals[1:], strict=False)
    assert all(one.frame_end + 1 < other.frame_start for one, other in after)


def test_what_has_two_names_or_stands_twice_in_a_view_is_refused(tmp_path: Path) -> None:
    for number, (views, problem) in enumerate(
        [
            ([view_of(0, (3, "chair")), view_of(1, (3, "table"))], "called 'chair' and, in view 1, 'table'"),
            ([view_of(4, (3, "chair"), (3, "chair"))], "object 3 of episode 'room' stands twice in view 4"),
        ]
    ):
        (tmp_path / str(number)).mkdir()
        with pytest.raises(LabelFormatError, match=problem):
            write_openlabel(tmp_path / str(number), views)
