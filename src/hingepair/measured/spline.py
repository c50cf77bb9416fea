"""Smoothing splines through noisy columns: the linear smoother that positions, attitudes and angles share.

Of all curves f the one that makes `sum (y_i - f(t_i))^2 + lambda int f^(5)^2 dt` least, written in B-splines of
degree 7 on knots closer than the curve can bend (Eilers and Marx, Statistical Science 11 (1996), 89-121): solved in
time proportional to the samples, and well conditioned at any lambda. Away from the ends a cosine of f Hz comes out
multiplied by 1 / (1 + (f / bandwidth)^10), without delay. The penalty is on the fifth derivative because it is
accelerations that are asked for: with the third or second, what noise leaves in them is up to ten times as large for
the same motion.

The bandwidth is that of the least generalised cross validation (Craven and Wahba, Numerische Mathematik 31 (1979),
377-403), each degree of freedom counted 1.4 times, against its habit of following noise now and then (Kim and Gu,
Journal of the Royal Statistical Society B 66 (2004), 337-356).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import MissingDependencyError
from hingepair.numeric.arrays import Float64Array

FEWEST = 8
"""Samples of a piece that is smoothed."""
_DEGREE = 7
_PENALTY = 5
_KNOTS = 4.0
"""Knots in a period of the bandwidth."""
_COUNTED = 1.4
_WIDER = 1.1
"""What the bandwidth of least cross validation is multiplied by: derivatives near the ends gain more by it than those
in the middle lose."""
_PROBES = 16
_WINDOW, _WINDOWS = 4096, 8
"""Of long records the bandwidth is chosen on so many stretches of so many samples."""


class Smoothed(NamedTuple):
    """Smooth columns at the instants asked for, and how sure they are.

    Attributes:
        values: and first and second derivative; shape (3, M, k); NaN outside the pieces.
        bandwidth: of the smoothing [Hz].
        noise: standard deviation of the noise of one sample of one column.
        errors: standard deviations that this noise leaves in values, first and second derivatives; shape (3,).
    """

    values: Float64Array
    bandwidth: float
    noise: float
    errors: Float64Array


def smooth_columns(
    t: Float64Array, columns: Float64Array, pieces: Sequence[NDArray[np.intp]], bandwidth: float | None
) -> Smoothed:
    """Columns smoothed piece by piece, with derivatives, at every instant between the ends of a piece.

    Args:
        t: instants, increasing [s]; shape (N,).
        columns: shape (N, k); those of pieces finite.
        pieces: samples of each unbroken piece, FEWEST at least (`hingepair.measured.instants.pieces`).
        bandwidth: [Hz]; chosen by the data where None.

    Raises:
        MissingDependencyError: SciPy is not installed.
    """
    try:
        import scipy.linalg  # noqa: F401
    except ImportError as error:
        wanted = "SciPy (pip install '.[measured]' in the project's folder)"
        raise MissingDependencyError("smooth", wanted, str(error)) from None
    used = np.concatenate(pieces)
    if bandwidth is None:
        bandwidth = _chosen_bandwidth(t, columns, pieces)
    spline = Spline([t[piece] for piece in pieces], bandwidth)
    probes = np.random.default_rng(0).standard_normal((used.size, 4))
    fitted = spline.solve(np.concatenate((columns[used], probes), axis=-1))
    k = columns.shape[1]
    inside = np.zeros(t.size, dtype=bool)
    owners = np.zeros(t.size, dtype=np.intp)
    for i, piece in enumerate(pieces):
        inside[piece[0] : piece[-1] + 1] = True
        owners[piece[0] : piece[-1] + 1] = i
    values = np.full((3, t.size, k + 4), np.nan)
    for order in range(3):
        values[order, inside] = spline.evaluate(fitted, t[inside], owners[inside], order)
    rest = columns[used] - values[0, used, :k]
    freedom = max(used.size - spline.freedom(), 1.0)
    noise = float(np.sqrt((rest * rest).sum() / (k * freedom)))
    errors = noise * np.sqrt((values[:, inside, k:] ** 2).mean(axis=(1, 2)))
    return Smoothed(values[:, :, :k], bandwidth, noise, errors)


def _chosen_bandwidth(t: Float64Array, columns: Float64Array, pieces: Sequence[NDArray[np.intp]]) -> float:
    """The bandwidth of least generalised cross validation."""
    if sum(piece.size for piece in pieces) > _WINDOW * _WINDOWS:
        pieces = _stretches(pieces)
    times = [t[piece] - t[piece[0]] for piece in pieces]
    values = np.concatenate([columns[piece] for piece in pieces])
    count = values.shape[0]
    longest, step = max(time[-1] for time in times), sum(time[-1] for time in times) / count

    def score(logarithm: float) -> float:
        spline = Spline(times, float(np.exp(logarithm)))
        share = 1 - _COUNTED * spline.freedom() / count
        if share <= 0:
            return np.inf
        rest = values - spline.fitted(spline.solve(values))
        return float((rest * rest).sum() / share**2)

    scan = np.arange(np.log(0.1 / longest), np.log(0.5 / step), np.log(2) / 2)
    scores = np.array([score(x) for x in scan])
    if not np.isfinite(scores).any():
        return float(np.exp(scan[0]))
    best = int(np.argmin(scores))
    found, width = float(scan[best]), np.log(2) / 4
    lowest = scores[best]
    for _ in range(3):
        for x in (found - width, found + width):
            if (value := score(x)) < lowest:
                found, lowest = x, value
        width /= 2
    return _WIDER * float(np.exp(found))


def _stretches(pieces: Sequence[NDArray[np.intp]]) -> list[NDArray[np.intp]]:
    """Some stretches of the pieces, evenly spread."""
    whole = np.concatenate(pieces)
    owners = np.repeat(np.arange(len(pieces)), [piece.size for piece in pieces])
    found = []
    for start in np.linspace(0, whole.size - _WINDOW, _WINDOWS).astype(np.intp):
        stretch, owner = whole[start : start + _WINDOW], owners[start : start + _WINDOW]
        found += [part for part in np.split(stretch, np.flatnonzero(np.diff(owner)) + 1) if part.size >= FEWEST]
    return found


class Spline:
    """B-splines on uniform knots of their own in each piece, and the penalty of a bandwidth.

    Args:
        times: instants of each piece [s].
        bandwidth: [Hz].
    """

    def __init__(self, times: Sequence[Float64Array], bandwidth: float) -> None:
        from scipy.linalg import cholesky_banded

        spans = np.array([time[-1] - time[0] for time in times])
        counts = np.array([time.size for time in times])
        step = float(spans.sum() / (counts - 1).sum())
        widest = max(1 / (_KNOTS * bandwidth), step)
        self.intervals = np.maximum(1, np.ceil(spans / widest * (1 - 1e-12))).astype(np.intp)
        self.widths = spans / self.intervals
        self.starts = np.array([time[0] for time in times])
        self.offsets = np.concatenate(([0], np.cumsum(self.intervals + _DEGREE)))
        owners = np.repeat(np.arange(len(times)), counts)
        self.rows, self.basis = self._located(np.concatenate(times), owners, 0)
        self.normal = self._normal()
        weight = (2 * np.pi * bandwidth) ** (-2 * _PENALTY) / step
        self.factor = cholesky_banded(self.normal + weight * self._penalty(), check_finite=False)

    def _located(
        self, t: Float64Array, owners: NDArray[np.intp], order: int
    ) -> tuple[NDArray[np.intp], Float64Array]:
        """The first B-spline of each instant, and the values of the eight that are not zero there; (M,), (8, M)."""
        x = (t - self.starts[owners]) / self.widths[owners]
        interval = np.clip(x.astype(np.intp), 0, self.intervals[owners] - 1)
        powers = (x - interval) ** np.arange(_DEGREE + 1 - order)[:, None]
        return self.offsets[owners] + interval, _pieces_of_basis(order) @ powers / self.widths[owners] ** order

    def _normal(self) -> Float64Array:
        """B^T B, upper bands."""
        size = int(self.offsets[-1])
        bands = np.zeros((_DEGREE + 1, size))
        for i in range(_DEGREE + 1):
            for j in range(i, _DEGREE + 1):
                bands[_DEGREE - (j - i)] += np.bincount(
                    self.rows + j, weights=self.basis[i] * self.basis[j], minlength=size
                )
        return bands

    def _penalty(self) -> Float64Array:
        """The integrals of products of fifth derivatives, upper bands."""
        bands = np.zeros((_DEGREE + 1, int(self.offsets[-1])))
        nodes, weights = np.polynomial.legendre.leggauss(_DEGREE - _PENALTY + 1)
        powers = ((nodes + 1) / 2) ** np.arange(_DEGREE + 1 - _PENALTY)[:, None]
        bends = _pieces_of_basis(_PENALTY) @ powers
        products = (bends * (weights / 2)) @ bends.T
        scale = np.repeat(self.widths ** (1 - 2 * _PENALTY), self.intervals)
        start = np.concatenate([np.arange(n) + o for n, o in zip(self.intervals, self.offsets[:-1], strict=True)])
        for i in range(_DEGREE + 1):
            for j in range(i, _DEGREE + 1):
                bands[_DEGREE - (j - i), start + j] += products[i, j] * scale
        return bands

    def _gathered(self, columns: Float64Array) -> Float64Array:
        """B^T y."""
        size = int(self.offsets[-1])
        found = np.zeros((size, columns.shape[1]))
        for k, column in enumerate(columns.T):
            for i in range(_DEGREE + 1):
                found[:, k] += np.bincount(self.rows + i, weights=self.basis[i] * column, minlength=size)
        return found

    def solve(self, columns: Float64Array) -> Float64Array:
        """Coefficients of columns at the instants of all pieces, one after the other."""
        from scipy.linalg import cho_solve_banded

        return np.asarray(cho_solve_banded((self.factor, False), self._gathered(columns), check_finite=False))

    def fitted(self, coefficients: Float64Array) -> Float64Array:
        """The curves at the instants that they were fitted at."""
        return _sum(self.basis, self.rows, coefficients)

    def evaluate(
        self, coefficients: Float64Array, t: Float64Array, owners: NDArray[np.intp], order: int
    ) -> Float64Array:
        """A derivative of the curves at instants, each in a piece that is named."""
        rows, basis = self._located(t, owners, order)
        return _sum(basis, rows, coefficients)

    def freedom(self) -> float:
        """Degrees of freedom: the trace of what takes data to the curve, by probes of signs set far apart."""
        from scipy.linalg import cho_solve_banded

        size = int(self.offsets[-1])
        signs = np.random.default_rng(1).choice((-1.0, 1.0), size)
        probes = np.zeros((size, min(_PROBES, size)))
        probes[np.arange(size), np.arange(size) % probes.shape[1]] = signs
        solved = cho_solve_banded((self.factor, False), probes, check_finite=False)
        found = probes * self.normal[_DEGREE][:, None]
        for k in range(1, _DEGREE + 1):
            found[:-k] += self.normal[_DEGREE - k, k:, None] * probes[k:]
            found[k:] += self.normal[_DEGREE - k, k:, None] * probes[:-k]
        return float((found * solved).sum())


def _sum(basis: Float64Array, rows: NDArray[np.intp], coefficients: Float64Array) -> Float64Array:
    """Curves from the B-splines that are not zero at each instant."""
    found: Float64Array = basis[0][:, None] * coefficients[rows]
    for i in range(1, _DEGREE + 1):
        found += basis[i][:, None] * coefficients[rows + i]
    return found


@cache
def _pieces_of_basis(order: int) -> Float64Array:
    """Coefficients, in powers of the place u in an interval, of a derivative of the eight B-splines on it; (8, .).

    By the recursion of Cox and de Boor for uniform knots: of degree k the a-th is (u + k - a) / k times that before
    it of degree k - 1, and (1 + a - u) / k times that of its own place.
    """
    found = np.ones((1, 1))
    for k in range(1, _DEGREE + 1):
        lower, found = found, np.zeros((k + 1, k + 1))
        for a in range(k + 1):
            if a > 0:
                found[a, :k] += (k - a) / k * lower[a - 1]
                found[a, 1:] += lower[a - 1] / k
            if a < k:
                found[a, :k] += (1 + a) / k * lower[a]
                found[a, 1:] -= lower[a] / k
    for _ in range(order):
        found = found[:, 1:] * np.arange(1, found.shape[1])
    return found
