"""Recordings of every layout hold the same episode; malformed ones get one clear error."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError, SbmError, UsageError
from labeling.core.geometry import OPENGL_TO_OPENCV, intrinsics_from_fov, is_rigid, look_at
from labeling.io.episodes import find_episodes, read_episode
from labeling.io.recordings.pictures import enlarge_depth, same_view
from labeling.io.recordings.recording_config import RecordingConfig

from ...synthetic_room import make_episode, pick
from .recording_writers import WRITERS, assert_same_views, picture, write_polycam, write_scannet, write_tum, written

UP = {"record3d": RecordingConfig(up="y")}


@pytest.fixture(scope="module")
def room() -> Episode:
    return make_episode(4, num_views=5, size=(36, 48), num_objects=3)


def config_of(layout: str, **changes: Any) -> RecordingConfig:
    return replace(UP.get(layout, RecordingConfig()), **changes)


# All layouts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", WRITERS)
def test_every_layout_holds_the_same_episode(tmp_path, room, layout):
    folder = written(tmp_path, layout, room)
    assert find_episodes(folder) == [folder]
    episode = read_episode(folder, config_of(layout))
    assert_same_views(episode, room)
    assert episode.notes == ()
    assert all((folder / name).is_file() for name in episode.file_names)


@pytest.mark.parametrize("layout", WRITERS)
def test_every_nth_frame_and_at_most_so_many(tmp_path, room, layout):
    folder = written(tmp_path, layout, room)
    assert_same_views(read_episode(folder, config_of(layout, every=2)), pick(room, [0, 2, 4]))
    few = read_episode(folder, config_of(layout, max_views=3))
    assert_same_views(few, pick(room, [0, 2, 4]))
    assert any("3 of 5 frames" in note for note in few.notes)
    assert len(few.frame_names) == 5


def test_a_dataset_may_mix_layouts(tmp_path, room):
    folders = sorted(written(tmp_path, layout, room) for layout in WRITERS)
    assert find_episodes(tmp_path) == folders
    assert find_episodes(tmp_path, RecordingConfig(layout="tum")) == [tmp_path / "tum"]


def test_what_was_looked_for_and_what_lacks_is_told(tmp_path, room):
    folder = written(tmp_path, "tum", room)
    (folder / "groundtruth.txt").unlink()
    with pytest.raises(EpisodeFormatError) as caught:
        read_episode(folder)
    for mark in ("transforms.json", "(missing: groundtruth.txt)", "color depth pose intrinsic"):
        assert mark in str(caught.value)
    with pytest.raises(EpisodeFormatError, match=r"looked for transforms\.json"):
        read_episode(folder, RecordingConfig(layout="nerfstudio"))
    with pytest.raises(EpisodeFormatError, match="looked, in it and in the 2 folders directly below it"):
        find_episodes(folder)


@pytest.mark.parametrize("layout", ["polycam", "scannet"])
def test_a_camera_is_only_taken_where_the_layout_tells_none(tmp_path, room, layout):
    with pytest.raises(UsageError, match="--camera"):
        read_episode(written(tmp_path, layout, room), RecordingConfig(camera=(1.0, 1.0, 1.0, 1.0)))


@pytest.mark.parametrize(
    "settings_",
    [
        {"every": 0},
        {"max_views": 0},
        {"depth_unit_m": 0.0},
        {"max_gap_s": -1.0},
        {"max_gap_s": float("nan")},
        {"camera": (0.0, 1.0, 1.0, 1.0)},
        {"camera": (1.0, 1.0, float("inf"), 1.0)},
    ],
)
def test_settings_that_make_no_sense_are_refused(settings_):
    with pytest.raises(UsageError, match="--" + next(iter(settings_)).replace("_", "-")):
        RecordingConfig(**settings_).check()


@pytest.mark.parametrize("up", ["z", "y", "x", "-z", "-y", "-x"])
def test_the_up_axis_becomes_z(tmp_path, room, up):
    """The world is turned rigidly, and the axis that is named ends up along +Z."""
    folder = written(tmp_path, "polycam", room)
    turned = read_episode(folder, RecordingConfig(up=up)).camera_to_world
    turn = turned[0] @ np.linalg.inv(room.camera_to_world[0])
    assert is_rigid(turn)
    np.testing.assert_allclose(turned, turn @ room.camera_to_world, atol=1e-9)
    axis = np.eye(3)["xyz".index(up[-1])] * (-1 if up[0] == "-" else 1)
    np.testing.assert_allclose(turn[:3, :3] @ axis, [0, 0, 1], atol=1e-12)


@pytest.mark.slow
@settings(max_examples=30)
@given(
    st.tuples(*[st.floats(-2, 2).map(lambda value: round(value, 3))] * 3).filter(lambda up: np.linalg.norm(up) > 0.1)
)
def test_any_direction_becomes_z_by_the_shortest_way(sound, up):
    straight = read_episode(sound["tum"]).camera_to_world
    turned = read_episode(sound["tum"], RecordingConfig(up=",".join(map(str, up)))).camera_to_world
    turn = turned[0] @ np.linalg.inv(straight[0])
    assert is_rigid(turn, 1e-6)
    np.testing.assert_allclose(turned, turn @ straight, atol=1e-6)
    direction = np.array(up) / np.linalg.norm(up)
    np.testing.assert_allclose(turn[:3, :3] @ direction, [0, 0, 1], atol=1e-6)
    # The angle of the rotation is that between the direction and +Z.
    assert (np.trace(turn[:3, :3]) - 1) / 2 == pytest.approx(direction[2], abs=1e-6)


@pytest.mark.parametrize("up", ["up", "w", "1,2", "0,0,0", "1,2,nan", "1,2,inf", "1,2,3,4", ""])
def test_what_is_no_direction_is_refused(up):
    with pytest.raises(UsageError, match=r"--up must be an axis \(z, y, x, -z, -y, -x\), a direction X,Y,Z or floor"):
        RecordingConfig(up=up).check()


def test_a_world_that_lies_on_its_side_is_noted(tmp_path, room):
    notes = read_episode(written(tmp_path, "record3d", room)).notes
    assert any("--up=y" in note for note in notes)


def test_views_that_stand_nowhere_near_the_others_are_noted(tmp_path, room):
    folder = written(tmp_path, "nerfstudio", room)
    assert read_episode(folder).notes == ()

    def send_away(content):
        content["frames"][2]["transform_matrix"][0][3] += 1e6

    edit(folder, send_away)
    (note,) = read_episode(folder).notes
    assert re.fullmatch(r"1 of 5 views stand up to [\d,]{9} m from the others: .*", note)
    assert note.endswith("002.png")


# nerfstudio, Record3D, Polycam ---------------------------------------------------------------------------------------


def edit(folder: Path, change) -> None:
    content = json.loads((folder / "transforms.json").read_text())
    change(content)
    (folder / "transforms.json").write_text(json.dumps(content))


def test_jpeg_colour_is_read(tmp_path, room):
    folder = written(tmp_path, "polycam", room)
    for file in (folder / "images").iterdir():
        cv2.imwrite(str(file.with_suffix(".jpg")), picture(file), [cv2.IMWRITE_JPEG_QUALITY, 100])
        file.unlink()

    def rename(content):
        for frame in content["frames"]:
            frame["file_path"] = frame["file_path"].replace(".png", ".jpg")

    edit(folder, rename)
    episode = read_episode(folder)
    assert np.abs(episode.rgb.astype(int) - room.rgb).mean() < 3
    whole = (folder / "images" / "frame_00002.jpg").read_bytes()
    (folder / "images" / "frame_00002.jpg").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(EpisodeFormatError, match=r"frame_00002\.jpg: the JPEG is truncated"):
        read_episode(folder)


def test_small_depth_is_enlarged_by_the_nearest_pixel(tmp_path, room):
    folder = written(tmp_path, "polycam", room)
    for view, file in enumerate(sorted((folder / "depth").iterdir())):
        cv2.imwrite(str(file), np.rint(room.depth_m[view, 1::3, 1::3] * 1000).astype(np.uint16))
    episode = read_episode(folder)
    np.testing.assert_allclose(
        episode.depth_m, np.repeat(np.repeat(room.depth_m[:, 1::3, 1::3], 3, axis=1), 3, axis=2), atol=1e-6
    )
    assert any("depth of 5 views" in note for note in episode.notes)


def test_depth_of_another_shape_is_refused(tmp_path, room):
    folder = written(tmp_path, "polycam", room)
    cv2.imwrite(str(folder / "depth" / "frame_00003.png"), np.ones((30, 48), np.uint16))
    with pytest.raises(EpisodeFormatError, match=r"frame_00003\.png: depth is 48x30 .* align depth to colour"):
        read_episode(folder)


def test_frames_without_depth_are_left_out_or_if_all_lack_it_refused(tmp_path, room):
    folder = written(tmp_path, "polycam", room)
    edit(folder, lambda content: content["frames"][1].pop("depth_file_path"))
    episode = read_episode(folder)
    assert_same_views(episode, pick(room, [0, 2, 3, 4]))
    assert episode.notes == ("left out 1 frame without depth_file_path: images/frame_00002.png",)
    edit(folder, lambda content: [frame.pop("depth_file_path", None) for frame in content["frames"]])
    with pytest.raises(EpisodeFormatError, match=r"frames\[0\]\.depth_file_path: is missing, as in every frame"):
        read_episode(folder)


def test_annotations_find_their_view_though_frames_were_left_out(tmp_path, room):
    folder = written(tmp_path, "polycam", room)
    mask = np.zeros(room.size, bool)
    mask[3:9, 4:12] = True
    from labeling.core.rle import encode_mask

    results = [
        {"image_id": frame, "category_id": 7, "score": 0.5, "segmentation": encode_mask(mask)} for frame in range(5)
    ]
    (folder / "detections.json").write_text(json.dumps(results))
    found = read_episode(folder, RecordingConfig(every=2)).detections
    assert found is not None
    assert [one.view_index for one in found] == [0, 1, 2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"k1": 0.1}, "lens distortion .*labeling.convert FOLDER --undistort"),
        ({"p2": -0.001}, "lens distortion"),
        ({"k4": 0.1}, "k4: fisheye"),
        ({"camera_model": "OPENCV_FISHEYE"}, "camera_model: 'OPENCV_FISHEYE' is not supported"),
        ({"applied_scale": 0}, "applied_scale: must be above 0"),
        ({"applied_transform": [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0]]}, "applied_transform: is more than a rot"),
        ({"applied_transform": [[1]]}, "applied_transform: must have shape"),
    ],
)
def test_what_a_transforms_file_cannot_be_used_with_is_told(tmp_path, room, change, message):
    folder = written(tmp_path, "record3d", room)
    edit(folder, lambda content: content.update(change))
    with pytest.raises(EpisodeFormatError, match=message):
        read_episode(folder)


def test_the_field_of_view_of_blender_files_is_a_focal_length(tmp_path, room):
    folder = written(tmp_path, "polycam", room)

    def as_blender(content):
        content["camera_angle_x"] = np.deg2rad(80)
        for frame in content["frames"]:
            for name in ("fl_x", "fl_y", "cx", "cy"):
                del frame[name]

    edit(folder, as_blender)
    np.testing.assert_allclose(read_episode(folder).intrinsics, room.intrinsics, atol=1e-9)


def distorted_point(point, k, distortion):
    """OpenCV's documented lens model, by hand: normalised coordinates -> distorted pixel."""
    k1, k2, p1, p2, k3 = distortion
    x, y = point
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.array([k[0, 0] * xd + k[0, 2], k[1, 1] * yd + k[1, 2]])


