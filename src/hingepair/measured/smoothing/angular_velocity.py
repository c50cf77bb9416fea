"""Angular velocity and acceleration from samples of a moving attitude (E3), however fast it spins.

For derivatives of order p (even) at a sample, p/2 neighbours are taken on either side; the polynomial goes through
all p + 1 samples. For the first and the last p/2 samples, whose neighbours are on one side, it is the one nearest to
the first or last p + 5 samples (least squares): one through p + 1 would amplify noise three times as much. The
instants need not be uniform.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Literal, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import Float64Array, FloatArray, result_dtype, vectors
from hingepair.rotations.matrices import check_rotation, rotation_exp, rotation_vector
from hingepair.tables.instants import instants_of

_BLOCK = 16384  # samples whose stencils are held at a time
ORDERS = (2, 4, 6, 8)  # accepted powers of the time step to which errors are proportional


@overload
def angular_velocity_from_samples(
    t: ArrayLike, S: ArrayLike, order: int = 6, with_alpha: Literal[False] = False
) -> FloatArray: ...
@overload
def angular_velocity_from_samples(
    t: ArrayLike, S: ArrayLike, order: int = 6, *, with_alpha: Literal[True]
) -> tuple[FloatArray, FloatArray]: ...
def angular_velocity_from_samples(
    t: ArrayLike, S: ArrayLike, order: int = 6, with_alpha: bool = False
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Return the angular velocity omega (..., N, 3), in world axes, from the rotation matrices S (..., N, 3, 3) at N
    instants t (equation E3). The finite differences have an error proportional to the time step to the power `order`.
    With `with_alpha`, return (omega, alpha), where alpha is the angular acceleration.

    For each sample i, `S(t) = exp([x(t)]x) exp([w]x (t - t_i)) S_i` defines the rotation vector x(t) in world axes
    beside the steady spin w from the sample before to the one after, which is left out (w = 0) where the neighbours
    turn by less than 2 rad; [w]x is the cross-product matrix of w. At sample i, x is 0, and therefore omega = w + x'
    and alpha = x'' - w cross x' exactly, however fast the body spins about an axis that turns slowly. The function
    differentiates the polynomial of degree `order` that interpolates x at sample i and at order / 2 neighbours on
    each side. Near the ends, a polynomial of degree `order` is fitted by least squares to x at the first or the last
    (`order` + 5) samples, or at all samples if there are fewer.

    A higher order suits smooth motion, and a lower order suits noisy data at small time steps. Suppose that the noise
    of the attitudes is white, that the rotation vector of the noise has the standard deviation sigma [rad] in each
    component, and that the time step is h [s]. Then the standard deviation of every component of omega is
    c sigma / h [rad/s], with c from this table:

        order    in the middle    first and last sample
        2        0.71             0.68
        4        0.95             1.9
        6        1.1              3.7
        8        1.2              6.8

    Args:
        t: instants, increasing, not necessarily uniform: seconds (floats), datetime64, or nanoseconds since 1970
            (integers); shape (N,) with N > order.
        S: rotation matrices, body to world, at the instants t; shape (..., N, 3, 3).
        order: power of the time step to which the error of omega is proportional: 2, 4, 6 (the default) or 8.
        with_alpha: whether to return the angular acceleration alpha too; False by default. If the time steps are
            uniform, the error of alpha away from the ends is of the same order as the error of omega. Otherwise, and
            near the ends, its order is lower by one.

    Returns:
        omega, world axes [rad/s]; shape (..., N, 3). With `with_alpha`, (omega, alpha), where alpha [rad/s^2] has the
        same shape, world axes. If a sample of S is not finite, the results that depend on this sample are not finite
        either.

    Raises:
        ArgumentError: t is not increasing or not finite; `order` is not 2, 4, 6 or 8; or the spin changes so much
            between a sample and the neighbours used with it that rotation vectors are ambiguous. Each turn from one
            sample to the next is assumed to be less than pi; a larger one cannot be detected.
        RotationError: S is finite, but an element of S S^T differs from the same element of the identity by more than
            2e-9 (2e-5 for float32), or det S is negative.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.linspace(0, 1, 11)
    >>> hp.angular_velocity_from_samples(t, hp.rotation_exp(t[:, None] * (0, 0, 2))).round(12)[5] + 0.0
    array([0., 0., 2.])
    """
    if not isinstance(order, int | np.integer) or order not in ORDERS:
        raise ArgumentError("order", f"one of {', '.join(map(str, ORDERS))}", quoted(order))
    time, attitude = instants_of("t", t, order), vectors("S", S, 3, 3)
    dtype = result_dtype((np.asarray(t), attitude))
    if attitude.ndim < 3 or attitude.shape[-3] != time.size:
        raise ArgumentError("S", f"shape (..., {time.size}, 3, 3), a rotation for each t", f"shape {attitude.shape}")
    check_rotation("S", attitude)
    found = _angular_rates(time, attitude.astype(np.float64, copy=False), order, 1 + with_alpha)
    omega, *alpha = (array.astype(dtype, copy=False) for array in found)
    return (omega, alpha[0]) if alpha else omega


