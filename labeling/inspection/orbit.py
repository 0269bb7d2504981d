"""A film of a labelled scene: the camera circles it once, without any graphics library."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from labeling.core.geometry import look_at
from labeling.formats.film import write_film
from labeling.inspection.colouring import object_colours, point_colours
from labeling.inspection.framing import SURE, below, cut_height_m, opening_view, region
from labeling.inspection.pictures import FOV_RAD, MARGIN, draw
from labeling.inspection.scene import LabelledScene

FRAMES = 36
FRAME_MS = 120
SIZE = (360, 480)
"""Height and width in pixels: small enough for a film of ``labeling.formats.film.MAX_MB``."""


def orbit(scene: LabelledScene, fov_rad: float, frames: int = FRAMES) -> list[Float[np.ndarray, "4 4"]]:
    """Camera poses (camera to world, OpenCV axes) in a circle, evenly apart, from the view that the viewer opens at.

    Args:
        scene: to circle.
        fov_rad: the smaller field of view; the boxes of all sure objects are in it.
        frames: how many.
    """
    position, target = opening_view(scene, fov_rad)
    poses = []
    for angle in 2 * np.pi * np.arange(frames) / frames:
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        poses.append(look_at(target + turn @ (position - target), target))
    return poses


def write_orbit(scene: LabelledScene, folder: Path) -> Path:
    """Writes ``EPISODE.gif`` and returns it; boxes and titles are of objects that are sure.

    Raises:
        SbmError: if it would be too large.
    """
    centre, size_m = region(scene)
    near = np.all(np.abs(scene.points - centre)[:, :2] <= (0.5 * size_m + MARGIN * size_m.max())[:2], axis=1)
    shown = below(scene, cut_height_m(scene)) & (near | (scene.labels > 0))
    fov_rad = 2 * np.arctan(np.tan(0.5 * FOV_RAD) * SIZE[0] / SIZE[1])
    objects = tuple(one for one in scene.objects if one.confidence >= SURE)
    colours = point_colours(scene, "object", [one.number for one in objects], object_colours(scene, "object"))
    sure = replace(scene, objects=objects, colours=colours)
    frames = [draw(sure, shown, pose, SIZE) for pose in orbit(scene, fov_rad)]
    file = folder / f"{scene.name}.gif"
    write_film(frames, file, FRAME_MS, FRAME_MS)
    return file
