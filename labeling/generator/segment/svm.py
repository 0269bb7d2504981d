"""A support vector machine with RBF kernel, small and native: training by SMO, decisions a block of points at a time.

Everything here runs on one thread and leaves Python's lock to others, so that objects can be learnt side by side.

Source: Platt, "Fast Training of Support Vector Machines using Sequential Minimal Optimization" (1998); the working set
is chosen by second order, Fan, Chen, Lin, "Working Set Selection Using Second Order Information" (2005), as in LIBSVM.
"""

import numpy as np
from jaxtyping import Bool, Float, Float32
from numba import njit

_BLOCK = 256
"""Points whose decisions are summed together: their features stay in the first cache."""
_LOG2_E = np.float32(1.4426950408889634)
_LN_2 = np.float32(0.6931471805599453)
_LOWEST = np.float32(-126.0)
"""Powers of two below this are not normal numbers; what they stand for is 0 here."""


def train_svm(
    features: Float[np.ndarray, "n d"], positive: Bool[np.ndarray, "n"], c: float, gamma: float, tolerance: float = 1e-3
) -> tuple[Float32[np.ndarray, "s d"], Float32[np.ndarray, "s"], float]:
    """Trains a machine on two classes.

    Args:
        features: of both classes, of about unit scale.
        positive: which rows are of the class with positive decisions.
        c: bound on the coefficients.
        gamma: the kernel is ``exp(-gamma * squared distance)``.
        tolerance: greatest violation of the optimality conditions.

    Returns:
        Support vectors, their coefficients, and the intercept.
    """
    rows = np.ascontiguousarray(features, np.float32)
    kernel = _kernel_matrix(rows, np.float32(gamma))
    sign = np.where(positive, 1.0, -1.0)
    alpha, rho = _smo(kernel, sign, float(c), float(tolerance))
    used = alpha > 0
    return rows[used], (sign * alpha)[used].astype(np.float32), -float(rho)


def decide(
    features: Float32[np.ndarray, "n d"],
    support: Float32[np.ndarray, "s d"],
    coefficient: Float32[np.ndarray, "s"],
    gamma: float,
    intercept: float,
) -> Float32[np.ndarray, "n"]:
    """Decision values."""
    return _decide(
        np.ascontiguousarray(features, np.float32), support, coefficient, np.float32(gamma), np.float32(intercept)
    )


@njit(cache=True, nogil=True)
def _exp_block(exponent, result, bits, size):  # pragma: no cover - compiled
    """``result = exp(exponent)`` for exponents up to 0, to 3e-7: a polynomial and a power of two put together by bits.

    ``exponent``, ``result`` (float32) and ``bits`` (int32) hold a block of ``size``. Written as plain loops, so that
    the compiler makes vector instructions of them.
    """
    for i in range(size):
        doublings = max(exponent[i] * _LOG2_E, _LOWEST)
        whole = np.floor(doublings + np.float32(0.5))
        z = (doublings - whole) * _LN_2
        value = np.float32(1 / 720)
        value = value * z + np.float32(1 / 120)
        value = value * z + np.float32(1 / 24)
        value = value * z + np.float32(1 / 6)
        value = value * z + np.float32(0.5)
        value = value * z + np.float32(1.0)
        result[i] = value * z + np.float32(1.0)
        bits[i] = (np.int32(whole) + np.int32(127)) << np.int32(23)
    powers = bits.view(np.float32)
    for i in range(size):
        result[i] *= powers[i]


@njit(cache=True, nogil=True)
def _squares(columns, row, square, size):  # pragma: no cover - compiled
    """Squared distances, into ``square`` (size,), of the points in ``columns`` (d, size) to the point ``row`` (d,)."""
    for i in range(size):
        square[i] = np.float32(0.0)
    for j in range(len(row)):
        value, column = row[j], columns[j]
        for i in range(size):
            difference = column[i] - value
            square[i] += difference * difference


