"""One step of Gauss-Newton for the poses of all views together."""

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from labeling.core.geometry import invert_rigid
from labeling.generator.poses.pair_sums import PairSums

PRIOR_RAD = 0.05
"""Standard deviation of the prior on recorded poses: of rotations in radians (3 degrees), of positions as a share of
the depth. It decides only what the residuals leave open: the common frame of all views, and shifts along planes."""
INDEPENDENT = 0.1
"""Weight of each surfel against the prior: below 1, since errors of neighbouring surfels are correlated."""
TOLERANCE, MAX_ITERATIONS = 1e-5, 300
"""Of the conjugate gradient solver: relative tolerance, and most iterations."""


def motions(
    start: Float[np.ndarray, "views 4 4"], end: Float[np.ndarray, "views 4 4"]
) -> Float64[np.ndarray, "views 6"]:
    """Rotation vector (radians) and translation (metres) of each camera between two poses, in the first one's frame."""
    between = np.einsum("vab,vbc->vac", np.stack([invert_rigid(one) for one in start]), end)
    return np.concatenate([Rotation.from_matrix(between[:, :3, :3]).as_rotvec(), between[:, :3, 3]], axis=1)


def moved(
    camera_to_world: Float[np.ndarray, "views 4 4"], motion: Float[np.ndarray, "views 6"]
) -> Float64[np.ndarray, "views 4 4"]:
    """The poses after motions as ``motions`` returns them."""
    by = np.tile(np.eye(4), (len(motion), 1, 1))
    by[:, :3, :3], by[:, :3, 3] = Rotation.from_rotvec(motion[:, :3]).as_matrix(), motion[:, 3:]
    return np.einsum("vab,vbc->vac", camera_to_world, by)


def joint_step(
    found: PairSums, correction: Float[np.ndarray, "views 6"], depth_m: Float[np.ndarray, "views"]
) -> Float64[np.ndarray, "views 6"]:
    """One Gauss-Newton step: how each camera should move so that the views agree better.

    Args:
        found: residuals and derivatives at the present poses.
        correction: from the recorded to the present poses (``motions``).
        depth_m: median depth of each view, 0 if it has none.

    Returns:
        Motions, as ``motions`` has them. The weak prior on the recorded poses fixes the common frame: the one in which
        corrections are least.
    """
    from scipy.sparse.linalg import LinearOperator, cg

    views = len(correction)
    distance_m = np.where(depth_m > 0, depth_m, 1.0).astype(float)
    prior = np.repeat(np.stack([np.ones(views), 1 / distance_m**2], axis=1) / PRIOR_RAD**2, 3, axis=1)
    matrix, gradient = _normal_equations(found, views, INDEPENDENT)
    diagonal = matrix.indptr[:-1] + [
        int(np.flatnonzero(matrix.indices[a:b] == v)[0])
        for v, (a, b) in enumerate(zip(matrix.indptr[:-1], matrix.indptr[1:], strict=True))
    ]
    matrix.data[diagonal] += np.eye(6) * prior[:, None]
    inverse = np.linalg.inv(matrix.data[diagonal])
    apply = LinearOperator(matrix.shape, lambda one: np.einsum("vab,vb->va", inverse, one.reshape(-1, 6)).ravel())
    step, _ = cg(matrix, -(gradient + prior * correction).ravel(), rtol=TOLERANCE, maxiter=MAX_ITERATIONS, M=apply)
    return step.reshape(-1, 6)


def _normal_equations(found: PairSums, views: int, weight: float):
    """Block-sparse Hessian (6 views, 6 views), in which every diagonal block is present, and gradient (views, 6)."""
    from scipy.sparse import bsr_array

    carry = _adjoints(found.first_to_second)
    first, second = found.pairs.T
    back = np.einsum("pba,pbc->pac", carry, found.hessian)
    every = np.arange(views)
    rows, columns = (
        np.concatenate([first, second, first, second, every]),
        np.concatenate([first, second, second, first, every]),
    )
    blocks = [np.einsum("pab,pbc->pac", back, carry), found.hessian, -back, -np.moveaxis(back, 1, 2)]
    places, inverse = np.unique(rows * views + columns, return_inverse=True)
    data = np.zeros((len(places), 6, 6))
    np.add.at(data, inverse, weight * np.concatenate([*blocks, np.zeros((views, 6, 6))]))
    start = np.searchsorted(places, views * np.arange(views + 1))
    gradient = np.zeros((views, 6))
    np.add.at(gradient, first, weight * np.einsum("pba,pb->pa", carry, found.gradient))
    np.add.at(gradient, second, -weight * found.gradient)
    return bsr_array((data, places % views, start), shape=(6 * views, 6 * views)), gradient


def _adjoints(transform: Float64[np.ndarray, "pairs 4 4"]) -> Float64[np.ndarray, "pairs 6 6"]:
    """Adjoint matrices: they turn a camera's motion in its own frame into that in the frame a transform leads to."""
    found = np.zeros((len(transform), 6, 6))
    found[:, :3, :3] = found[:, 3:, 3:] = transform[:, :3, :3]
    shift = np.broadcast_to(transform[:, None, :3, 3], transform[:, :3, :3].shape)
    found[:, 3:, :3] = np.cross(shift, np.moveaxis(transform[:, :3, :3], 1, 2)).transpose(0, 2, 1)
    return found
