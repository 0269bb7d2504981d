"""Pictures of a segmented cloud with its boxes, drawn without any graphics library."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from labeling.core.geometry import intrinsics_from_fov, look_at, project
from labeling.core.splatting import splat
from labeling.core.types import BOX_EDGES
from labeling.core.views import Camera
from labeling.formats.atomic import write_png
from labeling.inspection.framing import ABOVE, first_azimuth, region, spacing_m
from labeling.inspection.scene import LabelledScene
from labeling.inspection.titles import write_title

SIZE = (720, 960)
"""Height and width of a picture in pixels."""
FOV_RAD = 0.9
ELEVATION_RAD = 0.6
MARGIN = 0.35
"""How far around the objects the cloud is shown, as a share of the region they take up."""
BACKGROUND = 250
SUPERSAMPLE = 2
TITLE_SIZE, TITLE_ABOVE_PX, TITLE_INK = 0.5, 12, (20, 20, 20)
"""Of titles of objects, on plates of the objects' colours: size of letters, and how far above the box they stand."""


def write_pictures(scene: LabelledScene, folder: Path, viewpoints: int = 3) -> list[Path]:
    """Writes pictures of one episode: from above, and from ``viewpoints`` directions around it.

    Returns:
        The files, ``EPISODE_top.png`` and ``EPISODE_1.png`` ...
    """
    centre, size_m = region(scene)
    shown = _near(scene, centre, size_m)
    directions = [("top", np.array([0.0, -0.02, 1.0]))]
    for number in range(viewpoints):
        azimuth = first_azimuth(scene, centre) + 2 * np.pi * number / viewpoints
        flat = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        directions.append((str(number + 1), np.cos(ELEVATION_RAD) * flat + [0, 0, np.sin(ELEVATION_RAD)]))
    distance_m = 0.5 * float(np.linalg.norm(size_m)) / np.tan(0.5 * FOV_RAD * SIZE[0] / SIZE[1])
    files = []
    for name, direction in directions:
        pose = look_at(centre + distance_m * direction / np.linalg.norm(direction), centre)
        open_side = shown & ~_in_front(scene, centre, direction)
        file = folder / f"{scene.name}_{name}.png"
        write_png(file, draw(scene, open_side, pose))
        files.append(file)
    return files


def draw(
    scene: LabelledScene,
    shown: Bool[np.ndarray, "n"],
    pose: Float[np.ndarray, "4 4"],
    size: tuple[int, int] = SIZE,
) -> UInt8[np.ndarray, "h w 3"]:
    """The points shown, as squares, with boxes and their titles, from one viewpoint.

    Args:
        scene: to draw.
        shown: which of its n points.
        pose: camera to world, OpenCV axes.
        size: height and width of the picture in pixels.
    """
    camera = Camera.from_fov(pose, (SUPERSAMPLE * size[0], SUPERSAMPLE * size[1]), FOV_RAD)
    points = scene.points[shown]
    index = splat(points, camera, spacing_m(points))
    colours = np.concatenate([scene.colours[shown], np.full((1, 3), BACKGROUND, np.uint8)])
    canvas = cv2.resize(colours[index], size[::-1], interpolation=cv2.INTER_AREA)
    intrinsics = intrinsics_from_fov(size[1], size[0], FOV_RAD)
    for one in scene.objects:
        corners, depth_m = project(one.box.corners(), intrinsics, pose)
        if np.any(depth_m <= 0):
            continue
        colour = tuple(int(255 * value * 0.75) for value in one.colour)
        pixels = np.rint(np.clip(corners, -4 * size[1], 4 * size[1])).astype(int)
        for a, b in BOX_EDGES:
            cv2.line(canvas, pixels[a].tolist(), pixels[b].tolist(), colour, 2, cv2.LINE_AA)
    for one in scene.objects:  # titles last, so that no edge crosses them
        top, depth_m = project(one.box.corners().mean(axis=0)[None] + [0, 0, one.box.extent_m[2] / 2], intrinsics, pose)
        if depth_m[0] > 0:
            x, y = np.clip(top[0], -1e4, 1e4).tolist()
            red, green, blue = (int(255 * (0.35 * value + 0.65)) for value in one.colour)
            write_title(canvas, one.title, (x, y - TITLE_ABOVE_PX), TITLE_SIZE, (red, green, blue), TITLE_INK)
    return canvas


def _near(scene: LabelledScene, centre, size_m) -> Bool[np.ndarray, "n"]:
    """Points around the objects but not above them, where a ceiling would hide everything."""
    reach = 0.5 * size_m + MARGIN * size_m.max()
    reach[2] = 0.5 * size_m[2] + ABOVE * size_m.max()
    return (scene.labels > 0) | np.all(np.abs(scene.points - centre) <= reach, axis=1)


def _in_front(scene: LabelledScene, centre, direction) -> Bool[np.ndarray, "n"]:
    """Points of no object that lie nearer to the viewpoint than all objects: the back of a wall that hides them."""
    flat = np.array([direction[0], direction[1], 0.0])
    if np.linalg.norm(flat) < 0.1 or not scene.objects:
        return np.zeros(len(scene.points), bool)
    nearest = max(float(((one.box.corners() - centre) @ flat).max()) for one in scene.objects)
    return (scene.labels == 0) & ((scene.points - centre) @ flat > nearest)
