"""LDLS: masks of one view, diffused over the graph of its 3-D points; the baseline that needs no training.

Source: Wang, Chao, Wang, Hariharan, Weinberger, Campbell 2019, "LDLS: 3-D Object Segmentation through Label Diffusion
from 2-D Images", and its published code (numbers of neighbours, weights, outliers). It ran for a fixed number of steps
there; here its fixed point is found at once, by a sparse factorisation that serves all objects of a view.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from labeling.core.boxes3d import fit_box
from labeling.core.episode import Episode
from labeling.core.geometry import unproject
from labeling.core.types import Detection
from labeling.detectors3d.base import Detection3d
from labeling.detectors3d.frustums import MAX_RANGE_M


@dataclass(frozen=True)
class LdlsConfig:
    """Settings."""

    neighbours: int = 10
    """Of each point in space, beside itself. Source: published code."""
    scale_m: float = 1.0
    """Weights of neighbours are exp(-d²/scale²). Source: published code."""
    window_px: int = 5
    """Side of the window of pixels around a point's own that it hears of. Source: published code."""
    pixel_weight: float = 0.001
    """Of each of these pixels. Source: published code."""
    stride: int = 2
    """Every so many pixels in x and y is a point: a depth camera sees many more points than the lidar of the paper."""
    least_points: int = 10
    """Objects of fewer points get no box."""


class Ldls:
    """Segments the points of each view and fits boxes around them."""

    def __init__(self, config: LdlsConfig | None = None) -> None:
        """Takes settings; by default the published ones."""
        self.config = config or LdlsConfig()
        self.name, self.digest = "ldls", f"ldls {self.config}"

    def lift(self, episode: Episode, detections: Sequence[Detection]) -> list[Detection3d]:
        """See ``labeling.detectors3d.base.Detector3d``.

        The confidence is the 2-D detection's times the mean share of its label at the points that it has won.
        """
        found: list[Detection3d] = []
        for view in sorted({one.view_index for one in detections}):
            here = [one for one in detections if one.view_index == view and one.mask.any()]
            if not here:
                continue
            points, pixels = sparse_points(
                episode.depth_m[view], episode.intrinsics[view], episode.camera_to_world[view], self.config.stride
            )
            owner, share = segment(points, pixels, np.stack([one.mask for one in here]), self.config)
            for number, one in enumerate(here):
                own = owner == number
                if np.count_nonzero(own) < self.config.least_points:
                    continue
                box = fit_box(points[own])
                if box is not None and np.all(box.extent_m > 0):
                    confidence = one.confidence * float(share[own].mean())
                    found.append(Detection3d(view, one.category, confidence, box))
        return found


def sparse_points(
    depth_m: Float[np.ndarray, "h w"],
    intrinsics: Float[np.ndarray, "3 3"],
    camera_to_world: Float[np.ndarray, "4 4"],
    stride: int,
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n 2"]]:
    """World points of every so many pixels with known depth, and these pixels (row, column)."""
    rows, columns = np.mgrid[stride // 2 : depth_m.shape[0] : stride, stride // 2 : depth_m.shape[1] : stride]
    rows, columns = rows.ravel(), columns.ravel()
    depth = depth_m[rows, columns].astype(float)
    known = (depth > 0) & (depth <= MAX_RANGE_M)
    pixels = np.stack([rows[known], columns[known]], axis=1)
    return unproject(pixels[:, ::-1].astype(float), depth[known], intrinsics, camera_to_world), pixels


def segment(
    points: Float[np.ndarray, "n 3"],
    pixels: Int[np.ndarray, "n 2"],
    masks: Bool[np.ndarray, "k h w"],
    config: LdlsConfig,
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Which mask's object each point belongs to.

    Args:
        points: metres.
        pixels: row and column of each.
        masks: of the objects; they may overlap.
        config: settings.

    Returns:
        Index of the mask, -1 for none, and the share of the winning label at the point.
    """
    if len(points) <= config.neighbours:
        return np.full(len(points), -1), np.zeros(len(points))
    graph, pixel_labels, total = diffusion_problem(points, pixels, masks, config)
    labels = diffuse(graph, pixel_labels, total)
    owner = labels.argmax(axis=1) - 1
    share = labels.max(axis=1) / np.maximum(labels.sum(axis=1), 1e-12)
    for number in range(len(masks)):
        own = np.flatnonzero(owner == number)
        if len(own):
            _, part = connected_components(graph[own][:, own], directed=False)
            owner[own[part != np.bincount(part).argmax()]] = -1
    return owner, share


def diffusion_problem(
    points: Float[np.ndarray, "n 3"],
    pixels: Int[np.ndarray, "n 2"],
    masks: Bool[np.ndarray, "k h w"],
    config: LdlsConfig,
) -> tuple[sparse.csr_matrix, Float[np.ndarray, "n c"], Float[np.ndarray, "n"]]:
    """What ``diffuse`` solves; arguments as for ``segment``."""
    graph = neighbour_graph(points, config)
    pixel_labels = config.pixel_weight * _pixel_sums(masks, pixels, config.window_px)
    return graph, pixel_labels, np.asarray(graph.sum(axis=1)).ravel() + pixel_labels.sum(axis=1)


def neighbour_graph(points: Float[np.ndarray, "n 3"], config: LdlsConfig) -> sparse.csr_matrix:
    """Weights of the nearest neighbours of each point, itself among them."""
    distance, neighbour = cKDTree(points).query(points, k=config.neighbours + 1)
    weight = np.exp(-((distance / config.scale_m) ** 2))
    row = np.repeat(np.arange(len(points)), config.neighbours + 1)
    return sparse.csr_matrix((weight.ravel(), (row, neighbour.ravel())), shape=(len(points), len(points)))


def diffuse(
    graph: sparse.csr_matrix, pixel_labels: Float[np.ndarray, "n c"], total: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n c"]:
    """The labels that no further step of diffusion changes: each point's are the weighted mean of those of its
    neighbours and of the labels of its pixels. A point's labels sum to 1, so that the first follows from the others.

    Args:
        graph: weights of neighbours.
        pixel_labels: weighted labels of the pixels; they stay as they are. Every point has some.
        total: of all weights of a point.
    """
    # Diagonally dominant, since every point hears of its pixels: one factorisation for all labels, without pivoting.
    system = splu((sparse.diags(total) - graph).tocsc(), diag_pivot_thresh=0.0)
    objects = np.clip(system.solve(pixel_labels[:, 1:]), 0.0, 1.0)
    return np.column_stack([np.clip(1.0 - objects.sum(axis=1), 0.0, None), objects])


def _pixel_sums(
    masks: Bool[np.ndarray, "k h w"], pixels: Int[np.ndarray, "n 2"], window: int
) -> Float[np.ndarray, "n c"]:
    """How many pixels of a window show no object (first column), and each object."""
    import cv2

    layers = [~masks.any(axis=0), *masks]
    sums = []
    for layer in layers:
        counted = cv2.boxFilter(
            layer.astype(np.float32), -1, (window, window), normalize=False, borderType=cv2.BORDER_CONSTANT
        )
        sums.append(counted[pixels[:, 0], pixels[:, 1]].astype(float))
    return np.stack(sums, axis=1)
