"""Atlases against the views that they stand for."""

import json
import shutil
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from labeling.core.errors import SbmError, UsageError
from labeling.core.rle import decode_mask, encode_mask
from labeling.core.types import Detection
from sbm_gym import build_atlas
from sbm_gym.atlas import stored_views
from sbm_gym.atlas.pose_grid import PoseGrid
from sbm_gym.atlas.scene_atlas import AtlasError
from sbm_gym.env.fixation_env import FixationEnv
from sbm_gym.worlds.geometry.navigable import NavigableMap

from ..box_rooms import BoxRooms


class CornersOfBoxRooms(BoxRooms):
    """Where the robot keeps to one corner, so that an atlas is small."""

    def build(self, scene):
        world = super().build(scene)
        free = world.navigable.free.copy()
        free[50:], free[:, 50:] = False, False
        return replace(world, navigable=replace(world.navigable, free=free))


ENV, DETECTOR = "sbm_gym/AtlasBoxes-v0", f"{__package__}.colour_detector:blobs"
SETTINGS = {"worlds": CornersOfBoxRooms(3), "image_size": (24, 32), "detector_size": (48, 64), "renderer": "rays"}


@pytest.fixture(scope="module", autouse=True)
def registered():
    gymnasium.register(ENV, entry_point="sbm_gym.env.fixation_env:FixationEnv", kwargs=SETTINGS, max_episode_steps=25)
    yield
    del gymnasium.registry[ENV]


@pytest.fixture(scope="module")
def atlas(registered, tmp_path_factory):
    """Of the first training scene, with a real detector."""
    folder = tmp_path_factory.mktemp("atlas")
    build_atlas.build(build_atlas.AtlasConfig(folder, ENV, scenes=1, detector=DETECTOR))
    return folder


def plain(**changes) -> FixationEnv:
    return FixationEnv(**{**SETTINGS, "detector": DETECTOR, **changes})


@given(st.integers(0, 2**32 - 1), st.integers(2, 30), st.integers(2, 30), st.floats(0.05, 0.5))
@settings(max_examples=40)
def test_every_cell_of_the_grid_that_has_free_floor_has_one_place_there(seed, rows, columns, grid_m):
    in_tiles = 0.05 * (np.arange(30) + 0.5) / grid_m
    assume((np.abs(in_tiles - np.round(in_tiles)) > 1e-6).all())  # where borders meet, rounding decides
    free = np.random.default_rng(seed).random((rows, columns)) < 0.7
    free[0, 0] = True
    navigable = NavigableMap(free, np.array([-1.0, 2.0]), 0.05)
    poses = PoseGrid.cover(navigable, grid_m, 12)
    assert navigable.are_free(poses.places_m).all()
    tiles = {tuple(tile) for tile in np.floor((poses.places_m - navigable.origin_m) / grid_m + 1e-9).astype(int)}
    assert len(tiles) == len(poses.places_m)
    for i, j in np.argwhere(navigable.largest_component):
        middle_m = navigable.origin_m + 0.05 * (np.array([j, i]) + 0.5)
        assert tuple(np.floor((middle_m - navigable.origin_m) / grid_m).astype(int)) in tiles
    for place, at_m in enumerate(poses.places_m):
        assert poses.nearest_place(at_m, navigable) == place


@given(st.integers(12, 40), st.floats(-np.pi, np.pi))
def test_the_nearest_heading_is_at_most_half_a_step_away(num_headings, yaw_rad):
    poses = PoseGrid(np.zeros((1, 2)), num_headings)
    found_rad = poses.heading_rad(poses.nearest_heading(yaw_rad))
    assert -np.pi < found_rad <= np.pi
    assert abs((found_rad - yaw_rad + np.pi) % (2 * np.pi) - np.pi) <= np.pi / num_headings + 1e-9


