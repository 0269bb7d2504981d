"""Up is found from the floor, however the recording's world is turned."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError
from labeling.core.views import RgbdViews
from labeling.generate import main as generate
from labeling.io.episodes import read_episode, write_episode
from labeling.io.recordings.floor import floor_normal
from labeling.io.recordings.recording_config import RecordingConfig

from ...synthetic_room import make_episode


@pytest.fixture(scope="module")
def room() -> Episode:
    return make_episode(3, num_views=6, size=(96, 128), num_objects=5, confident_share=2.0)


@pytest.fixture(scope="module")
def noisy() -> Episode:
    return make_episode(4, num_views=6, size=(96, 128), num_objects=5, depth_noise=0.01, depth_holes=0.2)


def turned(episode: Episode, turn: np.ndarray) -> Episode:
    world = np.eye(4)
    world[:3, :3] = turn
    return replace(episode, camera_to_world=world @ episode.camera_to_world)


def angle_deg(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)))


@pytest.mark.slow
@settings(max_examples=25)
@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_the_floor_is_found_under_any_rotation(room, noisy, quaternion) -> None:
    turn = Rotation.from_quat(quaternion).as_matrix()
    for episode, tolerance in ((room, 0.2), (noisy, 1.0)):
        normal = floor_normal(turned(episode, turn))
        assert normal is not None
        assert np.linalg.norm(normal) == pytest.approx(1)
        assert angle_deg(normal, turn[:, 2]) < tolerance


@settings(max_examples=10)
@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_without_a_floor_in_view_nothing_is_taken_for_it(room, quaternion) -> None:
    turn = Rotation.from_quat(quaternion).as_matrix()
    height = np.zeros(room.depth_m.shape)
    y, x = np.mgrid[0 : room.size[0], 0 : room.size[1]]
    for v, (k, pose) in enumerate(zip(room.intrinsics, room.camera_to_world, strict=True)):
        rays = np.stack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones(x.shape)], -1)
        height[v] = (rays @ pose[2, :3]) * room.depth_m[v] + pose[2, 3]
    walls = replace(room, depth_m=np.where((height > 1.1) & (height < 2.5), room.depth_m, 0).astype(np.float32))
    assert floor_normal(turned(walls, turn)) is None


def test_cameras_that_look_straight_down_from_all_sides_do_not_tell_up_from_down() -> None:
    poses = [np.eye(4) for _ in range(4)]
    for k, pose in enumerate(poses):
        pose[:3, :3] = Rotation.from_euler("z", 90 * k, degrees=True).as_matrix() @ np.diag([1, -1, -1])
    k = np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])
    rgb, depth_m = np.zeros((4, 48, 64, 3), np.uint8), np.full((4, 48, 64), 2.0, np.float32)
    assert floor_normal(RgbdViews(rgb, depth_m, np.stack([k] * 4), np.stack(poses))) is None


def test_a_tilted_recording_is_read_as_if_gravity_had_been_known(room, tmp_path, capsys) -> None:
    turn = Rotation.from_rotvec([0.5, -0.3, 0.9]).as_matrix()
    write_episode(tmp_path / "room", turned(room, turn))
    episode = read_episode(tmp_path / "room", RecordingConfig(up="floor"))
    assert angle_deg(episode.camera_to_world[0, :3, :3] @ room.camera_to_world[0, :3, :3].T[:, 2], np.eye(3)[2]) < 0.2
    (note,) = [note for note in episode.notes if "the floor's normal was taken for up" in note]
    told = np.array([float(value) for value in note.partition("--up=")[2].split(",")])
    assert angle_deg(told, turn[:, 2]) < 0.2
    said = read_episode(tmp_path / "room", RecordingConfig(up=note.partition("--up=")[2]))
    assert np.allclose(said.camera_to_world, episode.camera_to_world, atol=1e-3)

    blind = replace(room, depth_m=np.where(np.arange(128) < 2, room.depth_m, 0).astype(np.float32))
    write_episode(tmp_path / "blind", blind)
    with pytest.raises(EpisodeFormatError, match=r"blind: no plane clearly is its floor .* --up=X,Y,Z"):
        read_episode(tmp_path / "blind", RecordingConfig(up="floor"))
    assert generate([str(tmp_path / "blind"), "--out", str(tmp_path / "labels"), "--up=floor"]) == 2
    assert "no plane clearly is its floor" in capsys.readouterr().err
