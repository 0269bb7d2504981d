"""Textures that scenes share, side by side in memory."""

import numpy as np
import pytest

from sbm_gym.store import packed_file, texel_files
from sbm_gym.store.packed_file import DamagedError
from sbm_gym.store.texel_files import open_texels, save_texels

RNG = np.random.default_rng(0)
PICTURES = [RNG.integers(0, 256, (count, 4), np.uint8) for count in (1, 5000, 1024, 70_000)]


@pytest.fixture(params=["mapped", "copied"])
def how(request, monkeypatch):
    """With the memory of the files themselves, and with a copy where the system cannot do that."""
    if request.param == "copied":
        monkeypatch.setattr(texel_files, "_mmap_function", lambda: None)


def shown(folder, files):
    texels, starts = open_texels(folder, files)
    return [texels[start : start + file.texels] for start, file in zip(starts, files, strict=True)]


@pytest.mark.usefixtures("how")
def test_textures_lie_side_by_side(tmp_path):
    files = [save_texels(tmp_path, picture) for picture in (*PICTURES, PICTURES[1])]
    assert len({file.name for file in files}) == len(list(tmp_path.iterdir())) == len(PICTURES)
    for _ in range(2):
        parts = shown(tmp_path, files)
        for part, picture in zip(parts, (*PICTURES, PICTURES[1]), strict=True):
            assert np.array_equal(part, picture)
        # Nobody does, but if somebody did, it would be his affair alone.
        parts[1][:] = 0


def test_textures_outlive_their_files(tmp_path):
    parts = shown(tmp_path, [save_texels(tmp_path, picture) for picture in PICTURES])
    for path in tmp_path.iterdir():
        path.unlink()
    assert all(np.array_equal(part, picture) for part, picture in zip(parts, PICTURES, strict=True))


def damage(path, kind):
    content = path.read_bytes()
    if kind == "cut":
        path.write_bytes(content[:-4096])
    else:
        path.write_bytes(content[:333] + bytes([content[333] ^ 4]) + content[334:])


@pytest.mark.usefixtures("how")
@pytest.mark.parametrize("kind", ["cut", "changed"])
def test_damaged_textures_go_and_are_written_again(kind, tmp_path):
    files = [save_texels(tmp_path, picture) for picture in PICTURES]
    damage(tmp_path / files[3].name, kind)
    packed_file._checked.clear()
    with pytest.raises(DamagedError):
        open_texels(tmp_path, files)
    with pytest.raises(OSError, match=files[3].name):
        open_texels(tmp_path, files)
    assert save_texels(tmp_path, PICTURES[3]) == files[3]
    assert np.array_equal(shown(tmp_path, files)[3], PICTURES[3])
