"""Settings of a recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from labeling.runtime.ranges import Count, NonNegative, PictureHeight


@dataclass(frozen=True)
class CollectConfig:
    """Lets a policy move through a world and records what it saw, ready for ``labeling.generate``.

    Each episode becomes a folder DIR/0000, DIR/0001, ... of one frame per step, with the detector's detections and the
    simulator's ground truth. Killed and started again, it goes on where it was; episode i depends on the seed and i
    only.
    """

    out: Path
    """Folder for the episodes; made if it does not exist."""
    env: str = "sbm_gym/Indoor-v0"
    """Gymnasium id of the world."""
    policy: str = "ring"
    """Who moves: "ring" (the thesis' hand-written policy), "next_best_view", "frontier", "spin", "random", "ppo" (the
    trained policy that comes with the project), or "ppo:RUN" (one of agents.train)."""
    detector: str = "simulated"
    """Whose detections guide the agent and are recorded: "simulated", or a real one: "compact",
    "maskrcnn_resnet50_fpn", the folder of a labeling.finetune run, "onnx:FILE" or "package.module:function"."""
    episodes: Count = 4
    """How many episodes the folder holds at the end."""
    seed: NonNegative[int] = 0
    """Decides scenes, starting places and all noise."""
    split: Literal["train", "val", "test", "wide", "endless"] = "train"
    """Scenes to record in: named ones to learn from, to choose settings by and to test on; "wide", many more to test
    on; or "endless", to learn from: more than a robot could ever visit."""
    episodes_per_scene: Count = 1
    """How many episodes, begun in different places, before the next scene. What one of them finds can be labelled in
    the others (labeling.generate --share-scenes)."""
    size: PictureHeight | None = None
    """Height of the recorded pictures, pixels; their shape is the world's. By default 256, as the thesis (256x256 in
    rooms, 768x256 in streets)."""
    workers: Count = 1
    """Processes side by side, one thread each if there are several. What comes out is the same for any number, but for
    the last digits of a network's confidences, which depend on its threads."""
