import zipfile

import numpy as np
import pytest

from labeling.core.errors import MissingAssetsError, SbmError
from sbm_gym.assets.catalog import archive as archive_module
from sbm_gym.assets.catalog import home3d
from sbm_gym.assets.catalog.archive import ArchiveError, FurnitureArchive, resolve
from sbm_gym.assets.catalog.catalog import FURNITURE_VARIABLE, find_libraries, read_library
from sbm_gym.assets.catalog.home3d import CachedModel, convert
from sbm_gym.assets.catalog.wavefront import ModelFormatError, parse_obj
from sbm_gym.assets.models.model import footprint_rectangles, load_model

from .tiny_library import write_library


@pytest.fixture
def library(tmp_path):
    return read_library(write_library(tmp_path / "tiny.sh3f"))


def all_vertices(model):
    return np.concatenate([surface.vertices_m for surface in model.surfaces])


def test_the_catalogue_is_read(library):
    (entry,) = library.entries
    assert (entry.model_id, entry.name, entry.creator, entry.licence) == (
        "Tiny#box",
        "Boîte en bois",
        "A. Maker",
        "CC0 1.0",
    )
    assert entry.size_m == pytest.approx((0.6, 0.4, 0.9))
    assert entry.top_m == pytest.approx(0.9)
    assert library.licence_text == "Do what you like."


def test_size_axes_and_origin_after_conversion(library):
    model = convert(library.entries[0])
    vertices = all_vertices(model)
    np.testing.assert_allclose(vertices.min(axis=0), [-0.3, -0.2, 0.0], atol=1e-6)
    np.testing.assert_allclose(vertices.max(axis=0), [0.3, 0.2, 0.9], atol=1e-6)
    assert model.num_triangles == 12
    front = next(surface for surface in model.surfaces if surface.texture is not None)
    np.testing.assert_allclose(front.vertices_m[:, 1], -0.2, atol=1e-6)
    np.testing.assert_allclose(front.normals, np.tile([0, -1, 0], (4, 1)), atol=1e-6)
    assert front.rgba == (1.0, 1.0, 1.0, 1.0)
    plain = next(surface for surface in model.surfaces if surface.texture is None)
    assert plain.rgba == (0.2, 0.4, 0.6, 0.5)


def test_pictures_stand_upright(library):
    """Texture rows count from the top: the upper corners of the front are red, the lower ones blue."""
    model = convert(library.entries[0])
    front = next(surface for surface in model.surfaces if surface.texture is not None)
    assert front.texcoords is not None
    assert front.texture is not None
    for vertex, (u, v) in zip(front.vertices_m, front.texcoords, strict=True):
        row, column = (int(np.clip(part * 8, 0, 7)) for part in (v, u))
        expected = [255, 0, 0] if vertex[2] > 0.45 else [0, 0, 255]
        assert front.texture[row, column].tolist() == expected


def test_model_rotation_comes_before_scaling(tmp_path):
    """A catalogue rotation that lays the model's y axis along its z axis still ends in the catalogue's size."""
    line = "modelRotation#1=1 0 0 0 0 -1 0 1 0\n"
    entry = read_library(write_library(tmp_path / "turned.sh3f", catalogue=line)).entries[0]
    model = convert(entry)
    np.testing.assert_allclose(np.ptp(all_vertices(model), axis=0), [0.6, 0.4, 0.9], atol=1e-6)
    front = next(surface for surface in model.surfaces if surface.texture is not None)
    np.testing.assert_allclose(front.normals[0], [0, 0, -1], atol=1e-6)


def test_zipped_models_give_the_same(library, tmp_path):
    zipped = read_library(write_library(tmp_path / "zipped.sh3f", model="/models/box.zip", zipped=True))
    np.testing.assert_array_equal(all_vertices(convert(zipped.entries[0])), all_vertices(convert(library.entries[0])))


def test_the_cache_is_used_and_rebuilt_for_another_version_or_content(library, tmp_path, monkeypatch):
    entry, cache = library.entries[0], tmp_path / "cache"
    model = CachedModel(entry, library.content_hash, cache)
    first = model.load()
    entry.archive.unlink()  # from here on only the cache can answer
    for a, b in zip(first.surfaces, model.load().surfaces, strict=True):
        np.testing.assert_array_equal(a.vertices_m, b.vertices_m)
        np.testing.assert_array_equal(a.faces, b.faces)
    with pytest.raises(ArchiveError):
        CachedModel(entry, "another content", cache).load()
    monkeypatch.setattr(home3d, "CONVERTER_VERSION", 10**6)
    with pytest.raises(ArchiveError):
        model.load()


def test_a_damaged_cache_is_made_again(library, tmp_path):
    model = CachedModel(library.entries[0], library.content_hash, tmp_path / "cache")
    model.load()
    (model.folder / "model.npz").write_bytes(b"not an archive")
    assert model.load().num_triangles == 12
    assert load_model(model.folder).num_triangles == 12


def test_content_hash_follows_the_content(tmp_path):
    a = read_library(write_library(tmp_path / "a.sh3f")).content_hash
    b = read_library(write_library(tmp_path / "b.sh3f")).content_hash
    c = read_library(write_library(tmp_path / "c.sh3f", catalogue="# more\n")).content_hash
    assert a == b != c