def test_undistorted_pictures_and_masks_are_where_a_pinhole_sees_them(tmp_path):
    size, distortion = (120, 160), (-0.25, 0.05, 0.002, -0.003, 0.01)
    k = intrinsics_from_fov(size[1], size[0], 1.2)
    straight = np.array([[20.0, 30.0], [80.0, 60.0], [140.0, 95.0], [30.0, 100.0]])
    rgb, depth = np.zeros((*size, 3), np.uint8), np.full(size, 2.0, np.float32)
    mask = np.zeros(size, bool)
    for number, pixel in enumerate(straight):
        u, v = np.rint(distorted_point((pixel - k[:2, 2]) / np.diag(k)[:2], k, distortion)).astype(int)
        rgb[v - 1 : v + 2, u - 1 : u + 2] = 255
        depth[v - 1 : v + 2, u - 1 : u + 2] = 3.0 + number
        mask[v - 1 : v + 2, u - 1 : u + 2] = True
    pose = look_at(np.zeros(3), np.array([1.0, 0, 0]))
    flat = Episode(rgb[None], depth[None], k[None], pose[None], "e", ("images/frame_00001.png",))
    write_polycam(tmp_path, flat)
    edit(
        tmp_path,
        lambda content: content["frames"][0].update(dict(zip(("k1", "k2", "p1", "p2", "k3"), distortion, strict=True))),
    )
    from labeling.core.rle import encode_mask

    (tmp_path / "detections.json").write_text(
        json.dumps([{"image_id": 0, "category_id": 1, "score": 0.9, "segmentation": encode_mask(mask)}])
    )
    episode = read_episode(tmp_path, undistort=True)
    assert episode.detections is not None
    for number, (x, y) in enumerate(straight.astype(int)):
        assert episode.rgb[0, y, x].min() > 100
        assert episode.depth_m[0, y, x] == 3.0 + number
        assert episode.detections[0].mask[y, x]
    assert any("lens distortion was removed from 1 views" in note for note in episode.notes)


