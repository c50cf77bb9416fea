"""A hinge from two inertial sensors in one call: clock offset, axis, point and angle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, FitError
from hingepair.measured.hinge import Hinge, home_of
from hingepair.measured.inertial.angle import AngleFit, fit_angle
from hingepair.measured.inertial.axis_and_point import AnchorFit, Axes, AxisFit, fit_anchor, fit_axis, solve_axes
from hingepair.measured.inertial.records import checked_vectors, local_slopes, report
from hingepair.numeric.arrays import Float64Array, number_not_below_0, read_only
from hingepair.pair.hinge_pair import HingePair
from hingepair.tables.instants import elapsed_seconds, increasing_seconds


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
        seconds, _ = increasing_seconds("t", self.t)
        object.__setattr__(self, "t", read_only(np.array(self.t)))
        named = {"omega": self.omega, "force": self.force}
        for name, array in zip(named, checked_vectors(named, seconds.size), strict=True):
            object.__setattr__(self, name, read_only(array))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImuFit:
    """The result of `fit_imus`: the hinge, and the fits of axis, point and angle.

    Attributes:
        pair: the hinge, a HingePair of sensor 1 and sensor 2.
        axis: the AxisFit.
        anchor: the AnchorFit.
        angle: the AngleFit, at the instants of sensor 1; its std includes what the clock offset leaves in doubt.
        clock_offset: time by which the clock of sensor 1 is ahead of that of sensor 2 [s]: a sample of sensor 2 with
            the time stamp s was taken at the instant s + clock_offset of the clock of sensor 1. It is 0 if the
            motion shows no offset.
        clock_offset_std: standard deviation of the clock offset [s]; inf if the motion does not determine it.
        imu2: the record of sensor 2 at the instants of sensor 1, corrected for the offset, an ImuRecording.
        ok: whether axis, point and angle are reliable.
        findings: sentences that say what is wrong with the data, or what the motion does not determine.
    """

    pair: HingePair
    axis: AxisFit
    anchor: AnchorFit
    angle: AngleFit
    clock_offset: float
    clock_offset_std: float
    imu2: ImuRecording
    ok: bool
    findings: tuple[str, ...]

    def __str__(self) -> str:
        lines = [line for fit in (self.axis, self.anchor, self.angle) for line in _report_lines(fit)]
        offset = f"clock offset: {1e3 * self.clock_offset:.4g} +- {1e3 * self.clock_offset_std:.2g} ms"
        return report([*lines, offset], self.findings, self.ok)


def _report_lines(fit: AxisFit | AnchorFit | AngleFit) -> list[str]:
    """Return the lines of the report of a fit without its findings and its verdict."""
    return str(fit).splitlines()[: -1 - len(fit.findings)]


def fit_imus(
    imu1: ImuRecording,
    imu2: ImuRecording,
    gaps: float = 0.05,
    gyroscope_bias: float = 0.05,
    accelerometer_bias: float = 0.2,
) -> ImuFit:
    """Fit clock offset, hinge axis, hinge point and hinge angle to the records of two inertial sensors, one on each
    body. `fit_axis`, `fit_anchor` and `fit_angle` do the same one by one.

    Args:
        imu1: ImuRecording of the sensor on body 1.
        imu2: ImuRecording of the sensor on body 2. Its instants need not be those of `imu1`: each of its samples is
            moved along its slope to the nearest instant of `imu1`, by at most three quarters of a time step.
        gaps: longest time without a sample across which angular velocities are smoothed [s].
        gyroscope_bias: expected size of the gyroscopes' biases, as the standard deviation of one component [rad/s].
        accelerometer_bias: expected size of the accelerometers' biases, likewise [m/s^2].

    Returns:
        The ImuFit. Check `.ok` and `.findings` before you use its numbers.

    Raises:
        FitError: as `fit_axis`, `fit_anchor` and `fit_angle`.
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
    >>> fit.ok, fit.axis.n1.round(2) + 0.0, fit.pair.u1.round(2) + 0.0
    (True, array([0., 1., 0.]), array([0., 0., 0.]))
    """
    bias = number_not_below_0("gyroscope_bias", gyroscope_bias)
    step = float(np.median(np.diff(increasing_seconds("imu1.t", imu1.t)[0])))
    _check_overlap(imu1, imu2)
    offset, shown = 0.0, None
    for _ in range(4):  # each with the records aligned by the offset of the last one
        there = _aligned(imu1, imu2, offset)
        found = _axes_or_none(imu1, there, bias)
        if found is None:
            break
        shown = found
        if not found.shows_offset():
            break
        offset += step * found.offset
    axis = fit_axis(imu1.omega, there.omega, gyroscope_bias)
    records = imu1.t, imu1.omega, imu1.force, there.omega, there.force
    options = {"gaps": gaps, "gyroscope_bias": gyroscope_bias, "accelerometer_bias": accelerometer_bias}
    known = (axis.n1, axis.n2) if np.isfinite(axis.std).all() else (None, None)
    anchor = fit_anchor(*records, *known, **options)
    angle = fit_angle(*records, axis.n1, axis.n2, anchor.u1, anchor.u2, **options)
    if offset and shown is not None and np.isfinite(shown.lag.std):
        # What one standard deviation of the offset does to the angle.
        later = _aligned(imu1, imu2, offset + step * shown.lag.std)
        records = imu1.t, imu1.omega, imu1.force, later.omega, later.force
        change = fit_angle(*records, axis.n1, axis.n2, anchor.u1, anchor.u2, **options).psi - angle.psi
        change -= 2 * np.pi * np.rint(change / (2 * np.pi))
        angle = replace(angle, std=read_only(np.hypot(angle.std, np.nan_to_num(change))))
    findings = dict.fromkeys((*axis.findings, *anchor.findings, *angle.findings))
    texts = list(findings)
    if offset:
        order = "later" if offset > 0 else "earlier"
        size = f"{1e3 * abs(offset):.3g} ms {order}"
        texts.append(f"Sensor 2 was read {size} than its time stamps say; the fit corrects this.")
    hinge = Hinge(axis.n1, axis.n2, anchor.u1, anchor.u2)
    return ImuFit(
        pair=HingePair(u1=anchor.u1, u2=anchor.u2, n=axis.n1, home=home_of(hinge)),
        axis=axis,
        anchor=anchor,
        angle=angle,
        clock_offset=offset,
        clock_offset_std=np.inf if shown is None else step * shown.lag.std,
        imu2=there,
        ok=axis.ok and anchor.ok and angle.ok,
        findings=tuple(texts),
    )


def _check_overlap(imu1: ImuRecording, imu2: ImuRecording) -> None:
    """Refuse recordings that do not overlap in time."""
    stamps, first = increasing_seconds("imu1.t", imu1.t)
    others, _ = elapsed_seconds("imu2.t", imu2.t, first)
    if others[-1] < stamps[0] or others[0] > stamps[-1]:
        expected = f"instants that overlap those of imu1, from {stamps[0]:.6g} to {stamps[-1]:.6g} s"
        raise ArgumentError("imu2.t", expected, f"{others[0]:.6g} to {others[-1]:.6g} s")


def _axes_or_none(imu1: ImuRecording, imu2: ImuRecording, bias: float) -> Axes | None:
    """Return the Axes of two records of equal instants, or None if they show none."""
    try:
        return solve_axes(imu1.omega, imu2.omega, bias)
    except FitError:
        return None


def _aligned(imu1: ImuRecording, imu2: ImuRecording, offset: float) -> ImuRecording:
    """Return the record of sensor 2 at the instants of sensor 1, if it was read later by `offset` [s] than its time
    stamps say; NaN where it has no sample near enough.
    """
    stamps, first = increasing_seconds("imu1.t", imu1.t)
    wanted = stamps - offset
    t, _ = elapsed_seconds("imu2.t", imu2.t, first)
    step = float(np.median(np.diff(t)))
    after = np.clip(np.searchsorted(t, wanted), 1, t.size - 1)
    near = after - (wanted - t[after - 1] < t[after] - wanted)
    shift = wanted - t[near]
    shift[np.abs(shift) < 1e-9 * step] = 0.0
    moved = []
    for values in (imu2.omega, imu2.force):
        slopes = local_slopes(values) / step
        there = values[near] + np.where(shift[:, None] == 0, 0.0, shift[:, None] * slopes[near])
        there[np.abs(shift) > 0.75 * step] = np.nan
        moved.append(there)
    return ImuRecording(imu1.t, *moved)
