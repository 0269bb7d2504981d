"""High-dimensional Gaussian filtering on a permutohedral lattice, compiled with numba.

Source: Adams, Baek, Davis, "Fast High-Dimensional Filtering Using the Permutohedral Lattice" (2010); as used for
fully connected CRFs by Kraehenbuehl and Koltun (2011).

The lattice depends on the features of the points only, so one lattice filters any number of channels (all objects of
an episode at once). Every output row is computed by one thread in a fixed order: results do not depend on the number
of threads. The hash table is sized for the worst case before it is filled, serially, and only read in parallel.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32
from numba import njit, prange

_MAX_KEY = 2**63 - 1


@dataclass(frozen=True)
class Lattice:
    """A lattice around the features of n points: where each point sits, and which vertices are neighbours."""

    vertex: Int32[np.ndarray, "n d1"]
    """The d + 1 vertices of the simplex around each point."""
    weight: Float32[np.ndarray, "n d1"]
    """Barycentric coordinates of the point in its simplex."""
    neighbours: Int32[np.ndarray, "d1 m 2"]
    """Both neighbours of every vertex along each of the d + 1 directions; m where there is none."""
    point_start: Int32[np.ndarray, "m1"]
    """Where the points of each vertex start in ``point_of`` (compressed rows)."""
    point_of: Int32[np.ndarray, "nd"]
    """Points that touch a vertex, in rising order."""
    point_weight: Float32[np.ndarray, "nd"]
    """Their barycentric weights."""

    @property
    def num_points(self) -> int:
        """How many points the lattice was built for."""
        return self.vertex.shape[0]

    @property
    def num_vertices(self) -> int:
        """How many lattice vertices the points touch."""
        return self.neighbours.shape[1]

    def filter(self, values: Float32[np.ndarray, "n c"]) -> Float32[np.ndarray, "n c"]:
        """Sums ``values`` over all points, weighted by a Gaussian (sigma 1) of the distance between their features.

        The kernel is known up to one constant factor, which every use here divides out. The sum includes the point
        itself.

        Args:
            values: c channels for each point.

        Returns:
            The filtered channels.
        """
        if values.shape[0] != self.num_points:
            raise ValueError(f"the lattice holds {self.num_points} points, but {values.shape[0]} rows were given")
        vertices = _splat(np.ascontiguousarray(values, np.float32), self.point_start, self.point_of, self.point_weight)
        other = np.zeros_like(vertices)
        for direction in range(self.neighbours.shape[0]):
            _blur(vertices, other, self.neighbours[direction])
            vertices, other = other, vertices
        return _slice(vertices, self.vertex, self.weight)


def build_lattice(features: Float[np.ndarray, "n d"]) -> Lattice:
    """Builds the lattice of a set of feature vectors.

    Args:
        features: one row per point, each coordinate divided by the standard deviation wanted of the kernel there.

    Returns:
        The lattice.

    Raises:
        ValueError: if features are not finite, or spread over so many standard deviations that lattice keys would not
            fit 63 bits.
    """
    features = np.ascontiguousarray(features, np.float64)
    if features.ndim != 2 or not np.all(np.isfinite(features)):
        raise ValueError(f"features must be a finite (n, d) array, not shape {features.shape}")
    dimension = features.shape[1]
    key, rank, weight = _embed(features)
    lowest, highest = key.min(axis=0, initial=0), key.max(axis=0, initial=0)
    # A vertex of the simplex lies up to d below its remainder-0 corner and d above; a neighbour up to d further.
    margin = 2 * (dimension + 1)
    sides = [int(high) - int(low) + 2 * margin + 1 for low, high in zip(lowest, highest, strict=True)]
    strides, total = [], 1
    for side in sides:
        strides.append(total)
        total *= side
    if total > _MAX_KEY:
        raise ValueError(f"features spread over {sides} lattice cells, more than 63 bits can number; use wider kernels")
    stride = np.array(strides, np.int64)
    packed = _pack_vertices(key, rank, (lowest - margin).astype(np.int64), stride)
    capacity = 1 << max(4, int(2 * packed.size - 1).bit_length())
    vertex, table_key, table_id, vertex_key = _number_keys(packed, capacity)
    neighbours = _find_neighbours(vertex_key, stride, table_key, table_id)
    start, point_of, point_weight = _group_by_vertex(vertex, weight, len(vertex_key))
    return Lattice(vertex, weight, neighbours, start, point_of, point_weight)


@njit(cache=True, parallel=True)
def _embed(features):  # pragma: no cover - compiled
    """Elevates points to the hyperplane and finds the enclosing simplex. Source: Adams et al. 2010, section 3.1."""
    n, d = features.shape
    key = np.empty((n, d), np.int64)
    rank = np.empty((n, d + 1), np.int64)
    weight = np.empty((n, d + 1), np.float32)
    # Blurring with [1 2 1]/4 along d + 1 directions and splatting and slicing with the tent each add variance; this
    # factor makes them sum to 1.
    scale = np.sqrt(2.0 / 3.0) * (d + 1)
    for i in prange(n):
        elevated = np.empty(d + 1)
        corner = np.empty(d + 1)
        order = np.zeros(d + 1, np.int64)
        barycentric = np.zeros(d + 2)
        total = 0.0
        for j in range(d, 0, -1):
            value = features[i, j - 1] * scale / np.sqrt(j * (j + 1.0))
            elevated[j] = total - j * value
            total += value
        elevated[0] = total
        excess = 0
        for j in range(d + 1):
            cell = np.floor(elevated[j] / (d + 1) + 0.5)
            corner[j] = cell * (d + 1)
            excess += int(cell)
        for j in range(d):
            for k in range(j + 1, d + 1):
                if elevated[j] - corner[j] < elevated[k] - corner[k]:
                    order[j] += 1
                else:
                    order[k] += 1
        for j in range(d + 1):
            order[j] += excess
            if order[j] < 0:
                order[j] += d + 1
                corner[j] += d + 1
            elif order[j] > d:
                order[j] -= d + 1
                corner[j] -= d + 1
        for j in range(d + 1):
            value = (elevated[j] - corner[j]) / (d + 1)
            barycentric[d - order[j]] += value
            barycentric[d + 1 - order[j]] -= value
        barycentric[0] += 1.0 + barycentric[d + 1]
        for j in range(d + 1):
            rank[i, j] = order[j]
            weight[i, j] = barycentric[j]
        for j in range(d):
            key[i, j] = int(corner[j])
    return key, rank, weight


@njit(cache=True, parallel=True)
def _pack_vertices(key, rank, lowest, stride):  # pragma: no cover - compiled
    """One integer for every vertex of every point's simplex."""
    n, d = key.shape
    packed = np.empty((n, d + 1), np.int64)
    for i in prange(n):
        for remainder in range(d + 1):
            number = np.int64(0)
            for j in range(d):
                step = remainder if rank[i, j] <= d - remainder else remainder - (d + 1)
                number += (key[i, j] + step - lowest[j]) * stride[j]
            packed[i, remainder] = number
    return packed


