"""A hinge from two inertial sensors, one on each body: clocks, axis, point and angle, without positions or attitudes.

Across the axis both sensors see the same two vectors, turned by psi: the angular velocity, and the specific force at
the hinge point, F = f + omega x (omega x u) + alpha x u. What does not depend on psi is 0 but for noise: the
differences of the lengths of both vectors across the axis, and of the forces along it (Seel, Schauer and Raisch, IEEE
International Conference on Control Applications, 2012, 45-49; Sensors 14 (2014), 6891-6909). The axis, the point, the
biases of the sensors, the clock offset and the clock drift make them least, in one problem of least squares. What the
motion does not show of these (Olsson, Kok, Seel and Halvorsen, Sensors 20 (2020), 3534) stays as uncertain as before.

Then psi: both vectors show it at each instant, noisy; the rate psi' = omega2 . m - omega1 . n connects the instants,
smooth but with a bias. The most likely angle is that of a fixed-interval smoother, one tridiagonal system.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, FitError, ShapeError
from hingepair.measured.clock import MAX_SHIFT, nearest_samples
from hingepair.measured.findings import RANDOM_CORRELATION, Finding, exceeded, memory_finding
from hingepair.measured.hinge import (
    Hinge,
    frame,
    home_angle,
    home_of,
    result_derivatives,
    sign_of,
    tilted,
)
from hingepair.measured.hinge_report import HingeReport
from hingepair.measured.smoothing.spline import MIN_PIECE, inverse_bands, smooth_columns
from hingepair.measured.statistics import (
    cauchy,
    every_kth,
    loss_weights,
    neighbour_correlation,
    over_all,
    score_scatter,
    solve_semidefinite,
)
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.numeric.arrays import Float64Array, read_only, vectors
from hingepair.rotations.matrices import skew
from hingepair.tables.instants import checked_gaps, elapsed_seconds, increasing_seconds, split_at_gaps
from hingepair.tables.sheets import percent
from hingepair.tables.suspicions import suspicions

# Unknowns: steps of the hinge (`Hinge.moved`), biases of both gyroscopes and of both accelerometers, clock.
_HINGE, _GYROSCOPES, _ACCELEROMETERS, _CLOCK = slice(0, 9), slice(9, 15), slice(15, 21), slice(21, 23)
# Expected sizes: rad, m, biases of usual sensors in rad/s and m/s^2, s; crystals in s/s.
_PRIOR = np.repeat((1.0, 10.0, 0.05, 0.2, 1.0, 2e-4), (4, 5, 6, 6, 1, 1))
_STEPS = np.repeat((1e-5, 1e-5, 1e-5, 1e-5, 1e-6, 1e-8), (4, 5, 6, 6, 1, 1))  # of derivatives
_FEW, _SOME, _MANY = 400, 2000, 20_000  # samples of starts, of the first steps, and of the last one, at most
_RELIABLE_POINT = 0.1  # standard deviation of the point, in parts of the levers, up to which it is relied on
_UNMEASURED = 1e6  # rad: standard deviation of an angle, or a change over a gap, that nothing measures


@dataclass(frozen=True, slots=True, eq=False)
class ImuRecording:
    """The record of an inertial sensor on a body: angular velocity and specific force in the body's axes.

    Attributes:
        t: instants, increasing: seconds (floats), datetime64, or nanoseconds since 1970 (integers); shape (N,).
        omega: angular velocity in the body's axes [rad/s]; shape (N, 3), NaN where a sample is missing.
        force: specific force, S^T (a - g), in the body's axes [m/s^2]; shape (N, 3), NaN where a sample is missing.

    Raises:
        ArgumentError: an argument cannot be used; the error names it.
    """

    t: NDArray[Any]
    omega: Float64Array
    force: Float64Array

    def __post_init__(self) -> None:
        count = increasing_seconds("t", self.t)[0].size
        object.__setattr__(self, "t", read_only(np.array(self.t)))
        for name in ("omega", "force"):
            array = vectors(name, getattr(self, name), 3).astype(np.float64)
            if array.shape != (count, 3):
                raise ShapeError(name, f"shape {(count, 3)}, as t", f"shape {array.shape}")
            object.__setattr__(self, name, read_only(array))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class ImuFit(HingeReport):
    """The result of `fit_imus`: the hinge, and its angle at the instants of sensor 1.

    Attributes:
        pair: the hinge, a HingePair of sensor 1 and sensor 2; the hinge point is the one closest to sensor 1.
        psi: hinge angle [rad]; shape (N,), NaN at instants that are not used. The first finite angle is in [-pi, pi],
            and there are no jumps of 2 pi between samples.
        psi_range: smallest and largest psi [rad].
        psid: rate of psi [rad/s]; shape (N,), NaN where psi is. A constant bias of the gyroscopes is subtracted.
        covariance: covariance matrix of u1, u2, n and the rotation vector of home, as of a HingeFit; shape (12, 12).
        std: standard deviations of the estimates: "u1" [m], "u2" [m], "n", "home" [rad], of shape (3,); "psi" [rad],
            of shape (N,); "gyroscope_bias" [rad/s] and "accelerometer_bias" [m/s^2], of shape (2, 3); "clock_offset"
            [s] and "clock_drift".
        gyroscope_bias: bias of both gyroscopes [rad/s]; shape (2, 3). What the motion does not show stays near 0.
        accelerometer_bias: bias of both accelerometers [m/s^2]; shape (2, 3).
        clock_offset: time by which the clock of sensor 1 is ahead of that of sensor 2 in the middle of the recording
            [s]: a sample of sensor 2 with the time stamp s was taken at the instant s + clock_offset of sensor 1.
        clock_drift: seconds by which the clock offset grows in a second.
        rms_rate: root mean square of the difference of the rates across the axis, without biases [rad/s].
        rms_force: root mean square of the difference of the forces at the hinge point, across the axis [m/s^2].
        t: time since the first instant of sensor 1 [s]; shape (N,).
        samples: number of instants that are used.
        findings: sentences on what is wrong with the data, or what the motion does not determine.
        gauge: name of the rule for the position of the hinge point along the axis, "closest_to_R1".
    """

    psid: Float64Array
    gyroscope_bias: Float64Array
    accelerometer_bias: Float64Array
    rms_rate: float
    rms_force: float

    _left: ClassVar = {"rms_rate": "rad/s", "rms_force": "m/s^2"}
    _reported: ClassVar = ("gyroscope_bias", "accelerometer_bias")
    _over_instants: ClassVar = {"psid": "psid"}
    _title: ClassVar = "hinge of two inertial sensors"


def fit_imus(
    imu1: ImuRecording,
    imu2: ImuRecording,
    gaps: float = 0.05,
) -> ImuFit:
    """Fit a hinge and its angle to the records of two inertial sensors, one on each body.

    An instant of sensor 1 is used if it and the nearest sample of sensor 2 are finite and belong to series of at
    least 8 such samples without a gap. Samples of sensor 2 are moved along their smoothed motion to these instants.

    Args:
        imu1: ImuRecording of the sensor on body 1, whose axes are those of the body.
        imu2: ImuRecording of the sensor on body 2, at instants of its own.
        gaps: longest time without a sample over which readings are smoothed and rates integrated [s].

    Returns:
        The ImuFit, with the signs, the hinge point and the zero of psi as `fit` chooses them. Check `.ok` and
        `.findings` before you use its numbers.

    Raises:
        FitError: there are too few samples, or neither body turns.
        ArgumentError: the recordings do not overlap in time.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.arange(1000) / 100
    >>> S1 = hp.rodrigues((1, 0, 0), np.sin(2 * t)) @ hp.rodrigues((0, 0, 1), np.cos(3 * t))
    >>> S2 = S1 @ hp.rodrigues((0, 1, 0), np.sin(4 * t))
    >>> omega1, omega2 = (
    ...     np.einsum("nji,nj->ni", turn, hp.angular_velocity_from_samples(t, turn)) for turn in (S1, S2)
    ... )  # both sensors are at the hinge point, which is at rest
    >>> fit = hp.fit_imus(hp.ImuRecording(t, omega1, 9.81 * S1[:, 2]), hp.ImuRecording(t, omega2, 9.81 * S2[:, 2]))
    >>> fit.ok, fit.pair.n.round(2) + 0.0, fit.pair.u1.round(2) + 0.0
    (True, array([0., 1., 0.]), array([0., 0., 0.]))
    """
    longest = checked_gaps(gaps)
    t1, origin = increasing_seconds("imu1.t", imu1.t)
    t2, _ = elapsed_seconds("imu2.t", imu2.t, origin)
    if t2[-1] < t1[0] or t2[0] > t1[-1]:
        expected = f"instants that overlap those of imu1, from {t1[0]:.6g} to {t1[-1]:.6g} s"
        raise ArgumentError("imu2.t", expected, f"{t2[0]:.6g} to {t2[-1]:.6g} s")
    sensors = _Sensor.of("imu1", t1, imu1, longest), _Sensor.of("imu2", t2, imu2, longest)
    problem = _started(sensors)
    # Each round with the samples of sensor 2 nearest at the last clock.
    x = np.zeros(_PRIOR.size)
    for _ in range(5):
        problem, x, moved = problem.solved(x)
        if moved < 0.01 * sensors[1].step:
            break
    covariance, seen = problem.covariance(x), problem.seen(x)
    psi, psi_std, drift, findings = _most_likely_angle(problem, seen, x, covariance, longest)
    psi -= 2 * np.pi * np.rint(psi[0] / (2 * np.pi))
    hinge, std = problem.hinge, np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    change = result_derivatives(lambda step: hinge.moved(step).results("closest_to_R1"), 9)
    of_hinge = change @ covariance[_HINGE, _HINGE] @ change.T
    deviations = np.sqrt(np.maximum(np.diagonal(of_hinge), 0.0)).reshape(4, 3)
    findings = _hinge_findings(problem, seen, deviations, float(std[2:4].max())) + findings
    for name, record in (("imu1", imu1), ("imu2", imu2)):
        texts = suspicions("instants", f"{name}.t", increasing_seconds("t", record.t)[0])
        texts += suspicions("gyroscope", f"{name}.omega", record.omega)
        texts += suspicions("accelerometer", f"{name}.force", record.force)
        findings += [Finding("unit", 1, 0, text) for text in texts]

    def of_all(values: Float64Array) -> Float64Array:
        return over_all(values, problem.rows[0], t1.size)

    biases = {"gyroscope_bias": _GYROSCOPES, "accelerometer_bias": _ACCELEROMETERS}
    rms = np.sqrt(np.mean(seen.differences() ** 2, axis=1))
    return ImuFit(
        pair=HingePair(u1=hinge.u1, u2=hinge.u2, n=hinge.n, home=home_of(hinge)),
        psi=of_all(psi),
        psi_range=(float(psi.min()), float(psi.max())),
        psid=of_all(seen.rate - drift),
        covariance=read_only(of_hinge),
        std=dict(zip(("u1", "u2", "n", "home"), map(read_only, deviations), strict=True))
        | {"psi": of_all(np.minimum(psi_std, np.pi))}
        | {name: read_only(std[part].reshape(2, 3)) for name, part in biases.items()}
        | dict(zip(("clock_offset", "clock_drift"), std[_CLOCK], strict=True)),
        **{name: read_only(x[part].reshape(2, 3)) for name, part in biases.items()},
        clock_offset=problem.clock[0],
        clock_drift=problem.clock[1],
        rms_rate=float(rms[0]),
        rms_force=float(rms[1]),
        t=read_only(t1),
        samples=problem.rows[0].size,
        findings=tuple(dict.fromkeys(findings)),
        gauge="closest_to_R1",
    )


class _Sensor(NamedTuple):
    """A record of one sensor, smoothed in series without gaps."""

    t: Float64Array  # [s]; (N,)
    # Of the angular velocity [rad/s] and the specific force [m/s^2] the readings, and the smooth values with their
    # first and second derivatives.
    courses: Float64Array  # (4, 2, N, 3)
    alpha_std: Float64Array  # standard deviation of the angular acceleration [rad/s^2]; (N,)
    is_used: NDArray[np.bool_]  # where all of these are finite; (N,)

    @classmethod
    def of(cls, name: str, t: Float64Array, record: ImuRecording, gaps: float) -> _Sensor:
        """Smooth a record."""
        readings = np.stack((record.omega, record.force))
        pieces = split_at_gaps(t, np.asarray(np.isfinite(readings).all(axis=(0, 2))), gaps, MIN_PIECE)
        if not pieces:
            raise FitError(name, f"at least {MIN_PIECE} finite samples without a gap", "none")
        smoothed = [smooth_columns(t, columns, pieces, None) for columns in readings]
        courses = np.stack([readings, *(np.stack([one.curves(order) for one in smoothed]) for order in range(3))])
        is_used = np.zeros(t.size, dtype=bool)
        is_used[np.concatenate(pieces)] = True
        return cls(t, courses, smoothed[0].deviations(1), is_used)

    @property
    def step(self) -> float:
        """Median time step [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def middle(self) -> float:
        """Instant in the middle of the record [s]."""
        return float(self.t[0] + self.t[-1]) / 2


class _Seen(NamedTuple):
    """The two vectors that both sensors see, in axes of which the third is the hinge axis, and the hinge rate."""

    turning: tuple[Float64Array, Float64Array]  # angular velocities [rad/s]; (M, 3) each
    pulling: tuple[Float64Array, Float64Array]  # specific forces at the hinge point [m/s^2]; (M, 3) each
    rate: Float64Array  # as measured, without the biases of the gyroscopes [rad/s]; (M,)
    home: float  # angle between these axes at psi = 0 [rad]

    def differences(self) -> Float64Array:
        """Return what does not depend on psi: the differences of the lengths of both vectors across the axis, and of
        the forces along it; (3, M).
        """
        lengths = [np.hypot(a[:, 0], a[:, 1]) - np.hypot(b[:, 0], b[:, 1]) for a, b in (self.turning, self.pulling)]
        return np.stack((*lengths, self.pulling[0][:, 2] - self.pulling[1][:, 2]))

    def angles(self) -> Float64Array:
        """Return the angles psi that both vectors tell, with jumps by 2 pi, and the hinge rate; (3, M)."""
        a, b = ([vector[:, 0] + 1j * vector[:, 1] for vector in both] for both in (self.turning, self.pulling))
        return np.stack((*(np.angle(x * np.conj(y)) - self.home for x, y in (a, b)), self.rate))


class _Problem(NamedTuple):
    """Least squares for the unknowns x: steps from `hinge`, biases, and changes of the clock. M samples are used."""

    sensors: tuple[_Sensor, _Sensor]
    hinge: Hinge
    clock: tuple[float, float]  # offset in the middle [s] and drift, by which samples were matched
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]  # the samples of both sensors that belong together; (M,) each
    gathered: tuple[Float64Array, Float64Array]  # their `courses`; (4, 2, M, 3) each

    @classmethod
    def at_clock(cls, sensors: tuple[_Sensor, _Sensor], hinge: Hinge, offset: float, drift: float) -> _Problem:
        """Return the problem with the samples matched by a clock."""
        first, second = sensors
        wanted = first.t - offset - drift * (first.t - first.middle)
        near = nearest_samples(second.t, wanted)
        is_near = np.abs(wanted - second.t[near]) <= MAX_SHIFT * second.step
        rows = np.flatnonzero(is_near & first.is_used & second.is_used[near])
        if rows.size < MIN_PIECE:
            expected = f"at least {MIN_PIECE} instants at which both sensors have samples"
            raise FitError("imu1, imu2", expected, rows.size)
        both = rows, near[rows]
        return cls(
            sensors, hinge, (offset, drift), both, (first.courses[:, :, both[0]], second.courses[:, :, both[1]])
        )

    @property
    def instants(self) -> Float64Array:
        """Instants of sensor 1 that are used [s]; (M,)."""
        return self.sensors[0].t[self.rows[0]]

    def thinned(self, most: int) -> _Problem:
        """Return the problem of every k-th sample, with the smallest k that leaves at most so many."""
        every = every_kth(self.rows[0].size, most)
        (rows1, rows2), (first, second) = self.rows, self.gathered
        return self._replace(rows=(rows1[every], rows2[every]), gathered=(first[:, :, every], second[:, :, every]))

    def seen(self, x: Float64Array) -> _Seen:
        """Return what both sensors see if the unknowns are x. Each reading of sensor 2 is moved along its smooth
        course to the instant of sensor 1.
        """
        offset, drift = np.array(self.clock) + x[_CLOCK]
        late = offset + drift * (self.instants - self.sensors[0].middle)
        shifts = np.zeros(late.size), self.instants - late - self.sensors[1].t[self.rows[1]]
        hinge, both = self.hinge.moved(x[_HINGE]), []
        for i, ((recorded, values, slopes, bends), shift) in enumerate(zip(self.gathered, shifts, strict=True)):
            by_shift = (slopes + bends * (shift[:, None] / 2)) * shift[:, None]
            readings, smooth = recorded + by_shift, values[0] + by_shift[0]
            alpha = slopes[0] + bends[0] * shift[:, None]
            axes, lever = hinge[i], hinge[2 + i]
            turning = smooth - x[_GYROSCOPES][3 * i :][:3]
            spin = turning * (turning @ lever)[:, None] - (turning**2).sum(axis=1)[:, None] * lever
            felt = readings[1] - x[_ACCELEROMETERS][3 * i :][:3] + spin + alpha @ np.asarray(skew(lever))
            both.append(((readings[0] - x[_GYROSCOPES][3 * i :][:3]) @ axes, felt @ axes))
        (turning1, pulling1), (turning2, pulling2) = both
        rate, home = turning2[:, 2] - turning1[:, 2], home_angle(hinge, home_of(hinge))
        return _Seen((turning1, turning2), (pulling1, pulling2), rate, home)

    def solved(self, x: Float64Array) -> tuple[_Problem, Float64Array, float]:
        """Return the problem at its solution, the biases there as unknowns, and by how much the clock moved [s]."""
        from scipy.optimize import least_squares

        some, weights = self.thinned(_SOME), np.ones((3, 1))

        def residuals(y: Float64Array) -> Float64Array:
            return np.concatenate(((weights * some.seen(y).differences()).ravel(), y / _PRIOR))

        for _ in range(2):  # each with the noise that the last one left
            weights = some.weights(x)
            x = least_squares(residuals, x, method="lm", x_scale="jac", ftol=1e-7, max_nfev=1000).x
        if self.rows[0].size > some.rows[0].size:  # a last step of Gauss and Newton with all samples
            some = self.thinned(_MANY)
            left = some.seen(x).differences()
            J, weights = some.derivatives(x, "differences"), some.weights(x)
            normal = np.einsum("aki,bki->ab", J * weights**2, J) + np.diag(_PRIOR**-2.0)
            gradient = np.einsum("aki,ki->a", J, left * weights**2) + x / _PRIOR**2
            x = x - solve_semidefinite(normal, gradient)
        hinge = self.hinge.moved(x[_HINGE]).signed().in_gauge("closest_to_R1")
        offset, drift = x[_CLOCK].tolist()
        moved = abs(offset) + abs(drift) * float(np.ptp(self.instants)) / 2
        x = np.concatenate((np.zeros(9), x[9:21], np.zeros(2)))
        return self.at_clock(self.sensors, hinge, self.clock[0] + offset, self.clock[1] + drift), x, moved

    def weights(self, x: Float64Array) -> Float64Array:
        """Return the weights (3, M) of the differences; those that are alike for long tell less, and so do forces
        where the angular acceleration is known less well than usual, as near ends.
        """
        left = self.seen(x).differences()
        hinge = self.hinge.moved(x[_HINGE])
        reach = [float(np.linalg.norm(lever)) for lever in (hinge.u1, hinge.u2)]
        noise = sum(
            (size * sensor.alpha_std[own]) ** 2
            for size, sensor, own in zip(reach, self.sensors, self.rows, strict=True)
        )
        scales = np.maximum(np.sqrt(np.mean(left**2, axis=1)), 1e-9)
        memory = [max(float(score_scatter(row[None])[0][0, 0] / max(row @ row, 1e-300)), 1.0) for row in left]
        more = np.maximum(np.asarray(noise) - np.median(noise), 0.0)
        variances = (scales**2)[:, None] + np.outer((0.0, 1.0, 1.0), more)
        return np.asarray(1 / np.sqrt(variances * np.array(memory)[:, None]))

    def derivatives(self, x: Float64Array, what: str) -> Float64Array:
        """Return the derivatives of `differences` or `angles` by the unknowns, by central differences; (23, 3, M)."""
        ends = [[getattr(self.seen(x + sign * step), what)() for sign in (1, -1)] for step in np.diag(_STEPS)]
        change = np.stack([high - low for high, low in ends])
        if what == "angles":
            change[:, :2] -= 2 * np.pi * np.rint(change[:, :2] / (2 * np.pi))
        return np.asarray(change / (2 * _STEPS[:, None, None]))

    def covariance(self, x: Float64Array) -> Float64Array:
        """Return the covariance (23, 23) of the unknowns.

        Noise of the angular accelerations makes levers look as if they were seen, and come out too short. The normal
        matrix without that noise tells how well they are; by how much they are too short counts as a further error.
        """
        some = self.thinned(_MANY)
        seen, J = some.seen(x), some.derivatives(x, "differences")
        left = seen.differences()
        weights = some.weights(x) ** 2
        normal = np.einsum("aki,bki->ab", J * weights, J)
        scatter, _ = score_scatter(np.einsum("aki,ki->ai", J, left * weights))
        noise = np.zeros_like(normal)
        for i, columns in enumerate((slice(4, 7), slice(7, 9))):  # levers, in axes of which the third is the hinge
            power = self.sensors[i].alpha_std[some.rows[i]] ** 2
            across = seen.pulling[i] * (1.0, 1.0, 0.0)
            across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
            of_lengths, along = weights[1] * power, (weights[2] * power).sum()
            whole = of_lengths.sum() * np.eye(3) - (across * of_lengths[:, None]).T @ across
            size = columns.stop - columns.start
            noise[columns, columns] = (whole + along * np.diag((1.0, 1.0, 0.0)))[:size, :size]
        # In units of the priors; what noise alone could make look seen stays as uncertain as before.
        scale = np.outer(_PRIOR, _PRIOR)
        values, vectors = np.linalg.eigh((normal - 2 * noise) * scale)
        shown = vectors[:, values > 1e-10 * values.max()]
        inverse = (
            shown @ np.linalg.inv(shown.T @ ((normal - noise) * scale) @ shown + np.eye(shown.shape[1])) @ shown.T
        )
        covariance = inverse @ (scatter * scale + np.eye(_PRIOR.size)) @ inverse
        covariance += np.eye(_PRIOR.size) - shown @ shown.T
        first, second = self.hinge.first, self.hinge.second
        levers = np.zeros(_PRIOR.size)
        levers[4:9] = np.concatenate((first.T @ self.hinge.u1, second[:, :2].T @ self.hinge.u2))
        shrinking = inverse @ (noise @ levers * _PRIOR)
        return np.asarray((covariance + np.outer(shrinking, shrinking)) * scale)


