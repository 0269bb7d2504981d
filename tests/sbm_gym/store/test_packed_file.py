"""Files of arrays: what is read is what was written, or nothing."""

import numpy as np
import pytest

from sbm_gym.store.packed_file import ALIGNMENT, DamagedError, read_content, read_packed, write_packed

ARRAYS = [
    np.arange(40, dtype=np.float32).reshape(4, 5, 2),
    np.zeros((0, 3)),
    np.array([True, False, True]),
    np.arange(9, dtype=np.int64),
]
CONTENT = {"name": "a scene", "numbers": [1, 2.5, None]}


def test_content_and_arrays_come_back(tmp_path):
    write_packed(tmp_path / "a.scene", CONTENT, ARRAYS)
    content, arrays = read_packed(tmp_path / "a.scene")
    assert content == read_content(tmp_path / "a.scene") == CONTENT
    assert [path.name for path in tmp_path.iterdir()] == ["a.scene"]
    for array, expected in zip(arrays, ARRAYS, strict=True):
        assert array.dtype == expected.dtype
        assert array.shape == expected.shape
        assert np.array_equal(array, expected)
        assert array.ctypes.data % ALIGNMENT == 0 or array.size == 0


def test_what_is_written_to_an_array_stays_in_this_process(tmp_path):
    write_packed(tmp_path / "a.scene", CONTENT, ARRAYS)
    for _ in range(2):
        _, arrays = read_packed(tmp_path / "a.scene")
        assert arrays[3].tolist() == list(range(9))
        arrays[3][:] = -1


def test_whoever_has_a_file_open_keeps_it(tmp_path):
    path = tmp_path / "a.scene"
    write_packed(path, CONTENT, ARRAYS)
    _, arrays = read_packed(path)
    write_packed(path, CONTENT, [np.ones(5)])
    path.unlink()
    assert np.array_equal(arrays[0], ARRAYS[0])


def test_a_file_in_the_place_of_one_that_was_checked_is_checked(tmp_path):
    """File systems give the number of a file that is gone to the next one."""
    for number in range(20):
        path = tmp_path / f"{number}.scene"
        write_packed(path, CONTENT, ARRAYS)
        read_packed(path)
        whole = path.read_bytes()
        path.unlink()
        path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
        with pytest.raises(DamagedError):
            read_packed(path)
        path.unlink()


def test_any_damage_is_found(tmp_path):
    path = tmp_path / "a.scene"
    write_packed(path, CONTENT, ARRAYS)
    read_packed(path)
    whole = path.read_bytes()
    damaged = [whole[:length] for length in range(0, len(whole), 7)] + [whole + b"\0"]
    for at in range(len(whole)):
        for bit in (0x01, 0x80):
            damaged.append(whole[:at] + bytes([whole[at] ^ bit]) + whole[at + 1 :])
    for number, content in enumerate(damaged):
        broken = tmp_path / f"{number}.scene"
        broken.write_bytes(content)
        with pytest.raises(DamagedError):
            read_packed(broken)
    for content in (b"", whole[:10], b"x" * 100):
        path.write_bytes(content)
        with pytest.raises(DamagedError):
            read_content(path)