@njit(cache=True, inline="always")
def _slot(key, mask):  # pragma: no cover - compiled
    """Home slot of a key: Fibonacci hashing, high bits folded onto low ones."""
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64((mixed ^ (mixed >> np.uint64(29))) & np.uint64(mask))


@njit(cache=True)
def _number_keys(packed, capacity):  # pragma: no cover - compiled
    """Numbers distinct keys in order of appearance, in a table that is at most half full and never grows."""
    n, corners = packed.shape
    mask = capacity - 1
    table_key = np.full(capacity, -1, np.int64)
    table_id = np.empty(capacity, np.int32)
    vertex = np.empty((n, corners), np.int32)
    vertex_key = np.empty(n * corners, np.int64)
    count = 0
    for i in range(n):
        for j in range(corners):
            key = packed[i, j]
            slot = _slot(key, mask)
            while table_key[slot] != -1 and table_key[slot] != key:
                slot = (slot + 1) & mask
            if table_key[slot] == -1:
                table_key[slot] = key
                table_id[slot] = count
                vertex_key[count] = key
                count += 1
            vertex[i, j] = table_id[slot]
    return vertex, table_key, table_id, vertex_key[:count].copy()


@njit(cache=True, parallel=True)
def _find_neighbours(vertex_key, stride, table_key, table_id):  # pragma: no cover - compiled
    m, d = len(vertex_key), len(stride)
    mask = len(table_key) - 1
    all_strides = np.int64(0)
    for j in range(d):
        all_strides += stride[j]
    neighbours = np.empty((d + 1, m, 2), np.int32)
    for i in prange(m):
        for direction in range(d + 1):
            step = -all_strides
            if direction < d:
                step += (d + 1) * stride[direction]
            for side in range(2):
                key = vertex_key[i] + (step if side == 0 else -step)
                slot = _slot(key, mask)
                while table_key[slot] != -1 and table_key[slot] != key:
                    slot = (slot + 1) & mask
                neighbours[direction, i, side] = table_id[slot] if table_key[slot] == key else m
    return neighbours


@njit(cache=True)
def _group_by_vertex(vertex, weight, m):  # pragma: no cover - compiled
    """Compressed rows vertex -> points, so that splatting is a gather: parallel, and in one order always."""
    n, corners = vertex.shape
    start = np.zeros(m + 1, np.int32)
    for i in range(n):
        for j in range(corners):
            start[vertex[i, j] + 1] += 1
    for i in range(m):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    point_of = np.empty(n * corners, np.int32)
    point_weight = np.empty(n * corners, np.float32)
    for i in range(n):
        for j in range(corners):
            place = fill[vertex[i, j]]
            fill[vertex[i, j]] = place + 1
            point_of[place] = i
            point_weight[place] = weight[i, j]
    return start, point_of, point_weight


@njit(cache=True, parallel=True)
def _splat(values, start, point_of, point_weight):  # pragma: no cover - compiled
    m, channels = len(start) - 1, values.shape[1]
    vertices = np.zeros((m + 1, channels), np.float32)
    for i in prange(m):
        for place in range(start[i], start[i + 1]):
            point, weight = point_of[place], point_weight[place]
            for c in range(channels):
                vertices[i, c] += weight * values[point, c]
    return vertices


@njit(cache=True, parallel=True)
def _blur(old, new, neighbours):  # pragma: no cover - compiled
    """[1 2 1] / 4 along one direction. The last row stands for all vertices that do not exist, and stays zero."""
    m, channels = neighbours.shape[0], old.shape[1]
    for i in prange(m):
        a, b = neighbours[i, 0], neighbours[i, 1]
        for c in range(channels):
            new[i, c] = np.float32(0.5) * old[i, c] + np.float32(0.25) * (old[a, c] + old[b, c])


@njit(cache=True, parallel=True)
def _slice(vertices, vertex, weight):  # pragma: no cover - compiled
    n, corners = vertex.shape
    channels = vertices.shape[1]
    values = np.zeros((n, channels), np.float32)
    for i in prange(n):
        for j in range(corners):
            row, share = vertex[i, j], weight[i, j]
            for c in range(channels):
                values[i, c] += share * vertices[row, c]
    return values
