"""Writes one episode the way other tools would: the same views in every layout, so that all readers must agree."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from labeling.core.episode import Episode
from labeling.core.geometry import OPENGL_TO_OPENCV


def write_colour(path: Path, rgb: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), rgb[..., ::-1])


def write_depth(path: Path, depth_m: np.ndarray, unit_m: float = 0.001) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.rint(depth_m.astype(float) / unit_m).astype(np.uint16))


def intrinsics_record(k: np.ndarray) -> dict[str, float]:
    return {"fl_x": k[0, 0], "fl_y": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}


def write_polycam(folder: Path, episode: Episode) -> None:
    """As nerfstudio's Polycam importer: intrinsics per frame, ``./images``, depth folder, no shared fields."""
    frames = []
    for view in range(episode.num_views):
        name = f"frame_{view + 1:05d}"
        write_colour(folder / "images" / f"{name}.png", episode.rgb[view])
        write_depth(folder / "depth" / f"{name}.png", episode.depth_m[view])
        frames.append(
            {
                **intrinsics_record(episode.intrinsics[view]),
                "w": episode.size[1],
                "h": episode.size[0],
                "file_path": f"./images/{name}.png",
                "depth_file_path": f"./depth/{name}.png",
                "transform_matrix": (episode.camera_to_world[view] @ OPENGL_TO_OPENCV).tolist(),
            }
        )
    content = {"camera_model": "OPENCV", "orientation_override": "none", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content))


def write_record3d(folder: Path, episode: Episode) -> None:
    """Shared intrinsics, names without extension, poses of a world whose Y axis is up, zero distortion stated."""
    to_y_up = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    frames = []
    for view in range(episode.num_views):
        write_colour(folder / "rgb" / f"{view}.png", episode.rgb[view])
        write_depth(folder / "depth" / f"{view}.png", episode.depth_m[view])
        frames.append(
            {
                "file_path": f"rgb/{view}",
                "depth_file_path": f"depth/{view}",
                "transform_matrix": (to_y_up @ episode.camera_to_world[view] @ OPENGL_TO_OPENCV).tolist(),
            }
        )
    shared = {"k1": 0.0, "k2": 0, "p1": 0.0, "p2": 0.0, **intrinsics_record(episode.intrinsics[0])}
    (folder / "transforms.json").write_text(json.dumps({**shared, "frames": frames}))


def write_scaled_nerfstudio(folder: Path, episode: Episode) -> None:
    """Poses that were turned and shrunk to the unit cube, which ``applied_transform`` and ``applied_scale`` tell."""
    frames = []
    for view in range(episode.num_views):
        write_colour(folder / "images" / f"{view:03d}.png", episode.rgb[view])
        (folder / "depths").mkdir(exist_ok=True)
        np.save(folder / "depths" / f"{view:03d}.npy", episode.depth_m[view].astype(np.float64) / 0.25)
        pose = episode.camera_to_world[view] @ OPENGL_TO_OPENCV
        pose[:3, 3] *= 0.5
        frames.append(
            {
                "file_path": f"images/{view:03d}.png",
                "depth_file_path": f"depths/{view:03d}.npy",
                "transform_matrix": pose.tolist(),
            }
        )
    content = {
        **intrinsics_record(episode.intrinsics[0]),
        "applied_transform": [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]],
        "applied_scale": 0.5,
        "depth_unit_scale_factor": 0.25,
        "frames": frames,
    }
    (folder / "transforms.json").write_text(json.dumps(content))


def rotation_to_xyzw(rotation: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat()


def write_tum(folder: Path, episode: Episode) -> None:
    """Time stamps of colour, depth and motion capture that nearly agree; depth in units of 0.2 mm."""
    start_s = 1305031102.175304
    rows: dict[str, list[str]] = {name: ["# made by a test", "# timestamp ..."] for name in ("rgb", "depth", "truth")}
    for view in range(episode.num_views):
        colour_s, depth_s = start_s + view * 0.1, start_s + view * 0.1 + 0.0125
        write_colour(folder / "rgb" / f"{colour_s:.6f}.png", episode.rgb[view])
        write_depth(folder / "depth" / f"{depth_s:.6f}.png", episode.depth_m[view], 1 / 5000)
        rows["rgb"].append(f"{colour_s:.6f} rgb/{colour_s:.6f}.png")
        rows["depth"].append(f"{depth_s:.6f} depth/{depth_s:.6f}.png")
        pose = episode.camera_to_world[view]
        numbers = [*pose[:3, 3], *rotation_to_xyzw(pose[:3, :3]) * (-1) ** view]
        # The camera rests around each picture, so that the pose between two samples is known.
        for shift_s in (-0.004, 0.006):
            rows["truth"].append(f"{colour_s + shift_s:.6f} " + " ".join(f"{value:.12g}" for value in numbers))
    for name, file in (("rgb", "rgb.txt"), ("depth", "depth.txt"), ("truth", "groundtruth.txt")):
        (folder / file).write_text("\n".join(rows[name]) + "\n")
    k = episode.intrinsics[0]
    (folder / "intrinsics.txt").write_text(
        f"# fx fy cx cy\n{k[0, 0]:.17g} {k[1, 1]:.17g} {k[0, 2]:.17g} {k[1, 2]:.17g}\n"
    )


def write_scannet(folder: Path, episode: Episode) -> None:
    """Numbered files, not padded with zeros; matrices as numpy.savetxt writes them."""
    for view in range(episode.num_views):
        write_colour(folder / "color" / f"{view * 7}.png", episode.rgb[view])
        write_depth(folder / "depth" / f"{view * 7}.png", episode.depth_m[view])
        (folder / "pose").mkdir(exist_ok=True)
        np.savetxt(folder / "pose" / f"{view * 7}.txt", episode.camera_to_world[view], fmt="%.12f")
    (folder / "intrinsic").mkdir()
    k = np.eye(4)
    k[:3, :3] = episode.intrinsics[0]
    for name, matrix in (
        ("intrinsic_color", k),
        ("intrinsic_depth", k),
        ("extrinsic_color", np.eye(4)),
        ("extrinsic_depth", np.eye(4)),
    ):
        np.savetxt(folder / "intrinsic" / f"{name}.txt", matrix, fmt="%.12f")


WRITERS: dict[str, Callable[[Path, Episode], None]] = {
    "polycam": write_polycam,
    "record3d": write_record3d,
    "nerfstudio": write_scaled_nerfstudio,
    "tum": write_tum,
    "scannet": write_scannet,
}


def written(tmp_path: Path, layout: str, episode: Episode) -> Path:
    folder = tmp_path / layout
    folder.mkdir()
    WRITERS[layout](folder, episode)
    return folder


def assert_same_views(found: Episode, expected: Episode) -> None:
    np.testing.assert_array_equal(found.rgb, expected.rgb)
    np.testing.assert_allclose(found.depth_m, expected.depth_m, atol=1e-6)
    np.testing.assert_allclose(found.intrinsics, expected.intrinsics, atol=1e-9)
    np.testing.assert_allclose(found.camera_to_world, expected.camera_to_world, atol=1e-7)


def picture(file: Path) -> np.ndarray:
    image = cv2.imread(str(file))
    assert image is not None
    return image
