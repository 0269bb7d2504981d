"""High-dimensional Gaussian filtering on a permutohedral lattice, compiled with numba.

Source: Adams, Baek, Davis, "Fast High-Dimensional Filtering Using the Permutohedral Lattice" (2010); as used for
fully connected CRFs by Kraehenbuehl and Koltun (2011).

The lattice depends on the features of the points only. Points may come in blocks that do not see each other, such as
the neighbourhoods of the objects of an episode: one lattice then filters all of them, and each block's part of it is
small enough for the cache. Each block is worked on by one thread at a time, in a fixed order: results do not depend on
the number of threads. Hash tables have a fixed size while they are filled, and are made anew, larger, if that was too
small.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float, Float32, Int, Int32
from numba import njit, prange

_MAX_KEY = 2**63 - 1
_CHUNK = 1024
"""Points that one thread takes at a time."""


@dataclass(frozen=True)
class Lattice:
    """A lattice around the features of n points: where each point sits, and which vertices are neighbours."""

    vertex: Int32[np.ndarray, "n d1"]
    """The d + 1 vertices of the simplex around each point."""
    weight: Float32[np.ndarray, "n d1"]
    """Barycentric coordinates of the point in its simplex."""
    neighbours: Int32[np.ndarray, "d1 m 2"]
    """Both neighbours of every vertex along each of the d + 1 directions; m where there is none."""
    block_start: Int[np.ndarray, "b1"]
    """Where the points of each block start; the last entry is n."""
    vertex_start: Int[np.ndarray, "b1"]
    """Where the vertices of each block start; the last entry is m."""

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
        filtered = np.empty((len(values), values.shape[1]), np.float32)
        arrays = self.vertex, self.weight, self.neighbours, self.block_start, self.vertex_start
        shares = _shares(self.block_start)
        for channel in range(values.shape[1]):
            filtered[:, channel] = _filter(np.ascontiguousarray(values[:, channel], np.float32), *arrays, *shares)
        return filtered


def lattice_of_blocks(parts: Sequence[tuple[Lattice, int]]) -> Lattice:
    """One lattice of blocks that are in others already.

    Args:
        parts: at least one lattice and the number of a block of it, in the order of the new blocks.
    """
    points = [slice(*one.block_start[block : block + 2]) for one, block in parts]
    vertices = [slice(*one.vertex_start[block : block + 2]) for one, block in parts]
    block_start, vertex_start = (np.cumsum([0, *(own.stop - own.start for own in two)]) for two in (points, vertices))
    first = parts[0][0]
    vertex = np.empty((block_start[-1], first.vertex.shape[1]), np.int32)
    weight = np.empty(vertex.shape, np.float32)
    neighbours = np.empty((len(first.neighbours), vertex_start[-1], 2), np.int32)
    for number, ((one, _), old, own) in enumerate(zip(parts, points, vertices, strict=True)):
        new, shift = slice(*block_start[number : number + 2]), np.int32(vertex_start[number] - own.start)
        vertex[new], weight[new] = one.vertex[old] + shift, one.weight[old]
        known = one.neighbours[:, own]
        neighbours[:, slice(*vertex_start[number : number + 2])] = np.where(
            known < one.num_vertices, known + shift, np.int32(vertex_start[-1])
        )
    return Lattice(vertex, weight, neighbours, block_start, vertex_start)


def build_lattice(features: Float[np.ndarray, "n d"], block_start: Int[np.ndarray, "b1"] | None = None) -> Lattice:
    """Builds the lattice of a set of feature vectors.

    Args:
        features: one row per point, each coordinate divided by the standard deviation wanted of the kernel there.
        block_start: where the blocks of points start, and the number of points at the end; points of different blocks
            do not see each other. None for a single block.

    Returns:
        The lattice.

    Raises:
        ValueError: if features are not finite, or spread over so many standard deviations that lattice keys would not
            fit 63 bits.
    """
    features = np.ascontiguousarray(features, np.float64)
    if features.ndim != 2 or not np.all(np.isfinite(features)):
        raise ValueError(f"features must be a finite (n, d) array, not shape {features.shape}")
    if block_start is None:
        block_start = np.array([0, len(features)])
    blocks = np.ascontiguousarray(block_start, np.int64)
    if blocks[0] != 0 or blocks[-1] != len(features) or np.any(np.diff(blocks) < 0):
        raise ValueError(f"block_start must rise from 0 to the {len(features)} points, not {blocks.tolist()}")
    dimension = features.shape[1]
    key, rank, weight = _embed(features)
    # Where the points lie does not matter, only how far they spread.
    lowest, highest = (key.min(axis=0), key.max(axis=0)) if len(key) else (np.zeros(dimension), np.zeros(dimension))
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
    vertex, tables, vertex_start, vertex_key = _number_all(packed, blocks)
    neighbours = _find_neighbours(vertex_key, vertex_start, stride, *tables)
    return Lattice(vertex, weight, neighbours, blocks, vertex_start)


def _number_all(packed, blocks):
    """Numbers the distinct keys of ``packed`` (n, d + 1), block after block, in tables that are at most half full."""
    corners = packed.shape[1]
    capacity = np.array([1 << max(6, int(size * corners // 2).bit_length()) for size in np.diff(blocks)], np.int64)
    while True:
        table_start = np.concatenate([[0], np.cumsum(capacity)])
        vertex, table_key, table_id, vertex_key, count = _number_keys(packed, blocks, table_start, *_shares(blocks))
        if (count >= 0).all():
            break
        capacity = np.where(count < 0, 4 * capacity, capacity)
    vertex_start = np.concatenate([[0], np.cumsum(count)])
    kept = _compress(vertex, table_id, vertex_key, blocks, table_start, vertex_start)
    return vertex, (table_key, table_id, table_start), vertex_start, kept


def _shares(blocks):
    """Blocks dealt to the threads, the largest first and each to the one with least to do: blocks, and where each
    thread's start.
    """
    load, dealt = np.zeros(numba.get_num_threads()), [[] for _ in range(numba.get_num_threads())]
    for block in np.argsort(-np.diff(blocks), kind="stable"):
        thread = int(load.argmin())
        dealt[thread].append(block)
        load[thread] += blocks[block + 1] - blocks[block]
    return np.array([b for one in dealt for b in one], np.int64), np.cumsum([0, *(len(one) for one in dealt)])


@njit(cache=True, parallel=True)
def _embed(features):  # pragma: no cover - compiled
    """Elevates ``features`` (n, d) to the hyperplane and finds the enclosing simplex.

    Returns its remainder-0 corner (n, d) int32, the ranks (n, d + 1) int8 and the barycentric coordinates (n, d + 1) of
    each point. Source: Adams et al. 2010, section 3.1.
    """
    n, d = features.shape
    key = np.empty((n, d), np.int32)
    rank = np.empty((n, d + 1), np.int8)
    weight = np.empty((n, d + 1), np.float32)
    # Blurring with [1 2 1]/4 along d + 1 directions and splatting and slicing with the tent each add variance; this
    # factor makes them sum to 1.
    scale = np.sqrt(2.0 / 3.0) * (d + 1)
    for chunk in prange((n + _CHUNK - 1) // _CHUNK):
        elevated, corner = np.empty(d + 1), np.empty(d + 1)
        order, barycentric = np.empty(d + 1, np.int64), np.empty(d + 2)
        for i in range(chunk * _CHUNK, min(n, (chunk + 1) * _CHUNK)):
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
                order[j] = 0
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
            barycentric[:] = 0.0
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
    """One integer for every vertex of every point's simplex, (n, d + 1) int64.

    ``key`` (n, d) and ``rank`` (n, d + 1) are those of ``_embed``; ``lowest`` and ``stride`` (d,) number the cells.
    """
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


@njit(cache=True, parallel=True)
def _number_keys(packed, blocks, table_start, dealt, share_start):  # pragma: no cover - compiled
    """Numbers the distinct keys of each block in order of appearance; count -1 where its table got over half full.

    ``packed`` is (n, d + 1); ``blocks`` and ``table_start`` (b + 1,) say where points and tables of blocks start;
    ``dealt`` and ``share_start`` which blocks each thread works on.
    """
    n, corners = packed.shape
    num_blocks = len(blocks) - 1
    table_key = np.full(table_start[-1], -1, np.int64)
    table_id = np.empty(table_start[-1], np.int32)
    vertex = np.empty((n, corners), np.int32)
    vertex_key = np.empty(n * corners, np.int64)
    counts = np.zeros(num_blocks, np.int64)
    for share in prange(len(share_start) - 1):
        for place in range(share_start[share], share_start[share + 1]):
            block = dealt[place]
            first, last, base = blocks[block], blocks[block + 1], table_start[block]
            counts[block] = _number_block(
                packed[first:last],
                table_key[base : table_start[block + 1]],
                table_id[base : table_start[block + 1]],
                vertex[first:last],
                vertex_key[first * corners : last * corners],
            )
    return vertex, table_key, table_id, vertex_key, counts


@njit(cache=True, nogil=True)
def _number_block(packed, table_key, table_id, vertex, vertex_key):  # pragma: no cover - compiled
    """The same for one block, into its parts of the arrays; returns the number of keys, or -1."""
    mask, corners = len(table_key) - 1, packed.shape[1]
    count = 0
    for i in range(len(packed)):
        if 2 * (count + corners) > mask:
            return -1
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
    return count


@njit(cache=True, parallel=True)
def _compress(vertex, table_id, vertex_key, blocks, table_start, vertex_start):  # pragma: no cover - compiled
    """Counts vertices over all blocks, in place, and returns their keys (m,) without gaps between the blocks."""
    corners = vertex.shape[1]
    kept = np.empty(vertex_start[-1], np.int64)
    for block in prange(len(blocks) - 1):
        offset, first = vertex_start[block], blocks[block] * corners
        for i in range(blocks[block], blocks[block + 1]):
            for j in range(corners):
                vertex[i, j] += offset
        for slot in range(table_start[block], table_start[block + 1]):
            table_id[slot] += offset
        for number in range(vertex_start[block + 1] - offset):
            kept[offset + number] = vertex_key[first + number]
    return kept


@njit(cache=True, parallel=True)
def _find_neighbours(vertex_key, vertex_start, stride, table_key, table_id, table_start):  # pragma: no cover - compiled
    """Both neighbours of each vertex along every direction, (d + 1, m, 2) int32; m where there is none.

    ``vertex_key`` is (m,), ``vertex_start`` and ``table_start`` (b + 1,), ``stride`` (d,).
    """
    m, d = len(vertex_key), len(stride)
    all_strides = np.int64(0)
    for j in range(d):
        all_strides += stride[j]
    neighbours = np.empty((d + 1, m, 2), np.int32)
    for chunk in prange((m + _CHUNK - 1) // _CHUNK):
        block = np.searchsorted(vertex_start, chunk * _CHUNK, side="right") - 1
        for i in range(chunk * _CHUNK, min(m, (chunk + 1) * _CHUNK)):
            while i >= vertex_start[block + 1]:
                block += 1
            base = table_start[block]
            mask = table_start[block + 1] - base - 1
            for direction in range(d + 1):
                step = -all_strides
                if direction < d:
                    step += (d + 1) * stride[direction]
                for side in range(2):
                    key = vertex_key[i] + (step if side == 0 else -step)
                    slot = _slot(key, mask)
                    while table_key[base + slot] != -1 and table_key[base + slot] != key:
                        slot = (slot + 1) & mask
                    neighbours[direction, i, side] = table_id[base + slot] if table_key[base + slot] == key else m
    return neighbours


@njit(cache=True, parallel=True)
def _filter(
    values, vertex, weight, neighbours, block_start, vertex_start, dealt, share_start
):  # pragma: no cover - compiled
    """Splats ``values`` (n,), blurs them along every direction, and slices, (n,); each block by one thread.

    The other arguments are those of ``Lattice``, and the blocks dealt to the threads (``_shares``).
    """
    m = neighbours.shape[1]
    filtered = np.empty(len(values), np.float32)
    # One entry more for all vertices that do not exist; it stays zero.
    here, there = np.zeros(m + 1, np.float32), np.empty(m + 1, np.float32)
    there[m] = 0.0
    for share in prange(len(share_start) - 1):
        for place in range(share_start[share], share_start[share + 1]):
            block = dealt[place]
            first, last = block_start[block], block_start[block + 1]
            low, high = vertex_start[block], vertex_start[block + 1]
            _splat(values, vertex, weight, first, last, here)
            for direction in range(len(neighbours)):
                if direction % 2 == 0:
                    _blur(here, there, neighbours[direction], low, high)
                else:
                    _blur(there, here, neighbours[direction], low, high)
            if len(neighbours) % 2 == 0:
                _slice(here, vertex, weight, first, last, filtered)
            else:
                _slice(there, vertex, weight, first, last, filtered)
    return filtered


# Functions of their own, so that the compiler knows which array is which and keeps their addresses at hand.


@njit(cache=True, nogil=True)
def _splat(values, vertex, weight, first, last, vertices):  # pragma: no cover - compiled
    """Adds ``values`` of the points from ``first`` to ``last`` to their ``vertices`` (m + 1,), in place."""
    for i in range(first, last):
        value = values[i]
        for j in range(vertex.shape[1]):
            vertices[vertex[i, j]] += weight[i, j] * value


@njit(cache=True, nogil=True)
def _blur(old, new, neighbours, low, high):  # pragma: no cover - compiled
    """[1 2 1] / 4 along one direction, of the vertices from ``low`` to ``high``; ``neighbours`` is (m, 2)."""
    for v in range(low, high):
        new[v] = np.float32(0.5) * old[v] + np.float32(0.25) * (old[neighbours[v, 0]] + old[neighbours[v, 1]])


@njit(cache=True, nogil=True)
def _slice(vertices, vertex, weight, first, last, filtered):  # pragma: no cover - compiled
    """Interpolates ``filtered`` (n,) of the points from ``first`` to ``last`` from their vertices, in place."""
    for i in range(first, last):
        total = np.float32(0.0)
        for j in range(vertex.shape[1]):
            total += weight[i, j] * vertices[vertex[i, j]]
        filtered[i] = total
