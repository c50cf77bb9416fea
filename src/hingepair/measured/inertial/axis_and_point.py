"""The hinge from inertial sensors alone, one on either body: no positions, no attitudes.

The axis: across it both bodies turn alike, so that `abs(omega1 x n1) = abs(omega2 x n2)`, each in its own body's axes
(Seel, Schauer and Raisch, IEEE International Conference on Control Applications, 2012, 45-49; Sensors 14 (2014),
6891-6909). Of n2 and -n2, which satisfy it alike, the one is right with which the angle between the two turning
vectors across the axis changes as psi' = omega2 . n2 - omega1 . n1 says.

The point: both sensors, moved there, feel the same force, `abs(f1 + Gamma1 u1) = abs(f2 + Gamma2 u2)` with
`Gamma u = omega x (omega x u) + alpha x u` (the same papers). What of the axis and the point is seen depends on the
motion (Olsson, Kok, Seel and Halvorsen, Sensors 20 (2020), 3534), and is told by the covariance.

Gyroscopes and accelerometers read something at rest too. These biases are unknowns beside the axis and the point,
with prior standard deviations: what the motion does not show of them widens the covariance as much as they may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, FitError
from hingepair.measured.findings import RANDOM_CORRELATION, RELIABLE_POINT, Check, Finding, exceeded, verdict
from hingepair.measured.hinge import frame, sign_of, tilt_axis
from hingepair.measured.inertial.records import (
    axis_arguments,
    checked_vectors,
    local_slopes,
    read_sensors,
    record_doubts,
    report,
)
from hingepair.measured.least_squares import (
    Equations,
    least_squares,
    neighbour_correlation,
    sandwich,
    score_scatter,
)
from hingepair.measured.smoothing.spline import MIN_PIECE
from hingepair.numeric.arrays import Float64Array, number_not_below_0, read_only
from hingepair.rotations.matrices import skew
from hingepair.tables.suspicions import suspicions

_START_SAMPLES = 400  # samples that starts are tried with
_LAG_SAMPLES = 4000  # that the lag of sensor 2 is sought with, at most
_ROUNDING = 1e-13  # residuals that rounding explains, in parts of the readings
_SYSTEMATIC_RATE = 0.05  # residuals that are not noise, in parts of the rates; above, the axis is not reliable


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AxisFit:
    """The result of `fit_axis`: the hinge axis in each body's own axes.

    Attributes:
        n1: hinge axis in body 1's axes, unit vector; shape (3,). It is the argument `n` of a HingePair; `fit_axis`
            says which sign it has.
        n2: the same vector in body 2's axes; shape (3,). For a HingePair, n2 = home^T n1.
        std: standard deviations of n1 and n2 in their least certain directions [rad]; shape (2,). It is inf if the
            motion does not determine the vector.
        covariance: covariance matrix of the six components of n1 and n2, in this order; shape (6, 6). A variance is
            inf if the motion does not determine the vector.
        bias1: bias of gyroscope 1 in body 1's axes [rad/s]; shape (3,).
        bias2: bias of gyroscope 2 in body 2's axes [rad/s]; shape (3,).
        bias_std: standard deviations of bias1 (first row) and bias2 (second row) [rad/s]; shape (2, 3). Where the
            motion does not determine them, biases stay near 0 and keep the standard deviation `gyroscope_bias`.
        rms: root mean square of the length of omega1 x n1 minus that of omega2 x n2, without biases [rad/s].
        ok: whether the recorded angular velocities agree with a hinge and determine n1 and n2.
        findings: sentences that say what is wrong with the data, or what the motion does not determine.
    """

    n1: Float64Array
    n2: Float64Array
    std: Float64Array
    covariance: Float64Array
    bias1: Float64Array
    bias2: Float64Array
    bias_std: Float64Array
    rms: float
    ok: bool
    findings: tuple[str, ...]

    def __str__(self) -> str:
        lines = ["hinge axis of two gyroscopes"]
        for name, vector, std in zip(("n1", "n2"), (self.n1, self.n2), np.degrees(self.std), strict=True):
            lines.append(f"{name} = ({', '.join(f'{x:.6g}' for x in vector)}), known to {std:.2g} deg")
        lines.append(f"left: {self.rms:.3g} rad/s rms")
        return report(lines, self.findings, self.ok)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AnchorFit:
    """The result of `fit_anchor`: the hinge point as seen from each of two inertial sensors.

    Attributes:
        u1: vector from sensor 1 to the hinge point, in body 1's axes [m]; shape (3,).
        u2: vector from sensor 2 to the hinge point, in body 2's axes [m]; shape (3,).
        covariance: covariance matrix of the six components of u1 and u2, in this order [m^2]; shape (6, 6). A
            variance is inf if the motion does not determine the component. The position along the hinge axis follows
            from a convention (see `fit_anchor`) and has no uncertainty. A hinge axis that was given counts as
            uncertain as these angular velocities determine it.
        bias1: bias of accelerometer 1 in body 1's axes [m/s^2]; shape (3,).
        bias2: bias of accelerometer 2 in body 2's axes [m/s^2]; shape (3,).
        bias_std: standard deviations of bias1 (first row) and bias2 (second row) [m/s^2]; shape (2, 3). Where the
            motion does not determine them, biases stay near 0 and keep the standard deviation `accelerometer_bias`.
        rms: root mean square of the difference between the magnitudes of the specific force at the hinge point, as
            both sensors give it [m/s^2].
        ok: whether the recorded data agree with a point that is fixed in both bodies, and the motion determines this
            point except for its position along the hinge axis.
        findings: sentences that say what is wrong with the data, or what the motion does not determine.
    """

    u1: Float64Array
    u2: Float64Array
    covariance: Float64Array
    bias1: Float64Array
    bias2: Float64Array
    bias_std: Float64Array
    rms: float
    ok: bool
    findings: tuple[str, ...]

    def __str__(self) -> str:
        lines, std = ["hinge point of two inertial sensors"], np.sqrt(np.diagonal(self.covariance)).reshape(2, 3)
        for name, vector, deviations in zip(("u1", "u2"), (self.u1, self.u2), std, strict=True):
            numbers = ", ".join(f"{x:.6g} +- {s:.2g}" for x, s in zip(vector, deviations, strict=True))
            lines.append(f"{name} = ({numbers}) m")
        lines.append(f"left: {self.rms:.3g} m/s^2 rms")
        return report(lines, self.findings, self.ok)


def fit_axis(omega1_b1: ArrayLike, omega2_b2: ArrayLike, gyroscope_bias: float = 0.05) -> AxisFit:
    """Fit the hinge axis to the records of two gyroscopes, one on each body.

    Args:
        omega1_b1: angular velocity of body 1 in body 1's axes, S1^T omega1 [rad/s]; shape (N, 3), NaN where a sample
            is missing. Samples must be in the order of time and equally spaced, because the sign of n2 relative to n1
            is found from the changes between successive samples.
        omega2_b2: angular velocity of body 2 in body 2's axes, S2^T omega2, at the same instants [rad/s]; shape
            (N, 3), NaN where a sample is missing.
        gyroscope_bias: expected size of the gyroscopes' biases, as the standard deviation of one component [rad/s];
            0 if the biases were subtracted from the data.

    Returns:
        An AxisFit. As -n1 and -n2 describe the same hinge, a rule fixes the sign: the first component of n1 whose
        magnitude is at least 0.45 times the largest magnitude is positive. Check `.ok` and `.findings` before you use
        the vectors: if, for example, both bodies turn as one, the motion does not determine the axis.

    Raises:
        FitError: there are fewer than 8 instants at which both records are finite, or neither body turns.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.linspace(0, 10, 1000)
    >>> omega1 = np.stack((np.sin(t), np.cos(2 * t), np.sin(3 * t)), axis=-1)
    >>> turn = hp.rodrigues((0, 0, 1), np.sin(t))
    >>> omega2 = np.einsum("nji,nj->ni", turn, omega1 + np.cos(t)[:, None] * np.array([0, 0, 1]))
    >>> fit = hp.fit_axis(omega1, omega2)
    >>> fit.n1.round(9) + 0.0, fit.n2.round(9) + 0.0
    (array([0., 0., 1.]), array([0., 0., 1.]))
    """
    omega1, omega2 = checked_vectors({"omega1_b1": omega1_b1, "omega2_b2": omega2_b2})
    found = solve_axes(omega1, omega2, number_not_below_0("gyroscope_bias", gyroscope_bias))
    n1, n2, bias1, bias2 = found.unknowns
    rms = float(np.sqrt(np.mean(found.residuals**2)))
    if found.is_systematic:
        why = (
            f"The two rates across the axis differ by {rms:.2g} rad/s rms, and not at random: they do not turn about "
            "one axis, or the clocks of the sensors differ."
        )
    else:
        why = f"They do not turn about one axis: the two rates across it differ by {rms:.2g} rad/s rms."
    findings = exceeded(
        *(
            Check(
                std,
                np.radians(5.0),
                f"The axis in body {i}'s axes is known to {np.degrees(std):.2g} deg only."
                if np.isfinite(std)
                else f"The motion does not show the axis in body {i}'s axes: let body {i} turn across it.",
            )
            for i, std in enumerate(found.std.tolist(), start=1)
        ),
        Check(rms, (_SYSTEMATIC_RATE if found.is_systematic else 0.3) * found.rms_rate, why),
        Check(
            -found.sign_correlation,
            -0.2,
            "The sign of n2 relative to n1 is not determined: the angle does not follow its rate.",
        ),
    )
    findings += found.clock_findings(None)
    for name, omega in (("omega1_b1", omega1), ("omega2_b2", omega2)):
        findings += map(Finding, suspicions("gyroscope", name, omega))
    ok, sentences = verdict(findings)
    return AxisFit(
        n1=read_only(n1),
        n2=read_only(n2),
        std=read_only(found.std),
        covariance=read_only(found.covariance_of_components()),
        bias1=read_only(bias1),
        bias2=read_only(bias2),
        bias_std=read_only(found.bias_std.reshape(2, 3)),
        rms=rms,
        ok=ok,
        findings=sentences,
    )


class Axes(NamedTuple):
    """The hinge axis in the axes of both bodies, from two gyroscopes."""

    unknowns: Float64Array  # n1, n2, bias1, bias2; (4, 3)
    covariance: Float64Array  # of two turns of n1 and two of n2 [rad^2]; (4, 4)
    unseen: NDArray[np.bool_]  # which of these turns the motion does not determine; (4,)
    bias_std: Float64Array  # (6,)
    residuals: Float64Array  # [rad/s]; (M,)
    rms_rate: float  # [rad/s]
    is_systematic: bool  # whether the residuals are large and not at random
    sign_correlation: float
    lag: Lag

    @property
    def std(self) -> Float64Array:
        """Standard deviations of n1 and n2 in their least certain directions [rad]."""
        variances = np.where(self.unseen, np.inf, np.diagonal(self.covariance)).reshape(2, 2)
        return np.asarray(np.sqrt(variances.max(axis=1)))

    def covariance_of_components(self) -> Float64Array:
        """Return the covariance (6, 6) of the components of n1 and n2, inf where they are not determined."""
        change = np.zeros((6, 4))
        for i, n in enumerate(self.unknowns[:2]):
            change[3 * i : 3 * i + 3, 2 * i : 2 * i + 2] = frame(n)[:, :2]
        covariance = change @ self.covariance @ change.T
        hidden = change**2 @ self.unseen > 1e-3
        covariance[hidden, hidden] = np.inf
        return np.asarray(covariance)

    @property
    def offset(self) -> float:
        """Samples by which body 2 was recorded later than body 1 at equal rows."""
        return -self.lag.rows

    def shows_offset(self) -> bool:
        """Return whether the clocks differ for certain, and by so much that the axis or the residuals change."""
        if abs(self.offset) <= max(4.0 * self.lag.std, 0.02):
            return False
        # With the lag an axis moves by half a standard deviation, or residuals fall by a tenth.
        across = np.where(self.unseen, 0.0, np.diagonal(self.covariance))
        turned = [frame(n)[:, :2].T @ m for n, m in zip(self.unknowns[:2], self.lag.unknowns[:2], strict=True)]
        moved = float(np.max(np.abs(np.concatenate(turned)) / np.sqrt(np.maximum(across, 1e-24))))
        return moved > 0.5 or float(np.sqrt(np.mean(self.residuals**2))) > 1.1 * self.lag.rms

    def clock_findings(self, step: float | None) -> list[Finding]:
        """Return a finding if the clocks differ. `step` is the time between samples [s]; None: not known."""
        if not self.shows_offset():
            return []
        how = f"{abs(self.offset):.2g} samples" if step is None else f"{1e3 * step * abs(self.offset):.3g} ms"
        order = "later" if self.offset > 0 else "earlier"
        text = f"Body 2 was recorded {how} {order} than body 1 at equal rows: the clocks of the sensors differ"
        return [Finding(f"{text}. fit_imus corrects this.")]


class Lag(NamedTuple):
    """The rows by which the record of sensor 2 is to be read later to agree best with that of sensor 1."""

    rows: float
    std: float  # inf where it is not shown
    unknowns: Float64Array  # n1, n2, bias1, bias2 that go with it; (4, 3)
    rms: float  # of the residuals [rad/s]


class _LagState(NamedTuple):
    """A lag in rows, and the unknowns (4, 3) that go with it."""

    lag: float
    x: Float64Array


class _Rates(NamedTuple):
    """Angular velocities (N, 3) whose sizes across both axes are to be equal. The unknowns (4, 3) are n1, n2 and,
    where there are priors, the biases of both gyroscopes.
    """

    w1: Float64Array
    w2: Float64Array
    prior: Float64Array  # weights that hold the biases near 0; (6,), 0: biases are no unknowns

    def linearised(self, x: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the residuals of the samples, then of the priors, and their derivatives by two turns of each axis,
        then by the biases.
        """
        frames = [frame(n) for n in x[:2]]
        in_axes = [(w - bias) @ axes for w, bias, axes in zip((self.w1, self.w2), x[2:], frames, strict=True)]
        sizes = [np.maximum(np.hypot(w[:, 0], w[:, 1]), 1e-300) for w in in_axes]
        first, second = (-w[:, 2:] * w[:, :2] / size[:, None] for w, size in zip(in_axes, sizes, strict=True))
        residuals, derivatives = sizes[0] - sizes[1], np.concatenate((first, -second), axis=-1)
        if not self.prior.any():
            return residuals, derivatives
        by_bias1, by_bias2 = (
            -(w[:, :2] / size[:, None]) @ axes[:, :2].T for w, size, axes in zip(in_axes, sizes, frames, strict=True)
        )
        return _with_priors(residuals, (derivatives, by_bias1, -by_bias2), self.prior, x[2:].ravel())

    def moved(self, x: Float64Array, step: Float64Array) -> Float64Array:
        """Return the unknowns after a step."""
        axes = [tilt_axis(n, turns) for n, turns in zip(x[:2], step[:4].reshape(2, 2), strict=True)]
        biases = x[2:] + step[4:].reshape(2, 3) if step.size > 4 else x[2:]
        return np.concatenate((np.stack(axes), biases))