@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.integers(1, 20))
@settings(max_examples=60)
def test_what_is_stored_comes_back(seed, height, width):
    rng = np.random.default_rng(seed)
    depth_m = (rng.choice([0.0, 1.0], (height, width)) * rng.exponential(5.0, (height, width))).astype(np.float32)
    again_m = stored_views.decode_depth(stored_views.encode_depth(depth_m, 0.001), (height, width), 0.001)
    np.testing.assert_array_equal(again_m > 0, depth_m > 0)
    np.testing.assert_allclose(again_m, np.where(depth_m > 0, np.maximum(depth_m, 0.001), 0), atol=0.000501)
    ids = rng.integers(-1, 900, (height, width)).astype(np.int32)
    np.testing.assert_array_equal(stored_views.decode_ids(stored_views.encode_ids(ids), (height, width)), ids)
    found = tuple(
        Detection(0, f"c{n}", float(rng.random()), rng.random((height, width)) < 0.5) for n in range(rng.integers(4))
    )
    content = stored_views.encode_detections(found)
    assert stored_views.decode_detections(content, (height, width)) == found


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 40), st.sampled_from(["", "0", "o", "P1", "P"]))
@settings(max_examples=80)
def test_stored_masks_are_those_of_the_codec_or_refused(seed, height, width, inserted):
    rng = np.random.default_rng(seed)
    mask = rng.random((height, width)) < rng.choice([0.0, 0.02, 0.5, 1.0])
    mask[: rng.integers(0, height + 1)] = rng.random() < 0.5
    counts = encode_mask(mask)["counts"]
    at = int(rng.integers(0, len(counts) + 1))
    counts = counts[:at] + inserted + counts[at:]
    content = json.dumps([["chair", 0.5, encode_mask(mask)["counts"]], ["lamp", 0.9, counts]]).encode()
    try:
        expected = decode_mask({"size": [height, width], "counts": counts})
    except ValueError:
        with pytest.raises(ValueError, match="does not fill"):
            stored_views.decode_detections(content, (height, width))
        return
    first, second = stored_views.decode_detections(content, (height, width))
    np.testing.assert_array_equal(first.mask, mask)
    np.testing.assert_array_equal(second.mask, expected)
    assert (second.category, second.confidence) == ("lamp", 0.9)


@pytest.mark.slow
def test_an_atlas_and_the_plain_environment_agree_at_the_same_poses(atlas):
    looking_up, drawing = plain(atlas=atlas), plain()
    seen_something = 0
    for seed in range(6):
        one, info = looking_up.reset(seed=seed, options={"scene": "box_0"})
        agent = info["agent"]
        start = (*agent["position_m"], agent["yaw_rad"])
        other, expected = drawing.reset(seed=seed, options={"scene": "box_0", "start": start})
        np.testing.assert_array_equal(agent["camera_to_world"], expected["agent"]["camera_to_world"])
        assert info["detections"] == expected["detections"]
        seen_something += bool(info["detections"])
        np.testing.assert_allclose(info["sight"]["depth_m"], expected["sight"]["depth_m"], atol=0.000501)
        np.testing.assert_array_equal(info["sight"]["intrinsics"], expected["sight"]["intrinsics"])
        assert np.abs(one["depth"].astype(int) - other["depth"]).max() <= 1
        assert not one["rgb"].any()
        np.testing.assert_allclose(one["state"], other["state"], atol=0.02)
        assert info["reward_terms"] == pytest.approx(expected["reward_terms"], abs=1e-6)
        assert [known["category"] for known in info["confirmed_objects"]] == [
            known["category"] for known in expected["confirmed_objects"]
        ]
    assert seen_something >= 3


@pytest.mark.slow
@pytest.mark.parametrize("detector", [DETECTOR, "simulated"])
def test_every_step_of_an_episode_sees_what_a_camera_would_draw_there(atlas, tmp_path, detector):
    folder = atlas
    if detector == "simulated":
        folder = tmp_path / "simulated"
        build_atlas.build(build_atlas.AtlasConfig(folder, ENV, scenes=1, detector=detector))
    env = plain(atlas=folder, detector=detector)
    env.reset(seed=4, options={"scene": "box_0"})
    rng = np.random.default_rng(0)
    places = set()
    for step in range(25):
        _, _, _, truncated, info = env.step(rng.uniform(-1, 1, 4))
        simulation = env.simulation
        drawn = simulation.draw(24, 32, antialias=False, colours=False)
        np.testing.assert_allclose(simulation.view.frame.depth_m, drawn.frame.depth_m, atol=0.000501)
        np.testing.assert_array_equal(simulation.view.frame.geom_id, drawn.frame.geom_id)
        np.testing.assert_array_equal(simulation.view.instance_map, drawn.instance_map)
        np.testing.assert_array_equal(simulation.view.camera.camera_to_world, drawn.camera.camera_to_world)
        assert all(one.view_index == step + 1 for one in info["detections"])
        places.add(tuple(info["agent"]["position_m"]))
        assert info["agent"]["tilt_rad"] == env.profile.rest_tilt_rad
    assert truncated
    assert len(places) > 6
    assert info["path_length_m"] > 3.0
    capture = env.capture(48, 64)
    assert capture.rgb.any(), "captures are drawn"
    if detector == DETECTOR:
        assert list(capture.detections) == info["detections"]


@pytest.mark.slow
def test_scenes_are_those_that_the_folder_holds(atlas, tmp_path):
    assert plain().scene_names == ("box_0", "box_1")
    assert plain(atlas=atlas).scene_names == ("box_0",)
    assert plain(atlas=tmp_path).scene_names == plain().scene_names, "reset says that there is none"
    (folder,) = build_atlas.build(build_atlas.AtlasConfig(tmp_path, ENV, skip=1, scenes=1, detector=DETECTOR))
    assert folder.name == "box_1"
    assert plain(atlas=tmp_path).scene_names == ("box_1",)
    with pytest.raises(UsageError, match="--skip 2 leaves no scene of split train"):
        build_atlas.build(build_atlas.AtlasConfig(tmp_path, ENV, skip=2, detector=DETECTOR))


