"""Reading JSON that others have written: every access checks, and every error names file and field."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import msgspec
import numpy as np

from labeling.core.errors import EpisodeFormatError
from labeling.formats.regular_file import regular


@dataclass(frozen=True)
class Json:
    """A JSON value and where it stands."""

    value: Any
    file: Path
    field: str = ""

    def where(self, name: str = "") -> str:
        """``file: field`` for messages."""
        field = ".".join(part for part in (self.field, name) if part)
        return f"{self.file}: {field}" if field else str(self.file)

    def error(self, problem: str, name: str = "") -> EpisodeFormatError:
        """An error about this value, or about one of its fields."""
        return EpisodeFormatError(f"{self.where(name)}: {problem}")

    def mapping(self) -> dict[str, Any]:
        """The value as a JSON object."""
        if not isinstance(self.value, dict):
            raise self.error(f"must be a JSON object, not {_kind(self.value)}")
        return self.value

    def finite_mapping(self) -> dict[str, Any]:
        """The value as a mapping that can be written as JSON again.

        Raises:
            EpisodeFormatError: if it is no mapping, or holds NaN or infinity, which JSON does not have.
        """
        found = self.mapping()
        try:
            json.dumps(found, allow_nan=False)
        except ValueError:
            raise self.error("holds NaN or infinity") from None
        return found

    def has(self, name: str) -> bool:
        """Whether the object has this field."""
        return name in self.mapping()

    def get(self, name: str) -> "Json":
        """A field that must be there."""
        if not self.has(name):
            raise self.error("is missing", name)
        return Json(self.value[name], self.file, ".".join(part for part in (self.field, name) if part))

    def items(self) -> list["Json"]:
        """The elements of a JSON list."""
        if not isinstance(self.value, list):
            raise self.error(f"must be a list, not {_kind(self.value)}")
        return [Json(item, self.file, f"{self.field}[{index}]") for index, item in enumerate(self.value)]

    def list_of(self, name: str) -> list["Json"]:
        """The elements of a list field."""
        return self.get(name).items()

    def text(self, name: str) -> str:
        """A non-empty text field."""
        value = self.get(name).value
        if not isinstance(value, str) or not value or "\x00" in value:
            raise self.error(f"must be a non-empty text, not {_kind(value)}", name)
        try:
            value.encode()
        except UnicodeEncodeError:  # half of a surrogate pair, which JSON can spell but no file or screen can hold
            raise self.error(f"must be Unicode text, not {_kind(value)}", name) from None
        return value

    def file_name(self, name: str) -> str:
        """A text field that files are named for: one part of a path, which leads nowhere else.

        A colon is part of a name, as in a time of day, but for one behind the letter of a drive.
        """
        value = self.text(name)
        if (
            value in (".", "..")
            or PureWindowsPath(value).drive
            or any(character in value for character in "/\\")
            or not value.isprintable()
        ):
            raise self.error(f"must be a plain name, without slashes, not {_kind(value)}", name)
        return value

    def relative_path(self, name: str) -> PurePosixPath:
        """A text field that names a file in a folder: no absolute path, and none that leaves the folder."""
        path = PurePosixPath(self.text(name).replace("\\", "/"))
        if path.is_absolute() or ".." in path.parts or PureWindowsPath(path).drive:
            raise self.error(f"must be a file below the folder, not {_kind(str(path))}", name)
        return path

    def number(self, name: str, default: float | None = None, above: int | float | None = None) -> float:
        """A finite number, above a bound if one is given; it must be there if it has no default."""
        if default is not None and not self.has(name):
            return float(default)
        value = self.get(name).value
        # Compared, not converted: a whole number may be too large for a float.
        if type(value) not in (int, float) or not abs(value) <= sys.float_info.max:
            raise self.error(f"must be a finite number, not {_kind(value)}", name)
        if above is not None and not value > above:
            raise self.error(f"must be above {above:g}, not {value:g}", name)
        return float(value)

    def integer(self, name: str) -> int:
        """A whole number."""
        value = self.get(name).value
        if type(value) is not int:
            raise self.error(f"must be a whole number, not {_kind(value)}", name)
        return value

    def flag(self, name: str) -> bool:
        """A truth value, 0 and 1 included; false where it is missing."""
        if not self.has(name):
            return False
        value = self.get(name).value
        if value not in (0, 1):
            raise self.error(f"must be 0 or 1, not {_kind(value)}", name)
        return bool(value)

    def array(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """Numbers in nested lists of this shape, all finite."""
        value = self.get(name).value
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise self.error("must be nested lists of numbers", name) from None
        # numpy reads "1", true and null as numbers too.
        if not all(type(item) in (int, float) for item in np.array(value, dtype=object).ravel()):
            raise self.error("must be nested lists of numbers", name)
        if array.shape != shape:
            raise self.error(f"must have shape {shape}, not {array.shape}", name)
        if not np.all(np.isfinite(array)):
            raise self.error("holds NaN or infinity", name)
        return array


def read_text(path: Path) -> str:
    """Reads a text file.

    Raises:
        EpisodeFormatError: if the file is missing or is not text.
    """
    try:
        return regular(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise EpisodeFormatError(f"{path}: file is missing") from None
    except (OSError, UnicodeDecodeError) as error:
        raise EpisodeFormatError(f"{path}: cannot be read ({error})") from None


def read_json(path: Path) -> Json:
    """Reads a JSON file.

    Raises:
        EpisodeFormatError: if the file is missing or is not JSON.
    """
    text = read_text(path)
    try:
        return Json(msgspec.json.decode(text), path)
    except (msgspec.MsgspecError, RecursionError):
        pass  # Python takes more for JSON, such as NaN, and says where it is wrong
    try:
        return Json(json.loads(text), path)
    except (ValueError, RecursionError) as error:  # ValueError: also a number of thousands of digits
        raise EpisodeFormatError(f"{path}: not valid JSON ({error})") from None


def _kind(value: Any) -> str:
    """A short name of a value for messages."""
    text = json.dumps(value) if isinstance(value, str | int | float | bool) or value is None else type(value).__name__
    return text if len(text) <= 40 else text[:37] + "..."
