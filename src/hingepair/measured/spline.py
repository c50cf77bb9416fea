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

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import MissingDependencyError
from hingepair.numeric.arrays import Float64Array

FEWEST = 8
"""Samples of a piece that is smoothed."""
_DEGREE = 7  # of the B-splines
_PENALTY = 5  # order of the derivative whose square is penalised
_KNOTS = 4.0  # in a period of the bandwidth
_COUNTED = 1.4  # how often generalised cross validation counts each degree of freedom
_WIDER = 1.1
"""What the bandwidth of least cross validation is multiplied by: derivatives near the ends gain more by it than those
in the middle lose."""
_PROBES = 16  # vectors of signs that the degrees of freedom are estimated with
_WINDOW, _WINDOWS = 4096, 8
"""Of long records the bandwidth is chosen on so many stretches of so many samples."""


class Smoothed(NamedTuple):
    """Smooth columns at the instants asked for, and how sure they are."""

    values: Float64Array  # and first and second derivative; shape (3, M, k); NaN outside the pieces
    bandwidth: float  # of the smoothing [Hz]
    noise: float  # standard deviation of the noise of one sample of one column
    errors: Float64Array  # standard deviations that this leaves in values, first and second derivatives; shape (3,)


def smooth_columns(
    t: Float64Array, columns: Float64Array, pieces: Sequence[NDArray[np.intp]], bandwidth: float | None
) -> Smoothed:
    """Smooth columns (N, k) piece by piece, with derivatives, at every instant between the ends of a piece.

    A piece has FEWEST samples at least, all of them finite. A bandwidth of None is chosen by the data.

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
    values = np.full((3, t.size, k + 4), np.nan)
    for i, piece in enumerate(pieces):
        own = slice(piece[0], piece[-1] + 1)
        values[:, own] = [spline.evaluate(fitted, i, t[own], order) for order in range(3)]
    rest = columns[used] - values[0, used, :k]
    freedom = max(used.size - spline.freedom(), 1.0)
    noise = float(np.sqrt((rest * rest).sum() / (k * freedom)))
    errors = noise * np.sqrt(np.nanmean(values[:, :, k:] ** 2, axis=(1, 2)))
    return Smoothed(values[:, :, :k], bandwidth, noise, errors)


def _chosen_bandwidth(t: Float64Array, columns: Float64Array, pieces: Sequence[NDArray[np.intp]]) -> float:
    """Return the bandwidth [Hz] of least generalised cross validation."""
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
    """Return some stretches of the pieces, evenly spread."""
    whole = np.concatenate(pieces)
    owners = np.repeat(np.arange(len(pieces)), [piece.size for piece in pieces])
    found = []
    for start in np.linspace(0, whole.size - _WINDOW, _WINDOWS).astype(np.intp):
        stretch, owner = whole[start : start + _WINDOW], owners[start : start + _WINDOW]
        found += [part for part in np.split(stretch, np.flatnonzero(np.diff(owner)) + 1) if part.size >= FEWEST]
    return found


class Spline:
    """B-splines on uniform knots of their own in each piece (instants [s]), and the penalty of a bandwidth [Hz]."""

    def __init__(self, times: Sequence[Float64Array], bandwidth: float) -> None:
        from scipy.interpolate import BSpline
        from scipy.linalg import cholesky_banded
        from scipy.sparse import block_diag

        step = sum(time[-1] - time[0] for time in times) / sum(time.size - 1 for time in times)
        widest = max(1 / (_KNOTS * bandwidth), step) * (1 + 1e-12)
        inner = [np.linspace(time[0], time[-1], 1 + math.ceil((time[-1] - time[0]) / widest)) for time in times]
        self.knots = [_continued(own) for own in inner]
        self.ends = np.cumsum([own.size - _DEGREE - 1 for own in self.knots])
        self.basis = block_diag(
            [BSpline.design_matrix(time, own, _DEGREE) for time, own in zip(times, self.knots, strict=True)], "csr"
        )
        self.normal = self.basis.T @ self.basis
        penalty = np.concatenate([_penalty(own.size - 1, own[1] - own[0]) for own in inner], axis=1)
        weight = (2 * np.pi * bandwidth) ** (-2 * _PENALTY) / step
        for k in range(_DEGREE + 1):
            penalty[_DEGREE - k, k:] = weight * penalty[_DEGREE - k, k:] + self.normal.diagonal(k)
        self.factor = cholesky_banded(penalty, check_finite=False)

    def solve(self, columns: Float64Array) -> Float64Array:
        """Return the coefficients of columns at the instants of all pieces, one after the other."""
        return self._solved(self.basis.T @ columns)

    def _solved(self, right: Float64Array) -> Float64Array:
        from scipy.linalg import cho_solve_banded

        return np.asarray(cho_solve_banded((self.factor, False), right, check_finite=False))

    def fitted(self, coefficients: Float64Array) -> Float64Array:
        """Return the curves at the instants that they were fitted at."""
        return np.asarray(self.basis @ coefficients)

    def evaluate(self, coefficients: Float64Array, piece: int, t: Float64Array, order: int) -> Float64Array:
        """Return a derivative of the curves at instants in one piece."""
        from scipy.interpolate import BSpline

        own = coefficients[self.ends[piece] - self.knots[piece].size + _DEGREE + 1 : self.ends[piece]]
        return np.asarray(BSpline(self.knots[piece], own, _DEGREE)(t, nu=order))

    def freedom(self) -> float:
        """Return the degrees of freedom: the trace of the smoother, by probes of signs set far apart."""
        size = int(self.ends[-1])
        probes = np.zeros((size, min(_PROBES, size)))
        probes[np.arange(size), np.arange(size) % probes.shape[1]] = np.random.default_rng(1).choice(
            (-1.0, 1.0), size
        )
        return float(((self.normal @ probes) * self._solved(probes)).sum())


def _continued(knots: Float64Array) -> Float64Array:
    """Return uniform knots with as many more at either end as the degree asks for."""
    more = (knots[1] - knots[0]) * np.arange(1, _DEGREE + 1)
    return np.concatenate([knots[0] - more[::-1], knots, knots[-1] + more])


def _penalty(intervals: int, width: float) -> Float64Array:
    """Return the integrals of products of fifth derivatives of B-splines, upper bands."""
    from scipy.interpolate import BSpline

    nodes, weights = np.polynomial.legendre.leggauss(_DEGREE - _PENALTY + 1)
    bend = BSpline.basis_element(np.arange(_DEGREE + 2.0)).derivative(_PENALTY)
    bends = bend((nodes + 1) / 2 + np.arange(_DEGREE, -1, -1)[:, None])
    products = (bends * (weights / 2)) @ bends.T * width ** (1 - 2 * _PENALTY)
    bands = np.zeros((_DEGREE + 1, intervals + _DEGREE))
    for i, j in itertools.combinations_with_replacement(range(_DEGREE + 1), 2):
        bands[_DEGREE - (j - i), j : j + intervals] += products[i, j]
    return bands
