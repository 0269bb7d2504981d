"""Settings of a recording."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tyro

from labeling.cluster.cluster_config import ClusterConfig
from labeling.runtime.ranges import Count, NonNegative, PictureHeight
from sbm_gym.sensors.noise_config import Sensor, SensorNoise
from sbm_gym.worlds.splits import Split


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
    """Who moves: "ring" (the thesis' hand-written policy), "next_best_view", "frontier", "spin", "random", "ppo",
    "ppo_evidence" and "ppo_unmapped" (trained policies that come with the project), or "ppo:RUN" (one of agents.train).
    """
    detector: str = "simulated"
    """Whose detections guide the agent and are recorded: "simulated", or a real one: "compact",
    "maskrcnn_resnet50_fpn", the folder of a labeling.finetune run, "onnx:FILE" or "package.module:function"."""
    episodes: Count = 4
    """How many episodes the folder holds at the end."""
    seed: NonNegative[int] = 0
    """Decides scenes, starting places and all noise."""
    split: Split = "train"
    """Scenes to record in: named ones to learn from, to choose settings by and to test on; "wide" and "final", many
    more to test on; or "endless", to learn from: more than a robot could ever visit."""
    unseen_models: bool = False
    """Keep furniture and vehicles that validation, test and final scenes show out of all others, and final ones from
    showing any other."""
    episodes_per_scene: Count = 1
    """How many episodes, begun in different places, before the next scene. What one of them finds can be labelled in
    the others (labeling.generate --share-scenes)."""
    size: PictureHeight | None = None
    """Height of the recorded pictures, pixels; their shape is the world's. By default 256, as the thesis (256x256 in
    rooms, 768x256 in streets)."""
    moving: NonNegative[int] = 0
    """Things that move while the robot does, at most: vehicles that drive, furniture that is carried. Where they are
    is recorded, too (motion.json)."""
    shifted: NonNegative[int] = 0
    """Pieces of furniture, at most, that stand elsewhere than in the last episode in the same scene; in rooms only."""
    moving_speed: NonNegative[float] = 1.0
    """Factor of the speed of what moves; with 0 the same things stand still where they would have set out."""
    sensor_noise: Sensor = "ideal"
    """Whose depth is recorded: the simulator's own ("ideal"), or as a "kinect" (structured light), a "stereo" camera or
    a "lidar" would have measured it. The policy sees without noise, here and below: recordings of one seed show the
    same walk."""
    pose_noise_deg: NonNegative[float] = 0.0
    """Error of each view's recorded orientation, independent of the others, degrees (root mean square)."""
    pose_noise_m: NonNegative[float] = 0.0
    """Error of each view's recorded position, independent of the others, metres (root mean square)."""
    pose_drift_deg: NonNegative[float] = 0.0
    """How far the recorded orientation has wandered off at the last view, degrees (root mean square)."""
    pose_drift_m: NonNegative[float] = 0.0
    """How far the recorded position has wandered off at the last view, metres (root mean square)."""
    workers: Count = 1
    """Processes side by side, one thread each if there are several. What comes out is the same for any number, but for
    the last digits of a network's confidences, which depend on its threads."""
    where: tyro.conf.OmitArgPrefixes[ClusterConfig] = field(default_factory=ClusterConfig)

    @property
    def motion(self) -> dict[str, Any]:
        """What moves, as arguments of the environment: none where nothing does, since others may not know them."""
        if not (self.moving or self.shifted):
            return {}
        return {"moving": self.moving, "shifted": self.shifted, "moving_speed": self.moving_speed}

    @property
    def world(self) -> dict[str, Any]:
        """Arguments of the environment, but for split and detector; none that is as it would be without."""
        return {**self.motion, **({"unseen_models": True} if self.unseen_models else {})}

    @property
    def noise(self) -> SensorNoise:
        """Of the recorded depth and poses."""
        return SensorNoise(
            self.sensor_noise, self.pose_noise_deg, self.pose_noise_m, self.pose_drift_deg, self.pose_drift_m
        )
