"""``motion.json`` of an episode: where the objects are that may move, as the simulator knows it."""

from typing import TYPE_CHECKING, Any

import numpy as np

from labeling.core.geometry import is_rigid
from labeling.core.types import ObjectMotion
from labeling.formats.checked_json import Json

if TYPE_CHECKING:
    from labeling.core.episode import Episode


def motion_record(episode: "Episode") -> dict[str, Any]:
    """The content of the file."""
    return {
        "frames": [f"rgb/{view:03d}.png" for view in range(episode.num_views)],
        "objects": [
            {
                "instance_id": one.instance_id,
                "category": one.category,
                "moves": one.moves,
                "object_to_world": one.object_to_world.tolist(),
            }
            for one in episode.motion or ()
        ],
    }


def read_motion(file: Json, episode: "Episode") -> tuple[ObjectMotion, ...]:
    """Reads the file; ``moves`` follows from the poses and is not asked for.

    Args:
        file: the file.
        episode: whose frames it has poses for; poses of frames that were left out are left out.

    Raises:
        EpisodeFormatError: naming file and field, if it is malformed or lacks a frame.
    """
    frames = [name.value for name in file.list_of("frames")]
    missing = [name for name in episode.file_names if name not in frames]
    if missing:
        raise file.error(f"has no frame {missing[0]!r}", "frames")
    chosen = [frames.index(name) for name in episode.file_names]
    found, known = [], set()
    for record in file.list_of("objects"):
        poses = record.array("object_to_world", (len(frames), 4, 4))
        bad = next((k for k, pose in enumerate(poses) if not is_rigid(pose)), None)
        if bad is not None:
            raise record.error(f"pose {bad} is not a rotation and a translation", "object_to_world")
        instance_id = record.integer("instance_id")
        if instance_id in known:
            raise record.error(f"{instance_id} is there twice", "instance_id")
        known.add(instance_id)
        found.append(ObjectMotion(instance_id, record.text("category"), np.ascontiguousarray(poses[chosen])))
    return tuple(found)
