"""Trajectories of policies from above: where they went and looked, what they found, from which sides they saw it.

Pictures may show what only the simulator knows, such as where all objects stand; policies never see any of it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from labeling.formats.atomic import atomic_file
from sbm_gym.env.fixation_env import FixationEnv

MAX_COLUMNS = 3
SEEN, UNSEEN, COLLISION = "#2ca02c", "#9aa5b1", "#d62728"
LETTER, LINE = 0.012, 0.03
"""Width of a letter and height of a line of names of objects, as shares of a panel."""


def draw_trajectories(env: FixationEnv, records: Mapping[str, dict[str, Any]], path: Path) -> None:
    """Draws one episode of several policies side by side.

    Args:
        env: in the scene of the episode.
        records: by policy, the results of episodes from the same start.
        path: PNG to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = -(-len(records) // MAX_COLUMNS)
    columns = -(-len(records) // rows)
    low_m, high_m = _window(env, records)
    aspect = float((high_m - low_m)[1] / (high_m - low_m)[0])
    figure = Figure(
        figsize=(4.6 * columns, rows * (4.6 * min(max(aspect, 0.4), 1.6) + 0.5)), dpi=110, layout="constrained"
    )
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(records) :]:
        axes.axis("off")
    for axes, (policy, record) in zip(panels, records.items(), strict=False):
        _draw_map(axes, env)
        _draw_objects(axes, env, low_m, high_m)
        _draw_found(axes, env, record)
        _draw_trajectory(axes, env.knowledge.stride_m, record)
        axes.set(xlim=(low_m[0], high_m[0]), ylim=(low_m[1], high_m[1]), aspect="equal", xticks=[], yticks=[])
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


def _window(env: FixationEnv, records: Mapping[str, dict[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
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
    navigable, stride_m = env.knowledge.navigable, env.knowledge.stride_m
    size_m = np.array(navigable.free.shape[::-1]) * navigable.cell_m
    low_m = np.maximum(np.min(points, axis=0) - 4.0 * stride_m, navigable.origin_m - stride_m)
    high_m = np.minimum(np.max(points, axis=0) + 4.0 * stride_m, navigable.origin_m + size_m + stride_m)
    return low_m, high_m


def _draw_map(axes: Any, env: FixationEnv) -> None:
    """Where the robot can stand in white, the rest in grey."""
    navigable = env.knowledge.navigable
    low_m = navigable.origin_m
    high_m = low_m + np.array(navigable.free.shape[::-1]) * navigable.cell_m
    shade = np.where(navigable.free, 1.0, 0.86)
    extent = (low_m[0], high_m[0], low_m[1], high_m[1])
    axes.set_facecolor("0.86")
    axes.imshow(shade, origin="lower", extent=extent, cmap="gray", vmin=0.0, vmax=1.0, interpolation="nearest")


def _draw_objects(axes: Any, env: FixationEnv, low_m: np.ndarray, high_m: np.ndarray) -> None:
    """Outlines objects and writes their categories on them: large ones first, and no name over another."""
    from matplotlib.patheffects import withStroke

    outlines = [(one.category, one.box_3d.corners()[[0, 2, 6, 4], :2]) for one in env.scene.world.objects]
    for _, corners_m in outlines:
        axes.fill(*corners_m.T, facecolor="#f2e3c6", edgecolor="0.45", linewidth=0.7, zorder=2)
    placed: list[tuple[np.ndarray, int]] = []
    for category, corners_m in sorted(outlines, key=lambda one: -float(np.ptp(one[1], axis=0).prod())):
        centre_m = corners_m.mean(axis=0)
        place = (centre_m - low_m) / (high_m - low_m)
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


def _draw_found(axes: Any, env: FixationEnv, record: dict[str, Any]) -> None:
    """A ring around every confirmed object, its sectors green where it has been seen from there."""
    from matplotlib.patches import Wedge

    count = record["num_sectors"]
    ring_m = max(0.45 * env.profile.ring_m[0], 0.9 * env.knowledge.stride_m)
    style = {"width": 0.22 * ring_m, "edgecolor": "white", "linewidth": 0.4, "alpha": 0.9, "zorder": 4}
    for known in record["objects"]:
        centre = known["centroid_m"][:2]
        radius_m = max(ring_m, 0.5 * max(known["extent_m"][:2]))
        for sector in range(count):
            angles = 360.0 * sector / count, 360.0 * (sector + 1) / count
            colour = SEEN if sector in known["sectors"] else UNSEEN
            axes.add_patch(Wedge(centre, radius_m, *angles, facecolor=colour, **style))
        axes.plot(*centre, marker="+", color=SEEN, markersize=6, zorder=5)


def _draw_trajectory(axes: Any, stride_m: float, record: dict[str, Any]) -> None:
    """Every camera position and the direction of the look, from dark to bright; collisions crossed."""
    from matplotlib import colormaps

    places = np.array([record["start"]["position_m"], *(step["position_m"] for step in record["steps"])])
    yaws = np.array([record["start"]["yaw_rad"], *(step["yaw_rad"] for step in record["steps"])])
    colours = colormaps["plasma"](np.linspace(0.0, 0.9, len(places)))
    axes.plot(*places.T, color="0.35", linewidth=0.8, zorder=6)
    ends = places + 0.8 * stride_m * np.stack([np.cos(yaws), np.sin(yaws)], axis=1)
    for place, end, colour in zip(places, ends, colours, strict=True):
        axes.plot(*np.stack([place, end]).T, color=colour, linewidth=1.1, zorder=7)
    axes.scatter(*places.T, s=14, c=colours, edgecolors="white", linewidths=0.4, zorder=8)
    axes.scatter(*places[0], s=60, facecolors="none", edgecolors="black", linewidths=1.2, zorder=9)
    bumps = np.array([step["position_m"] for step in record["steps"] if step["collided"]])
    if len(bumps):
        axes.scatter(*bumps.T, marker="x", s=36, c=COLLISION, linewidths=1.4, zorder=9)