@njit(cache=True, nogil=True)
def _decide(features, support, coefficient, gamma, intercept):  # pragma: no cover - compiled
    """Decision values (n,) of ``features`` (n, d) from ``support`` vectors (s, d) and their ``coefficient`` (s,)."""
    n, d = features.shape
    decision = np.empty(n, np.float32)
    columns = np.empty((d, _BLOCK), np.float32)
    square, value = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    bits, total = np.empty(_BLOCK, np.int32), np.empty(_BLOCK, np.float32)
    for first in range(0, n, _BLOCK):
        size = min(_BLOCK, n - first)
        for i in range(size):
            total[i] = intercept
            for j in range(d):
                columns[j, i] = features[first + i, j]
        for s in range(len(coefficient)):
            _squares(columns, support[s], square, size)
            for i in range(size):
                square[i] *= -gamma
            _exp_block(square, value, bits, size)
            weight = coefficient[s]
            for i in range(size):
                total[i] += weight * value[i]
        for i in range(size):
            decision[first + i] = total[i]
    return decision


@njit(cache=True, nogil=True)
def _kernel_matrix(rows, gamma):  # pragma: no cover - compiled
    """``exp(-gamma * squared distance)`` between all ``rows`` (n, d), as (n, n) float32."""
    n = len(rows)
    columns = rows.T.copy()
    kernel = np.empty((n, n), np.float32)
    square, bits = np.empty(n, np.float32), np.empty(n, np.int32)
    for i in range(n):
        _squares(columns, rows[i], square, n)
        for j in range(n):
            square[j] *= -gamma
        _exp_block(square, kernel[i], bits, n)
    return kernel


@njit(cache=True, nogil=True)
def _smo(kernel, sign, c, tolerance):  # pragma: no cover - compiled
    """Coefficients (n,), all between 0 and ``c``, and offset of the machine.

    ``kernel`` is (n, n), ``sign`` (n,) is 1 for positive rows and -1 for negative ones.
    """
    n = len(sign)
    alpha, gradient = np.zeros(n), np.full(n, -1.0)
    for _ in range(100 * n + 10_000):
        # i violates its optimality condition most; j promises the greatest decrease together with it.
        i, highest = -1, -np.inf
        for t in range(n):
            if (alpha[t] < c) if sign[t] > 0 else (alpha[t] > 0):
                value = -sign[t] * gradient[t]
                if value > highest:
                    i, highest = t, value
        j, lowest, best = -1, np.inf, np.inf
        for t in range(n):
            if (alpha[t] > 0) if sign[t] > 0 else (alpha[t] < c):
                value = -sign[t] * gradient[t]
                lowest = min(lowest, value)
                if i >= 0 and value < highest:
                    curvature = max(2.0 - 2.0 * kernel[i, t], 1e-12)
                    decrease = -((highest - value) ** 2) / curvature
                    if decrease < best:
                        j, best = t, decrease
        if j < 0 or highest - lowest < tolerance:
            break
        step = (highest + sign[j] * gradient[j]) / max(2.0 - 2.0 * kernel[i, j], 1e-12)
        room_i = c - alpha[i] if sign[i] > 0 else alpha[i]
        room_j = alpha[j] if sign[j] > 0 else c - alpha[j]
        step = min(step, room_i, room_j)
        alpha[i] = min(c, max(0.0, alpha[i] + sign[i] * step))
        alpha[j] = min(c, max(0.0, alpha[j] - sign[j] * step))
        for t in range(n):
            gradient[t] += sign[t] * step * (kernel[i, t] - kernel[j, t])
    upper, lower, total, free = np.inf, -np.inf, 0.0, 0
    for t in range(n):
        value = sign[t] * gradient[t]
        if alpha[t] > 0 and alpha[t] < c:
            total += value
            free += 1
        elif (alpha[t] <= 0) == (sign[t] > 0):
            upper = min(upper, value)
        else:
            lower = max(lower, value)
    return alpha, total / free if free > 0 else 0.5 * (upper + lower)
