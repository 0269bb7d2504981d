import os
from pathlib import Path

import numpy as np
import pytest

from labeling.formats.ply import hues, read_ply, write_ply


def write(path: Path, count: int = 50):
    rng = np.random.default_rng(0)
    points, colours = rng.normal(size=(count, 3)), rng.random((count, 3))
    labels, probability = rng.integers(0, 4, count), rng.random(count)
    write_ply(path, points.astype(np.float32), colours, labels, probability)
    return points, colours, labels, probability


def test_another_program_reads_the_points_and_colours(tmp_path: Path) -> None:
    import trimesh

    points, colours, labels, _ = write(tmp_path / "cloud.ply")
    cloud = trimesh.load(tmp_path / "cloud.ply")
    np.testing.assert_allclose(cloud.vertices, points, atol=1e-6)
    plain = labels == 0
    np.testing.assert_allclose(np.asarray(cloud.colors)[plain, :3], 255 * colours[plain], atol=1)


def test_labels_come_back(tmp_path: Path) -> None:
    _, _, labels, probability = write(tmp_path / "cloud.ply")
    back = read_ply(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(back["label"], labels)
    np.testing.assert_allclose(back["probability"], probability, atol=1e-7)


def test_an_empty_cloud_is_a_file_too(tmp_path: Path) -> None:
    write_ply(tmp_path / "e.ply", np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, int), np.zeros(0))
    assert len(read_ply(tmp_path / "e.ply")) == 0


def test_objects_have_colours_that_differ() -> None:
    colours = hues(np.arange(1, 9))
    distance = np.abs(colours[:, None] - colours[None]).sum(axis=-1) + 9 * np.eye(8)
    assert distance.min() > 0.25


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda content: content[:-3], "truncated"),
        (lambda content: content[:60], "truncated"),
        (lambda content: content.replace(b"vertex 50", b"vertex 10000000000000"), "truncated .*10000000000000 points"),
        (
            lambda content: content.replace(b"binary_little_endian", b"ascii").replace(
                b"vertex 50", b"vertex 1" + b"0" * 13
            ),
            "truncated .*10000000000000 points",
        ),
        (lambda content: b"", "PLY"),
        (lambda content: b"not a cloud\n" + content, "PLY"),
        (lambda content: content.replace(b"int label", b"int owner"), "no label"),
        (lambda content: content.replace(b"element vertex", b"element corner"), "PLY"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, damage, said: str) -> None:
    write(tmp_path / "cloud.ply")
    (tmp_path / "cut.ply").write_bytes(damage((tmp_path / "cloud.ply").read_bytes()))
    with pytest.raises(ValueError, match=said):
        read_ply(tmp_path / "cut.ply")


def test_the_bytes_are_those_written_before_plyfile(tmp_path: Path) -> None:
    """Clouds of earlier label sets stay equal, byte by byte: a header of eight properties, then packed records."""
    write(tmp_path / "cloud.ply", 3)
    header, _, body = (tmp_path / "cloud.ply").read_bytes().partition(b"end_header\n")
    kinds = [
        "float x",
        "float y",
        "float z",
        "uchar red",
        "uchar green",
        "uchar blue",
        "int label",
        "float probability",
    ]
    lines = ["ply", "format binary_little_endian 1.0", "element vertex 3", *(f"property {kind}" for kind in kinds), ""]
    assert header.decode() == "\n".join(lines)
    assert body == read_ply(tmp_path / "cloud.ply").tobytes()


def test_a_pipe_is_refused_instead_of_waited_for(tmp_path):
    os.mkfifo(tmp_path / "cloud.ply")
    with pytest.raises(OSError, match="is a pipe or a device"):
        read_ply(tmp_path / "cloud.ply")