def _started(sensors: tuple[_Sensor, _Sensor]) -> _Problem:
    """Return the problem at a first estimate: of the clock offset, 0 unless rates differ there, at which one axis
    fits both gyroscopes best; of that axis; and of the levers that fit the accelerometers best.
    """
    z, none = np.array((0.0, 0.0, 1.0)), np.zeros(3)
    first, second = sensors

    def axes_at(offset: float, starts: int) -> tuple[float, Float64Array, Float64Array, _Problem]:
        there = _Problem.at_clock(sensors, Hinge.along(z, z, none, none), offset, 0.0)
        omega1, omega2 = (each[0, 0] for each in there.thinned(_FEW).gathered)
        return *_start_axes(omega1, omega2, starts), there

    found = [axes_at(0.0, 12)]
    rates = np.sqrt(np.mean([np.mean((each[0, 0] ** 2).sum(axis=1)) for each in found[0][3].gathered]))
    if np.sqrt(found[0][0]) > 0.05 * rates:
        speed, pace = (float(np.sqrt(np.nanmedian((rate**2).sum(axis=1)))) for rate in second.courses[1:3, 0])
        apart = max(first.step, second.step, 0.3 * speed / max(pace, 1e-300))
        offsets = np.arange(1, max(min(float(np.ptp(first.t)) / 4, 40 * apart) / apart, 1)) * apart
        for offset in (*offsets, *-offsets):
            with contextlib.suppress(FitError):  # the records hardly overlap there
                found.append(axes_at(float(offset), 2))
    _, n, m, problem = min(found, key=lambda each: each[0])
    n, m = sign_of(n) * n, sign_of(n) * max(m, -m, key=lambda axis: _sign_correlation(problem, n, axis))
    tried = []
    for levers in (np.zeros((2, 3)), *np.random.default_rng(0).normal(scale=0.3, size=(3, 2, 3))):
        start = Hinge.along(n, m, *levers).in_gauge("closest_to_R1")
        there, x, _ = problem._replace(hinge=start).thinned(_FEW).solved(np.zeros(_PRIOR.size))
        tried.append((float((there.seen(x).differences()[1:] ** 2).mean()), there.hinge))
    return problem._replace(hinge=min(tried, key=lambda each: each[0])[1])


