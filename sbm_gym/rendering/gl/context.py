"""OpenGL contexts without a window: which kind works here, and whether a GPU stands behind it."""

import atexit
import ctypes
import functools
import importlib
import os
import platform
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from labeling.core.errors import SbmError

LIBRARIES = {"egl": ("libEGL.so.1",), "osmesa": ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")}
"""What must be installed for each kind of context on Linux; the first that loads is used."""
PACKAGES = "libegl1 libgl1-mesa-dri libopengl0"
"""System packages that give OpenGL to a machine without a screen, with or without a GPU."""
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software rasterizer", "swiftshader")
"""How drivers that draw on the CPU call themselves."""
_open: "weakref.WeakSet[GlContext]" = weakref.WeakSet()


class NoOpenGlError(SbmError):
    """No OpenGL context can be made on this machine."""


class GlContext:
    """An OpenGL context that is current only while something is drawn, so that any thread may draw with it."""

    def __init__(self) -> None:
        """Makes a context.

        Raises:
            NoOpenGlError: if there is no OpenGL, saying what to install.
        """
        kind = context_kind()
        self._owned: list[Any] = []
        self._context: Any = None
        try:
            self._context = _context_class(kind)(1, 1)
            with self.current():
                from OpenGL import GL

                self.renderer_name = GL.glGetString(GL.GL_RENDERER).decode(errors="replace")
        # What a missing driver raises depends on where it is noticed: PyOpenGL, EGL, ctypes or MuJoCo.
        except Exception as error:
            raise NoOpenGlError(_advice(kind, error)) from error
        _open.add(self)

    @property
    def on_gpu(self) -> bool:
        """Whether a GPU draws."""
        return not any(name in self.renderer_name.lower() for name in SOFTWARE)

    @contextmanager
    def current(self) -> Iterator[None]:
        """Makes the context current in this thread for a while, then what was current before."""
        if hasattr(self._context, "as_current"):
            with self._context.as_current():
                yield
        else:
            self._context.make_current()
            yield

    def own(self, resource: Any) -> None:
        """Leaves it to the context to ``free()`` something that lives in it."""
        self._owned.append(resource)

    def free(self) -> None:
        """Gives the context back with everything it owns; it cannot be used again."""
        _open.discard(self)
        if self._context is None:
            return
        with self.current():
            for resource in self._owned:
                resource.free()
        self._owned.clear()
        self._context.free()
        self._context = None


@atexit.register
def _free_all() -> None:
    """Frees what is left while the libraries still work; later they would complain."""
    for context in list(_open):
        context.free()


def context_kind() -> str:
    """The kind of context that is made here: the one that ``MUJOCO_GL`` names, else what is installed.

    Raises:
        NoOpenGlError: if nothing is installed, or ``MUJOCO_GL`` switches OpenGL off.
    """
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    if asked in ("disable", "disabled", "off", "false", "0"):
        raise NoOpenGlError(
            f"MUJOCO_GL={asked} switches OpenGL off; unset it, or use renderer 'rays', which needs none"
        )
    if asked in LIBRARIES:
        return asked
    if platform.system() != "Linux" or asked in ("glfw", "glx"):
        return "default"
    for kind, libraries in LIBRARIES.items():
        if any(_loads(library) for library in libraries):
            return kind
    raise NoOpenGlError(_advice("egl", None))


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _context_class(kind: str) -> Any:
    return importlib.import_module("mujoco" if kind == "default" else f"mujoco.{kind}").GLContext


def _advice(kind: str, error: Exception | None) -> str:
    reason = "" if error is None else f" ({kind}: {type(error).__name__}: {error})"
    return (
        f"the 'gl' renderer finds no OpenGL on this machine{reason}; install it (Debian and Ubuntu: "
        f"apt install {PACKAGES}), or use renderer 'rays', which needs none"
    )


@functools.cache
def gpu_available() -> bool:
    """Whether OpenGL would draw on a GPU. Asked once; no context is made where no GPU's device file is."""
    if platform.system() == "Linux":
        devices = [*Path("/dev").glob("nvidia[0-9]*"), *Path("/dev/dri").glob("renderD*")]
        if not devices:
            return False
    try:
        context = GlContext()
    except NoOpenGlError:
        return False
    on_gpu = context.on_gpu
    context.free()
    return on_gpu