@pytest.mark.slow
def test_the_same_seed_gives_the_same_rollout(atlas):
    def rollout():
        env = plain(atlas=atlas, split=None)
        env.reset(seed=2, options={"scene": "box_0"})
        rng = np.random.default_rng(1)
        return [env.step(rng.uniform(-1, 1, 4)) for _ in range(6)]

    for (one, reward, *_), (other, other_reward, *_) in zip(rollout(), rollout(), strict=True):
        assert reward == other_reward
        for name in one:
            np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.slow
def test_an_atlas_is_gone_on_with_and_comes_out_the_same(atlas, tmp_path, monkeypatch):
    config = build_atlas.AtlasConfig(tmp_path, ENV, scenes=1, detector=DETECTOR)
    written = []
    from sbm_gym.atlas.scene_atlas import AtlasBuilder

    original = AtlasBuilder.write_place

    def interrupted(self, place, views):
        if len(written) == 3:
            raise KeyboardInterrupt
        written.append(place)
        original(self, place, views)

    monkeypatch.setattr(AtlasBuilder, "write_place", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build_atlas.build(config)
    with pytest.raises(AtlasError, match="is not finished; the same"):
        plain(atlas=tmp_path).reset(options={"scene": "box_0"})
    again = []
    monkeypatch.setattr(
        AtlasBuilder, "write_place", lambda self, place, views: (again.append(place), original(self, place, views))
    )
    (folder,) = build_atlas.build(config)
    assert written
    assert not set(written) & set(again)
    assert (folder / "views.bin").read_bytes() == (atlas / "box_0" / "views.bin").read_bytes()
    assert build_atlas.build(config) == [folder], "a finished one is left alone"


@pytest.mark.slow
def test_what_does_not_fit_is_refused(atlas, tmp_path):
    with pytest.raises(AtlasError, match="has no views of scene 'box_1'; python -m"):
        plain(atlas=atlas).reset(options={"scene": "box_1"})
    with pytest.raises(AtlasError, match=r"holds other views .*detector .* asked for"):
        plain(atlas=atlas, detector="simulated").reset(options={"scene": "box_0"})
    with pytest.raises(AtlasError, match=r"image_size \[24, 32\] there"):
        plain(atlas=atlas, image_size=(32, 32)).reset(options={"scene": "box_0"})
    with pytest.raises(UsageError, match=r"made with other settings \(headings 12 there, 16 now\)"):
        build_atlas.build(build_atlas.AtlasConfig(atlas, ENV, scenes=1, detector=DETECTOR, headings=16))
    with pytest.raises(UsageError, match=r"0.05 to 0.5 m apart, not 0.8 m"):
        build_atlas.build(build_atlas.AtlasConfig(tmp_path, ENV, scenes=1, detector=DETECTOR, grid_m=0.8))
    with pytest.raises(UsageError, match="at least 12 headings, not 8"):
        build_atlas.build(build_atlas.AtlasConfig(tmp_path, ENV, scenes=1, detector=DETECTOR, headings=8))


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["truncated", "empty", "table", "views", "key", "places", "headings", "no key"])
def test_a_damaged_atlas_is_named(atlas, tmp_path, damage):
    folder = tmp_path / "box_0"
    shutil.copytree(atlas / "box_0", folder)
    views = bytearray((folder / "views.bin").read_bytes())
    if damage == "truncated":
        views = views[: len(views) // 2]
    elif damage == "empty":
        views = bytearray()
    elif damage == "table":
        views[100:108] = (2**62).to_bytes(8, "little")
    elif damage == "views":
        views[-len(views) // 2 :] = bytes(len(views) - len(views) // 2)
    else:
        content = json.loads((folder / "atlas.json").read_text())
        content |= {
            "key": {"format": 99},
            "places": {"places_m": False},
            "headings": {"num_headings": -12},
            "no key": {"key": [1]},
        }[damage]
        (folder / "atlas.json").write_text(json.dumps(content))
    (folder / "views.bin").write_bytes(views)

    def look_around():
        for seed in range(20):
            plain(atlas=tmp_path).reset(seed=seed, options={"scene": "box_0"})

    with pytest.raises(SbmError, match=r"is damaged|format 99 there|places_m|holds other views"):
        look_around()


def test_the_command_says_what_is_wrong_in_one_line(tmp_path, capsys):
    assert build_atlas.main(["--out", str(tmp_path), "--env", "sbm_gym/Nowhere-v0"]) == 2
    assert "unknown env 'sbm_gym/Nowhere-v0'" in capsys.readouterr().err
    assert build_atlas.main(["--out", str(tmp_path), "--env", ENV, "--grid-m", "2"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
