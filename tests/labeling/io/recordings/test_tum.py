"""Folders as the TUM RGB-D benchmark has them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError
from labeling.io.episodes import read_episode
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.io.recordings.tum import associate, pose_at

from ...synthetic_room import make_episode, pick
from .recording_writers import assert_same_views, written


@pytest.fixture(scope="module")
def room() -> Episode:
    return make_episode(4, num_views=5, size=(36, 48), num_objects=3)


def test_the_camera_of_a_tum_folder_is_given_or_asked_for(tmp_path, room):
    folder = written(tmp_path, "tum", room)
    (folder / "intrinsics.txt").unlink()
    with pytest.raises(EpisodeFormatError, match=r"--camera FX FY CX CY"):
        read_episode(folder)
    k = room.intrinsics[0]
    given_ = read_episode(folder, RecordingConfig(camera=(k[0, 0], k[1, 1], k[0, 2], k[1, 2])))
    assert_same_views(given_, room)
    np.savetxt(folder / "intrinsics.txt", k)
    np.testing.assert_allclose(read_episode(folder).intrinsics, room.intrinsics)


def test_tum_pictures_without_depth_or_pose_in_time_are_left_out(tmp_path, room):
    folder = written(tmp_path, "tum", room)
    depth = (folder / "depth.txt").read_text().splitlines()
    (folder / "depth.txt").write_text("\n".join(depth[:3] + depth[4:]))
    poses = (folder / "groundtruth.txt").read_text().splitlines()
    (folder / "groundtruth.txt").write_text("\n".join(poses[:-2]))
    episode = read_episode(folder)
    assert_same_views(episode, pick(room, [0, 2, 3]))
    assert ["without depth" in episode.notes[0], "without a pose" in episode.notes[1]] == [True, True]
    with pytest.raises(
        EpisodeFormatError, match=r"none of its 5 pictures .* \(5 without depth within .*, 0 without a pose within"
    ):
        read_episode(folder, RecordingConfig(max_gap_s=0.005))


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("rgb.txt", "rgb/", "../", r"rgb\.txt: line 3: .*leads out"),
        ("rgb.txt", "rgb/", "nowhere/", r"rgb\.txt: line 3: .*does not exist"),
        ("rgb.txt", " rgb/", " a rgb/", r"rgb\.txt: line 3: expected 'timestamp file', not 3 words"),
        ("depth.txt", " depth/", "x depth/", r"depth\.txt: line 3: expected numbers"),
        ("groundtruth.txt", "1305031102", "nan", r"groundtruth\.txt: line 3: "),
        ("groundtruth.txt", " ", " 1 ", r"groundtruth\.txt: line 1?\d: expected 'timestamp tx ty tz"),
        ("intrinsics.txt", " ", " 1 ", r"intrinsics\.txt: expected fx fy cx cy"),
        ("intrinsics.txt", "\n", "\n-", r"intrinsics\.txt: "),
    ],
)
def test_malformed_tum_files_are_named_by_line(tmp_path, room, file, old, new, message):
    folder = written(tmp_path, "tum", room)
    lines = (folder / file).read_text()
    head = "" if file == "intrinsics.txt" else "\n".join(lines.splitlines()[:2]) + "\n"
    (folder / file).write_text(head + lines[len(head) :].replace(old, new))
    with pytest.raises(EpisodeFormatError, match=message):
        read_episode(folder)


@settings(max_examples=60)
@given(
    st.lists(st.floats(0, 2), max_size=7),
    st.lists(st.floats(0, 2), max_size=7),
    st.floats(0.01, 0.5),
)
def test_association_in_time_is_greedy_and_one_to_one(first, second, gap):
    """The same pairs as the plain algorithm: over and over the closest free pair within the gap."""
    free_a, free_b, expected = set(range(len(first))), set(range(len(second))), {}
    while True:
        pairs = sorted((abs(first[i] - second[j]), i, j) for i in free_a for j in free_b)
        if not pairs or pairs[0][0] > gap:
            break
        _, i, j = pairs[0]
        expected[i] = j
        free_a.remove(i)
        free_b.remove(j)
    partner = associate(np.array(first), np.array(second), gap)
    assert {i: int(j) for i, j in enumerate(partner) if j >= 0} == expected


def test_poses_between_samples_are_interpolated():
    from scipy.spatial.transform import Rotation, Slerp

    turns = Rotation.from_euler("xyz", [[0, 0, 0], [3, -2, 4]], degrees=True)
    quaternions = turns.as_quat()
    table = np.concatenate([[[0, 0, 0], [1, 2, 3]], [quaternions[0], -quaternions[1]]], axis=1).astype(float)
    pose = pose_at(0.25, np.array([0.0, 1.0]), table, max_gap_s=1.0)
    assert pose is not None
    np.testing.assert_allclose(pose[:3, 3], [0.25, 0.5, 0.75])
    np.testing.assert_allclose(pose[:3, :3], Slerp([0, 1], turns)(0.25).as_matrix(), atol=1e-4)
    assert pose_at(5.0, np.array([0.0, 1.0]), table, max_gap_s=1.0) is None


@settings(max_examples=30)
@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_quaternions_have_their_real_part_last(q):
    """Against Hamilton's product: a rotated vector is q v q*."""
    x, y, z, w = unit = np.array(q) / np.linalg.norm(q)
    expected = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    pose = pose_at(0.0, np.zeros(1), np.array([[1.0, 2.0, 3.0, *unit]]), 0.1)
    assert pose is not None
    np.testing.assert_allclose(pose[:3, :3], expected, atol=1e-9)
    np.testing.assert_array_equal(pose[:3, 3], [1, 2, 3])