def _start_axes(omega1: Float64Array, omega2: Float64Array, starts: int) -> tuple[float, Float64Array, Float64Array]:
    """Return the axes n and m across which two angular velocities (M, 3) are equally long, but for their signs, after
    the mean squared difference of these lengths.
    """
    from scipy.optimize import least_squares

    if not (omega1.any() or omega2.any()):
        raise FitError("imu1, imu2", "bodies that turn", "none that does")
    # The squares of the rates tell n n^T and m m^T by linear least squares.
    rows = [np.einsum("ni,nj->nij", omega, omega).reshape(-1, 9) for omega in (omega1, omega2)]
    squares = (omega1**2).sum(axis=1) - (omega2**2).sum(axis=1)
    products = np.linalg.lstsq(np.concatenate((rows[0], -rows[1]), axis=1), squares)[0].reshape(2, 3, 3)
    tried = [
        np.linalg.eigh((products + np.swapaxes(products, -1, -2)) / 2)[1][..., -1],
        np.linalg.eigh(np.stack((omega1.T @ omega1, omega2.T @ omega2)))[1][..., -1],
        *np.random.default_rng(0).normal(size=(10, 2, 3)),
    ]
    found = []
    for start in tried[:starts]:
        frames = [frame(axis) for axis in start / np.linalg.norm(start, axis=1, keepdims=True)]

        def lengths(x: Float64Array, frames: list[Float64Array] = frames) -> Float64Array:
            tilts = zip((omega1, omega2), frames, x.reshape(2, 2), strict=True)
            one, other = (np.linalg.norm((omega @ tilted(*each))[:, :2], axis=1) for omega, *each in tilts)
            return np.asarray(one - other)

        solution = least_squares(lengths, np.zeros(4), method="lm", ftol=1e-6, max_nfev=100)
        n, m = (tilted(*each)[:, 2] for each in zip(frames, solution.x.reshape(2, 2), strict=True))
        found.append((2 * solution.cost / squares.size, n, m))
    return min(found, key=lambda each: float(each[0]))


