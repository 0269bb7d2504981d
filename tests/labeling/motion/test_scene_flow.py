"""Scene flow and motion.json: laws, and files that are refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.core.geometry import project
from labeling.core.types import GroundTruth, ObjectMotion
from labeling.io.episodes import read_episode, write_episode
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.motion.scene_flow import scene_flow

SIZE = (24, 32)


def posed(rng, far_m=0.5):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = (
        Rotation.from_rotvec(rng.normal(size=3)).as_matrix(),
        rng.uniform(-far_m, far_m, 3),
    )
    return pose


def motion_of(episode: Episode) -> tuple[ObjectMotion, ...]:
    assert episode.motion is not None
    return episode.motion


def truth_of(episode: Episode) -> tuple[GroundTruth, ...]:
    assert episode.ground_truth is not None
    return episode.ground_truth


def episode_of(seed) -> Episode:
    """Three views of flat things; object 4 moves as it likes, object 9 does not."""
    rng = np.random.default_rng(seed)
    masks = np.zeros((2, *SIZE), bool)
    masks[0, 5:15, 4:14], masks[1, 5:15, 18:28] = True, True
    poses = np.stack([posed(rng) for _ in range(3)])
    truth = [
        GroundTruth(view, number, "chair", mask)
        for view in range(3)
        for number, mask in zip((4, 9), masks, strict=True)
    ]
    depth_m = rng.uniform(1.0, 3.0, (3, *SIZE)).astype(np.float32)
    depth_m[:, 0, :3] = 0
    return Episode(
        rgb=np.zeros((3, *SIZE, 3), np.uint8),
        depth_m=depth_m,
        intrinsics=np.repeat(np.array([[30.0, 0, 15.5], [0, 30.0, 11.5], [0, 0, 1]])[None], 3, axis=0),
        camera_to_world=np.stack([posed(rng) for _ in range(3)]),
        name="one",
        file_names=tuple(f"rgb/{view:03d}.png" for view in range(3)),
        ground_truth=tuple(truth),
        motion=(ObjectMotion(4, "chair", poses), ObjectMotion(9, "chair", np.repeat(posed(rng)[None], 3, axis=0))),
    )


@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_points_stay_where_they_are_in_the_frame_of_their_object(seed):
    episode = episode_of(seed)
    flow, known = scene_flow(episode, 0, 2)
    assert np.array_equal(known, episode.depth_m[0] > 0)
    poses = motion_of(episode)[0].object_to_world
    rays = np.linalg.inv(episode.intrinsics[0])
    for y, x in np.argwhere(known):
        point = rays @ [x, y, 1.0] * episode.depth_m[0, y, x]
        point = episode.camera_to_world[0] @ [*point, 1.0]
        if not truth_of(episode)[0].modal[y, x]:
            assert not flow[y, x].any()
            continue
        before = np.linalg.inv(poses[0]) @ point
        after = np.linalg.inv(poses[2]) @ (point + np.append(flow[y, x], 0.0))
        assert np.allclose(before, after, atol=1e-5)


@settings(max_examples=10)
@given(st.integers(0, 10_000))
def test_there_and_back_is_no_flow(seed):
    episode = episode_of(seed)
    flow, _ = scene_flow(episode, 1, 1)
    assert not np.abs(flow).max() > 1e-6


def test_flow_tells_where_in_the_other_view_a_point_is_seen():
    episode = episode_of(3)
    flow, known = scene_flow(episode, 0, 1)
    y, x = np.argwhere(truth_of(episode)[0].modal & known)[10]
    point = np.linalg.inv(episode.intrinsics[0]) @ [x, y, 1.0] * episode.depth_m[0, y, x]
    point = (episode.camera_to_world[0] @ [*point, 1.0])[:3]
    moves = motion_of(episode)[0].object_to_world
    there = (moves[1] @ np.linalg.inv(moves[0]) @ [*point, 1.0])[:3]
    told, _ = project((point + flow[y, x])[None], episode.intrinsics[1], episode.camera_to_world[1])
    expected, _ = project(there[None], episode.intrinsics[1], episode.camera_to_world[1])
    assert np.allclose(told, expected, atol=1e-3, equal_nan=True)


def test_what_moves_is_written_and_read_and_frames_that_are_left_out_are(tmp_path):
    episode = episode_of(0)
    write_episode(tmp_path / "one", episode)
    read = read_episode(tmp_path / "one")
    assert [one.moves for one in motion_of(read)] == [True, False]
    assert [one["moves"] for one in json.loads((tmp_path / "one" / "motion.json").read_text())["objects"]] == [
        True,
        False,
    ]
    assert np.allclose(motion_of(read)[0].object_to_world, motion_of(episode)[0].object_to_world)
    some = read_episode(tmp_path / "one", RecordingConfig(every=2))
    assert np.allclose(motion_of(some)[0].object_to_world, motion_of(episode)[0].object_to_world[::2])
    assert read_episode(tmp_path / "one", ground_truth=False).motion is None


def test_episodes_in_which_nothing_moves_have_no_such_file(tmp_path):
    write_episode(tmp_path / "one", replace(episode_of(0), motion=None))
    assert not (tmp_path / "one" / "motion.json").exists()
    read = read_episode(tmp_path / "one")
    assert read.motion is None
    with pytest.raises(UsageError, match=r"'one' has no motion\.json"):
        scene_flow(read, 0, 1)
    with pytest.raises(UsageError, match="there is no view 3: the episode has 3"):
        scene_flow(episode_of(0), 0, 3)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda c: c.pop("frames"), "frames: is missing"),
        (lambda c: c["frames"].pop(), "frames: has no frame 'rgb/002.png'"),
        (
            lambda c: c["objects"][0]["object_to_world"].pop(),
            r"objects\[0\].object_to_world: must have shape \(3, 4, 4\)",
        ),
        (lambda c: c["objects"][0]["object_to_world"][1][0].__setitem__(0, 3.0), "pose 1 is not a rotation"),
        (lambda c: c["objects"][1].__setitem__("instance_id", 4), r"objects\[1\].instance_id: 4 is there twice"),
        (lambda c: c["objects"][0].pop("category"), r"objects\[0\].category: is missing"),
    ],
)
def test_a_malformed_file_is_refused_in_one_sentence(tmp_path, change, told):
    write_episode(tmp_path / "one", episode_of(0))
    path = tmp_path / "one" / "motion.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(EpisodeFormatError, match=told):
        read_episode(tmp_path / "one")
