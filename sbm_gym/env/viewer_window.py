"""MuJoCo's own viewer as a window on the agent, for ``render_mode="human"``."""

import itertools
import os
import platform
from typing import Any

import mujoco
import numpy as np

from labeling.core.errors import SbmError
from sbm_gym.scenes.third_person import AgentTrace, frustum_lines

_PATH_RGBA = np.array([1.0, 0.75, 0.15, 1.0], np.float32)
_FRUSTUM_RGBA = np.array([1.0, 0.45, 0.1, 1.0], np.float32)
_LINE_PX = 3.0


class NoScreenError(SbmError):
    """There is no screen to open a window on."""


def screen_available() -> bool:
    """Whether a window could be opened here."""
    if platform.system() != "Linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def check_screen() -> None:
    """Checks that a window can be opened.

    Raises:
        NoScreenError: if not, naming the modes that need none.
    """
    if not screen_available():
        raise NoScreenError(
            "render_mode='human' opens MuJoCo's viewer, and there is no screen here (DISPLAY is not set); use "
            "render_mode='rgb_array' or 'third_person', whose render() returns pictures"
        )


class ViewerWindow:
    """A window that follows one scene at a time."""

    def __init__(self) -> None:
        """Opens nothing yet."""
        self._handle: Any = None
        self._model: mujoco.MjModel | None = None

    def show(self, model: mujoco.MjModel, data: mujoco.MjData, trace: AgentTrace) -> None:
        """Shows the present state; opens the window, or another one when the scene has changed.

        Raises:
            NoScreenError: if the window cannot be opened.
        """
        if self._handle is None or self._model is not model:
            self.close()
            self._handle, self._model = _launch(model, data), model
        if not self._handle.is_running():
            return  # The user has closed the window; the episode goes on.
        with self._handle.lock():
            draw_lines(self._handle.user_scn, trace)
        self._handle.sync()

    def close(self) -> None:
        """Closes the window."""
        if self._handle is not None:
            self._handle.close()
            self._handle = self._model = None


def draw_lines(scene: mujoco.MjvScene, trace: AgentTrace) -> None:
    """Replaces the user geoms of a viewer's scene by the agent's path and frustum."""
    path = np.array([[*place, 0.03] for place in trace.path_m]).reshape(-1, 3)
    frustum = frustum_lines(trace.camera)
    scene.ngeom = 0
    for line, rgba in [(path, _PATH_RGBA), *((edge, _FRUSTUM_RGBA) for edge in frustum)]:
        for start, end in itertools.pairwise(line):
            if scene.ngeom >= scene.maxgeom:
                return
            geom = scene.geoms[scene.ngeom]
            kind = mujoco.mjtGeom.mjGEOM_LINE
            mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), rgba)
            mujoco.mjv_connector(geom, kind, _LINE_PX, start, end)
            scene.ngeom += 1


def _launch(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    check_screen()
    import mujoco.viewer

    try:
        return mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
    except (RuntimeError, mujoco.FatalError) as error:
        raise NoScreenError(f"MuJoCo's viewer could not be opened: {error}") from error
