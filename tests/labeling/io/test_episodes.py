"""Episodes survive the way to disk and back."""

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError
from labeling.core.geometry import OPENGL_TO_OPENCV
from labeling.io.episodes import find_episodes, read_episode, write_episode

from .small_episode import HEIGHT_PX, WIDTH_PX, make_episode


def assert_same(a: Any, b: Any) -> None:
    """Compares records that hold arrays."""
    if a is None or b is None:
        assert a is b
    elif hasattr(a, "__dataclass_fields__"):
        for name in a.__dataclass_fields__:
            assert_same(getattr(a, name), getattr(b, name))
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            assert_same(one, other)
    elif isinstance(a, np.ndarray):
        np.testing.assert_array_equal(a, b)
        assert a.dtype == b.dtype
    else:
        assert a == b


@pytest.fixture
def folder(tmp_path) -> Path:
    write_episode(tmp_path / "episode", make_episode())
    return tmp_path / "episode"


@pytest.mark.parametrize("same_camera", [True, False])
@pytest.mark.parametrize("annotated", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_an_episode_survives_the_disk_unchanged(tmp_path, seed, same_camera, annotated):
    episode = make_episode(seed, same_camera=same_camera, annotated=annotated)
    write_episode(tmp_path / "episode", episode)
    assert_same(read_episode(tmp_path / "episode"), episode)


@settings(max_examples=30)
@given(hnp.arrays(np.float32, (1, 2, 3), elements=st.floats(0, 100, width=32)))
def test_depth_is_rounded_to_millimetres_and_too_far_is_no_return(tmp_path_factory, depth_m):
    episode = make_episode(views=1, annotated=False)
    rgb = np.zeros((1, 2, 3, 3), np.uint8)
    small = Episode(rgb, depth_m, episode.intrinsics, episode.camera_to_world, "e", ("rgb/000.png",))
    path = tmp_path_factory.mktemp("depth") / "e"
    write_episode(path, small)
    back = read_episode(path).depth_m
    near = depth_m < 65.534
    np.testing.assert_allclose(back[near], depth_m[near], atol=0.00051)
    assert (back[depth_m > 65.536] == 0).all()


def test_writing_replaces_an_older_episode_whole(folder):
    (folder / "stale").write_text("old")
    write_episode(folder, make_episode(seed=1, annotated=False))
    assert sorted(path.name for path in folder.iterdir()) == ["depth", "episode.json", "rgb", "transforms.json"]
    assert [path.name for path in folder.parent.iterdir()] == ["episode"]


def test_a_failed_write_leaves_nothing(tmp_path):
    episode = make_episode()
    unwritable = Episode(**{**vars(episode), "metadata": {"reward": float("nan")}})
    with pytest.raises(ValueError):
        write_episode(tmp_path / "episode", unwritable)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # pycocotools with numpy 2.4
def test_files_are_nerfstudio_opengl_and_coco(folder):
    """Other tools read these files: the conventions, not only the round trip, have to be right."""
    from pycocotools import mask as pycoco_mask

    episode = make_episode()
    transforms = json.loads((folder / "transforms.json").read_text())
    assert (transforms["w"], transforms["h"]) == (WIDTH_PX, HEIGHT_PX)
    assert (transforms["fl_x"], transforms["fl_y"], transforms["cx"], transforms["cy"]) == (6.5, 6.25, 3.25, 2.5)
    opengl = np.array(transforms["frames"][1]["transform_matrix"])
    np.testing.assert_array_equal(opengl, episode.camera_to_world[1] @ OPENGL_TO_OPENCV)
    png = cv2.imread(str(folder / transforms["frames"][2]["file_path"]))
    assert png is not None
    np.testing.assert_array_equal(png[..., ::-1], episode.rgb[2])
    truth = json.loads((folder / "ground_truth.json").read_text())
    assert episode.ground_truth is not None
    for record, label in zip(truth["annotations"], episode.ground_truth, strict=True):
        np.testing.assert_array_equal(pycoco_mask.decode(record["segmentation"]), label.modal)
        assert record["area"] == label.modal.sum()
        assert record["iscrowd"] == label.ignore


# Finding -------------------------------------------------------------------------------------------------------------


def test_find_episodes_takes_an_episode_or_a_folder_of_them(folder):
    assert find_episodes(folder) == [folder]
    shutil.copytree(folder, folder.parent / "another")
    assert find_episodes(folder.parent) == [folder.parent / "another", folder]


def test_find_episodes_passes_over_dot_folders_and_other_things(folder):
    shutil.copytree(folder, folder.parent / ".episode.half")
    (folder.parent / "notes").mkdir()
    (folder.parent / "transforms.txt").write_text("")
    assert find_episodes(folder.parent) == [folder]


@pytest.mark.parametrize("name", ["missing", "empty"])
def test_find_episodes_says_so_if_there_is_none(tmp_path, name):
    (tmp_path / "empty").mkdir()
    with pytest.raises(EpisodeFormatError, match=name):
        find_episodes(tmp_path / name)


# Real data -----------------------------------------------------------------------------------------------------------


def test_the_real_capture_is_read_as_its_readme_says(apc_shelf):
    episode = read_episode(apc_shelf)
    assert (episode.num_views, episode.size) == (15, (480, 640))
    assert episode.detections is not None
    assert episode.ground_truth is not None
    assert len(episode.detections) == 54
    assert sorted({label.instance_id for label in episode.ground_truth}) == [1, 2, 3, 4]
    with_depth = [np.mean(episode.depth_m[label.view_index][label.modal] > 0) for label in episode.ground_truth]
    assert 0.2 < np.median(with_depth) < 0.6  # sparse, as the README warns
    # All cameras look at the bin: the views' axes pass close to one point in front of them.
    from_camera = episode.camera_to_world[:, :3, 3]
    axes = episode.camera_to_world[:, :3, 2]
    off_axis = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    nearest = np.linalg.solve(off_axis.sum(axis=0), (off_axis @ from_camera[:, :, None]).sum(axis=0)[:, 0])
    ahead_m = ((nearest - from_camera) * axes).sum(axis=1)
    assert (ahead_m > 0.1).all()
    assert (ahead_m < 1.5).all()
