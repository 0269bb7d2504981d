"""Reading colour and depth pictures that others have written."""

import struct
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from labeling.core.errors import EpisodeFormatError
from labeling.formats.pixel_limit import jpeg_size, max_pixels, too_large
from labeling.formats.regular_file import regular


def read_colour(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """A colour picture with 8 bits a channel; grey and transparent ones become RGB.

    Raises:
        EpisodeFormatError: naming the file.
    """
    image = read_picture(path)
    if image.dtype != np.uint8:
        raise EpisodeFormatError(f"{path}: colour must have 8 bits a channel, not {image.dtype}")
    if image.ndim == 2:
        return cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
    code = cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB
    return cv2.cvtColor(image, code)


def read_depth(path: Path, depth_unit_m: float) -> Float32[np.ndarray, "h w"]:
    """A depth picture in metres: a 16-bit PNG, or an array of numpy (``.npy``).

    Returns:
        Depth; 0 where there is no return, which pictures write as 0 or as 65535.

    Raises:
        EpisodeFormatError: naming the file.
    """
    units = _read_array(path) if path.suffix.lower() == ".npy" else read_picture(path)
    if units.ndim != 2 or (units.dtype != np.uint16 and path.suffix.lower() != ".npy"):
        raise EpisodeFormatError(f"{path}: depth must be a single-channel 16-bit PNG, not {units.dtype} {units.shape}")
    if units.dtype == np.uint16:
        return _metres_of_units(depth_unit_m)[units]
    with np.errstate(over="ignore", invalid="ignore"):
        depth_m = (units * np.float64(depth_unit_m)).astype(np.float32)
    return np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, 0)


