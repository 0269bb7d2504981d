"""Trajectories of policies from above: where they went and looked, what they found, from which sides they saw it.

Pictures may show what only the simulator knows, such as where all objects stand; policies never see any of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from labeling.formats.atomic import atomic_file
from sbm_gym.env.fixation_env import FixationEnv
from sbm_gym.worlds.geometry.navigable import NavigableMap

MAX_COLUMNS = 3
SEEN, UNSEEN, COLLISION = "#2ca02c", "#9aa5b1", "#d62728"
LETTER, LINE = 0.012, 0.03
"""Width of a letter and height of a line of names of objects, as shares of a panel."""


@dataclass(frozen=True)
class TopDownMap:
    """What does not move in an episode."""

    navigable: NavigableMap
    outlines_m: tuple[tuple[str, Float[np.ndarray, "4 2"]], ...]
    """Category and corners of every object, from above."""
    stride_m: float
    ring_m: float
    """Radius of the ring that shows from which sides an object has been seen."""


def top_down_map(env: FixationEnv) -> TopDownMap:
    """The map of the scene that the env is in."""
    outlines = tuple((one.category, one.box_3d.corners()[[0, 2, 6, 4], :2]) for one in env.scene.world.objects)
    ring_m = max(0.45 * env.profile.ring_m[0], 0.9 * env.knowledge.stride_m)
    return TopDownMap(env.knowledge.navigable, outlines, env.knowledge.stride_m, ring_m)


def draw_trajectories(scene: TopDownMap, records: Mapping[str, dict[str, Any]], path: Path) -> None:
    """Draws one episode of several policies side by side.

    Args:
        scene: its map.
        records: by policy, the results of episodes from the same start.
        path: PNG to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = -(-len(records) // MAX_COLUMNS)
    columns = -(-len(records) // rows)
    window = low_m, high_m = _window(scene, records)
    aspect = float((high_m - low_m)[1] / (high_m - low_m)[0])
    figure = Figure(
        figsize=(4.6 * columns, rows * (4.6 * min(max(aspect, 0.4), 1.6) + 0.5)), dpi=110, layout="constrained"
    )
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(records) :]:
        axes.axis("off")
    for axes, (policy, record) in zip(panels, records.items(), strict=False):
        _draw_map(axes, scene)
        _name_objects(axes, scene, window)
        _draw_found(axes, scene, record)
        _draw_trajectory(axes, scene, record)
        axes.set_xlim(low_m[0], high_m[0])
        axes.set_ylim(low_m[1], high_m[1])
        axes.set_aspect("equal")
        axes.set_xticks([])
        axes.set_yticks([])
        figures = record["figures"]
        axes.set_title(
            f"{policy}: return {figures['return']:.1f}; objects: {figures['objects']:.0f}, sides: "
            f"{figures['sectors']:.0f}, bumps: {figures['collisions']:.0f}",
            fontsize=9,
        )
    first = next(iter(records.values()))
    figure.suptitle(
        f"{first['scene']}, seed {first['seed']}, episode {first['episode']}: way from dark to bright, lines of sight, "
        "rings show the sides seen",
        fontsize=9,
    )
    with atomic_file(path) as temporary:
        figure.savefig(temporary, format="png")


def _window(scene: TopDownMap, records: Mapping[str, dict[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the part of the map that shows all trajectories, with room around them."""
    points = [
        point
        for record in records.values()
        for point in (
            record["start"]["position_m"],
            *(step["position_m"] for step in record["steps"]),
            *(known["centroid_m"][:2] for known in record["objects"]),
        )
    ]
    margin_m = 4.0 * scene.stride_m
    size_m = np.array(scene.navigable.free.shape[::-1]) * scene.navigable.cell_m
    low_m = np.maximum(np.min(points, axis=0) - margin_m, scene.navigable.origin_m - scene.stride_m)
    high_m = np.minimum(np.max(points, axis=0) + margin_m, scene.navigable.origin_m + size_m + scene.stride_m)
    return low_m, high_m


def _draw_map(axes: Any, scene: TopDownMap) -> None:
    """Where the robot can stand in white, the rest in grey, objects outlined."""
    navigable = scene.navigable
    low_m = navigable.origin_m
    high_m = low_m + np.array(navigable.free.shape[::-1]) * navigable.cell_m
    shade = np.where(navigable.free, 1.0, 0.86)
    extent = (low_m[0], high_m[0], low_m[1], high_m[1])
    axes.set_facecolor("0.86")
    axes.imshow(shade, origin="lower", extent=extent, cmap="gray", vmin=0.0, vmax=1.0, interpolation="nearest")
    for _, corners_m in scene.outlines_m:
        axes.fill(*corners_m.T, facecolor="#f2e3c6", edgecolor="0.45", linewidth=0.7, zorder=2)


def _name_objects(axes: Any, scene: TopDownMap, window: tuple[np.ndarray, np.ndarray]) -> None:
    """Writes categories on objects: large ones first, and no name over another."""
    from matplotlib.patheffects import withStroke

    placed: list[tuple[np.ndarray, int]] = []
    for category, corners_m in sorted(scene.outlines_m, key=lambda one: -float(np.ptp(one[1], axis=0).prod())):
        centre_m = corners_m.mean(axis=0)
        place = (centre_m - window[0]) / (window[1] - window[0])
        near = ((np.abs(place - there), 0.5 * LETTER * (len(category) + letters)) for there, letters in placed)
        if any(gap[0] < width and gap[1] < LINE for gap, width in near):
            continue
        placed.append((place, len(category)))
        axes.annotate(
            category,
            centre_m,
            ha="center",
            va="center",
            fontsize=6.5,
            color="0.2",
            zorder=10,
            annotation_clip=True,
            clip_on=True,
            path_effects=[withStroke(linewidth=2, foreground="white", alpha=0.8)],
        )


def _draw_found(axes: Any, scene: TopDownMap, record: dict[str, Any]) -> None:
    """A ring around every confirmed object, its sectors green where it has been seen from there."""
    from matplotlib.patches import Wedge

    count = record["num_sectors"]
    for known in record["objects"]:
        centre = known["centroid_m"][:2]
        radius_m = max(scene.ring_m, 0.5 * max(known["extent_m"][:2]))
        for sector in range(count):
            seen = sector in known["sectors"]
            axes.add_patch(
                Wedge(
                    centre,
                    radius_m,
                    360.0 * sector / count,
                    360.0 * (sector + 1) / count,
                    width=0.22 * scene.ring_m,
                    facecolor=SEEN if seen else UNSEEN,
                    edgecolor="white",
                    linewidth=0.4,
                    alpha=0.9,
                    zorder=4,
                )
            )
        axes.plot(*centre, marker="+", color=SEEN, markersize=6, zorder=5)


def _draw_trajectory(axes: Any, scene: TopDownMap, record: dict[str, Any]) -> None:
    """Every camera position and the direction of the look, from dark to bright; collisions crossed."""
    from matplotlib import colormaps

    places = np.array([record["start"]["position_m"], *(step["position_m"] for step in record["steps"])])
    yaws = np.array([record["start"]["yaw_rad"], *(step["yaw_rad"] for step in record["steps"])])
    colours = colormaps["plasma"](np.linspace(0.0, 0.9, len(places)))
    axes.plot(*places.T, color="0.35", linewidth=0.8, zorder=6)
    ends = places + 0.8 * scene.stride_m * np.stack([np.cos(yaws), np.sin(yaws)], axis=1)
    for place, end, colour in zip(places, ends, colours, strict=True):
        axes.plot(*np.stack([place, end]).T, color=colour, linewidth=1.1, zorder=7)
    axes.scatter(*places.T, s=14, c=colours, edgecolors="white", linewidths=0.4, zorder=8)
    axes.scatter(*places[0], s=60, facecolors="none", edgecolors="black", linewidths=1.2, zorder=9)
    bumps = np.array([step["position_m"] for step in record["steps"] if step["collided"]])
    if len(bumps):
        axes.scatter(*bumps.T, marker="x", s=36, c=COLLISION, linewidths=1.4, zorder=9)