def _sign_correlation(problem: _Problem, n: Float64Array, m: Float64Array) -> float:
    """Return the correlation between the steps of the hinge angle from the directions of the angular velocities
    across the axis, and the rates about it: positive if n and m point in the same direction along the axis.
    """
    one, other = (each[1, 0] @ frame(axis) for each, axis in zip(problem.gathered, (n, m), strict=True))
    both = (one[:, 0] + 1j * one[:, 1]) * (other[:, 0] - 1j * other[:, 1])
    steps, rates = (both[1:] * np.conj(both[:-1])).imag, (other - one)[1:, 2]
    rates = rates * np.abs(both[1:]) ** 2
    return float(steps @ rates / max(np.linalg.norm(steps) * np.linalg.norm(rates), 1e-300))


def _directions(one: Float64Array, other: Float64Array) -> tuple[Float64Array, float]:
    """Return the variances of the angle between two vectors (M, 3) about the third axis [rad^2], inf where they are
    too short across it, and the rms difference of their lengths.
    """
    sizes = np.hypot(one[:, 0], one[:, 1]), np.hypot(other[:, 0], other[:, 1])
    noise = max(float(np.sqrt(np.mean((sizes[0] - sizes[1]) ** 2))), 1e-9)
    least = max(0.05 * float(max(sizes[0].max(), sizes[1].max())), 3 * noise)
    seen = np.minimum(*sizes) > least
    variances = np.full(sizes[0].size, np.inf)
    variances[seen] = noise**2 / 2 * (1 / sizes[0][seen] ** 2 + 1 / sizes[1][seen] ** 2)
    return np.maximum(variances, 1e-18), noise


