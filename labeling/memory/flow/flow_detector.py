"""A network that tells flow on a memory as a finder of what moves in episodes, and on disk with its spec."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labeling.core.detector import DetectorError
from labeling.core.geometry import invert_rigid, transform_points, unproject_depth
from labeling.core.views import RgbdViews
from labeling.memory.flow.flow_net import FlowNet, FlowOutput, Remembered
from labeling.memory.flow.moving_objects import MovingObject, boxes_of_groups, group_flow
from labeling.memory.flow.view_pairs import view_pairs
from labeling.memory.settings.flow_settings import FlowSpec
from labeling.memory.view_prediction.scenes import SmallScene
from labeling.training.config import WEIGHTS_FILE
from labeling.training.weights import file_digest, load_weights, read_header, read_spec, save_with_spec

SPEC_KEY = "memory_flow"


class MovingDetector:
    """Finds what moves between each view of an episode and the next; needs no label and no 2-D detector."""

    def __init__(self, network: FlowNet, name: str, digest: str = "", device: str = "cpu") -> None:
        self.name, self.digest, self.spec = name, digest, network.spec
        self._network, self._device = network.to(device).eval(), device

    def find(self, name: str, views: RgbdViews) -> list[tuple[SmallScene, list[MovingObject]]]:
        """What moves in an episode.

        Args:
            name: of the episode.
            views: in order of time.

        Returns:
            For every pair of views that see something in common, the objects, the surest first.

        Raises:
            EpisodeFormatError: if there is no such pair.
        """
        return [(pair, self.find_in(pair)) for pair in view_pairs(name, views, self.spec.memory)]

    @torch.inference_mode()
    def flow(self, pair: SmallScene) -> tuple[FlowOutput, Remembered]:
        """Flow of a pair, in the grid of its first view, and the memory of that view."""
        before, after = self._network.both(*(pair.views([view], 0).to(self._device) for view in range(2)))
        return self._network.head(before, after, self.spec.memory.grid), before

    def find_in(self, pair: SmallScene) -> list[MovingObject]:
        """What moves between the two views of a pair, the surest first."""
        return self.objects(pair, *self.flow(pair))

    def objects(self, pair: SmallScene, output: FlowOutput, before: Remembered) -> list[MovingObject]:
        """The same from what ``flow`` has told of the pair."""
        flow_m, moves = output.flow_m[0].cpu().double().numpy(), output.moves[0, 0].sigmoid().cpu().double().numpy()
        grid, grid_to_world = self.spec.memory.grid, pair.grid_to_world(0)
        groups = group_flow(flow_m, moves, before.occupied[0, 0].cpu().double().numpy(), grid)
        points, _ = points_of(pair, 0)
        return boxes_of_groups(groups, flow_m, moves, points, grid, grid_to_world, pair.floor_in_grid_m)


def points_of(pair: SmallScene, view: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) points that one view of a pair has measured, in the grid of the first one, metres; and the flat indices
    (n,) of their pixels.
    """
    points, pixels = unproject_depth(
        pair.depth_m[view], pair.depth_intrinsics[view].astype(float), pair.camera_to_world[view].astype(float)
    )
    return transform_points(invert_rigid(pair.grid_to_world(0)), points), pixels


def is_flow_run(path: Path) -> bool:
    """Whether a folder is a run of ``labeling.train_flow``."""
    try:
        read_header(path / WEIGHTS_FILE, SPEC_KEY, "labeling.train_flow")
    except DetectorError:
        return False
    return True


def load_moving_detector(path: Path, device: str | None = None) -> MovingDetector:
    """Loads a finder of what moves.

    Args:
        path: folder of a ``labeling.train_flow`` run.
        device: cpu, cuda, ...; by default a GPU if there is one.

    Raises:
        DetectorError: if its files are missing or damaged.
    """
    from labeling.detectors.registry import choose_device

    file = path / WEIGHTS_FILE
    return MovingDetector(load_flow_net(file), str(path), file_digest(file), choose_device(device))


def save_flow_net(path: Path, network: FlowNet, about: Mapping[str, Any]) -> None:
    """Writes a network atomically.

    Args:
        path: of the file.
        network: what to write; with its memory.
        about: where it comes from, as JSON.
    """
    save_with_spec(path, network, SPEC_KEY, about)


def load_flow_net(path: Path) -> FlowNet:
    """Reads a network, on the CPU, in evaluation mode.

    Raises:
        DetectorError: if the file is missing, damaged, or holds something else.
    """
    spec = read_spec(path, SPEC_KEY, FlowSpec, "labeling.train_flow")
    network = FlowNet(spec)
    load_weights(path, network, f"a network that tells flow on a memory of kind {spec.memory.model}")
    return network.eval()
