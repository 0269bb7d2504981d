"""Contact sheets: what they hold, and how the command behaves."""

import subprocess
import sys
from dataclasses import replace

import cv2
import mujoco
import numpy as np
import pytest

from labeling.core.geometry import project
from sbm_gym import preview
from sbm_gym.preview import EYE_VIEWS, PreviewConfig
from sbm_gym.rendering.contact_sheet import contact_sheet
from sbm_gym.scenes import world_sources
from sbm_gym.scenes.viewpoints import eye_level_views, fitted_camera, view_from_above

from .box_rooms import FURNITURE, BoxRooms


@pytest.fixture
def box_worlds(monkeypatch):
    """One kind of world, the hand-written one."""
    monkeypatch.setattr(world_sources, "WORLDS", {"boxes": lambda unseen_models: BoxRooms()})


def read(path):
    picture = cv2.imread(str(path))
    assert picture is not None
    return picture


def compiled(scene="box_0"):
    world = BoxRooms().build(scene)
    model = world.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return world, model, data


@pytest.mark.slow
def test_sheets_of_scenes_and_renderers_show_every_scene(box_worlds, tmp_path, capsys):
    assert preview.main(["--out", str(tmp_path), "--what", "scenes", "renderers", "--size", "48"]) == 0
    scenes = read(tmp_path / "scenes_boxes_0.png")
    renderers = read(tmp_path / "renderers_boxes_0.png")
    assert scenes.shape[1] == 4 + round(1.4 * 48) + 4 + EYE_VIEWS * (48 + 4)
    assert scenes.shape[0] == renderers.shape[0] == 4 + 4 * (48 + 16 + 4)
    listed = capsys.readouterr().out.split()
    assert listed == [str(tmp_path / name) for name in ("scenes_boxes_0.png", "renderers_boxes_0.png")]
    rays, gl = (renderers[4:52, left : left + 48].astype(int) for left in (4, 56))
    assert np.abs(rays - gl).mean() < 30
    assert rays.std() > 10


