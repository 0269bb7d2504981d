"""Small valid inputs of all commands, made once by the project's own commands."""

import contextlib
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from experiments.campaign.foreign_inputs import make_furniture, make_onnx, make_outlines
from labeling.core.errors import SbmError
from labeling.formats.atomic import atomic_folder

ENV, SIZE_PX, EPISODES = "sbm_gym/IndoorBuiltin-v0", 64, 2
HYPERPARAMETERS = """\
sbm_gym/IndoorBuiltin-v0:
  n_timesteps: 50
  n_envs: 1
  env_wrapper: moves_and_looks
  policy: ChoicePolicy
  n_steps: 25
  batch_size: 25
  n_epochs: 1
  gamma: 0.9
  learning_rate: lin_0.001
  normalize: {norm_obs: false, norm_reward: true}
  policy_kwargs: {width: 8}
"""
TINY_BOXES = ("--iterations", "4", "--validate-every", "2", "--batch-size", "2", "--num-points", "64")
TINY_BOXES += ("--width", "0.125", "--device", "cpu")
"""Options of a training of boxes that takes a second."""
TINY_MEMORY = ("--iterations", "4", "--validate-every", "2", "--batch-size", "1", "--voxels", "8", "8", "8")
TINY_MEMORY += ("--voxel-m", "0.5", "--channels", "4", "--planes", "8", "--width", "8", "--picture", "32", "32")
TINY_MEMORY += ("--around", "scene", "--device", "cpu")
"""Options of a training of a memory that takes a few seconds."""
TINY_FLOW = ("--iterations", "4", "--validate-every", "2", "--batch-size", "1", "--width", "4", "--device", "cpu")
"""Likewise of flow on it."""


def make_inputs(folder: Path) -> None:
    """Makes what is not there yet; about a minute.

    Args:
        folder: gets a folder for each name in ``MAKERS``.

    Raises:
        SbmError: if one of the project's commands fails on valid input.
    """
    for name, make in MAKERS.items():
        if not (folder / name).exists():
            with atomic_folder(folder / name) as temporary:
                make(temporary, folder)


def run_command(*arguments: str) -> None:
    """Runs a command of the project in a process of its own.

    Raises:
        SbmError: if it fails.
    """
    found = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, check=False)
    if found.returncode != 0:
        raise SbmError(f"{' '.join(arguments)}: exit code {found.returncode}: {found.stderr[-500:]}")


def _episodes(out: Path, _: Path) -> None:
    options = ["--env", ENV, "--episodes", str(EPISODES), "--episodes-per-scene", str(EPISODES)]
    run_command("agents.collect", *options, "--size", str(SIZE_PX), "--out", str(out / "all"))
    for episode in sorted((out / "all").iterdir()):
        if episode.is_dir():
            _shorten(episode, 8)
            episode.rename(out / episode.name)
    shutil.rmtree(out / "all")


def _shorten(episode: Path, views: int) -> None:
    """Leaves the first views of an episode only."""
    transforms = json.loads((episode / "transforms.json").read_text())
    gone = transforms["frames"][views:]
    transforms["frames"] = transforms["frames"][:views]
    (episode / "transforms.json").write_text(json.dumps(transforms))
    for frame in gone:
        for name in ("file_path", "depth_file_path"):
            (episode / frame[name]).unlink()
    for name in ("detections.json", "ground_truth.json"):
        content = json.loads((episode / name).read_text())
        lists = [content] if isinstance(content, list) else [content["annotations"], content["images"]]
        for records in lists:
            records[:] = [one for one in records if one.get("image_id", one.get("id", 0)) < views]
        (episode / name).write_text(json.dumps(content))


def _labels(out: Path, inputs: Path) -> None:
    shutil.copytree(inputs / "episodes", out / "episodes")
    run_command("labeling.generate", str(out / "episodes"), "--out", str(out / "set"))