def test_missing_libraries_name_the_command(tmp_path, monkeypatch):
    with pytest.raises(MissingAssetsError, match=r"sudo apt-get install sweethome3d-furniture.*SBM_FURNITURE"):
        find_libraries([tmp_path])
    monkeypatch.setenv(FURNITURE_VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(MissingAssetsError, match="nowhere"):
        find_libraries()


def test_the_variable_names_files_and_folders(tmp_path, monkeypatch):
    folder = tmp_path / "folder"
    folder.mkdir()
    inside, outside = write_library(folder / "b.sh3f"), write_library(tmp_path / "a.sh3f")
    monkeypatch.setenv(FURNITURE_VARIABLE, f"{outside}:{folder}")
    assert find_libraries() == [outside, inside]


@pytest.mark.parametrize("path", ["../../etc/passwd", "/../x.obj", "..\\x.obj", "C:/x.obj", "a/../../x.obj"])
def test_paths_out_of_the_archive_are_refused(tmp_path, path):
    with pytest.raises(ArchiveError, match="leads out of the archive"):
        resolve(path, "library")
    with pytest.raises(ArchiveError, match="leads out of the archive"):
        read_library(write_library(tmp_path / "evil.sh3f", model=path.replace("\\", "\\\\")))


def test_textures_out_of_the_archive_are_refused(tmp_path):
    entry = read_library(write_library(tmp_path / "evil.sh3f", texture="../../../../../../secret.png")).entries[0]
    with pytest.raises(ArchiveError, match="leads out of the archive"):
        convert(entry)


def test_members_beyond_the_limit_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "bomb.sh3f"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("zeros", bytes(100_000))
    monkeypatch.setattr(archive_module, "MAX_MEMBER_BYTES", 50_000)
    with FurnitureArchive(path, "bomb") as archive, pytest.raises(ArchiveError, match="more than 50000"):
        archive.read("zeros")


def test_a_file_that_is_no_library_is_one_clear_error(tmp_path):
    path = tmp_path / "fake.sh3f"
    path.write_text("hello")
    with pytest.raises(ArchiveError, match="not a readable zip archive"):
        read_library(path)


def test_bytes_flipped_anywhere_are_one_clear_error_or_harmless(tmp_path):
    whole = write_library(tmp_path / "whole.sh3f", zipped=True, model="/models/box.zip").read_bytes()
    path, rng, refused = tmp_path / "flipped.sh3f", np.random.default_rng(0), 0
    for _ in range(300):
        content = bytearray(whole)
        content[int(rng.integers(len(whole)))] ^= int(rng.integers(1, 256))
        path.write_bytes(content)
        try:
            for entry in read_library(path).entries:
                convert(entry)
        except SbmError:
            refused += 1
    assert refused > 100


@pytest.mark.parametrize(
    "content",
    [
        "",
        "v 1 2 x\n",
        "v 0 0 0\nf 1 2 3\n",
        "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "v 0 0 1e308\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    ],
)
def test_bad_models_are_one_clear_error(content):
    with pytest.raises(ModelFormatError, match=r"^box\.obj: "):
        parse_obj(content.encode(), "box.obj")


@pytest.mark.parametrize(("mirror_x", "mirror_y"), [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_an_empty_corner_is_cut_out_of_the_footprint(mirror_x, mirror_y):
    """An L of 2 x 2 m with its (+, +) quarter missing: two boxes that cover it and leave the quarter free."""
    grid = np.stack(np.meshgrid(np.arange(-0.99, 1, 0.02), np.arange(-0.99, 1, 0.02)), axis=-1).reshape(-1, 2)
    shape = grid[~((grid[:, 0] > 0) & (grid[:, 1] > 0))] * [mirror_x, mirror_y]
    points = np.concatenate([shape, np.zeros((len(shape), 1))], axis=1)
    boxes = footprint_rectangles(points, (2.0, 2.0, 1.0))
    assert len(boxes) == 2
    inside = ((shape[:, None] >= boxes[None, :, :2] - 1e-9) & (shape[:, None] <= boxes[None, :, 2:] + 1e-9)).all(-1)
    assert np.all(np.any(inside, axis=-1))
    area = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1).sum()
    assert area == pytest.approx(3.0, abs=0.11)


def test_a_full_footprint_stays_one_box():
    points = np.random.default_rng(0).uniform([-1, -0.5, 0], [1, 0.5, 1], (20_000, 3))
    np.testing.assert_allclose(footprint_rectangles(points, (2.0, 1.0, 1.0)), [[-1, -0.5, 1, 0.5]])


def test_triangles_are_counted_without_reading_the_mesh(library, tmp_path):
    model = CachedModel(library.entries[0], library.content_hash, tmp_path / "cache")
    assert model.num_triangles() == 12  # converted for it
    (model.folder / "model.npz").unlink()
    assert model.num_triangles() == 12
    (model.folder / "model.json").write_text("{}", encoding="utf-8")
    assert model.num_triangles() == 12  # damaged: converted again
    assert load_model(model.folder).num_triangles == 12
