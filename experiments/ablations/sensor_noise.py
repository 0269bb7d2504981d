"""Label quality with the noise of real sensors: the same episodes with noise of several kinds."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Any

from experiments.ablations.label_scores import Setting
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from labeling.generator.settings.label_config import LabelConfig
from sbm_gym.sensors.noise_config import SensorNoise

CLEAN = "clean"


@dataclass(frozen=True)
class Kind:
    """One row of the table."""

    name: str
    noise: SensorNoise


KINDS = (
    Kind(CLEAN, SensorNoise()),
    Kind("rotation 2°", SensorNoise(pose_noise_deg=2.0)),
    Kind("rotation 4°", SensorNoise(pose_noise_deg=4.0)),
    Kind("5 cm", SensorNoise(pose_noise_m=0.05)),
    Kind("drift to 2° and 5 cm", SensorNoise(pose_drift_deg=2.0, pose_drift_m=0.05)),
    Kind("Kinect", SensorNoise("kinect")),
    Kind("stereo", SensorNoise("stereo")),
    Kind("lidar", SensorNoise("lidar")),
    Kind("Kinect, 2°, 5 cm", SensorNoise("kinect", pose_noise_deg=2.0, pose_noise_m=0.05)),
    Kind("Kinect, 4°, 10 cm", SensorNoise("kinect", pose_noise_deg=4.0, pose_noise_m=0.1)),
    Kind("Kinect, drift to 2° and 5 cm", SensorNoise("kinect", pose_drift_deg=2.0, pose_drift_m=0.05)),
    Kind("Kinect, drift to 4° and 10 cm", SensorNoise("kinect", pose_drift_deg=4.0, pose_drift_m=0.1)),
)
TREATMENTS: Mapping[str, LabelConfig] = MappingProxyType(
    {"poses as recorded": LabelConfig(refine_poses="off"), "poses mended": LabelConfig(refine_poses="auto")}
)
"""How noisy episodes are labelled."""
EPISODES: dict[Scale, int] = {"smoke": 1, "quick": 24, "standard": 40, "full": 60}
SEED = 3
"""Of the homes: nothing is chosen on these."""
SHOWN = ("mean_iou", "mask_ap50", "box_ap50")
"""The figures that treatments are compared by."""


@experiment(
    "noise",
    "labels of the same episodes with the noise of sensors and wrong poses: homes that compact has never seen",
    pages=("sensor_noise",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Labels all episodes with every noise.

    Returns:
        The kinds of noise, the pool, and by treatment and kind the figures, with differences from no noise and, under
        ``gain``, from the first treatment of the same noise.
    """
    from agents.evaluation.statistics import paired_record
    from experiments.ablations.label_comparison import compare
    from experiments.cache.episode_pool import EpisodePool

    count = EPISODES[context.scale]
    pool = EpisodePool("rooms_noise", "sbm_gym/Indoor-v0", "endless", count, SEED, detector="compact")
    named = {
        f"{treatment}: {kind.name}": [Setting(replace(config, seed=seed), kind.noise) for seed in context.seeds]
        for treatment, config in TREATMENTS.items()
        for kind in KINDS
    }
    first = next(iter(TREATMENTS))
    about, results = compare(named, f"{first}: {CLEAN}", [pool], context, "noise")
    found = {
        treatment: {kind.name: results[f"{treatment}: {kind.name}"][pool.name] for kind in KINDS}
        for treatment in TREATMENTS
    }
    scenes = about[pool.name]["scenes"]
    for kinds in found.values():
        for kind, one in kinds.items():
            ours, theirs = one["per_episode"], found[first][kind]["per_episode"]
            one["gain"] = {figure: paired_record(ours[figure], theirs[figure], scenes) for figure in SHOWN}
    return {
        "pool": about[pool.name],
        "kinds": [{"name": kind.name, **asdict(kind.noise)} for kind in KINDS],
        "results": found,
    }