# Depth at another size -----------------------------------------------------------------------------------------------


@settings(max_examples=100)
@given(st.integers(2, 200), st.integers(2, 200), st.floats(0.1, 8))
def test_rounded_copies_of_a_size_are_the_same_view(height, width, factor):
    small = (max(1, int(height * factor + 0.5)), max(1, int(width * factor + 0.5)))
    if min(small) > 1:
        assert same_view(small, (height, width))


@pytest.mark.parametrize(
    ("depth", "colour"),
    [((480, 640), (968, 1296)), ((4, 7), (5, 7)), ((240, 240), (480, 640)), ((640, 480), (480, 640))],
)
def test_other_fields_of_view_are_not(depth, colour):
    assert not same_view(depth, colour)


def test_enlarging_by_whole_factors_repeats_pixels():
    depth = np.arange(12, dtype=np.float32).reshape(3, 4)
    np.testing.assert_array_equal(enlarge_depth(depth, (6, 12)), np.repeat(np.repeat(depth, 2, 0), 3, 1))
    np.testing.assert_array_equal(enlarge_depth(depth, (3, 4)), depth)


@pytest.mark.parametrize("content", ["objects", "text", "3d", "archive", "no size", "huge"])
def test_arrays_that_are_no_depth_are_refused(tmp_path, room, content):
    folder = written(tmp_path, "nerfstudio", room)
    file = folder / "depths" / "001.npy"
    if content == "objects":
        np.save(file, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    elif content == "text":
        file.write_text("hello")
    elif content == "3d":
        np.save(file, np.ones((36, 48, 3)))
    elif content == "archive":
        with file.open("wb") as opened:
            np.savez(opened, depth=np.ones((36, 48)))
    else:
        shape = b"(True, 4)" if content == "no size" else b"(999999, 999999)"
        header = (b"{'descr': '<f4', 'fortran_order': False, 'shape': " + shape + b", }").ljust(117) + b"\n"
        file.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(16))
    with pytest.raises(EpisodeFormatError, match=r"001\.npy: "):
        read_episode(folder)


