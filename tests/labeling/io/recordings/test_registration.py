"""Depth that lies beside colour is noticed, by how far it does; depth that lies where colour lies never is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.convert import main as convert
from labeling.core.episode import Episode
from labeling.core.geometry import intrinsics_matrix
from labeling.core.views import RgbdViews
from labeling.io.episodes import read_episode
from labeling.io.recordings.registration import DepthOffset, depth_edges, depth_offset, offset_note

from ...synthetic_room import make_episode
from .recording_writers import written


@pytest.fixture(scope="module")
def room() -> Episode:
    return make_episode(3, num_views=8, size=(240, 320), num_objects=6)


def shifted(room: Episode, right_px: int, down_px: int) -> Episode:
    return replace(room, depth_m=np.roll(room.depth_m, (down_px, right_px), axis=(1, 2)))


@pytest.mark.slow
def test_registered_depth_lies_where_colour_lies(room):
    assert depth_offset(room) is None
    assert offset_note(room) is None


@pytest.mark.slow
@pytest.mark.parametrize(("right_px", "down_px"), [(10, 0), (-25, 0), (0, 14), (18, -12), (-8, 6)])
def test_the_offset_is_measured(room, right_px, down_px):
    found = depth_offset(shifted(room, right_px, down_px))
    assert found is not None
    # Pictures are halved before they are compared.
    assert (found.right_px, found.down_px) == pytest.approx((right_px, down_px), abs=2)


def zoomed(room: Episode, factor: float) -> Episode:
    """Depth as a camera of another focal length at the same place would see it."""
    height, width = room.depth_m.shape[1:]
    rows, columns = (
        np.rint((np.arange(size) - (size - 1) / 2) / factor + (size - 1) / 2).astype(int).clip(0, size - 1)
        for size in (height, width)
    )
    return replace(room, depth_m=room.depth_m[:, rows][:, :, columns])


@pytest.mark.slow
@pytest.mark.parametrize("factor", [585 / 525, 0.88, 1.15])
def test_another_focal_length_is_measured(room, factor):
    found = depth_offset(zoomed(room, factor))
    assert found is not None
    assert found.scale == pytest.approx(factor, abs=0.03)
    assert np.hypot(found.right_px, found.down_px) <= 4
    note = offset_note(zoomed(room, factor))
    assert note is not None
    assert f"depth draws things {found.scale:.2f} times as large as colour does" in note


@pytest.mark.slow
def test_small_offsets_are_none_and_noise_hides_none(room):
    assert depth_offset(shifted(room, 1, 0)) is None
    rng = np.random.default_rng(0)
    noisy = np.where(rng.random(room.depth_m.shape) < 0.1, 0, room.depth_m * rng.normal(1, 0.004, room.depth_m.shape))
    assert depth_offset(replace(room, depth_m=noisy.astype(np.float32))) is None


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_nothing_is_said_where_there_is_nothing_to_see(seed, views):
    rng = np.random.default_rng(seed)
    rgb = rng.integers(0, 255, (views, 60, 80, 3)).astype(np.uint8)
    k = np.tile(intrinsics_matrix(60.0, 60.0, 39.5, 29.5), (views, 1, 1))
    wall = Episode(rgb, np.full((views, 60, 80), 2, np.float32), k, np.tile(np.eye(4), (views, 1, 1)), "", ())
    assert depth_offset(wall) is None
    assert depth_offset(replace(wall, depth_m=np.zeros_like(wall.depth_m))) is None


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(2, 8), st.integers(3, 60), st.integers(3, 60))
def test_noise_says_nothing_however_small_the_pictures(seed, count, height_px, width_px):
    rng = np.random.default_rng(seed)
    rgb = rng.integers(0, 256, (count, height_px, width_px, 3), np.uint8)
    depth_m = rng.uniform(0.5, 9.0, (count, height_px, width_px)).astype(np.float32)
    poses = np.stack([np.eye(4)] * count)
    assert depth_offset(RgbdViews(rgb, depth_m, np.stack([np.eye(3)] * count), poses)) is None


@settings(max_examples=50)
@given(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(0.5, 5))
def test_planes_have_no_edges_however_tilted(across, along, distance_m):
    y, x = np.mgrid[-1:1:40j, -1:1:50j]
    depth_m = (distance_m / (1.85 + across * x + along * y)).astype(np.float32)
    assert not depth_edges(depth_m).any()
    depth_m[:, 25:] *= 1.5
    assert set(np.flatnonzero(depth_edges(depth_m).any(axis=0))) == {24, 25}


@pytest.mark.slow
def test_it_is_told_when_a_recording_is_read_but_not_of_simulators(tmp_path, room, capsys):
    folder = written(tmp_path, "polycam", shifted(room, -25, 0))
    (note,) = read_episode(folder).notes
    assert "edges of depth lie 2" in note
    assert "pixels to the left" in note
    assert convert([str(folder), "--out", str(tmp_path / "converted")]) == 0
    assert "not registered to colour" in capsys.readouterr().out
    (folder / "episode.json").write_text('{"world": "sbm_gym/Indoor-v0"}')
    assert read_episode(folder).notes == ()


def test_directions_in_words():
    assert str(DepthOffset(-25.2, 3.0)) == "25 pixels to the left and 3 down"
    assert str(DepthOffset(7.0, -2.0)) == "7 pixels to the right and 2 up"