class _Forces(NamedTuple):
    """Specific forces, angular velocities and their derivatives, (2, N, 3) each. The sizes of the forces at the hinge
    point are to be equal. The unknowns (18,) are u1, u2 and, where there are priors, the biases of both
    accelerometers and of both gyroscopes.
    """

    forces: Float64Array
    omegas: Float64Array
    alphas: Float64Array
    prior: Float64Array  # weights that hold the biases near 0; (12,), 0: biases are no unknowns
    basis: Float64Array  # directions in which (u1, u2) may move; (6, k)

    def linearised(self, x: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the residuals of the samples, then of the priors, and their derivatives by the directions of the
        basis, then by the biases.
        """
        felt, by_lever, by_bias, by_rate = [], [], [], []
        for i in range(2):
            u, bias, drift = x[3 * i :][:3], x[6 + 3 * i :][:3], x[12 + 3 * i :][:3]
            turning = self.omegas[i] - drift
            gamma = acceleration_matrices(turning, self.alphas[i])
            force = self.forces[i] - bias + gamma @ u
            size = np.maximum(np.linalg.norm(force, axis=-1), 1e-300)
            unit = force / size[:, None]
            felt.append(size)
            by_lever.append((unit[:, None] @ gamma)[:, 0])
            by_bias.append(-unit)
            # Of turning x (turning x u), less the bias.
            by_rate.append(np.cross(np.cross(unit, turning), u) - np.cross(np.cross(turning, u), unit))
        residuals = felt[0] - felt[1]
        derivatives = np.concatenate((by_lever[0], -by_lever[1]), axis=-1) @ self.basis
        if not self.prior.any():
            return residuals, derivatives
        columns = derivatives, by_bias[0], -by_bias[1], by_rate[0], -by_rate[1]
        return _with_priors(residuals, columns, self.prior, x[6:])

    def moved(self, x: Float64Array, step: Float64Array) -> Float64Array:
        """Return the unknowns after a step."""
        count = self.basis.shape[1]
        biases = x[6:] + step[count:] if step.size > count else x[6:]
        return np.concatenate((x[:6] + self.basis @ step[:count], biases))


def _with_priors(
    residuals: Float64Array, columns: Sequence[Float64Array], prior: Float64Array, biases: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return residuals and derivatives with a row for each bias, of which the prior expects 0."""
    derivatives = np.concatenate(columns, axis=-1)
    rows = np.pad(np.diag(prior), ((0, 0), (derivatives.shape[1] - prior.size, 0)))
    return np.concatenate((residuals, prior * biases)), np.concatenate((derivatives, rows))


def _solved(problem: Any, start: Float64Array, max_steps: int = 60) -> tuple[Float64Array, Float64Array]:
    """Return the unknowns that fit a `_Rates` or `_Forces` best, and the residuals there, those of priors last."""

    def equations(x: Float64Array) -> Equations:
        residuals, derivatives = problem.linearised(x)
        return Equations(derivatives.T @ derivatives, derivatives.T @ residuals, float(residuals @ residuals))

    x, _ = least_squares(
        start,
        equations,
        lambda x, step: (problem.moved(x, step), step),
        lambda step, *_: bool(np.abs(step).max() < 1e-13),
        max_steps,
        damped=True,
    )
    return x, problem.linearised(x)[0]


def _best_of(few: Any, starts: Sequence[Float64Array]) -> Float64Array:
    """Return the unknowns that fit a few samples best, of those reached from several starts."""
    tried = [_solved(few, start, 12) for start in starts]
    return min(tried, key=lambda found: float(found[1] @ found[1]))[0]


def _with_biases(
    problem: Any, start: Float64Array, bias_stds: Float64Array, size: float
) -> tuple[Any, Float64Array, Float64Array]:
    """Fit without biases and, unless rounding explains what is left of readings of this `size`, with them. Return the
    problem with the weights of the priors, the unknowns and the residuals of the samples. The weight of a bias is the
    standard deviation of a residual over that of the bias.
    """
    x, residuals = _solved(problem, start)
    count = residuals.size
    if bias_stds.any() and residuals @ residuals > (_ROUNDING * size) ** 2:
        for _ in range(3):  # each with the noise that the last one left
            noise = np.sqrt(residuals @ residuals / count)
            problem = problem._replace(prior=noise / np.where(bias_stds > 0, bias_stds, 1e-9))
            x, residuals = _solved(problem, x)
            residuals = residuals[:count]
    return problem, x, residuals


def solve_axes(omega1: Float64Array, omega2: Float64Array, bias: float, start: Float64Array | None = None) -> Axes:
    """Return the axes of angular velocities (N, 3) in the axes of their bodies, NaN where missing.

    Args:
        omega1: of body 1 [rad/s].
        omega2: of body 2 [rad/s].
        bias: expected size of the biases [rad/s].
        start: first estimate of n1 and n2; (2, 3).

    Raises:
        FitError: there are too few samples, or neither body turns.
    """
    known = np.isfinite(omega1).all(axis=-1) & np.isfinite(omega2).all(axis=-1)
    w1, w2 = omega1[known], omega2[known]
    size = float(np.sqrt((w1**2).sum() + (w2**2).sum()))
    if known.sum() < MIN_PIECE or size == 0:
        expected = f"at least {MIN_PIECE} finite samples of bodies that turn"
        raise FitError("omega1_b1, omega2_b2", expected, int(known.sum()))
    # The axes and the biases.
    every = slice(None, None, -(-w1.shape[0] // _START_SAMPLES))
    few = _Rates(w1[every], w2[every], np.zeros(6))
    starts = _axis_starts(few.w1, few.w2) if start is None else [start]
    first = _best_of(few, [np.concatenate((axes, np.zeros((2, 3)))) for axes in starts])
    rates, unknowns, residuals = _with_biases(_Rates(w1, w2, np.zeros(6)), first, np.full(6, bias), size)
    # The sign of n2 to which the angle turns as its rate says, and the rule for both.
    n1, n2, bias1, bias2 = unknowns
    correlations = [sign_correlation(omega1 - bias1, omega2 - bias2, n1, sign * n2) for sign in (1, -1)]
    n2 = -n2 if correlations[1] > correlations[0] else n2
    unknowns = np.stack((sign_of(n1) * n1, sign_of(n1) * n2, bias1, bias2))
    # The covariance.
    _, derivatives = rates.linearised(unknowns)
    own, own_prior, bias_std = _without_biases(derivatives, 4, residuals, rates.prior, np.full(6, bias))
    noise = residuals @ residuals / 2 * np.eye(4)
    # Noise adds more to the normal matrix than the variance of the rates says where rates across an axis are small.
    covariance, unseen = _covariance(np.zeros(4), residuals, own, noise, 10.0, own_prior)
    rms_rate = size / np.sqrt(2 * w1.shape[0])
    is_systematic = bool(
        np.sqrt(np.mean(residuals**2)) > _SYSTEMATIC_RATE * rms_rate
        and neighbour_correlation(residuals) > RANDOM_CORRELATION
    )
    lag = _fit_lag(omega1, omega2, unknowns, rates.prior, is_systematic)
    return Axes(unknowns, covariance, unseen, bias_std, residuals, rms_rate, is_systematic, max(correlations), lag)


def _fit_lag(
    omega1: Float64Array, omega2: Float64Array, unknowns: Float64Array, prior: Float64Array, search: bool
) -> Lag:
    """Return the lag of sensor 2; if `search`, lags far from 0 are tried too.

    A lag within half a row moves a reading along its slope, in which the reading itself has no part, so that its
    noise makes no bias.
    """
    change = local_slopes(omega2)
    stride = -(-omega1.shape[0] // _LAG_SAMPLES)
    starts = [0.0]
    if search:
        speed, pace = (float(np.sqrt(np.nanmedian((x * x).sum(axis=1)))) for x in (omega2, change))
        gap = max(1.0, np.rint(0.3 * speed / max(pace, 1e-300)))
        most = min(omega1.shape[0] // 4, 40 * gap)
        starts += [sign * lag for lag in np.arange(gap, most, gap) for sign in (1, -1)]
    records = omega1, omega2, change
    found = [_lag_from(records, unknowns, prior, start, stride * (4 if search else 1)) for start in starts]
    best = min(found, key=lambda each: each.rms)
    return _lag_from(records, best.unknowns, prior, best.rows, stride) if search else best


def _lag_from(
    records: tuple[Float64Array, Float64Array, Float64Array],
    unknowns: Float64Array,
    prior: Float64Array,
    start: float,
    stride: int,
) -> Lag:
    """Return the lag that Gauss-Newton steps reach from `start`, by every `stride`-th row. The records are omega1,
    omega2 and the change of omega2 from row to row.
    """
    omega1, omega2, change = records
    rows = np.arange(0, omega1.shape[0], stride)
    blind = Lag(start, np.inf, unknowns, np.inf)

    def seen(at: _LagState) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return residuals, derivatives by the unknowns, and derivatives by the lag."""
        place = rows + int(np.rint(at.lag))
        inside = (place >= 0) & (place < omega2.shape[0])
        w1, w2, d = omega1[rows[inside]], omega2[place[inside]], change[place[inside]]
        known = np.isfinite(w1 + w2 + d).all(axis=1)
        w1, w2, d = w1[known], w2[known] + (at.lag - np.rint(at.lag)) * d[known], d[known]
        residuals, derivatives = _Rates(w1, w2, prior).linearised(at.x)
        axes = frame(at.x[1])[:, :2]
        across = (w2 - at.x[3]) @ axes
        by_lag = np.zeros(residuals.size)
        by_lag[: w1.shape[0]] = -np.einsum("ni,ni->n", across, d @ axes) / np.maximum(
            np.linalg.norm(across, axis=1), 1e-300
        )
        return residuals, derivatives, by_lag

    def equations(at: _LagState) -> Equations:
        residuals, derivatives, by_lag = seen(at)
        J = np.column_stack((derivatives, by_lag))
        return Equations(J.T @ J, J.T @ residuals)

    def move(at: _LagState, step: Float64Array) -> tuple[_LagState, Float64Array]:
        # Shorten it to 0.3 rad and three rows.
        step = step * min(1.0, 0.3 / max(np.abs(step[:4]).max(), 1e-300), 3.0 / max(abs(step[-1]), 1e-300))
        return _LagState(at.lag + float(step[-1]), _Rates(omega1, omega2, prior).moved(at.x, step[:-1])), step

    first = _LagState(start, unknowns)
    if omega2.shape[0] < 12 or seen(first)[0].size < 4 * MIN_PIECE:
        return blind
    at, _ = least_squares(first, equations, move, lambda step, *_: abs(float(step[-1])) < 1e-6, 12)
    residuals, derivatives, by_lag = seen(at)
    if residuals.size < 4 * MIN_PIECE:
        return blind
    own = by_lag - derivatives @ np.linalg.lstsq(derivatives, by_lag)[0]
    power = max(float(own @ own), 1e-300)
    std = float(np.sqrt(score_scatter((own * residuals)[None])[0][0, 0])) / power
    # What noise of the readings alone, which neighbours do not share, makes of the slopes.
    noise = float((np.diff(residuals) ** 2).sum()) / 4 / 28
    rms = float(np.sqrt(residuals @ residuals / residuals.size))
    return Lag(at.lag, std if power > 3.0 * noise else np.inf, at.x, rms)


def fit_anchor(
    t: ArrayLike,
    omega1_b1: ArrayLike,
    f1_b1: ArrayLike,
    omega2_b2: ArrayLike,
    f2_b2: ArrayLike,
    n1: ArrayLike | None = None,
    n2: ArrayLike | None = None,
    gaps: float = 0.05,
    gyroscope_bias: float = 0.05,
    accelerometer_bias: float = 0.2,
) -> AnchorFit:
    """Fit the hinge point to the records of two inertial sensors, one on each body.

    The axes of each sensor may be taken as the axes of its body. Angular velocities are smoothed and differentiated
    as `smooth` does it; specific forces are used as recorded. The biases of gyroscopes and accelerometers are
    estimated together with the point. An instant is used if all four records are finite there, and if it belongs to a
    series of at least 8 such instants without a gap.

    Args:
        t: instants, increasing: seconds (floats), datetime64, or nanoseconds since 1970 (integers); shape (N,).
        omega1_b1: angular velocity of body 1 in body 1's axes [rad/s]; shape (N, 3), NaN where a sample is missing.
        f1_b1: specific force that accelerometer 1 measures, in body 1's axes [m/s^2]; shape (N, 3): S1^T (a - g),
            where a is the acceleration of the sensor and g = (0, 0, -9.81), both in world axes.
        omega2_b2: angular velocity of body 2 in body 2's axes [rad/s]; shape (N, 3).
        f2_b2: specific force that accelerometer 2 measures, in body 2's axes [m/s^2]; shape (N, 3).
        n1: hinge axis in body 1's axes, as found by `fit_axis`; shape (3,). Give both n1 and n2 or neither. If they
            are given, the hinge point is the point on the axis closest to sensor 1. Otherwise the axis is estimated,
            and the hinge point is the point on it at which the sum of the squared distances to both sensors is
            smallest.
        n2: hinge axis in body 2's axes; shape (3,).
        gaps: longest time without a sample across which angular velocities are smoothed [s], at least 1.5 times the
            median time step.
        gyroscope_bias: expected size of the gyroscopes' biases, as the standard deviation of one component [rad/s]; 0
            if the biases were subtracted from the data, for example those that `fit_axis` estimates.
        accelerometer_bias: expected size of the accelerometers' biases, likewise [m/s^2].

    Returns:
        The AnchorFit. Check `.ok` and `.findings` before you use its numbers.

    Raises:
        FitError: no series of samples without a gap has 8 samples or more, or neither body turns.
    """
    if (n1 is None) != (n2 is None):
        raise ArgumentError(
            "n2" if n2 is None else "n1", f"an axis, since {'n1' if n2 is None else 'n2'} is given", None
        )
    named = {"omega1_b1": omega1_b1, "f1_b1": f1_b1, "omega2_b2": omega2_b2, "f2_b2": f2_b2}
    sensors = read_sensors(t, named, gaps, gyroscope_bias, accelerometer_bias)
    if not np.abs(sensors.smooth).max() > 0:
        raise FitError("omega1_b1, omega2_b2", "bodies that turn", "none that does")
    # Levers and biases, first without an axis.
    bias_stds = np.repeat((sensors.accelerometer_bias, sensors.gyroscope_bias), 6)
    omegas, alphas = np.moveaxis(sensors.smooth, 1, 0)
    whole = _Forces(sensors.used_forces, omegas, alphas, np.zeros(12), np.eye(6))
    some = slice(None, None, -(-whole.forces.shape[1] // _START_SAMPLES))
    few = whole._replace(**{name: getattr(whole, name)[:, some] for name in ("forces", "omegas", "alphas")})
    levers = [np.zeros(6), *np.random.default_rng(0).normal(scale=0.3, size=(5, 6))]
    first = _best_of(few, [np.concatenate((u, np.zeros(12))) for u in levers])
    size = float(np.linalg.norm(whole.forces))
    problem, x, residuals = _with_biases(whole, first, bias_stds, size)
    # What is along the axis is not seen, so it must not be left to the noise: u1 is across n1.
    known_axes = None if n1 is None or n2 is None else np.stack(axis_arguments(n1, n2))
    try:
        axes = solve_axes(sensors.omega[0], sensors.omega[1], sensors.gyroscope_bias, known_axes)
    except FitError:
        axes = None  # the angular velocities show no axis
    if known_axes is not None:
        problem = problem._replace(basis=_complement(np.concatenate((known_axes[0], np.zeros(3)))))
        x[:6] -= (x[:3] @ known_axes[0]) * known_axes.ravel()
        x, residuals = _solved(problem, x)
        residuals = residuals[: whole.forces.shape[1]]
    u = x[:6]
    _, derivatives = problem._replace(basis=np.eye(6)).linearised(x)
    own, own_prior, bias_std = _without_biases(derivatives, 6, residuals, problem.prior, bias_stds)
    across = problem.basis
    if known_axes is None:  # along both axes: the direction that is seen least
        along = np.linalg.eigh(own.T @ own + own_prior.T @ own_prior)[1][:, 0]
        u, across = u - along * (along @ u), _complement(along)
    # The covariance.
    noise = across.T @ _lever_noise(whole, u, sensors.alpha_deviations) @ across
    inner, unseen = _covariance(across.T @ u, residuals, own @ across, noise, 2.0, own_prior @ across)
    covariance = across @ inner @ across.T
    if known_axes is not None and axes is not None:
        # An axis that is off moves the point that is closest to sensor 1 along the axis.
        turns = np.where(axes.unseen, 0.0, 1.0) * np.pad(u[:3] @ frame(axes.unknowns[0])[:, :2], (0, 2))
        covariance += float(turns @ axes.covariance @ turns) * np.outer(known_axes, known_axes)
    hidden = across**2 @ unseen > 1e-3
    covariance[hidden, hidden] = np.inf
    std = float(np.sqrt(np.diagonal(covariance).max()))
    findings = _point_findings(std, u, residuals, whole.forces)
    if axes is not None:
        findings += axes.clock_findings(sensors.step)
    findings += record_doubts(t, named)
    ok, sentences = verdict(findings)
    return AnchorFit(
        u1=read_only(u[:3]),
        u2=read_only(u[3:]),
        covariance=read_only(covariance),
        bias1=read_only(x[6:9]),
        bias2=read_only(x[9:12]),
        bias_std=read_only(bias_std[:6].reshape(2, 3)),
        rms=float(np.sqrt(residuals @ residuals / residuals.size)),
        ok=ok,
        findings=sentences,
    )


def _complement(direction: Float64Array) -> Float64Array:
    """Return an orthonormal basis (k, k - 1) of what is across a direction (k,)."""
    return np.asarray(np.linalg.svd(direction[None])[2][1:].T)


def _point_findings(std: float, u: Float64Array, residuals: Float64Array, forces: Float64Array) -> list[Finding]:
    """Return findings on a hinge point of which a coordinate has the standard deviation `std` [m] at most."""
    # Levers shorter than a decimetre are judged as if they had this length.
    reach = max(float(np.linalg.norm(u.reshape(2, 3), axis=1).max()), 0.1)
    how = f"is known to {std:.2g} m only" if np.isfinite(std) else "is not shown"
    rms = float(np.sqrt(np.mean(residuals**2)))
    apart = np.subtract(*np.linalg.norm(forces, axis=-1))
    is_random = neighbour_correlation(residuals) <= RANDOM_CORRELATION
    return exceeded(
        Check(
            std,
            RELIABLE_POINT * reach,
            f"The hinge point {how}: let both bodies turn faster, about more than one direction.",
        ),
        Check(
            0.0 if is_random else rms,
            0.07 * float(np.sqrt(np.mean(apart**2))),
            f"The forces at the hinge point differ by {rms:.2g} m/s^2 rms, and not at random: no point is in both "
            "bodies, or the clocks, units or axes of the sensors differ.",
        ),
    )


def _lever_noise(whole: _Forces, u: Float64Array, deviations: Float64Array) -> Float64Array:
    """Return what noise of the angular accelerations, with the standard deviations (2, N), adds to the normal matrix
    (6, 6) of the levers.
    """
    noise = np.zeros((6, 6))
    for i, rows in enumerate((slice(0, 3), slice(3, 6))):
        felt = whole.forces[i] + acceleration_matrices(whole.omegas[i], whole.alphas[i]) @ u[rows]
        felt /= np.maximum(np.linalg.norm(felt, axis=-1, keepdims=True), 1e-300)
        variances = deviations[i] ** 2
        noise[rows, rows] = variances.sum() * np.eye(3) - (felt * variances[:, None]).T @ felt
    return noise


def _without_biases(
    derivatives: Float64Array, count: int, residuals: Float64Array, prior: Float64Array, bias_stds: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return the derivatives of the samples (N, count) and of the priors (b, count) by the first `count` unknowns,
    without what a change of the b biases could explain, and the standard deviations of the biases (b,).
    """
    if not prior.any():
        return derivatives, np.zeros((0, count)), bias_stds
    own, by_bias = derivatives[:, :count], derivatives[:, count:]
    rest = own - by_bias @ np.linalg.lstsq(by_bias, own)[0]
    bias_rest = by_bias - own @ np.linalg.lstsq(own, by_bias)[0]
    std = np.sqrt(np.mean(residuals**2) * np.diagonal(np.linalg.pinv(bias_rest.T @ bias_rest)))
    return rest[: residuals.size], rest[residuals.size :], std


def _axis_starts(w1: Float64Array, w2: Float64Array) -> list[Float64Array]:
    """Return pairs (n1, n2) of axes (2, 3) from which fits start: the solution of linear least squares for the
    matrices n n^T, the principal axes of the angular velocities, and ten random pairs (fixed seed).
    """
    rows = [np.einsum("ni,nj->nij", w, w).reshape(-1, 9) for w in (w1, w2)]
    size = (w1 * w1).sum(axis=-1) - (w2 * w2).sum(axis=-1)
    squares = np.linalg.lstsq(np.concatenate((rows[0], -rows[1]), axis=-1), size)[0].reshape(2, 3, 3)
    linear = np.linalg.eigh((squares + np.swapaxes(squares, -1, -2)) / 2)[1][..., -1]
    principal = np.linalg.eigh(np.stack((w1.T @ w1, w2.T @ w2)))[1][..., -1]
    random = np.random.default_rng(0).normal(size=(10, 2, 3))
    random /= np.linalg.norm(random, axis=-1, keepdims=True)
    return [linear, principal, *random]


def sign_correlation(omega1: Float64Array, omega2: Float64Array, n1: Float64Array, n2: Float64Array) -> float:
    """Return the correlation between changes of the hinge angle from the angular velocities (N, 3) across the axis,
    and from those about it: positive if n1 and n2 point in the same direction along the axis.
    """
    a, b = omega1 @ frame(n1), omega2 @ frame(n2)
    across = (a[:, 0] + 1j * a[:, 1]) * (b[:, 0] - 1j * b[:, 1])
    rate = b[:, 2] - a[:, 2]
    turned = np.cumsum(np.nan_to_num(rate))
    # The largest counts: over few steps noise exceeds the change, over many the angle turns around.
    best, lag = -1.0, 1
    while lag <= min(256, rate.size // 4):
        step, middle = across[lag:] * np.conj(across[:-lag]), turned[lag:] - turned[:-lag]
        known = np.isfinite(step)
        weight, turn, middle = np.abs(step[known]), np.angle(step[known]), middle[known]
        power = (weight @ (turn * turn)) * (weight @ (middle * middle))
        best = max(best, float(weight @ (turn * middle) / np.sqrt(power)) if power > 0 else 0.0)
        lag *= 4
    return best


def acceleration_matrices(omega: Float64Array, alpha: Float64Array) -> Float64Array:
    """Return matrices (N, 3, 3) that convert a lever to the acceleration of its end relative to its start."""
    W = np.asarray(skew(omega), dtype=np.float64)
    return np.asarray(W @ W + skew(alpha), dtype=np.float64)


def _covariance(
    parameters: Float64Array,
    residuals: Float64Array,
    derivatives: Float64Array,
    noise: Float64Array,
    min_signal: float,
    prior_rows: Float64Array,
) -> tuple[Float64Array, NDArray[np.bool_]]:
    """Return the covariance (k, k) of parameters fitted by least squares, and which of them are not determined.

    Noise in the derivatives adds to the normal matrix, by which parameters come out too small. The matrix without
    that noise says how sure a direction is (the sandwich), and the shrinking is taken for a further error.

    Args:
        parameters: the parameters, from where noise does not shrink them; (k,).
        residuals: what is left of each sample; (N,).
        derivatives: its derivatives by the parameters; (N, k).
        noise: what noise in `derivatives` adds to the normal matrix; (k, k).
        min_signal: size of the normal matrix from which a direction is shown, in parts of what noise adds to it.
        prior_rows: rows of priors, whose residuals scatter like those of the samples; (b, k).
    """
    normal = derivatives.T @ derivatives + prior_rows.T @ prior_rows
    values, axes = np.linalg.eigh(normal - min_signal * noise)
    blind = values <= 1e-10 * np.linalg.norm(normal)  # rounding
    shown = axes[:, ~blind]
    inverse = shown @ np.linalg.inv(shown.T @ (normal - noise) @ shown) @ shown.T
    prior = np.mean(residuals * residuals) * prior_rows.T @ prior_rows
    covariance, _ = sandwich(inverse, (derivatives * residuals[:, None]).T, 1, prior)
    shrinking = inverse @ noise @ parameters
    return covariance + np.outer(shrinking, shrinking), (axes[:, blind] ** 2).sum(axis=1) > 1e-3
