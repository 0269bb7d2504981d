"""Embree by its C interface: search trees over triangles, and rays through them, sixteen at a time.

Compiled kernels call the library, so that no ray passes through Python. Trees are built at low quality (Morton codes,
one thread, so the same tree every time), in a third of the default's time: one tree for each run of triangles that
belong together and one over all runs, so that the bounds of small objects hold no long walls. Packets of rays depend on
the order of the rays alone, so that results do not depend on the number of threads.

Source: https://github.com/RenderKit/embree, api manual of version 4 (``rtcNewScene``, ``rtcIntersect16``).
"""

import ctypes
import functools
import importlib.util
import weakref
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Int64
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from labeling.core.errors import SbmError
from sbm_gym.rendering.rays.workers import Workers

PACKET = 16
"""Number of rays in a packet."""
_TRIANGLES, _INDICES, _VERTICES, _UINT3, _FLOAT3 = 0, 0, 1, 0x5003, 0x9003
_FAST_BUILD, _ROBUST = 0, 4
_NOTHING = 0xFFFFFFFF
_ONE_RUN = np.zeros(1, np.int64)
AS_THEY_ARE = np.zeros(0, np.int64)
"""As the order of rays: the given one."""
# Where the fields of sixteen rays and their hits stand, in columns of sixteen words. Source: rtcore_ray.h.
_TNEAR, _TIME, _TFAR, _MASK, _ID, _FLAGS, _U, _V, _PRIMITIVE, _GEOMETRY, _COLUMNS = (
    3,
    7,
    8,
    9,
    10,
    11,
    15,
    16,
    17,
    18,
    21,
)


