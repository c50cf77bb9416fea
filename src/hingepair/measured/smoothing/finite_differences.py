"""Derivatives of samples: of a polynomial of degree p through or near each sample and its neighbours.

For derivatives of order p (even) at a sample, p/2 neighbours are taken on either side; the polynomial goes through
all p + 1 samples, with the weights of Fornberg (Mathematics of Computation 51 (1988), 699-706). For the first and the
last p/2 samples, whose neighbours are on one side, it is the one nearest to the first or last p + 5 samples (least
squares): one through p + 1 would amplify noise three times as much. The instants need not be uniform.

The error of a first derivative is of order h^p, that of a second one of order h^(p-1), in the middle of uniform
steps h^p too. Only differences of instants and of values enter, so neither may be large without harm.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import Float64Array

_BLOCK = 16384  # samples whose stencils are held at a time


Stencil: TypeAlias = tuple[slice, NDArray[np.intp], Float64Array, Float64Array]
"""Some samples, their neighbours (they themselves among them), and the neighbours' weights in the first [1/s] and the
second derivative [1/s^2]; shape (samples, neighbours)."""


def stencils(t: Float64Array, order: int) -> Iterator[Stencil]:
    """Yield stencils, block by block: the samples as a slice, the indices of their neighbours, and the weights of
    these in the first and in the second derivative.
    """
    half, wide = order // 2, min(order + 5, t.size)
    for start in range(half, t.size - half, _BLOCK):
        rows = slice(start, min(start + _BLOCK, t.size - half))
        lowest = np.arange(rows.start, rows.stop) - half
        yield _stencil_weights(t, rows, lowest[:, None] + np.arange(order + 1), order)
    for rows, first in ((slice(0, half), 0), (slice(t.size - half, t.size), t.size - wide)):
        yield _stencil_weights(t, rows, np.broadcast_to(first + np.arange(wide), (half, wide)), order)


def _stencil_weights(t: Float64Array, rows: slice, neighbours: NDArray[np.intp], accuracy_order: int) -> Stencil:
    """Return the `Stencil` of samples and neighbours; more than accuracy_order + 1 are fitted by least squares."""
    nodes = t[neighbours] - t[rows, None]
    step = (nodes[:, -1:] - nodes[:, :1]) / (neighbours.shape[1] - 1)
    x = nodes / step
    first, second = (
        _interpolation_weights(x) if x.shape[1] == accuracy_order + 1 else _least_squares_weights(x, accuracy_order)
    )
    return rows, neighbours, first / step, second / step / step


def _interpolation_weights(x: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the weights (..., m) of values at distinct nodes x in the first and second derivative at 0 of the
    polynomial through them.
    """
    nodes = [x[..., i] for i in range(x.shape[-1])]
    zero = np.zeros(x.shape[:-1])
    weights = [(zero + 1, zero, zero)]
    product = zero + 1
    for i, node in enumerate(nodes[1:], start=1):
        before, previous, (c0, c1, c2) = nodes[i - 1], product, weights[-1]
        product = zero + 1
        for j in range(i):
            gap = node - nodes[j]
            product = product * gap
            w0, w1, w2 = weights[j]
            weights[j] = node * w0 / gap, (node * w1 - w0) / gap, (node * w2 - 2 * w1) / gap
        ratio = previous / product
        weights.append((-ratio * before * c0, ratio * (c0 - before * c1), ratio * (2 * c1 - before * c2)))
    return np.stack([w[1] for w in weights], axis=-1), np.stack([w[2] for w in weights], axis=-1)


def _least_squares_weights(x: Float64Array, degree: int) -> tuple[Float64Array, Float64Array]:
    """Return the weights (rows, m) of values at increasing nodes x in the first and second derivative at 0 of the
    polynomial of this degree that fits them.
    """
    from numpy.polynomial.legendre import legder, legval, legvander

    slopes = legder(np.eye(degree + 1))
    bends = legder(slopes)
    first, second = np.empty(x.shape), np.empty(x.shape)
    for i, nodes in enumerate(x):
        middle, half = (nodes[0] + nodes[-1]) / 2, (nodes[-1] - nodes[0]) / 2
        inverse = np.linalg.pinv(legvander((nodes - middle) / half, degree))
        first[i] = legval(-middle / half, slopes) @ inverse / half
        second[i] = legval(-middle / half, bends) @ inverse / half**2
    return first, second
