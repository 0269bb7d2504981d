"""Anything malformed in an episode gets one error that names file and field."""

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError
from labeling.io.episodes import read_episode, write_episode

from .small_episode import HEIGHT_PX, WIDTH_PX, make_episode


@pytest.fixture
def folder(tmp_path) -> Path:
    write_episode(tmp_path / "episode", make_episode())
    return tmp_path / "episode"


def edit(path: Path, change: Callable[[Any], Any]) -> None:
    """Changes the content of a JSON file in place, or replaces it by what the change returns."""
    content = json.loads(path.read_text())
    returned = change(content)
    path.write_text(json.dumps(content if returned is None else returned))


def put(*keys_and_value):
    """A change that sets one value deep inside."""
    *keys, last, value = keys_and_value

    def change(content):
        for key in keys:
            content = content[key]
        content[last] = value

    return change


def drop(*keys):
    """A change that removes one value deep inside."""

    def change(content):
        for key in keys[:-1]:
            content = content[key]
        del content[keys[-1]]

    return change


def spoiled_matrix(value):
    return [[value, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


RLE = {"size": [HEIGHT_PX, WIDTH_PX], "counts": [HEIGHT_PX * WIDTH_PX]}

MALFORMED = [
    ("transforms.json", drop("frames"), "frames: is missing"),
    ("transforms.json", put("frames", []), "frames: has no frames"),
    ("transforms.json", put("frames", {}), "frames: must be a list"),
    ("transforms.json", put("frames", 1, 7), r"frames\[1\]: must be a JSON object"),
    ("transforms.json", lambda content: [content], "must be a JSON object"),
    ("transforms.json", drop("fl_x"), "fl_x: is missing"),
    ("transforms.json", put("fl_x", 0), "fl_x: must be above 0"),
    ("transforms.json", put("fl_x", "600"), "fl_x: must be a finite number"),
    ("transforms.json", put("cx", float("nan")), "cx: must be a finite number"),
    ("transforms.json", put("cy", True), "cy: must be a finite number"),
    ("transforms.json", put("w", 8), "w: says 8 pixels"),
    ("transforms.json", put("depth_unit_scale_factor", -1), "depth_unit_scale_factor: must be above 0"),
    ("transforms.json", put("depth_unit_scale_factor", 1e300), "depth_unit_scale_factor: "),
    ("transforms.json", put("frames", 0, "fl_x", -3), r"frames\[0\].fl_x: must be above 0"),
    ("transforms.json", drop("frames", 2, "file_path"), r"frames\[2\].file_path: is missing"),
    ("transforms.json", put("frames", 2, "file_path", ""), r"frames\[2\].file_path: must be a non-empty text"),
    ("transforms.json", put("frames", 2, "file_path", 3), r"frames\[2\].file_path: must be a non-empty text"),
    ("transforms.json", put("frames", 2, "file_path", "rgb/nope.png"), r"frames\[2\].file_path: .*does not exist"),
    ("transforms.json", put("frames", 2, "file_path", "rgb"), r"frames\[2\].file_path: .*does not exist"),
    ("transforms.json", put("frames", 2, "file_path", "../outside.png"), r"frames\[2\].file_path: .*leads out"),
    ("transforms.json", put("frames", 2, "file_path", "/etc/hostname"), r"frames\[2\].file_path: .*leads out"),
    ("transforms.json", put("frames", 2, "file_path", "x" * 5000), r"frames\[2\].file_path: .*cannot be a file name"),
    ("transforms.json", put("frames", 2, "file_path", "\ud800"), r"frames\[2\].file_path: must be Unicode"),
    ("transforms.json", put("frames", 2, "depth_file_path", "../x"), r"frames\[2\].depth_file_path: .*leads out"),
    ("transforms.json", drop("frames", 1, "transform_matrix"), r"frames\[1\].transform_matrix: is missing"),
    ("transforms.json", put("frames", 1, "transform_matrix", [[1]]), r"frames\[1\].transform_matrix: must have shape"),
    ("transforms.json", put("frames", 1, "transform_matrix", [[1], []]), r"transform_matrix: must be nested lists"),
    ("transforms.json", put("frames", 1, "transform_matrix", "I"), r"transform_matrix: must be nested lists"),
    ("transforms.json", put("frames", 1, "transform_matrix", 0, 0, "1"), r"transform_matrix: must be nested lists"),
    ("transforms.json", put("frames", 1, "transform_matrix", 0, 0, None), r"transform_matrix: must be nested lists"),
    ("transforms.json", put("frames", 1, "transform_matrix", spoiled_matrix(2.0)), "transform_matrix: is not a rigid"),
    ("transforms.json", put("frames", 1, "transform_matrix", spoiled_matrix(-1)), "transform_matrix: is not a rigid"),
    ("transforms.json", put("frames", 1, "transform_matrix", spoiled_matrix(1e300)), "matrix: is not a rigid"),
    ("transforms.json", put("frames", 1, "transform_matrix", 3, 0, 0.5), "transform_matrix: is not a rigid"),
    ("transforms.json", put("frames", 1, "transform_matrix", 0, 3, float("nan")), "transform_matrix: holds NaN"),
    ("transforms.json", put("frames", 1, "transform_matrix", 0, 3, float("inf")), "transform_matrix: holds NaN"),
    ("episode.json", put("seed", float("-inf")), "episode.json: holds NaN or infinity"),
    ("detections.json", lambda content: {}, "detections.json: must be a list"),
    ("detections.json", put(0, []), r"\[0\]: must be a JSON object"),
    ("detections.json", put(1, "category_id", 99), r"\[1\].category_id: unknown category id 99; known: 1 plant"),
    ("detections.json", put(1, "category_id", "1"), r"\[1\].category_id: must be a whole number"),
    ("detections.json", put(1, "category_id", 1.0), r"\[1\].category_id: must be a whole number"),
    ("detections.json", put(1, "image_id", 99), r"\[1\].image_id: unknown image id 99"),
    ("detections.json", put(1, "score", 1.5), r"\[1\].score: a score lies in \[0, 1\]"),
    ("detections.json", put(1, "score", float("nan")), r"\[1\].score: must be a finite number"),
    ("detections.json", put(1, "segmentation", 3), r"\[1\].segmentation: must be a JSON object"),
    ("detections.json", put(1, "segmentation", [3]), r"\[1\].segmentation: a polygon mask is a list of lists"),
    ("detections.json", put(1, "segmentation", [0, 0, 1, 0, 1, 1]), r"\[1\].segmentation: a polygon mask is a list"),
    ("detections.json", put(1, "segmentation", [[0, 0, 1, True, 1, 1]]), r"\[1\].segmentation: a polygon mask is a"),
    ("detections.json", put(1, "segmentation", [[0, 0, 3, 4]]), r"\[1\].segmentation: a polygon needs .* not 4"),
    ("detections.json", put(1, "segmentation", [[0, 0, 3, 4, 5, 5, 6]]), r"\[1\].segmentation: a polygon needs"),
    ("detections.json", put(1, "segmentation", [[0, 0, 1e9, 0, 1, 1]]), r"\[1\].segmentation: .* far outside the pic"),
    ("detections.json", put(1, "segmentation", [[0, 0, float("nan"), 0, 1, 1]]), r"\[1\].segmentation: .* far outside"),
    ("detections.json", put(1, "segmentation", 3), r"\[1\].segmentation: must be a JSON object"),
    (
        "detections.json",
        put(1, "segmentation", "size", [5, 8]),
        r"\[1\].segmentation.size: must be the picture.s \[5, 7\].*, not \[5, 8\]",
    ),
    ("detections.json", put(1, "segmentation", "size", [10**9, 10**9]), r"\[1\].segmentation.size: must be the pic"),
    ("detections.json", put(1, "segmentation", "size", None), r"\[1\].segmentation.size: must be the pic"),
    ("detections.json", put(1, "segmentation", "counts", "zz"), r"\[1\].segmentation: RLE"),
    ("detections.json", put(1, "segmentation", "counts", [1, 2]), r"\[1\].segmentation: RLE runs do not fill"),
    ("ground_truth.json", lambda content: [], "ground_truth.json: must be a JSON object"),
    ("ground_truth.json", drop("annotations"), "annotations: is missing"),
    ("ground_truth.json", put("annotations", 1, "category_id", 4), r"annotations\[1\].category_id: unknown"),
    ("ground_truth.json", put("annotations", 1, "image_id", -1), r"annotations\[1\].image_id: unknown image id"),
    ("ground_truth.json", put("annotations", 1, "instance_id", None), r"annotations\[1\].instance_id: must be a whole"),
    ("ground_truth.json", put("annotations", 1, "amodal_segmentation", {}), r"annotations\[1\].amodal_segmentation: "),
    ("ground_truth.json", put("annotations", 1, "box_3d", "extent", [1, 2]), r"annotations\[1\].box_3d.extent: must"),
    ("ground_truth.json", put("annotations", 1, "box_3d", 5), r"annotations\[1\].box_3d: must be a JSON object"),
    ("ground_truth.json", put("images", 0, "file_name", "rgb/9.png"), r"images\[0\].file_name: .*not a frame"),
    ("ground_truth.json", put("categories", 0, "name", None), r"categories\[0\].name: must be a non-empty text"),
    ("ground_truth.json", put("categories", 0, "id", "1"), r"categories\[0\].id: must be a whole number"),
    ("episode.json", lambda content: 3, "episode.json: must be a JSON object"),
    ("episode.json", put("categories", 7), "categories: must be a list"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "change", "message"), MALFORMED, ids=[f"{n}-{m[:40]}" for n, _, m in MALFORMED])
def test_malformed_json_is_named_by_file_and_field(folder, name, change, message):
    edit(folder / name, change)
    with pytest.raises(EpisodeFormatError, match=message) as caught:
        read_episode(folder)
    assert str(caught.value).startswith(f"{folder / name}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "nonsense", "[" * 100_000, '{"a": ' + "9" * 5000 + "}", "\ufeff{}"])
@pytest.mark.parametrize("name", ["transforms.json", "detections.json", "ground_truth.json", "episode.json"])
def test_what_is_not_json_is_named(folder, name, text):
    (folder / name).write_text(text, encoding="utf-8")
    with pytest.raises(EpisodeFormatError, match=f"{name}: not valid JSON"):
        read_episode(folder)


def test_what_is_not_text_is_named(folder):
    (folder / "detections.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(EpisodeFormatError, match=r"detections\.json: cannot be read"):
        read_episode(folder)


def test_a_folder_without_transforms_is_named(folder):
    (folder / "transforms.json").unlink()
    with pytest.raises(EpisodeFormatError, match=r"no recording here; looked for transforms\.json"):
        read_episode(folder)


@pytest.mark.parametrize("name", ["rgb/001.png", "depth/001.png"])
def test_a_missing_frame_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(EpisodeFormatError, match=rf"frames\[1\]\..*{name}"):
        read_episode(folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rgb/001.png", "depth/001.png"])
def test_a_png_cut_anywhere_is_named(folder, name):
    whole = (folder / name).read_bytes()
    for length in range(len(whole)):
        (folder / name).write_bytes(whole[:length])
        with pytest.raises(EpisodeFormatError, match=name):
            read_episode(folder)


@pytest.mark.parametrize("name", ["rgb/001.png", "depth/001.png"])
def test_a_file_that_is_no_picture_is_named(folder, name):
    (folder / name).write_text("hello")
    with pytest.raises(EpisodeFormatError, match=f"{name}: not a picture"):
        read_episode(folder)


def test_a_png_that_claims_a_huge_size_is_refused_before_it_takes_memory(folder):
    png = bytearray((folder / "rgb/001.png").read_bytes())
    png[16:24] = (60_000).to_bytes(4, "big") * 2
    (folder / "rgb/001.png").write_bytes(png)
    with pytest.raises(EpisodeFormatError, match=r"rgb/001\.png: 60000x60000 pixels are more than"):
        read_episode(folder)


@pytest.mark.parametrize("name", ["rgb/001.png", "depth/001.png"])
def test_a_png_part_that_claims_to_be_huge_is_refused_before_it_takes_memory(folder, name, monkeypatch):
    png = bytearray((folder / name).read_bytes())
    pixels = png.index(b"IDAT") - 4
    png[pixels : pixels + 4] = (0xFFFFFFF0).to_bytes(4, "big")
    (folder / name).write_bytes(bytes(png))
    decode, decoded = cv2.imdecode, []
    monkeypatch.setattr(cv2, "imdecode", lambda content, how: (decoded.append(bytes(content)), decode(content, how))[1])
    with pytest.raises(EpisodeFormatError, match=f"{name}: the PNG's parts reach beyond its {len(png)} bytes"):
        read_episode(folder)
    assert bytes(png) not in decoded


def test_the_shortest_files_that_look_like_a_png_are_named(folder):
    (folder / "rgb/001.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(4) + b"IEND")
    with pytest.raises(EpisodeFormatError, match="truncated"):
        read_episode(folder)


def test_a_link_out_of_the_episode_is_refused(folder):
    (folder.parent / "outside.png").write_bytes((folder / "rgb/001.png").read_bytes())
    (folder / "rgb/001.png").unlink()
    (folder / "rgb/001.png").symlink_to(folder.parent / "outside.png")
    with pytest.raises(EpisodeFormatError, match=r"frames\[1\]\.file_path: .*leads out"):
        read_episode(folder)


@pytest.mark.parametrize(
    ("name", "image", "message"),
    [
        ("rgb/001.png", np.zeros((5, 8, 3), np.uint8), "is 8x5 pixels, but the first view is 7x5"),
        ("rgb/001.png", np.zeros((5, 7, 3), np.uint16), "8 bits"),
        ("depth/001.png", np.zeros((4, 7), np.uint16), "depth is 7x4 pixels but its colour picture is 7x5"),
        ("depth/001.png", np.zeros((5, 7), np.uint8), "16-bit"),
        ("depth/001.png", np.zeros((5, 7, 3), np.uint16), "single-channel"),
    ],
)
def test_pictures_of_another_kind_are_named(folder, name, image, message):
    cv2.imwrite(str(folder / name), image)
    with pytest.raises(EpisodeFormatError, match=rf"{name}: .*{message}"):
        read_episode(folder)


@pytest.mark.parametrize("channels", [1, 4])
def test_grey_and_transparent_colour_is_read_as_rgb(folder, channels):
    image = np.random.default_rng(0).integers(0, 256, (5, 7, channels), dtype=np.uint8)
    cv2.imwrite(str(folder / "rgb/001.png"), image)
    rgb = read_episode(folder).rgb[1]
    np.testing.assert_array_equal(rgb, np.repeat(image, 3, axis=2) if channels == 1 else image[..., 2::-1])


# Fuzzing -------------------------------------------------------------------------------------------------------------

json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([0, 1, 2, -1, 10**30, 10**400, 0.5, 1e308, -1e-308, "", "rgb/000.png", "..", "\x00", "\ud800"])
    | st.floats()
    | st.text(max_size=6),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory) -> tuple[Path, dict[str, str]]:
    """An episode whose JSON files may be overwritten at will, and their sound content."""
    folder = tmp_path_factory.mktemp("fuzz") / "episode"
    write_episode(folder, make_episode(views=2))
    return folder, {path.name: path.read_text() for path in folder.glob("*.json")}


def read_or_refuse(folder: Path, named: str) -> Episode | None:
    """The episode, or None if it was refused by a format error that names the place; anything else is raised."""
    try:
        return read_episode(folder)
    except EpisodeFormatError as error:
        problem = str(error)
    assert named in problem
    return None


def spoil(data: st.DataObject, content: Any) -> Any:
    """Walks down at random and replaces, removes or repeats what it finds there."""
    content = {"root": copy.deepcopy(content)}
    parent: Any = content
    key: Any = "root"
    while isinstance(parent[key], dict | list) and parent[key] and data.draw(st.integers(0, 5), label="deeper"):
        parent = parent[key]
        key = data.draw(st.sampled_from(sorted(parent) if isinstance(parent, dict) else range(len(parent))))
    if parent is not content and data.draw(st.booleans(), label="remove"):
        del parent[key]
    else:
        parent[key] = data.draw(json_values)
    return content["root"]


@pytest.mark.slow
@settings(max_examples=400)
@given(
    data=st.data(), name=st.sampled_from(["transforms.json", "detections.json", "ground_truth.json", "episode.json"])
)
def test_whatever_the_json_holds_only_format_errors_come_out(fuzzed, data, name):
    folder, sound = fuzzed
    for file, text in sound.items():
        (folder / file).write_text(text)
    (folder / name).write_text(json.dumps(spoil(data, json.loads(sound[name]))))
    episode = read_or_refuse(folder, named=str(folder))
    if episode is None:
        return
    assert np.isfinite(episode.intrinsics).all()
    assert np.isfinite(episode.camera_to_world).all()
    assert np.isfinite(episode.depth_m).all()
    for label in [*(episode.detections or ()), *(episode.ground_truth or ())]:
        assert 0 <= label.view_index < episode.num_views


@pytest.mark.slow
@settings(max_examples=200)
@given(data=st.data(), name=st.sampled_from(["rgb/001.png", "depth/001.png"]))
def test_whatever_a_picture_holds_only_format_errors_come_out(fuzzed, data, name):
    folder, sound = fuzzed
    for file, text in sound.items():
        (folder / file).write_text(text)
    whole = (folder / name).read_bytes()
    spoiled = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        spoiled[data.draw(st.integers(0, len(spoiled) - 1))] = data.draw(st.integers(0, 255))
    (folder / name).write_bytes(bytes(spoiled))
    read_or_refuse(folder, named=name)
    (folder / name).write_bytes(whole)
