"""Corruptions of files, drawn at random: JSON and tables with odd values, bytes cut and flipped, forged headers."""

import copy
import json
import os
import struct
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

ODD_VALUES: tuple[Any, ...] = (
    *(None, True, False, -1, 0, 1, 3, 2**31, -(2**63), 10**30, 1e308, -1e308, 1e-9, 0.5, 1e9, 25e9),
    *(float("nan"), float("inf"), float("-inf"), "", "x", "nan", "../../etc/passwd", "/etc/passwd", "\0", "\x1b[31m"),
    *("é" * 50, "a" * 100_000, [], {}, [[]], [None], {"size": [100_000, 100_000]}, [1e9] * 6, [[1e6] * 4] * 4),
)
"""What stands where something else should."""
HUGE_PX = (30_000, 65_000)
"""Sides that headers of pictures claim."""


def damage(folder: Path, names: list[str], rng: np.random.Generator) -> dict[str, str]:
    """Corrupts one file of a folder, or two.

    Args:
        folder: the files are changed in place.
        names: of the files to choose from, below the folder.
        rng: decides everything.

    Returns:
        What was done, by file.
    """
    done = {}
    for _ in range(1 + int(rng.random() < 0.25)):
        name = names[int(rng.integers(len(names)))]
        file = folder / name
        if file.is_file() and not file.is_symlink():
            done[name] = _damage_file(file, rng)
    return done


def _damage_file(file: Path, rng: np.random.Generator) -> str:
    drawn = rng.random()
    if drawn < 0.04:
        file.unlink()
        return "gone"
    if drawn < 0.06:
        file.unlink()
        file.mkdir()
        return "a folder"
    if drawn < 0.08:
        file.unlink()
        os.mkfifo(file)
        return "a pipe that nobody writes to"
    if drawn < 0.10:
        file.unlink()
        file.symlink_to(file.name)
        return "a link to itself"
    data = file.read_bytes()
    if file.suffix == ".json" and drawn < 0.85:
        try:
            content = json.loads(data)
        except ValueError:
            content = None
        if content is not None:
            content, what = damage_json(content, rng)
            file.write_text(json.dumps(content))
            return what
    if file.suffix in (".txt", ".yaml", ".yml", ".csv", ".obj", ".mtl", ".properties") and drawn < 0.85:
        text, what = damage_table(data.decode("utf-8", "replace"), rng)
        file.write_text(text)
        return what
    members = _members(file) if drawn < 0.85 else {}
    if members:
        return _damage_member(file, members, rng)
    if file.suffix == ".png" and drawn < 0.3:
        file.write_bytes(forge_png_size(data, rng))
        return "a PNG whose header claims to be huge"
    changed, what = damage_bytes(data, rng)
    file.write_bytes(changed)
    return what


def _members(file: Path) -> dict[str, bytes]:
    """The files in a zip archive; none if it is no valid one."""
    if not zipfile.is_zipfile(file):
        return {}
    try:
        with zipfile.ZipFile(file) as archive:
            return {name: archive.read(name) for name in archive.namelist()}
    except Exception:  # spoilt already
        return {}


def _damage_member(file: Path, members: dict[str, bytes], rng: np.random.Generator) -> str:
    """Spoils one file of a zip archive, which stays a valid archive; one in an archive within it likewise."""
    name = sorted(members)[int(rng.integers(len(members)))]
    with tempfile.TemporaryDirectory() as folder:
        member = Path(folder) / f"member{Path(name).suffix}"
        member.write_bytes(members[name])
        what = _damage_file(member, rng) if rng.random() < 0.9 else "gone"
        if what in ("gone", "a folder", "a pipe that nobody writes to", "a link to itself"):
            what = "gone"
            del members[name]
        else:
            members[name] = member.read_bytes()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for kept, data in members.items():
            archive.writestr(kept, data)
    return f"{name}: {what}"


def damage_json(content: Any, rng: np.random.Generator) -> tuple[Any, str]:
    """A JSON value with one to three places changed, all depths alike, and what was done."""
    content, done = copy.deepcopy(content), []
    for _ in range(int(rng.integers(1, 4))):
        if not isinstance(content, dict | list):
            break
        places = _places(content)
        depth = int(rng.integers(0, max(map(len, places)) + 1))
        chosen = [place for place in places if len(place) == depth]
        path = chosen[int(rng.integers(len(chosen)))]
        value = copy.deepcopy(ODD_VALUES[int(rng.integers(len(ODD_VALUES)))])
        if not path:
            content = value
            done.append(f"all = {_short(value)}")
            continue
        parent = content
        for key in path[:-1]:
            parent = parent[key]
        where, action = "/".join(map(str, path)), rng.choice(["replace", "replace", "delete", "repeat", "scale"])
        old = parent[path[-1]]
        if action == "delete":
            del parent[path[-1]]
        elif action == "repeat" and isinstance(parent, list):
            parent.append(copy.deepcopy(old))
        elif action == "scale" and isinstance(old, int | float) and not isinstance(old, bool):
            parent[path[-1]] = old * float(rng.choice([-1.0, 1e-6, 0.5, 2.0, 1e3, 1e6, 1e12]))
        else:
            action, parent[path[-1]] = f"= {_short(value)}", value
        done.append(f"{where} {action}")
    return content, "; ".join(done)


def damage_table(text: str, rng: np.random.Generator) -> tuple[str, str]:
    """A text of lines of words with one word or line changed, and what was done."""
    lines = text.splitlines()
    if not lines:
        return "x", "a word in an empty file"
    row = int(rng.integers(len(lines)))
    action = str(rng.choice(["word", "word", "word", "delete", "repeat", "cut"]))
    if action == "delete":
        del lines[row]
    elif action == "repeat":
        lines.insert(row, lines[row])
    elif action == "cut":
        lines[row] = lines[row][: len(lines[row]) // 2]
    else:
        words = lines[row].split(" ")
        at = int(rng.integers(len(words)))
        words[at] = str(ODD_VALUES[int(rng.integers(len(ODD_VALUES)))])
        lines[row], action = " ".join(words), f"word {at + 1} = {_short(words[at])}"
    return "\n".join(lines) + "\n", f"line {row + 1}: {action}"


def damage_bytes(data: bytes, rng: np.random.Generator) -> tuple[bytes, str]:
    """Bytes cut off, changed, put in or doubled, and what was done."""
    action = str(rng.choice(["cut", "flip", "flip", "insert", "empty", "double"]))
    if action == "empty" or not data:
        return b"", "empty"
    if action == "double":
        return data + data, "twice"
    at = int(rng.integers(len(data)))
    if rng.random() < 0.5:  # headers are short, and matter
        at = min(at, int(rng.integers(256)))
    if action == "cut":
        return data[:at], f"cut after {at} bytes"
    noise = rng.bytes(int(rng.integers(1, 13)))
    return data[:at] + noise + data[at + (len(noise) if action == "flip" else 0) :], f"{action} at byte {at}"


def forge_png_size(data: bytes, rng: np.random.Generator) -> bytes:
    """A PNG whose header, with a valid checksum, claims a huge size."""
    import zlib

    size = struct.pack(">II", *(int(rng.integers(*HUGE_PX)) for _ in range(2)))
    header = b"IHDR" + size + data[24:29]
    return data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:]


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """All paths into a JSON value; of long lists the first and the last few."""
    if isinstance(value, dict):
        children = list(value.items())
    elif isinstance(value, list):
        children = list(enumerate(value))
        children = children if len(children) <= 12 else children[:6] + children[-6:]
    else:
        children = []
    return [path, *(below for key, child in children for below in _places(child, (*path, key)))]


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