def _most_likely_angle(
    problem: _Problem, seen: _Seen, x: Float64Array, covariance: Float64Array, gaps: float
) -> tuple[Float64Array, Float64Array, float, list[Finding]]:
    """Return the angle that integrated rates, which have a constant bias, and directions tell together, its standard
    deviations, that bias and findings. `covariance` is that of the unknowns x.
    """
    rate_bias = np.sqrt(2) * _PRIOR[_GYROSCOPES][0]
    (by_turning, rate_noise), (by_pulling, _) = (_directions(*both) for both in (seen.turning, seen.pulling))
    angles, variances = seen.angles()[:2], np.stack((by_turning, by_pulling))
    dt = np.diff(problem.instants)
    after_gap = dt > max(gaps, 1.5 * problem.sensors[0].step)

    def integrated(rate: Float64Array) -> Float64Array:
        return np.where(after_gap, 0.0, (rate[1:] + rate[:-1]) / 2 * dt)  # nothing is known of a gap

    steps = integrated(seen.rate)
    # Errors of the trapezoidal rule beside the noise.
    bends = np.pad(np.abs(np.diff(seen.rate, 2)), 1, mode="edge")
    rule = np.maximum(bends[1:], bends[:-1]) / 12
    step_weights = np.where(after_gap, 1 / _UNMEASURED**2, 1 / ((rate_noise**2 + rule**2) * dt**2))
    precision = 1 / variances
    psi = _unwrapped_start(np.concatenate(([0.0], np.cumsum(steps))), angles, precision)
    weights = precision
    # Each round with the directions nearest to the last angle; those far off count little.
    for _ in range(8):
        near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
        weights = precision * loss_weights(cauchy, (psi - near) ** 2 * precision, 1, np.inf)[0]
        psi = _Smoother(dt, step_weights, weights, rate_bias).solve(steps, near)[0]
    near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
    # How far directions are off, and over how many samples alike.
    excess, memory, lag = 0.0, 1.0, 0
    for one, weight in zip(near, weights, strict=True):
        row = ((psi - one) * np.sqrt(weight))[weight > 0]
        if row.size > MIN_PIECE:
            excess = max(excess, float(np.sqrt(np.mean(row * row))))
            scatter, unresolved_lag = score_scatter(row[None])
            memory, lag = max(memory, float(scatter[0, 0] / max(row @ row, 1e-300))), max(lag, unresolved_lag)
    smoother = _Smoother(dt, step_weights, weights / (max(excess, 1.0) ** 2 * memory), rate_bias)
    psi, drift = smoother.solve(steps, near)
    # What the unknowns change goes through the same smoother.
    changes = np.stack(
        [smoother.solve(integrated(change[2]), change[:2])[0] for change in problem.derivatives(x, "angles")]
    )
    sizes, axes = np.linalg.eigh(covariance)
    spread = (axes * np.sqrt(np.maximum(sizes, 0.0))).T @ changes
    std = np.sqrt(smoother.variances() + (spread**2).sum(axis=0))
    shown = np.isfinite(variances)
    off = np.abs(psi - angles - 2 * np.pi * np.rint((psi - angles) / (2 * np.pi)))[shown]
    # Off by five deviations, and by more than half of what chance would leave.
    far = float(np.mean((off > 5.0 * np.sqrt(variances[shown])) & (off > 0.2))) if off.size else 0.0
    worst = min(float(std.max()), np.pi)
    known = f"The angle is known to {worst:.2g} rad only: neither the force at the hinge point nor the angular "
    known += "velocity shows a direction across the axis for long enough."
    scattered = f"Directions are {excess:.2g} times as far from the integrated angle as their noise explains: the "
    scattered += "axis or the point may be wrong."
    contradicted = f"{percent(far)} of the directions contradict the integrated rate: units, axes or the point may "
    contradicted += "be wrong."
    text = "Whole turns during a gap are not seen: the angle after it is taken as less than half a turn away."
    findings = exceeded(
        Finding("angle", worst, 0.2, known),
        Finding("directions", excess, 3.0, scattered),
        Finding("contradictions", far, 0.2, contradicted),
        memory_finding(lag, "the directions"),
        Finding("turns in a gap", float(after_gap.any()), 0, text, harmless=True),
    )
    return psi, std, drift, findings