@functools.cache
def _library() -> ctypes.CDLL:
    """The Embree library of the package ``embreex``.

    Raises:
        SbmError: if the package does not hold the library.
    """
    spec = importlib.util.find_spec("embreex")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("No module named 'embreex'", name="embreex")
    package = Path(spec.origin).parent
    found = sorted(
        path
        for folder in (package.parent / "embreex.libs", package / ".dylibs", package)
        for path in folder.glob("*embree4*")
    )
    if not found:
        raise SbmError(f"{package} holds no Embree 4 library; install embreex anew, from a wheel")
    library = ctypes.CDLL(str(found[0]))
    pointer, number, size = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
    for name, result, arguments in (
        ("rtcNewDevice", pointer, (ctypes.c_char_p,)),
        ("rtcNewScene", pointer, (pointer,)),
        ("rtcSetSceneBuildQuality", None, (pointer, number)),
        ("rtcSetSceneFlags", None, (pointer, number)),
        ("rtcNewGeometry", pointer, (pointer, number)),
        ("rtcSetGeometryBuildQuality", None, (pointer, number)),
        ("rtcSetSharedGeometryBuffer", None, (pointer, number, number, number, pointer, size, size, size)),
        ("rtcCommitGeometry", None, (pointer,)),
        ("rtcAttachGeometry", number, (pointer, pointer)),
        ("rtcReleaseGeometry", None, (pointer,)),
        ("rtcCommitScene", None, (pointer,)),
        ("rtcReleaseScene", None, (pointer,)),
        ("rtcGetDeviceError", number, (pointer,)),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


@functools.cache
def _device() -> int:
    """One device for all scenes of the process."""
    return _library().rtcNewDevice(b"threads=1")


@functools.cache
def _address(name: str) -> int:
    """Address of a function of the library."""
    return ctypes.cast(getattr(_library(), name), ctypes.c_void_p).value or 0


@functools.cache
def _query(coherent: bool) -> Int64[np.ndarray, "5"]:
    """``RTCIntersectArguments``: all features, and whether rays start and point alike."""
    arguments = np.zeros(5, np.int64)
    arguments.view(np.int32)[:2] = (1 << 16) * coherent, -1
    return arguments


_indices = np.zeros((0, 3), np.uint32)


def _corner_indices(count: int) -> np.ndarray:
    """Indices of corners, three for each triangle, in order; shared by the trees of all scenes."""
    global _indices
    if len(_indices) < count:
        _indices = np.arange(3 * count, dtype=np.uint32).reshape(-1, 3)
    return _indices


class TriangleTree:
    """A search tree over triangles. Casting is safe from several threads."""

    def __init__(self, corners: Float32[np.ndarray, "n 3 3"], first: Int64[np.ndarray, "runs"] = _ONE_RUN) -> None:
        """Builds the tree.

        Args:
            corners: triangles; kept, and not to be changed while the tree is in use.
            first: where each run of triangles that belong together begins, from 0 on.

        Raises:
            SbmError: if Embree says that it cannot build it.
        """
        library, device = _library(), _device()
        vertices = np.ascontiguousarray(corners, np.float32).reshape(-1, 3)
        # Embree reads sixteen bytes for each vertex, so four behind the last one: those must be ours.
        if not _has_room_behind(vertices):
            vertices = np.concatenate([vertices, np.zeros((1, 3), np.float32)])
        counts = np.diff(first, append=len(corners))
        indices = _corner_indices(int(counts.max()))
        self._kept = vertices, indices
        self._first = first
        self._scene = library.rtcNewScene(device)
        weakref.finalize(self, library.rtcReleaseScene, self._scene)
        library.rtcSetSceneBuildQuality(self._scene, _FAST_BUILD)
        library.rtcSetSceneFlags(self._scene, _ROBUST)
        share = library.rtcSetSharedGeometryBuffer
        for start, count in zip(first.tolist(), counts.tolist(), strict=True):
            geometry = library.rtcNewGeometry(device, _TRIANGLES)
            library.rtcSetGeometryBuildQuality(geometry, _FAST_BUILD)
            share(geometry, _VERTICES, 0, _FLOAT3, vertices.ctypes.data, 36 * start, 12, 3 * count)
            share(geometry, _INDICES, 0, _UINT3, indices.ctypes.data, 0, 12, count)
            library.rtcCommitGeometry(geometry)
            library.rtcAttachGeometry(self._scene, geometry)
            library.rtcReleaseGeometry(geometry)
        library.rtcCommitScene(self._scene)
        if error := library.rtcGetDeviceError(device):
            raise SbmError(f"Embree cannot build a tree over {len(corners)} triangles (its error {error})")

    def cast(
        self,
        rays: Float32[np.ndarray, "n 6"],
        rows: Int64[np.ndarray, "triangles"],
        workers: Workers,
        order: Int64[np.ndarray, "n"] = AS_THEY_ARE,
    ) -> tuple[Float32[np.ndarray, "n"], Int64[np.ndarray, "n"], Float32[np.ndarray, "n 2"]]:
        """Nearest hits.

        Args:
            rays: origins and un-normalised directions.
            rows: what to call each triangle.
            workers: threads.
            order: which rays to trace together: it takes less time if they point alike. Where surfaces share a place,
                which of them is hit may depend on it.

        Returns:
            parameters (inf: no hit), names of the triangles (-1: no hit) and barycentric coordinates.
        """
        t, triangle = np.empty(len(rays), np.float32), np.empty(len(rays), np.int64)
        uv = np.empty((len(rays), 2), np.float32)
        calls = (_address("rtcIntersect16"), self._scene, _query(True).ctypes.data)
        _split(workers, _intersect, *calls, np.ascontiguousarray(rays), order, self._first, rows, t, triangle, uv)
        return t, triangle, uv

    def occluded(self, rays: Float32[np.ndarray, "n 6"], far: float, workers: Workers) -> Bool[np.ndarray, "n"]:
        """Whether anything lies on each ray before parameter ``far``."""
        hidden = np.empty(len(rays), bool)
        calls = (_address("rtcOccluded16"), self._scene, _query(False).ctypes.data)
        _split(workers, _occlude, *calls, np.ascontiguousarray(rays), AS_THEY_ARE, np.float32(far), hidden)
        return hidden


def _has_room_behind(vertices: Float32[np.ndarray, "n 3"]) -> bool:
    """Whether an array is followed by at least four bytes of its base array."""
    whole = vertices
    while isinstance(whole.base, np.ndarray):
        whole = whole.base
    end = vertices.ctypes.data + vertices.nbytes
    return whole.flags.c_contiguous and end + 4 <= whole.ctypes.data + whole.nbytes


def _split(workers: Workers, kernel, function: int, scene: int, query: int, rays, *columns) -> None:
    packets = -(-len(rays) // PACKET)
    workers.split(kernel, packets, function, scene, query, rays, *columns, least=128)


@intrinsic
def _call(typing_context, function, valid, scene, rays, query):
    """Calls ``function(valid, scene, rays, query)`` at an address."""
    del typing_context
    signature = types.void(*[types.uint64] * 5)

    def generate(context, builder, signature, arguments):
        del signature
        word = ir.IntType(64)
        pointer = ir.FunctionType(ir.VoidType(), [word] * 4).as_pointer()
        builder.call(builder.inttoptr(arguments[0], pointer), arguments[1:])
        return context.get_dummy_value()

    return signature, generate


@njit(cache=True, nogil=True)
def _packet_memory():
    """A row of words for which rays are valid, and the rays' columns below it; aligned to 64 bytes."""
    words = np.zeros((_COLUMNS + 2) * PACKET, np.float32)
    skipped = (64 - words.ctypes.data % 64) % 64 // 4
    return words[skipped : skipped + (_COLUMNS + 1) * PACKET].reshape(_COLUMNS + 1, PACKET)


@njit(cache=True, nogil=True)
def _fill_packet(words, start, rays, order, far):
    """Puts up to sixteen rays, from ``start`` on in their order, into a packet; returns how many."""
    count = min(PACKET, len(rays) - start)
    whole = words.view(np.uint32)
    for k in range(PACKET):
        whole[0, k] = _NOTHING if k < count else 0
    for k in range(count):
        ray = order[start + k] if len(order) else start + k
        for axis in range(3):
            words[1 + axis, k] = rays[ray, axis]
            words[5 + axis, k] = rays[ray, 3 + axis]
        words[1 + _TNEAR, k] = 0.0
        words[1 + _TIME, k] = 0.0
        words[1 + _TFAR, k] = far
        whole[1 + _MASK, k] = _NOTHING
        whole[1 + _ID, k] = 0
        whole[1 + _FLAGS, k] = 0
        whole[1 + _PRIMITIVE, k] = _NOTHING
        whole[1 + _GEOMETRY, k] = _NOTHING
    return count


@njit(cache=True, nogil=True)
def _intersect(start, stop, function, scene, query, rays, order, first_of, rows, t, triangle, uv):
    """Nearest hits of the packets [start, stop); columns as in ``TriangleTree.cast``."""
    words = _packet_memory()
    whole = words.view(np.uint32)
    at = words.ctypes.data
    for packet in range(start, stop):
        first = packet * PACKET
        count = _fill_packet(words, first, rays, order, np.float32(np.inf))
        _call(function, at, scene, at + 4 * PACKET, query)  # type: ignore[call-arg]
        for k in range(count):
            ray = order[first + k] if len(order) else first + k
            t[ray] = words[1 + _TFAR, k]
            if t[ray] < np.inf:
                triangle[ray] = rows[first_of[whole[1 + _GEOMETRY, k]] + whole[1 + _PRIMITIVE, k]]
                uv[ray, 0], uv[ray, 1] = words[1 + _U, k], words[1 + _V, k]
            else:
                triangle[ray], uv[ray, 0], uv[ray, 1] = -1, 0.0, 0.0


@njit(cache=True, nogil=True)
def _occlude(start, stop, function, scene, query, rays, order, far, hidden):
    """Whether rays of the packets [start, stop) meet anything before ``far``."""
    words = _packet_memory()
    at = words.ctypes.data
    for packet in range(start, stop):
        first = packet * PACKET
        count = _fill_packet(words, first, rays, order, far)
        _call(function, at, scene, at + 4 * PACKET, query)  # type: ignore[call-arg]
        for k in range(count):
            # Embree marks occluded rays by minus infinity.
            hidden[first + k] = words[1 + _TFAR, k] < 0.0