# Corruptions ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sound(tmp_path_factory, room) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("sound")
    return {layout: written(root, layout, room) for layout in ("tum", "scannet")}


@pytest.mark.slow
@settings(max_examples=200)
@given(data=st.data())
def test_whatever_the_text_files_hold_only_our_errors_come_out(sound, data):
    folder = sound[data.draw(st.sampled_from(sorted(sound)))]
    files = sorted(path for path in folder.rglob("*.txt"))
    file = data.draw(st.sampled_from(files))
    whole = file.read_bytes()
    spoiled = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(spoiled)))
        end = min(len(spoiled), start + data.draw(st.integers(0, 12)))
        spoiled[start:end] = data.draw(
            st.sampled_from(
                [b"", b"-inf", b"nan", b"1e309", b"\n", b" 7 ", b"#", b"\xff", b"0", b"-", b"../x", b"\x00"]
            )
        )
    file.write_bytes(bytes(spoiled))
    episode, problem = None, f"{folder}"
    try:
        episode = read_episode(folder)
    except SbmError as error:
        problem = str(error)
    finally:
        file.write_bytes(whole)
    assert "\n" not in problem
    assert str(folder) in problem
    if episode is not None:
        assert np.isfinite(episode.camera_to_world).all()
        assert np.isfinite(episode.intrinsics).all()


def test_writers_of_these_tests_follow_the_conventions(tmp_path, room):
    """The files themselves, not only the round trip: OpenGL axes, TUM's order of numbers, ScanNet's matrices."""
    for layout, writer in (("polycam", write_polycam), ("tum", write_tum), ("scannet", write_scannet)):
        (tmp_path / layout).mkdir()
        writer(tmp_path / layout, room)
    frame = json.loads((tmp_path / "polycam" / "transforms.json").read_text())["frames"][0]
    np.testing.assert_allclose(np.array(frame["transform_matrix"]) @ OPENGL_TO_OPENCV, room.camera_to_world[0])
    numbers = [float(word) for word in (tmp_path / "tum" / "groundtruth.txt").read_text().splitlines()[2].split()]
    np.testing.assert_allclose(numbers[1:4], room.camera_to_world[0, :3, 3])
    np.testing.assert_allclose(np.loadtxt(tmp_path / "scannet" / "pose" / "0.txt"), room.camera_to_world[0], atol=1e-9)
