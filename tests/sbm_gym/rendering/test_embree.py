"""Search trees against brute force over all triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sbm_gym.rendering.rays.embree import TriangleTree
from sbm_gym.rendering.rays.workers import Workers

WORKERS = Workers(1)


def nearest_by_brute_force(corners: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Parameter of the nearest hit of each ray, inf for none (Möller and Trumbore, double precision)."""
    a, b, c = (corners[:, k].astype(float) for k in range(3))
    nearest = np.full(len(rays), np.inf)
    for n, ray in enumerate(rays.astype(float)):
        p = np.cross(ray[3:], c - a)
        determinant = np.einsum("td,td->t", b - a, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("td,td->t", ray[:3] - a, p) / determinant
            q = np.cross(ray[:3] - a, b - a)
            v = q @ ray[3:] / determinant
            t = np.einsum("td,td->t", c - a, q) / determinant
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0)
        nearest[n] = t[hit].min(initial=np.inf)
    return nearest


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(0, 50))
@settings(max_examples=40)
def test_hits_are_those_of_brute_force(seed: int, triangles: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    corners = (rng.uniform(-1, 1, (triangles, 1, 3)) + rng.normal(0, 0.5, (triangles, 3, 3))).astype(np.float32)
    rays = np.concatenate([rng.uniform(-2, 2, (count, 3)), rng.normal(0, 1, (count, 3))], axis=1).astype(np.float32)
    names = rng.permutation(triangles) + 100
    tree = TriangleTree(corners)
    t, triangle, uv = tree.cast(rays, names, WORKERS)
    expected = nearest_by_brute_force(corners, rays)
    # A ray that grazes an edge may be decided either way.
    agrees = np.isclose(t, expected, rtol=1e-3, atol=1e-4) | (np.isinf(t) & np.isinf(expected))
    assert (~agrees).sum() <= max(1, 0.03 * count)
    hit = triangle >= 0
    assert np.array_equal(hit, np.isfinite(t))
    assert np.isin(triangle[hit], names).all()
    rows = np.argsort(names)[np.searchsorted(np.sort(names), triangle[hit])]
    weights = np.concatenate([1 - uv[hit].sum(axis=1, keepdims=True), uv[hit]], axis=1)
    points = np.einsum("nk,nkd->nd", weights, corners[rows])
    np.testing.assert_allclose(points, rays[hit, :3] + t[hit, None] * rays[hit, 3:], atol=2e-3)
    for far in (0.5, 1.0, np.inf):
        hidden = tree.occluded(rays, far, WORKERS)
        clear = np.abs(t - far) > 1e-4 if np.isfinite(far) else np.ones(count, bool)
        assert np.array_equal(hidden[clear], (t < far)[clear])


def test_threads_change_nothing() -> None:
    rng = np.random.default_rng(1)
    corners = rng.uniform(-1, 1, (500, 3, 3)).astype(np.float32)
    rays = rng.normal(0, 1, (5000, 6)).astype(np.float32)
    tree, rows = TriangleTree(corners), np.arange(500)
    alone, together = tree.cast(rays, rows, WORKERS), tree.cast(rays, rows, Workers(3))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(tree.occluded(rays, 1.0, WORKERS), tree.occluded(rays, 1.0, Workers(3)))
    again = TriangleTree(corners.copy())
    for one, other in zip(alone, again.cast(rays, rows, WORKERS), strict=True):
        np.testing.assert_array_equal(one, other)


@given(st.integers(0, 2**32 - 1), st.integers(1, 200), st.integers(1, 30), st.integers(1, 100))
@settings(max_examples=40)
def test_neither_runs_nor_the_order_of_rays_change_what_is_hit(
    seed: int, triangles: int, runs: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (triangles, 3, 3)).astype(np.float32)
    rays = rng.normal(0, 1, (count, 6)).astype(np.float32)
    names = rng.permutation(triangles)
    first = np.unique(np.append(0, rng.integers(0, triangles, runs)))
    expected = TriangleTree(corners).cast(rays, names, WORKERS)
    found = TriangleTree(corners, first).cast(rays, names, WORKERS, rng.permutation(count))
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_no_light_gets_through_the_seams_of_a_surface() -> None:
    """A wavy sheet whose triangles do not share corners: every ray that crosses it is stopped."""
    n = 60
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    points = np.stack([x, y, 0.2 * np.sin(5 * x) * np.cos(4 * y)], axis=-1).astype(np.float32)
    low, right, up, corner = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    corners = np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((low, right, corner), (low, corner, up))])
    # Towards the seams themselves, and everywhere else.
    rng = np.random.default_rng(0)
    share = rng.uniform(0, 1, (20000, 1))
    row, column = rng.integers(1, n - 1, 20000), rng.integers(1, n - 2, 20000)
    a, b = points[row, column], points[row, column + 1]
    aims = np.concatenate([a + share * (b - a), rng.uniform(-0.9, 0.9, (20000, 3)) * [1, 1, 0]])
    eye = np.array([0.1, -0.2, 3.0])
    rays = np.concatenate([np.broadcast_to(eye, aims.shape), 2 * (aims - eye)], axis=1).astype(np.float32)
    tree = TriangleTree(corners)
    assert tree.occluded(rays, 1.0, WORKERS).all()
    assert np.isfinite(tree.cast(rays, np.arange(len(corners)), WORKERS)[0]).all()


def test_triangles_at_the_end_of_their_memory_are_read_safely() -> None:
    whole = np.random.default_rng(2).uniform(-1, 1, (40, 3, 3)).astype(np.float32)
    rays = np.random.default_rng(3).normal(0, 1, (100, 6)).astype(np.float32)
    for part in (whole, whole[:20], whole[20:]):
        expected = TriangleTree(part.copy()).cast(rays, np.arange(len(part)), WORKERS)[0]
        np.testing.assert_array_equal(TriangleTree(part).cast(rays, np.arange(len(part)), WORKERS)[0], expected)


def test_a_package_without_the_library_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    from labeling.core.errors import SbmError
    from sbm_gym.rendering.rays import embree

    class Spec:
        origin = str(tmp_path / "embreex" / "__init__.py")

    monkeypatch.setattr(embree.importlib.util, "find_spec", lambda name: Spec)
    with pytest.raises(SbmError, match="holds no Embree 4 library; install embreex anew"):
        embree._library.__wrapped__()
