"""Depth from a camera of its own, which stands beside the colour camera, comes to lie in the colour pictures."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError
from labeling.core.geometry import OPENGL_TO_OPENCV, intrinsics_matrix, invert_rigid
from labeling.io.episodes import read_episode
from labeling.io.recordings.pictures import read_depth, register_depth, reproject_depth

from ...synthetic_room import furnish, make_episode, render
from .recording_writers import intrinsics_record, picture, write_colour, write_depth, written

DEPTH_SIZE = (60, 84)
DEPTH_K = intrinsics_matrix(52.0, 53.0, 41.0, 30.5)
LAYOUTS = ("polycam", "tum", "scannet")


def rigid(angle_rad: float, shift_m: tuple[float, float, float]) -> np.ndarray:
    """Turned about the vertical axis, and moved."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    matrix = np.eye(4)
    matrix[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    matrix[:3, 3] = shift_m
    return matrix


TRANSFORM = rigid(0.02, (0.06, -0.01, 0.005))


@pytest.fixture(scope="module")
def room() -> Episode:
    return make_episode(4, num_views=3, size=(72, 96), num_objects=3)


def depth_files(folder: Path) -> list[Path]:
    return sorted((folder / "depth").iterdir(), key=lambda path: [float(path.stem.rpartition("_")[2])])


def with_depth_camera(tmp_path: Path, layout: str, room: Episode) -> Path:
    """The room in a layout, its depth replaced by that of a camera which stands beside the colour camera."""
    folder = written(tmp_path, layout, room)
    parts, _ = furnish(4, 3)
    for file, pose in zip(depth_files(folder), room.camera_to_world, strict=True):
        _, depth_m, _ = render(parts, pose @ TRANSFORM, DEPTH_K, *DEPTH_SIZE)
        write_depth(file, depth_m, 1 / 5000 if layout == "tum" else 0.001)
    return folder


def tell(folder: Path, layout: str, transform: np.ndarray) -> None:
    """Writes into the recording which camera the depth is of."""
    if layout == "tum":
        np.savetxt(folder / "depth_intrinsics.txt", DEPTH_K)
        np.savetxt(folder / "depth_to_color.txt", transform)
    elif layout == "scannet":
        k = np.eye(4)
        k[:3, :3] = DEPTH_K
        np.savetxt(folder / "intrinsic" / "intrinsic_depth.txt", k)
        # Poses are of a third frame, which either camera has its transform to.
        body = rigid(-0.1, (0.3, 0.2, 0.1))
        np.savetxt(folder / "intrinsic" / "extrinsic_color.txt", body)
        np.savetxt(folder / "intrinsic" / "extrinsic_depth.txt", body @ transform)
        for file in (folder / "pose").iterdir():
            np.savetxt(file, np.loadtxt(file) @ invert_rigid(body))
    else:
        content = json.loads((folder / "transforms.json").read_text())
        shared = {f"depth_{name}": value for name, value in intrinsics_record(DEPTH_K).items()}
        content |= {**shared, "depth_to_color": transform.tolist()}
        (folder / "transforms.json").write_text(json.dumps(content))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_depth_is_as_the_colour_camera_would_have_seen_it(tmp_path, room, layout):
    folder = with_depth_camera(tmp_path, layout, room)
    if layout != "scannet":  # which always tells of a depth camera
        with pytest.raises(EpisodeFormatError, match="a camera of its own"):
            read_episode(folder)
    tell(folder, layout, TRANSFORM)
    episode = read_episode(folder)
    np.testing.assert_allclose(episode.camera_to_world, room.camera_to_world, atol=1e-6)
    assert any("depth of 3 views was brought into their colour pictures" in note for note in episode.notes)
    seen = episode.depth_m > 0
    assert seen.mean() > 0.7
    right = np.abs(episode.depth_m - room.depth_m) < 0.05 * room.depth_m
    assert right[seen].mean() > 0.95


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_transform_that_moves_nothing_is_a_camera_at_the_same_place(tmp_path, room, layout):
    folder = with_depth_camera(tmp_path, layout, room)
    tell(folder, layout, np.eye(4))
    raw = read_depth(depth_files(folder)[0], 1 / 5000 if layout == "tum" else 0.001)
    expected = register_depth(raw, DEPTH_K, room.intrinsics[0], room.size)
    np.testing.assert_array_equal(read_episode(folder).depth_m[0], expected)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_transform_that_is_none_is_refused(tmp_path, room, layout):
    folder = with_depth_camera(tmp_path, layout, room)
    tell(folder, layout, np.diag([2.0, 2, 2, 1]))
    with pytest.raises(EpisodeFormatError, match=r"(extrinsic_depth|depth_to_color).*rigid transform"):
        read_episode(folder)


@pytest.mark.parametrize(
    ("layout", "file"), [("tum", "depth_intrinsics.txt"), ("scannet", "intrinsic/intrinsic_depth.txt")]
)
def test_a_transform_without_its_camera_is_refused(tmp_path, room, layout, file):
    folder = with_depth_camera(tmp_path, layout, room)
    tell(folder, layout, TRANSFORM)
    (folder / file).unlink()
    with pytest.raises(EpisodeFormatError, match=rf"{file}: is missing"):
        read_episode(folder)


def test_a_frames_own_camera_goes_before_that_of_all(tmp_path, room):
    folder = with_depth_camera(tmp_path, "polycam", room)
    tell(folder, "polycam", np.diag([2.0, 2, 2, 1]))
    content = json.loads((folder / "transforms.json").read_text())
    for frame in content["frames"]:
        frame["depth_to_color"] = TRANSFORM.tolist()
    (folder / "transforms.json").write_text(json.dumps(content))
    assert (read_episode(folder).depth_m > 0).mean() > 0.7
    del content["depth_cx"]
    (folder / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(EpisodeFormatError, match="depth_cx: is missing"):
        read_episode(folder)


def test_depth_of_a_camera_of_its_own_is_no_more_distorted_than_that_camera(tmp_path):
    """Lens distortion is that of the colour camera: depth that was brought into its straight picture has none."""
    k = intrinsics_matrix(60.0, 60.0, 39.5, 29.5)
    depth_m = np.full((60, 80), 2.0, np.float32)
    depth_m[:, 40:] = 3.0
    write_colour(tmp_path / "0.png", np.zeros((60, 80, 3), np.uint8))
    write_depth(tmp_path / "0_depth.png", depth_m)
    frame = {"file_path": "0.png", "depth_file_path": "0_depth.png", "transform_matrix": OPENGL_TO_OPENCV.tolist()}
    own = {f"depth_{name}": value for name, value in intrinsics_record(k).items()}
    content = {**intrinsics_record(k), "k1": -0.2, **own, "frames": [frame]}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    assert picture(tmp_path / "0.png").shape == (60, 80, 3)
    np.testing.assert_array_equal(read_episode(tmp_path, undistort=True).depth_m[0], depth_m)


@settings(max_examples=50)
@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(1.0, 4.0), st.integers(1, 3))
def test_a_wall_has_no_gaps_however_large_the_colour_picture(shift_m, angle_rad, distance_m, factor):
    """Every colour pixel whose ray meets the seen part of a wall has the wall's depth."""
    colour_k = intrinsics_matrix(40.0 * factor, 40.0 * factor, 20.0 * factor, 15.0 * factor)
    depth_k = intrinsics_matrix(30.0, 30.0, 40.0, 30.0)
    transform = rigid(angle_rad, (shift_m, 0.0, 0.0))
    # The wall z = distance before the depth camera, and the plane that this is before the colour camera.
    found = reproject_depth(
        np.full((61, 81), distance_m, np.float32), depth_k, transform, colour_k, (31 * factor, 41 * factor)
    )
    normal = transform[:3, :3] @ [0, 0, 1]
    offset_m = distance_m + normal @ transform[:3, 3]
    y, x = np.mgrid[: 31 * factor, : 41 * factor]
    rays = np.stack(
        [(x - 20.0 * factor) / (40 * factor), (y - 15.0 * factor) / (40 * factor), np.ones(x.shape)], axis=-1
    )
    expected = offset_m / (rays @ normal)
    inner = (slice(factor, -factor), slice(factor, -factor))
    np.testing.assert_allclose(found[inner], expected[inner], rtol=0.02)


def test_no_depth_at_all_stays_none():
    k = intrinsics_matrix(30.0, 30.0, 4.0, 3.0)
    assert not reproject_depth(np.zeros((7, 9), np.float32), k, TRANSFORM, k, (14, 18)).any()


@pytest.mark.parametrize("suffix", [".png", ".npy"])
def test_the_highest_number_is_no_return(tmp_path, suffix):
    file = tmp_path / f"depth{suffix}"
    units = np.array([[0, 1000, 65534, 65535]], np.uint16)
    if suffix == ".npy":
        np.save(file, units)
    else:
        write_depth(file, units.astype(float) / 1000)
    np.testing.assert_allclose(read_depth(file, 0.001), [[0, 1, 65.534, 0]], rtol=1e-6)
