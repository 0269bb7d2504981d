"""A network that finds boxes in a memory as a detector of episodes, and on disk with its spec in the header."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from labeling.core.detector import DetectorError
from labeling.core.episode import Episode
from labeling.core.errors import UsageError
from labeling.detectors3d.several_views import SceneDetection3d
from labeling.memory.boxes.box_evaluation import detect_in, spread_views
from labeling.memory.boxes.box_net import BoxNet
from labeling.memory.settings.box_settings import BoxSpec
from labeling.memory.view_prediction.scenes import small_scene
from labeling.training.config import WEIGHTS_FILE
from labeling.training.weights import file_digest, load_weights, read_header, read_spec, save_with_spec

SPEC_KEY = "memory_boxes"


class MemoryBoxDetector:
    """Finds boxes in a memory of several views of an episode; needs no 2-D detector."""

    def __init__(self, network: BoxNet, name: str, digest: str = "", device: str = "cpu") -> None:
        self.name, self.digest, self.categories = name, digest, network.spec.categories
        self._network, self._device = network.to(device).eval(), device

    def find(
        self, episode: Episode, count: int | None = None, views: Sequence[int] | None = None
    ) -> list[SceneDetection3d]:
        """Boxes in the world, the surest first.

        Args:
            episode: pictures, depth and poses of its views.
            count: how many views go into the memory, spread evenly over those that look at the grid; None takes as
                many as the network was trained with.
            views: these views instead, of those that look at the grid.

        Raises:
            EpisodeFormatError: if too few views of the episode look at the grid, or there is no depth.
            UsageError: if none of ``views`` looks at the grid.
        """
        spec = self._network.spec
        scene = small_scene(episode.name, episode, spec.memory, spec.around)
        if views is None:
            chosen = spread_views(scene.num_views, count or spec.views)
        else:
            chosen = [scene.view_index.index(view) for view in views if view in scene.view_index]
            if not chosen:
                raise UsageError(f"{episode.name}: none of views {list(views)} looks at the middle of the grid")
        return detect_in(self._network, scene, chosen, self._device)


def is_memory_run(path: Path) -> bool:
    """Whether a folder is a run of ``labeling.train3d --memory``."""
    try:
        read_header(path / WEIGHTS_FILE, SPEC_KEY, "labeling.train3d --memory")
    except DetectorError:
        return False
    return True


def load_memory_detector(path: Path, device: str | None = None) -> MemoryBoxDetector:
    """Loads a detector.

    Args:
        path: folder of a ``labeling.train3d --memory`` run.
        device: cpu, cuda, ...; by default a GPU if there is one.

    Raises:
        DetectorError: if its files are missing or damaged.
    """
    from labeling.detectors.registry import choose_device

    file = path / WEIGHTS_FILE
    return MemoryBoxDetector(load_box_net(file), str(path), file_digest(file), choose_device(device))


def save_box_net(path: Path, network: BoxNet, about: Mapping[str, Any]) -> None:
    """Writes a network atomically.

    Args:
        path: of the file.
        network: what to write.
        about: where it comes from, as JSON.
    """
    save_with_spec(path, network, SPEC_KEY, about)


def load_box_net(path: Path) -> BoxNet:
    """Reads a network, on the CPU, in evaluation mode.

    Raises:
        DetectorError: if the file is missing, damaged, or holds something else.
    """
    spec = read_spec(path, SPEC_KEY, BoxSpec, "labeling.train3d --memory")
    network = BoxNet(spec)
    load_weights(path, network, f"a network that finds {', '.join(spec.categories)} in a memory")
    return network.eval()
