import json

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.errors import UsageError
from labeling.core.rle import decode_mask
from labeling.detectors.data.annotated_pictures import read_pictures
from sbm_gym.assets.models.classes import NOVEL_CATEGORIES
from sbm_gym.photographs import album
from sbm_gym.photographs.__main__ import main
from sbm_gym.photographs.album import AlbumSettings, make_album, photographs_of_set
from sbm_gym.photographs.camera import MAX_ELEVATION_RAD, draw_azimuth, draw_camera
from sbm_gym.photographs.interiors import THEMES, interior
from sbm_gym.photographs.models import CATEGORIES, PhotographLibrary
from sbm_gym.photographs.streets import USES, street
from sbm_gym.photographs.take import Viewfinder
from sbm_gym.worlds.world import GEOM_GROUP_VISUAL

SMALL = AlbumSettings(split="train", seed=1, size_px=64, builtin=True)


def builtin_set(theme: str, seed: int = 0):
    rng = np.random.default_rng((9, seed))
    library = PhotographLibrary(None, "train", (9, seed))
    return (interior if theme in THEMES else street)(theme, library, rng), rng


@pytest.mark.slow
@pytest.mark.parametrize("theme", ["dining", "bed", "bicycle"])
def test_masks_are_what_mujocos_own_rays_hit(theme):
    photo_set, rng = builtin_set(theme)
    view = Viewfinder(photo_set)
    camera = view.find(96, rng)
    assert camera is not None
    picture = view.take(camera)
    owner = np.zeros(picture.rgb.shape[:2], int)
    names = {}
    for number, annotation in enumerate(picture.annotations, start=1):
        assert not (owner[annotation.mask] > 0).any(), "masks overlap"
        owner[annotation.mask] = number
        names[number] = annotation
    groups = np.zeros(6, np.uint8)
    groups[: GEOM_GROUP_VISUAL + 1] = 1
    scene = photo_set.pieces.scene
    scene.left_out.put_into(scene.spec)  # the model that is drawn from has boxes in place of meshes
    model = scene.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = {view.model.body(o.body_name).id: o for o in photo_set.pieces.objects}
    places = [np.argwhere(owner == number) for number in range(len(names) + 1)]
    right = total = 0
    for number, pixels in enumerate(places):
        for row, column in pixels[rng.permutation(len(pixels))[:25]]:
            ray = camera.camera_to_world[:3, :3] @ np.linalg.inv(camera.intrinsics) @ [column, row, 1.0]
            hit = np.full(1, -1, np.int32)
            mujoco.mj_ray(model, data, camera.camera_to_world[:3, 3], ray, groups, 1, -1, hit)
            found = bodies.get(int(model.geom_bodyid[hit[0]])) if hit[0] >= 0 else None
            right += (found is None) if number == 0 else found is not None and found.category == names[number].category
            total += 1
    assert total >= 40
    assert right >= 0.97 * total


@pytest.mark.slow
@pytest.mark.parametrize("theme", [*THEMES, *USES])
def test_subjects_are_seen_whole_from_their_front(theme):
    photo_set, rng = builtin_set(theme, 1)
    assert all(o.category in CATEGORIES for o in photo_set.pieces.objects)
    view = Viewfinder(photo_set)
    camera = view.find(64, rng)
    assert camera is not None, "no view of it"
    x, y, z = camera.camera_to_world[:3, 3]
    assert photo_set.floor_m[0] <= x <= photo_set.floor_m[2]
    assert photo_set.floor_m[1] <= y <= photo_set.floor_m[3]
    assert 0.1 < z <= photo_set.ceiling_m
    shown = [a for a in view.take(camera).annotations if not a.ignore]
    assert shown
    assert max(np.count_nonzero(a.mask) for a in shown) > 0.01 * 64 * 64


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=200)
def test_nobody_takes_pictures_of_backs(seed):
    assert abs(draw_azimuth(np.random.default_rng(seed))) <= np.deg2rad(95.0)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_cameras_look_level_at_their_subject(seed):
    photo_set, _ = _SET
    rng = np.random.default_rng(seed)
    subject = photo_set.pieces.subjects[0].box_3d
    camera = draw_camera(photo_set, subject, (64, 80), rng)
    if camera is None:
        return
    local = np.linalg.inv(camera.camera_to_world) @ np.append(subject.centre_m, 1.0)
    assert local[2] > 0
    pixel = camera.intrinsics @ local[:3] / local[2]
    assert 0 <= pixel[0] <= 80
    assert 0 <= pixel[1] <= 64
    away = camera.camera_to_world[:3, 3] - subject.centre_m
    assert np.arctan2(away[2], np.hypot(*away[:2])) <= MAX_ELEVATION_RAD + 1e-6
    np.testing.assert_allclose(camera.camera_to_world[:3, :3] @ camera.camera_to_world[:3, :3].T, np.eye(3), atol=1e-9)


_SET = builtin_set("table", 2)


def test_a_set_gives_the_same_photographs_again():
    first, second = photographs_of_set(SMALL, 5), photographs_of_set(SMALL, 5)
    assert len(first) == len(second) > 0
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.rgb, b.rgb)
        assert [x.model_name for x in a.annotations] == [x.model_name for x in b.annotations]
        for x, y in zip(a.annotations, b.annotations, strict=True):
            np.testing.assert_array_equal(x.mask, y.mask)