@pytest.mark.slow
def test_wide_pictures_stand_in_two_rows_a_scene(monkeypatch, tmp_path):
    streets = BoxRooms(profile=replace(BoxRooms().profile, capture_size=(96, 288)))
    monkeypatch.setattr(world_sources, "WORLDS", {"boxes": lambda unseen_models: streets})
    sheets = preview.run(PreviewConfig(out=tmp_path, what=("scenes",), size=48))
    names = len(streets.scenes(None))
    assert [path.name for path in sheets] == [f"scenes_boxes_{number}.png" for number in range(-(-names // 3))]
    sheet, row = read(sheets[0]), 48 + 16 + 4
    assert sheet.shape[1] == 4 + (round(1.4 * 48) + 4) + 2 * (2 * 48 + 4)
    assert sheet.shape[0] == 4 + 2 * min(3, names) * row
    below_the_view_from_above = sheet[4 + row : 4 + row + 48, 4 : 4 + round(1.4 * 48)]
    assert (below_the_view_from_above == 245).all()
    assert sheet[4 + row : 4 + row + 48, 4 + round(1.4 * 48) + 4 :].std() > 10


@pytest.mark.parametrize(("split", "scenes"), [("val", None), ("train", 1)])
def test_one_split_only_or_some_scenes_of_it(box_worlds, tmp_path, split, scenes):
    (path,) = preview.run(PreviewConfig(out=tmp_path, what=("scenes",), split=split, size=40, scenes=scenes))
    assert read(path).shape[0] == 4 + 40 + 16 + 4


def test_eye_level_views_stand_apart_and_look_at_objects_in_sight():
    world, model, data = compiled()
    views = eye_level_views(world, model, data, 1.5, 4)
    places = np.array([view[:2, 3] for view in views])
    assert all(world.navigable.is_free(place) for place in places)
    assert min(np.linalg.norm(places[i] - places[j]) for i in range(4) for j in range(i)) > 1.5
    centres = np.array([instance.box_3d.centre_m for instance in world.objects])
    intrinsics = np.array([[50.0, 0, 49.5], [0, 50.0, 49.5], [0, 0, 1]])
    for view in views:
        pixels, depth = project(centres, intrinsics, view)
        assert np.any((depth > 0.5) & (np.abs(pixels - 49.5) < 50).all(axis=1))


@pytest.mark.parametrize("size_m", [(100.0, 100.0, 1.5), (140.0, 60.0, 1.5), (3.0, 9.0, 1.5)])
@pytest.mark.parametrize("size_px", [(240, 336), (120, 120)])
def test_pictures_from_above_hold_everything_and_little_else(size_m, size_px):
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]) * size_m + [7, -3, 0]
    height, width = size_px
    camera = fitted_camera(corners, (height, width), 0.9)
    pixels, depth = project(corners, camera.intrinsics, camera.camera_to_world)
    assert np.all(depth > 0)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    assert np.all(low >= -0.5)
    assert np.all(high <= np.array([width, height]) - 0.5)
    # One of the two directions is filled.
    assert max((high - low) / [width, height]) > 0.93


def test_from_above_all_furniture_shows():
    """Every piece has its own colour; each must be found where it stands."""
    _, model, data = compiled()
    picture = view_from_above(model, data, 1.5, 160, 160)
    assert picture.shape == (160, 160, 3)
    for index in range(len(FURNITURE)):
        colour = np.random.default_rng(index).uniform(0.2, 0.9, 3)
        hue = picture / np.maximum(picture.max(axis=-1, keepdims=True), 1)
        # Light changes how bright a surface is, hardly its hue; in encoded values the ratio stays nearly the same.
        near = np.abs(hue - colour / colour.max()).max(axis=-1) < 0.12
        assert near.sum() > 20, FURNITURE


def test_contact_sheets_place_pictures_row_by_row():
    tiles = [
        (np.full((20, 30, 3), 40 * k, np.uint8), f"picture {k} with a name that is far too long") for k in range(5)
    ]
    sheet = contact_sheet(tiles, 3)
    assert sheet.shape == (2 * (20 + 20) + 4, 3 * 34 + 4, 3)
    for k in range(5):
        top, left = 4 + k // 3 * 40, 4 + k % 3 * 34
        assert (sheet[top : top + 20, left : left + 30] == 40 * k).all()
    assert (sheet[44:64, 72:102] == 245).all()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--what", "dreams"], "known: scenes, renderers, assets"),
        (["--worlds", "moon"], "indoor"),
        (["--size", "2"], "--size must be at least 32 pixels"),
        (["--scenes", "0"], "--scenes must be at least 1"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_two(arguments, says, tmp_path, capsys):
    assert preview.main(["--out", str(tmp_path / "out"), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert says in error
    assert not (tmp_path / "out").exists()


def test_installed_and_builtin_models_are_drawn():
    from sbm_gym.assets.parametric.builtin import BuiltinLibrary

    library = BuiltinLibrary()
    card = library.models("couch")[0] if library.models("couch") else library.models("bed")[0]
    picture = preview.draw_model(library, card, 64)
    ground = picture[2, 2].astype(int)
    assert (np.abs(picture.astype(int) - ground).max(axis=-1) > 25).mean() > 0.1


def test_help_needs_none_of_the_heavy_libraries():
    code = (
        "import sys, sbm_gym.preview as p\n"
        "try: p.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print([m for m in ('mujoco', 'numba', 'open3d', 'cv2') if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr.strip() == "[]"


@pytest.mark.slow
def test_scenes_in_which_nothing_can_move_are_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(preview, "MOVING_THINGS", 0)
    where = ["--worlds", "indoor-builtin", "--scenes", "1", "--size", "32", "--out", str(tmp_path / "sheets")]
    assert preview.main(["--what", "moving", *where]) == 0
    assert "note: nothing in train/00 can move" in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.png"))