def _unwrapped_start(integrated_rates: Float64Array, angles: Float64Array, precision: Float64Array) -> Float64Array:
    """Return a first estimate of the hinge angle without jumps by 2 pi: the integrated rates (M,), of which measured
    angles (2, M) correct the slow drift.
    """
    off = (precision * np.exp(1j * (angles - integrated_rates))).sum(axis=0)
    if not precision.any():
        return integrated_rates
    total = np.concatenate(([0.0], np.cumsum(off)))
    count = integrated_rates.size
    half, place = max(1, count // 100), np.arange(count)
    mean = total[np.minimum(place + half, count)] - total[np.maximum(place - half, 0)]
    return np.asarray(integrated_rates + np.unwrap(np.angle(mean)))


class _Smoother:
    """Weighted least squares of M angles and of the bias of their rate, factorised once. The weights are the inverse
    variances of measured steps (M - 1,) over times `dt` and of measured angles (2, M); `bias_std` is a prior.
    """

    def __init__(
        self, dt: Float64Array, step_weights: Float64Array, angle_weights: Float64Array, bias_std: float
    ) -> None:
        from scipy.linalg import cholesky_banded

        self._dt, self._step_weights, self._angle_weights = dt, step_weights, angle_weights
        steps = np.append(step_weights, 0.0) + np.append(0.0, step_weights)  # after and before each angle
        diagonal = angle_weights.sum(axis=0) + steps + 1 / _UNMEASURED**2
        diagonal += 1e-13 * diagonal.max()  # rounding must not make the matrix indefinite
        self._matrix = np.stack((np.pad(-step_weights, (1, 0)), diagonal))
        self._factor, self._border = cholesky_banded(self._matrix), -np.diff(np.pad(step_weights * dt, 1))
        self._y = self._solved(self._border)
        least = 1 / max(bias_std, 1e-9) ** 2
        self._precision = max(float((step_weights * dt) @ dt - self._border @ self._y), 0.0) + least

    def _solved(self, right: Float64Array) -> Float64Array:
        from scipy.linalg import cho_solve_banded

        return np.asarray(cho_solve_banded((self._factor, False), right))

    def solve(self, steps: Float64Array, angles: Float64Array) -> tuple[Float64Array, float]:
        """Return the angles (M,) and the bias of the rate, from measured `steps` (M - 1,) and `angles` (2, M)."""
        weighted = self._step_weights * steps
        right = (self._angle_weights * np.where(self._angle_weights > 0, angles, 0.0)).sum(axis=0)
        right -= np.diff(np.pad(weighted, 1))
        x = self._solved(right)
        drift = float((weighted @ self._dt - self._border @ x) / self._precision)
        return x - drift * self._y, drift

    def variances(self) -> Float64Array:
        """Return the variances of the angles (M,)."""
        variances = inverse_bands(self._matrix, 1)[0, : self._y.size] + self._y * self._y / self._precision
        return np.asarray(np.maximum(variances, 0.0))


def _hinge_findings(problem: _Problem, seen: _Seen, std: Float64Array, m_std: float) -> list[Finding]:
    """Return findings on axis and point. `std` are the standard deviations of u1, u2, n and home (4, 3), `m_std` that
    of the axis in body 2 [rad].
    """
    rates, lengths, along = seen.differences()
    rms_rate, rms_force, rms_along = (float(np.sqrt(np.mean(part**2))) for part in (rates, lengths, along))
    usual_rate, force = (
        float(np.sqrt(np.mean([(part**2).sum(axis=1).mean() for part in both])))
        for both in (seen.turning, seen.pulling)
    )
    # Levers shorter than a decimetre are judged as if they had this length.
    reach = max(float(np.linalg.norm(problem.hinge.u1)), float(np.linalg.norm(problem.hinge.u2)), 0.1)
    recorded = [np.linalg.norm(each[0, 1], axis=1) for each in problem.gathered]
    apart = float(np.sqrt(np.mean((recorded[0] - recorded[1]) ** 2)))
    least = max(0.07 * apart, 1e-6 * force)  # sensors that are both at the hinge point feel the same
    axis, point = float(max(std[2].max(), m_std)), float(std[:2].max())
    turns, pulls = (neighbour_correlation(part) <= RANDOM_CORRELATION for part in (rates, lengths))
    axis_text = f"The axis is known to {np.degrees(axis):.2g} deg only: let both bodies turn across it."
    rate_text = f"They do not turn about one axis: the rates across it differ by {rms_rate:.2g} rad/s rms"
    rate_text += "." if turns else ", and not at random; or the clocks of the sensors differ by more than was tried."
    point_text = f"The hinge point is known to {point:.2g} m only: let both bodies turn faster, about several axes."
    force_text = f"The forces at the hinge point differ by {rms_force:.2g} m/s^2 rms, and not at random: no point is "
    force_text += "in both bodies, or units or axes of the sensors differ."
    along_text = f"The forces along the axis differ by {rms_along:.2g} m/s^2 rms: axis, point or units may be wrong."
    return exceeded(
        Finding("axis", axis, np.radians(5.0), axis_text),
        Finding("rates", rms_rate, (0.3 if turns else 0.05) * usual_rate, rate_text),
        Finding("point", point, _RELIABLE_POINT * reach, point_text),
        Finding("forces", 0.0 if pulls else rms_force, least, force_text),
        Finding("forces along the axis", rms_along, 0.2 * force, along_text),
        *_scale_findings(seen),
    )


def _scale_findings(seen: _Seen) -> list[Finding]:
    """Return findings on sensors of which one sees more than the other by a factor."""
    findings = []
    # Across the axis both gyroscopes see the same, and the forces are the same as a whole.
    for name, both, parts in (("gyroscopes", seen.turning, 2), ("accelerometers", seen.pulling, 3)):
        sizes = [np.linalg.norm(each[:, :parts], axis=1) for each in both]
        mean, off = (sizes[0] + sizes[1]) / 2, sizes[0] - sizes[1]
        power = max(float(mean @ mean), 1e-300)
        scale = float(mean @ off) / power
        scatter = float(score_scatter(((off - scale * mean) * mean)[None])[0][0, 0])
        text = f"What the {name} see differs by a factor, by {percent(abs(scale))} or more: calibrate their scales, "
        text += "on which the levers depend."
        findings.append(Finding("scale", abs(scale), max(6 * np.sqrt(scatter) / power, 0.002), text))
    return findings