@lru_cache(maxsize=8)
def _metres_of_units(depth_unit_m: float) -> Float32[np.ndarray, "65536"]:
    """Metres of every depth that 16 bits can tell.

    In double precision, so that writing what was read gives the same millimetres and reading them the same metres.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        metres = (np.arange(1 << 16) * np.float64(depth_unit_m)).astype(np.float32)
    metres[-1] = 0  # the highest number stands for "no return" in pictures of many sensors
    return metres


def same_view(depth_size: tuple[int, int], colour_size: tuple[int, int]) -> bool:
    """Whether two sizes (height, width) can be one picture at two resolutions: one factor, rounded to whole pixels."""
    depth, colour = np.array([depth_size, colour_size])
    return bool(((depth - 0.5) / colour).max() < ((depth + 0.5) / colour).min())


def enlarge_depth(depth_m: Float32[np.ndarray, "dh dw"], size: tuple[int, int]) -> Float32[np.ndarray, "h w"]:
    """Depth at another resolution, by the nearest pixel: averages over an edge would be points in mid-air."""
    rows, columns = (
        np.minimum(((np.arange(new) + 0.5) * old / new).astype(int), old - 1)
        for new, old in zip(size, depth_m.shape, strict=True)
    )
    return depth_m[np.ix_(rows, columns)]


def register_depth(
    depth_m: Float32[np.ndarray, "dh dw"],
    depth_intrinsics: Float[np.ndarray, "3 3"],
    intrinsics: Float[np.ndarray, "3 3"],
    size: tuple[int, int],
) -> Float32[np.ndarray, "h w"]:
    """Depth of a camera that stands where the colour camera stands, in the pixels of the colour camera.

    Args:
        depth_m: z-depth in the depth camera's pixels.
        depth_intrinsics: its K.
        intrinsics: K of the colour camera.
        size: height and width of the colour picture.

    Returns:
        For each colour pixel the z-depth of the nearest depth pixel on its ray; 0 out of the depth camera's view.
    """
    inside, index = [], []
    for axis, (new, old) in enumerate(zip(size[::-1], depth_m.shape[::-1], strict=True)):
        ray = (np.arange(new) - intrinsics[axis, 2]) / intrinsics[axis, axis]
        place = ray * depth_intrinsics[axis, axis] + depth_intrinsics[axis, 2]
        pixel = np.rint(np.clip(place, -2, old + 1)).astype(int)
        inside.append((pixel >= 0) & (pixel < old))
        index.append(np.clip(pixel, 0, old - 1))
    return np.where(np.outer(inside[1], inside[0]), depth_m[np.ix_(index[1], index[0])], np.float32(0))


def reproject_depth(
    depth_m: Float32[np.ndarray, "dh dw"],
    depth_intrinsics: Float[np.ndarray, "3 3"],
    depth_to_colour: Float[np.ndarray, "4 4"],
    intrinsics: Float[np.ndarray, "3 3"],
    size: tuple[int, int],
) -> Float32[np.ndarray, "h w"]:
    """Depth of a camera that stands beside the colour camera, as that one would have seen it.

    Args:
        depth_m: z-depth in the depth camera's pixels.
        depth_intrinsics: its K.
        depth_to_colour: rigid transform of points from its frame to the colour camera's (OpenCV axes).
        intrinsics: K of the colour camera.
        size: height and width of the colour picture.

    Returns:
        z-depth before the colour camera of the nearest surface at each of its pixels; 0 where the depth camera has seen
        none. Each pixel of depth covers as much as it has seen, so that larger pictures have no gaps.
    """
    from labeling.core.geometry import unproject_depth
    from labeling.core.splatting import splat
    from labeling.core.views import Camera

    points, pixels = unproject_depth(depth_m, depth_intrinsics, depth_to_colour)
    # A pixel seen by another camera covers up to half as much again where it is turned, or its surface is.
    edges_m = 1.5 * depth_m.ravel()[pixels] / min(depth_intrinsics[0, 0], depth_intrinsics[1, 1])
    nearest = splat(points, Camera(intrinsics, np.eye(4), size), edges_m)
    found, hit = np.zeros(size, np.float32), nearest >= 0
    found[hit] = points[nearest[hit], 2]
    return found


class Undistortion:
    """Removes the lens distortion of one view; the undistorted picture has the same K."""

    def __init__(self, intrinsics: Float[np.ndarray, "3 3"], distortion: tuple[float, ...], size: tuple[int, int]):
        """Prepares the maps. ``distortion``: OpenCV's k1 k2 p1 p2 k3; ``size``: height and width."""
        height_px, width_px = size
        self._maps = cv2.initUndistortRectifyMap(
            intrinsics, np.array(distortion), np.eye(3), intrinsics, (width_px, height_px), cv2.CV_32FC1
        )

    def colour(self, rgb: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """An undistorted colour picture; black where the lens has seen nothing."""
        return cv2.remap(rgb, *self._maps, cv2.INTER_LINEAR)

    def depth(self, depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        """Undistorted depth, from the nearest pixel."""
        return cv2.remap(depth_m, *self._maps, cv2.INTER_NEAREST)

    def mask(self, mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
        """An undistorted mask, from the nearest pixel."""
        return cv2.remap(mask.astype(np.uint8), *self._maps, cv2.INTER_NEAREST).astype(bool)


def size_text(image: np.ndarray) -> str:
    """``WIDTHxHEIGHT`` for messages."""
    return f"{image.shape[1]}x{image.shape[0]}"


def read_picture(path: Path, flags: int = cv2.IMREAD_UNCHANGED) -> np.ndarray:
    """Reads a picture, by default as it is stored; a truncated file is an error, not a picture with a grey half.

    Raises:
        EpisodeFormatError: naming the file.
    """
    try:
        content = regular(path).read_bytes()
    except OSError as error:
        raise EpisodeFormatError(f"{path}: cannot be read ({error})") from None
    if content[:8] == b"\x89PNG\r\n\x1a\n":
        _check_png(path, content)
    if content[:3] == b"\xff\xd8\xff":
        if b"\xff\xd9" not in content[-1024:]:
            raise EpisodeFormatError(f"{path}: the JPEG is truncated ({len(content)} bytes); copy or export it again")
        _check_size(path, jpeg_size(content) or (0, 0))
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), flags) if content else None
    except cv2.error:
        image = None
    if image is None:
        raise EpisodeFormatError(f"{path}: not a picture that can be read ({len(content)} bytes); expected PNG or JPEG")
    _check_size(path, image.shape[:2])
    return image


def _check_size(path: Path, size: tuple[int, ...]) -> None:
    if problem := too_large(size[0], size[1]):
        raise EpisodeFormatError(f"{path}: {problem}")


def _check_png(path: Path, content: bytes) -> None:
    """Refuses, before anything is decoded, a PNG that lacks its end, or whose forged sizes would claim memory.

    OpenCV takes as many bytes as a chunk says that it has, up to 4 GB, before it looks whether they are there.
    """
    if len(content) < 33 or b"IEND" not in content[-16:]:  # shorter than the signature and the chunk of the size
        raise EpisodeFormatError(f"{path}: the PNG is truncated ({len(content)} bytes); copy or export it again")
    width_px, height_px = struct.unpack(">II", content[16:24])
    _check_size(path, (height_px, width_px))
    start = 8
    while start + 12 <= len(content):
        length, kind = struct.unpack(">I4s", content[start : start + 8])
        start += 12 + length
        if kind == b"IEND":
            return
    raise EpisodeFormatError(f"{path}: the PNG's parts reach beyond its {len(content)} bytes; copy or export it again")


def _read_array(path: Path) -> np.ndarray:
    """Reads numbers that numpy has saved; objects, which could hold code, are refused."""
    try:
        array = np.load(regular(path), mmap_mode="r", allow_pickle=False)
        if not isinstance(array, np.ndarray):
            array.close()
            raise ValueError("an archive of several arrays")
        if array.size > max_pixels() or array.dtype.kind not in "fui":
            raise ValueError(f"{array.dtype} {array.shape}")
        return np.array(array)
    except (OSError, ValueError, EOFError, TypeError, OverflowError) as error:  # the last two: sizes that are none
        raise EpisodeFormatError(f"{path}: not an array of depths that can be read ({error})") from None