def _angular_rates(t: Float64Array, S: Float64Array, order: int, count: int) -> list[Float64Array]:
    """Return [omega], or [omega, alpha] if `count` is 2, world axes, (..., N, 3), of the samples S at instants t."""
    derivatives = [np.zeros(S.shape[:-1]) for _ in range(count)]
    last = t.size - 1
    with np.errstate(all="ignore"):
        steps = np.linalg.norm(turn_between(S[..., :-1, :, :], S[..., 1:, :, :]), axis=-1)
        turned_before = np.cumsum(np.nan_to_num(np.concatenate([0 * steps[..., :1], steps], axis=-1)), axis=-1)
        for rows, neighbours, *weights in stencils(t, order):
            samples = np.arange(rows.start, rows.stop)
            before, after = np.maximum(samples - 1, 0), np.minimum(samples + 1, last)
            turn = turn_between(S[..., before, :, :], S[..., rows, :, :])
            turn = turn + turn_between(S[..., rows, :, :], S[..., after, :, :])
            farthest = np.abs(turned_before[..., neighbours] - turned_before[..., samples, None]).max(axis=-1)
            omega = needed_spin(turn / (t[after] - t[before])[:, None], farthest)
            vectors_beside = np.empty((*omega.shape[:-1], neighbours.shape[1], 3))
            for k, others in enumerate(neighbours.T):
                dt = t[others] - t[samples]
                x = vector_beside_spin(S[..., rows, :, :], S[..., others, :, :], omega, dt)
                x[..., others == samples, :] *= 0.0  # round-off; NaN where S is
                for derivative, weight in zip(derivatives, weights, strict=False):
                    derivative[..., rows, :] += weight[:, k, None] * x
                vectors_beside[..., k, :] = x
            _check_turns(vectors_beside, samples, neighbours)
            if count == 2:
                turning = np.cross(omega, derivatives[0][..., rows, :])
                derivatives[1][..., rows, :] -= turning
            derivatives[0][..., rows, :] += omega
    return derivatives


def turn_between(start: Float64Array, stop: Float64Array) -> Float64Array:
    """Return the rotation vectors (..., 3), world axes [rad], that turn rotations `start` into `stop`."""
    return rotation_vector(stop @ np.swapaxes(start, -1, -2))


def needed_spin(omega: Float64Array, turned: Float64Array) -> Float64Array:
    """Return the angular velocities `omega` (..., 3) where neighbours have turned by more than two radians (`turned`
    [rad]), and zeros where rotation vectors by themselves are nearer to polynomials.
    """
    return np.where(turned[..., None] > 2.0, omega, 0.0)


def vector_beside_spin(base: Float64Array, S: Float64Array, omega: Float64Array, dt: Float64Array) -> Float64Array:
    """Return rotation vectors x (..., 3), world axes [rad], with S = exp(x) exp(omega dt) base.

    However fast the spin, x changes slowly where its axis does: polynomials in t through x are interpolants on the
    rotation group.
    """
    back = np.asarray(rotation_exp(-omega * dt[..., None]))
    return rotation_vector(S @ np.swapaxes(base, -1, -2) @ back)


def _check_turns(x: Float64Array, samples: NDArray[np.intp], neighbours: NDArray[np.intp]) -> None:
    """Raise ArgumentError if the vectors beside the spin, (..., samples, neighbours, 3), change by pi or more between
    a sample and a neighbour: those of turns near pi are ambiguous.
    """
    changes = np.nan_to_num(np.linalg.norm(np.diff(x, axis=-2), axis=-1))
    turned = np.cumsum(np.concatenate([np.zeros_like(changes[..., :1]), changes], axis=-1), axis=-1)
    centres = np.argmax(neighbours == samples[:, None], axis=-1)
    own = np.take_along_axis(turned, np.broadcast_to(centres[:, None], (*turned.shape[:-1], 1)), axis=-1)
    farthest = np.abs(turned - own).max(axis=-1, initial=0.0)
    bad = np.argwhere(farthest >= np.pi)
    if bad.size:
        expected = (
            "samples of a spin that changes less from each to its neighbours (a smaller step, or a lower order)"
        )
        raise ArgumentError("S", expected, f"{farthest[tuple(bad[0])]:.3g} rad at index {samples[bad[0, -1]]}")


# ---- finite differences

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
    is_exact = x.shape[1] == accuracy_order + 1
    first, second = lagrange_weights(x)[1:] if is_exact else _least_squares_weights(x, accuracy_order)
    return rows, neighbours, first / step, second / step / step


def lagrange_weights(nodes: Float64Array) -> Float64Array:
    """Return Lagrange's weights (3, ..., m) of values at m distinct nodes (..., m): those of the value, and of the
    first and the second derivative at 0, of the polynomial through them.
    """
    x = np.moveaxis(nodes, -1, 0)
    weights = np.zeros((3, *x.shape))
    weights[0] = 1.0
    for i, j in itertools.permutations(range(len(x)), 2):  # times (t - x_j) / (x_i - x_j), up to t^2
        c0, c1, c2 = weights[:, i]
        weights[:, i] = np.stack((-x[j] * c0, c0 - x[j] * c1, c1 - x[j] * c2)) / (x[i] - x[j])
    return np.asarray(np.moveaxis(weights, 1, -1) * np.array((1.0, 1.0, 2.0)).reshape(3, *[1] * nodes.ndim))


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
