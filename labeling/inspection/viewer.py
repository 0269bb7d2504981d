"""A label set in the browser: segmented clouds, boxes and cameras, by viser (extra ``viewer``)."""

import time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from labeling.core.errors import UsageError
from labeling.core.types import BOX_EDGES
from labeling.inspection.scene import LabelledScene


def serve(scenes: list[LabelledScene], port: int) -> Any:
    """Starts the viewer; it runs until the process ends.

    Args:
        scenes: the episodes; the first is shown, the others can be chosen.
        port: of the address ``http://localhost:PORT``.

    Returns:
        viser's server.

    Raises:
        UsageError: if viser is not installed or there is nothing to show.
    """
    try:
        import viser  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise UsageError("--view needs viser: pip install 'seeing-by-moving[viewer]', or use --pictures DIR") from None
    if not scenes:
        raise UsageError("--view: no episode of this label set was labelled")
    server = viser.ViserServer(host="127.0.0.1", port=port, label="Seeing by Moving")
    server.scene.set_up_direction("+z")
    choice = server.gui.add_dropdown("episode", tuple(scene.name for scene in scenes))
    point_px = server.gui.add_slider("point size", min=0.2, max=5.0, step=0.1, initial_value=1.0)
    boxes = server.gui.add_checkbox("boxes", initial_value=True)
    cameras = server.gui.add_checkbox("cameras", initial_value=True)

    def show(_: object = None) -> None:
        scene = next(scene for scene in scenes if scene.name == choice.value)
        server.scene.reset()
        server.scene.set_up_direction("+z")
        _add(server, scene, float(point_px.value), bool(boxes.value), bool(cameras.value))

    for control in (choice, point_px, boxes, cameras):
        control.on_update(show)
    show()
    return server


def wait() -> None:
    """Keeps the viewer open until Ctrl-C."""
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        return


def _add(server: Any, scene: LabelledScene, point_scale: float, boxes: bool, cameras: bool) -> None:
    centre = np.median(scene.points, axis=0) if len(scene.points) else np.zeros(3)
    spread = float(np.linalg.norm(np.ptp(scene.points, axis=0))) if len(scene.points) else 1.0
    # Browsers draw with 32 bits: what is far from the origin of its world frame is shown near it.
    origin_m = 100.0 * np.round(centre / 100.0)
    shown = (scene.points - origin_m).astype(np.float32)
    server.scene.add_point_cloud("/cloud", shown, scene.colours, point_size=point_scale * spread / 800)
    for one in scene.objects if boxes else ():
        colour = tuple(int(255 * value) for value in one.colour)
        corners = one.box.corners() - origin_m
        segments = np.array([[corners[a], corners[b]] for a, b in BOX_EDGES], np.float32)
        server.scene.add_line_segments(f"/boxes/{one.number}", segments, colors=colour, line_width=2.5)
        top = one.box.centre_m - origin_m + np.array([0, 0, 0.5 * one.box.extent_m[2]])
        server.scene.add_label(f"/boxes/{one.number}/title", one.title, position=tuple(top))
    for number, camera in enumerate(scene.cameras if cameras else ()):
        height_px, width_px = camera.size
        server.scene.add_camera_frustum(
            f"/cameras/{number}",
            fov=2 * float(np.arctan(0.5 * height_px / camera.intrinsics[1, 1])),
            aspect=width_px / height_px,
            scale=0.03 * max(1e-3, float(np.linalg.norm(camera.camera_to_world[:3, 3] - centre))),
            wxyz=Rotation.from_matrix(camera.camera_to_world[:3, :3]).as_quat(scalar_first=True),
            position=tuple(camera.camera_to_world[:3, 3] - origin_m),
        )
