"""Folders as ScanNet has them."""

import numpy as np
import pytest

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError
from labeling.core.geometry import project
from labeling.io.episodes import read_episode
from labeling.io.recordings.pictures import register_depth

from ...synthetic_room import make_episode, pick
from .recording_writers import assert_same_views, picture, write_colour, written


@pytest.fixture(scope="module")
def room() -> Episode:
    return make_episode(4, num_views=5, size=(36, 48), num_objects=3)


def test_frames_whose_tracking_was_lost_are_left_out(tmp_path, room):
    folder = written(tmp_path, "scannet", room)
    (folder / "pose" / "7.txt").write_text("\n".join(["-inf -inf -inf -inf"] * 4))
    (folder / "pose" / "21.txt").unlink()
    episode = read_episode(folder)
    assert_same_views(episode, pick(room, [0, 2, 4]))
    assert episode.notes == ("left out 2 frames without a pose (tracking lost): color/7.png, color/21.png",)
    for file in (folder / "pose").iterdir():
        file.write_text("\n".join(["-inf -inf -inf -inf"] * 4))
    with pytest.raises(EpisodeFormatError, match="none of the 5 pictures in color/ has both depth and a pose"):
        read_episode(folder)


def test_frames_are_taken_in_the_order_of_their_numbers(tmp_path, room):
    names = read_episode(written(tmp_path, "scannet", room)).file_names
    assert names == ("color/0.png", "color/7.png", "color/14.png", "color/21.png", "color/28.png")


@pytest.mark.parametrize("kinds", [("", "", ""), (".color", ".depth", ".pose")])
def test_names_may_be_times(tmp_path, room, kinds):
    folder = written(tmp_path, "scannet", room)
    for name, kind in zip(("color", "depth", "pose"), kinds, strict=True):
        files = sorted((folder / name).iterdir(), key=lambda file: int(file.stem))
        for number, file in enumerate(files):
            file.rename(file.with_name(f"1305031102.{100 + 33 * number}{kind}{file.suffix}"))
    assert_same_views(read_episode(folder), room)
    (folder / "pose" / f"1305031102.133{kinds[2]}.txt").unlink()
    assert_same_views(read_episode(folder), pick(room, [0, 2, 3, 4]))


def test_numbers_may_be_padded_in_one_folder_and_not_in_another(tmp_path, room):
    folder = written(tmp_path, "scannet", room)
    for name, width in (("color", 6), ("pose", 4)):
        for file in list((folder / name).iterdir()):
            file.rename(file.with_stem(f"{int(file.stem):0{width}d}"))
    episode = read_episode(folder)
    assert_same_views(episode, room)
    assert episode.file_names[:2] == ("color/000000.png", "color/000007.png")


def test_two_files_of_one_name_are_refused(tmp_path, room):
    folder = written(tmp_path, "scannet", room)
    (folder / "color" / "7.rgb.png").write_bytes((folder / "color" / "7.png").read_bytes())
    with pytest.raises(EpisodeFormatError, match="are both '7'; one view has one file here"):
        read_episode(folder)


def test_depth_of_a_camera_of_its_own_is_brought_into_the_colour_picture(tmp_path):
    """Seen by a wider camera of a third of the resolution from the same place, each point keeps its depth."""
    colour_k = np.array([[60.0, 0, 47.5], [0, 62.0, 35.0], [0, 0, 1]])
    depth_k = np.array([[18.0, 0, 17.0], [0, 17.5, 13.0], [0, 0, 1]])
    y, x = np.mgrid[0:28, 0:36]
    depth_m = (1 + 0.01 * x + 0.02 * y).astype(np.float32)
    aligned = register_depth(depth_m, depth_k, colour_k, (72, 96))
    for v, u in [(0, 0), (35, 47), (71, 95), (10, 80)]:
        ray = np.array([(u - colour_k[0, 2]) / colour_k[0, 0], (v - colour_k[1, 2]) / colour_k[1, 1], 1.0])
        pixel, _ = project(ray[None], depth_k, np.eye(4))
        near = np.rint(pixel[0]).astype(int)
        assert aligned[v, u] == depth_m[near[1], near[0]]
    narrow = register_depth(depth_m, depth_k * np.array([[4], [4], [1]]), colour_k, (72, 96))
    assert (narrow == 0).any()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / "pose" / "0.txt").write_text("1 2 3"), r"0\.txt: a pose is 4x4 numbers, not \(1, 3\)"),
        (lambda f: (f / "pose" / "0.txt").write_text("1 2\n3"), r"0\.txt: expected a matrix"),
        (lambda f: np.savetxt(f / "pose" / "0.txt", 2 * np.eye(4)), r"0\.txt: is not a rigid transform"),
        (lambda f: np.savetxt(f / "intrinsic" / "intrinsic_color.txt", -np.eye(4)), "expected a camera matrix"),
        (lambda f: (f / "intrinsic" / "intrinsic_color.txt").unlink(), r"intrinsic_color\.txt: file is missing"),
        (lambda f: np.savetxt(f / "intrinsic" / "extrinsic_depth.txt", np.ones((4, 4))), "not a 4x4 rigid transform"),
        (lambda f: [p.unlink() for p in (f / "color").iterdir()], "color: holds no PNG or JPEG"),
        (lambda f: [p.unlink() for p in (f / "depth").iterdir()], "5 without depth"),
    ],
)
def test_malformed_scannet_files_are_named(tmp_path, room, spoil, message):
    folder = written(tmp_path, "scannet", room)
    spoil(folder)
    with pytest.raises(EpisodeFormatError, match=message):
        read_episode(folder)


def test_pictures_resized_after_calibration_are_refused(tmp_path, room):
    folder = written(tmp_path, "scannet", room)
    for file in (folder / "color").iterdir():
        write_colour(file, picture(file)[::2, ::2])
    with pytest.raises(EpisodeFormatError, match=r"intrinsic_color\.txt: its principal point .* they were resized"):
        read_episode(folder)