@pytest.fixture(scope="module")
def small_album(tmp_path_factory):
    folder = tmp_path_factory.mktemp("album") / "train"
    make_album(folder, SMALL, 7)
    return folder


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # of pycocotools
def test_an_album_is_plain_coco(small_album):
    from contextlib import redirect_stdout
    from io import StringIO

    from pycocotools.coco import COCO

    with redirect_stdout(StringIO()):
        coco = COCO(str(small_album / "annotations.json"))
    assert [coco.cats[i]["name"] for i in sorted(coco.cats)] == list(CATEGORIES)
    assert not set(NOVEL_CATEGORIES) & {entry["name"] for entry in coco.cats.values()}
    assert len(coco.imgs) == 7
    for record in coco.anns.values():
        mask = coco.annToMask(record).astype(bool)
        image = coco.imgs[record["image_id"]]
        assert mask.shape == (image["height"], image["width"])
        assert np.count_nonzero(mask) == record["area"] > 0
        left, top, width, height = record["bbox"]
        rows, columns = np.nonzero(mask)
        assert (left, top, width, height) == (columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1)


def test_detectors_read_an_album(small_album):
    pictures = read_pictures(small_album)
    assert len(pictures) == 7
    for picture in pictures:
        assert picture.rgb().shape[:2] == picture.size
        for annotation in picture.annotations:
            assert decode_mask(annotation.rle).shape == picture.size


def test_an_album_grows_and_heals(small_album, tmp_path):
    before = json.loads((small_album / "annotations.json").read_text())
    content = {p: p.read_bytes() for p in small_album.rglob("*.png")}
    # A killed process leaves whole sets only; a lost one is made again, byte by byte.
    lost = small_album / "images" / "00000"
    for path in lost.iterdir():
        path.unlink()
    lost.rmdir()
    make_album(small_album, SMALL, 9)
    after = json.loads((small_album / "annotations.json").read_text())
    assert after["images"][:7] == before["images"]
    assert after["annotations"][: len(before["annotations"])] == before["annotations"]
    assert len(after["images"]) == 9
    assert all(path.read_bytes() == old for path, old in content.items())
    make_album(small_album, SMALL, 7)


@pytest.mark.nightly
def test_the_number_of_processes_changes_nothing(small_album, tmp_path):
    make_album(tmp_path / "two", SMALL, 7, workers=2)
    assert (tmp_path / "two" / "annotations.json").read_bytes() == (small_album / "annotations.json").read_bytes()


def test_held_out_photographs_are_other_ones():
    from dataclasses import replace

    train, val = photographs_of_set(SMALL, 3), photographs_of_set(replace(SMALL, split="val"), 3)
    models = [{a.model_name for one in part for a in one.annotations} for part in (train, val)]
    assert not models[0] & models[1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"split": "test"}, "split 'test'; known: train, val"),
        ({"seed": -1}, "--seed"),
        ({"size_px": 8}, "--size"),
    ],
)
def test_settings_that_make_no_sense_are_refused(tmp_path, change, words):
    from dataclasses import replace

    with pytest.raises(UsageError, match=words):
        make_album(tmp_path / "album", replace(SMALL, **change), 1)
    assert not (tmp_path / "album").exists()


def test_other_settings_in_the_same_folder_are_refused(small_album):
    from dataclasses import replace

    with pytest.raises(UsageError, match="seed 1 there, 2 now"):
        make_album(small_album, replace(SMALL, seed=2), 1)


@pytest.mark.parametrize(
    "arguments",
    [["--count", "0"], ["--workers", "0"], ["--size", "8"], ["--seed", "-3"], ["--sheet-count", "0"]],
)
def test_the_command_says_what_is_wrong_in_one_line(tmp_path, capsys, arguments):
    assert main(["--out", str(tmp_path / "album"), "--builtin", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    assert arguments[0].removeprefix("--") in captured.err


def test_the_command_refuses_a_folder_of_something_else(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    assert main(["--out", str(tmp_path), "--builtin", "--count", "1"]) == 2
    assert "give another --out" in capsys.readouterr().err


def test_the_command_needs_furniture_or_says_so(tmp_path, capsys, monkeypatch):
    from sbm_gym.assets.catalog.library import default_library

    default_library.cache_clear()
    monkeypatch.setenv("SBM_FURNITURE", str(tmp_path / "nothing"))
    try:
        assert main(["--out", str(tmp_path / "album"), "--count", "1"]) == 2
    finally:
        default_library.cache_clear()
    assert "sweethome3d-furniture" in capsys.readouterr().err


def test_the_command_draws_a_sheet(small_album, tmp_path, capsys):
    import cv2

    options = ["--count", "7", "--seed", "1", "--size", "64", "--builtin"]
    sheet = tmp_path / "sheet.png"
    assert main(["--out", str(small_album), *options, "--sheet", str(sheet), "--sheet-count", "4"]) == 0
    picture = cv2.imread(str(sheet))
    assert picture is not None
    assert ((picture == (70, 255, 70)).all(axis=2)).any(), "masks are outlined in green"


def test_themes_are_drawn_as_often_as_they_should():
    rng = np.random.default_rng(0)
    drawn = [album.draw_theme(rng) for _ in range(4000)]
    assert np.mean([indoor for indoor, _ in drawn]) == pytest.approx(album.INDOOR_SHARE, abs=0.03)
    for indoor, weights in ((True, album.INDOOR), (False, album.OUTDOOR)):
        there = [theme for inside, theme in drawn if inside == indoor]
        for theme, weight in weights.items():
            assert there.count(theme) / len(there) == pytest.approx(weight / sum(weights.values()), abs=0.04)