def _frames(inputs: Path) -> list[tuple[Path, Path, np.ndarray, dict[str, float]]]:
    """Colour, depth, camera to world in OpenCV axes, and intrinsics of the views of an episode."""
    episode = inputs / "episodes" / "0000"
    transforms = json.loads((episode / "transforms.json").read_text())
    found = []
    for frame in transforms["frames"]:
        pose = np.array(frame["transform_matrix"]) @ np.diag([1.0, -1.0, -1.0, 1.0])
        camera = {name: frame.get(name, transforms.get(name)) for name in ("fl_x", "fl_y", "cx", "cy")}
        found.append((episode / frame["file_path"], episode / frame["depth_file_path"], pose, camera))
    return found


def _scannet(out: Path, inputs: Path) -> None:
    room = out / "room"
    for name in ("color", "depth", "pose", "intrinsic"):
        (room / name).mkdir(parents=True)
    for number, (colour, depth, pose, camera) in enumerate(_frames(inputs)):
        shutil.copy(colour, room / "color" / f"{number}.png")
        shutil.copy(depth, room / "depth" / f"{number}.png")
        np.savetxt(room / "pose" / f"{number}.txt", pose)
        matrix = np.eye(4)
        matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2] = camera.values()
        for name in ("intrinsic_color.txt", "intrinsic_depth.txt"):
            np.savetxt(room / "intrinsic" / name, matrix)
    shutil.copy(inputs / "episodes" / "0000" / "detections.json", room)
    shutil.copy(inputs / "episodes" / "0000" / "episode.json", room)


def _tum(out: Path, inputs: Path) -> None:
    from scipy.spatial.transform import Rotation

    room = out / "room"
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    for number, (colour, depth, pose, camera) in enumerate(_frames(inputs)):
        for name, file in (("rgb", colour), ("depth", depth)):
            (room / name).mkdir(parents=True, exist_ok=True)
            shutil.copy(file, room / name / f"{number}.png")
            lists[name].append(f"{number}.0 {name}/{number}.png")
        numbers = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
        lists["groundtruth"].append(" ".join(map(str, [float(number), *numbers])))
        (room / "intrinsics.txt").write_text(" ".join(map(str, camera.values())) + "\n")
    for name, lines in lists.items():
        (room / f"{name}.txt").write_text("# made\n" + "\n".join(lines) + "\n")


def _run(out: Path, _: Path) -> None:
    (out / "ppo.yaml").write_text(HYPERPARAMETERS)
    options = ["--hyperparams", str(out / "ppo.yaml"), "--scenes", "1", "--validation-scenes", "1"]
    options += ["--eval-episodes", "1", "--compare-episodes", "0", "--processes", "1"]
    run_command("agents.train", "--env", ENV, *options, "--out", str(out / "run"))
    with contextlib.suppress(FileNotFoundError):
        shutil.rmtree(out / "run" / "tensorboard")


def _network(out: Path, inputs: Path) -> None:
    options = ["--iterations", "2", "--validate-every", "2", "--batch-size", "1", "--device", "cpu"]
    run_command("labeling.finetune", str(inputs / "labels" / "set"), *options, "--out", str(out / "run"))
    shutil.copytree(inputs / "episodes" / "0000", out / "episode")


def _boxes(out: Path, inputs: Path) -> None:
    run_command("labeling.train3d", str(inputs / "labels" / "set"), *TINY_BOXES, "--out", str(out / "run"))
    shutil.copytree(inputs / "episodes", out / "episodes")


def _memory(out: Path, inputs: Path) -> None:
    run_command("labeling.train_memory", str(inputs / "episodes"), *TINY_MEMORY, "--out", str(out / "run"))
    shutil.copytree(inputs / "episodes" / "0000", out / "episode")


def _atlas(out: Path, _: Path) -> None:
    options = ["--env", ENV, "--split", "endless", "--scenes", "2", "--detector", "simulated"]
    run_command("sbm_gym.build_atlas", *options, "--out", str(out / "atlas"))
    (out / "ppo.yaml").write_text(HYPERPARAMETERS)


MAKERS: dict[str, Callable[[Path, Path], None]] = {
    "episodes": _episodes,
    "labels": _labels,
    "scannet": _scannet,
    "tum": _tum,
    "policy": _run,
    "network": _network,
    "boxes": _boxes,
    "memory": _memory,
    "outlines": make_outlines,
    "onnx": make_onnx,
    "furniture": make_furniture,
    "atlas": _atlas,
}
"""Folders of inputs by name, each made from those before it."""
