"""What nodes of a cluster must have in common with the machine that they work for, so that bytes are the same."""

import functools
import hashlib
import platform
from collections.abc import Mapping, Sequence

from labeling.cluster.cluster_config import Contents, SameThere
from labeling.runtime.code_digest import PACKAGES, ROOT
from labeling.runtime.provenance import EXPERIMENT_PACKAGES, SIMULATION_PACKAGES, package_versions

_CODE, _WEIGHTS = (".py", ".toml", ".json", ".yaml"), (".safetensors",)
LABELING_LIBRARIES = ("numpy", "numba", "scipy", "opencv-python-headless", "hotcoco", "torch", "onnxruntime", "ray")
"""Whose versions must agree where both machines have them."""
ALL_LIBRARIES = tuple(dict.fromkeys((*LABELING_LIBRARIES, *SIMULATION_PACKAGES, *EXPERIMENT_PACKAGES)))
"""For work above ``labeling``: what is recorded names them, and so they must agree where they are missing, too."""


def packages_up_to(module: str) -> tuple[str, ...]:
    """The project's packages that a module may import: its own and those below; the lowest for modules of others."""
    package = module.partition(".")[0]
    return PACKAGES[: PACKAGES.index(package) + 1] if package in PACKAGES else PACKAGES[:1]


@functools.cache
def files_of(packages: Sequence[str], suffixes: Sequence[str]) -> Contents:
    """Digests of files that are installed with packages, by their paths."""
    return {
        path.relative_to(ROOT).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for package in packages
        for path in sorted((ROOT / package).rglob("*.*"))
        if path.suffix in suffixes and path.is_file() and "results" not in path.parts
    }


def library_versions(packages: Sequence[str]) -> Contents:
    """Versions of Python and of libraries that results depend on, for work of these packages of the project."""
    if tuple(packages) == PACKAGES[:1]:
        found = {name: version for name, version in package_versions(LABELING_LIBRARIES).items() if version}
    else:
        found = {name: version or "missing" for name, version in package_versions(ALL_LIBRARIES).items()}
    return {"python": platform.python_version(), **found}


def contents_here(packages: tuple[str, ...], more: Sequence[SameThere]) -> dict[str, Contents]:
    """All that must agree, as it is on this machine, by kind."""
    return {
        "code": files_of(packages, _CODE),
        "weights": files_of(packages, _WEIGHTS),
        "versions": library_versions(packages),
        **{same.name: same.contents() for same in more},
    }


def differences(expected: Mapping[str, Contents], found: Mapping[str, Contents]) -> list[str]:
    """Says what differs, a phrase for each kind; empty if nothing does.

    >>> differences({"versions": {"numpy": "2.4.1", "ray": "2.60"}}, {"versions": {"numpy": "2.4.0", "ray": "2.60"}})
    ['versions: numpy is 2.4.0 there and 2.4.1 here']

    Args:
        expected: on the machine that gives the jobs.
        found: on the node; it may have other libraries, but no other code.
    """
    phrases = []
    for kind, contents in expected.items():
        there = found.get(kind, {})
        names = sorted({*contents} & {*there} if kind == "versions" else {*contents} | {*there})
        unlike = [name for name in names if contents.get(name) != there.get(name)]
        if unlike:
            here, other = (_short(side.get(unlike[0])) for side in (contents, there))
            more = f", and {len(unlike) - 1} more" if len(unlike) > 1 else ""
            phrases.append(f"{kind}: {unlike[0]} is {other} there and {here} here{more}")
    return phrases


def _short(value: str | None) -> str:
    return "missing" if value is None else value[:12]
