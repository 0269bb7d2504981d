"""Meshes without thickness: cloth with a front and a back in one place, which shadow maps cover with speckles.

A shadow map cannot tell whether the front lies before the back or behind it, so the one throws shadows on the other.
"""

import mujoco
import numpy as np
from jaxtyping import Bool, Float

MAX_FACES = 2000
"""Meshes with more are not cloth of this kind."""
SAME_PLACE_M = 1e-4
FLAT = 1e-3
"""Angle-weighted normals around a corner may add up to this much, as rounding leaves it."""


def two_sided_meshes(model: mujoco.MjModel) -> Bool[np.ndarray, "ngeom"]:
    """Which geoms are meshes whose surface lies twice in each place, once facing either way.

    Args:
        model: the compiled model.
    """
    of_mesh = np.array([_is_two_sided(_triangles(model, mesh)) for mesh in range(model.nmesh)], bool)
    found = np.zeros(model.ngeom, bool)
    is_mesh = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    found[is_mesh] = of_mesh[model.geom_dataid[is_mesh]]
    return found


def _triangles(model: mujoco.MjModel, mesh: int) -> Float[np.ndarray, "n 3 3"]:
    start, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    if count > MAX_FACES:
        return np.zeros((0, 3, 3))
    first, vertices = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    places = np.asarray(model.mesh_vert[first : first + vertices], float)
    return places[np.asarray(model.mesh_face[start : start + count])]


def _is_two_sided(corners: Float[np.ndarray, "n 3 3"]) -> bool:
    """Whether around every corner as much surface faces one way as the other.

    Angles count, not areas: they are the same however a polygon is cut into triangles.
    """
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice_area = np.linalg.norm(normals, axis=1)
    corners, normals, twice_area = (column[twice_area > 0] for column in (corners, normals, twice_area))
    if len(corners) == 0:
        return False
    # Most meshes enclose a volume, which is found at once.
    volume = abs(float(np.einsum("nj,nj->", normals, corners[:, 0]))) / 6.0
    if volume > FLAT * float(0.5 * twice_area.sum()) ** 1.5:
        return False
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    lengths = np.linalg.norm(ahead, axis=2) * np.linalg.norm(behind, axis=2)
    angles = np.arccos(np.clip((ahead * behind).sum(axis=2) / np.maximum(lengths, 1e-30), -1.0, 1.0))
    shares = angles[:, :, None] * (normals / twice_area[:, None])[:, None]
    places = np.rint(corners.reshape(-1, 3) / SAME_PLACE_M).astype(np.int64)
    _, numbers = np.unique(places, axis=0, return_inverse=True)
    sums = np.zeros((int(numbers.max()) + 1, 3))
    np.add.at(sums, numbers.ravel(), shares.reshape(-1, 3))
    return bool(np.abs(sums).max() < FLAT)
