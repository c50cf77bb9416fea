"""`hingepair bench fit`: fits of a hinge to recordings, beside SciPy's least_squares and the package qmt.

Poses: SciPy's least_squares on the constraint equations. Gyroscopes: the axis by qmt's `jointAxisEstHingeOlsson`
(Olsson, Kok, Seel and Halvorsen, Sensors 20 (2020), 3534), which takes accelerometers too. The recordings are
computed with SciPy's rotations, independently of hingepair.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from importlib.util import find_spec
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.measure import (
    Method,
    Report,
    Row,
    available_methods,
    make_rows,
    measure_methods,
    print_progress,
    time_interleaved,
)
from hingepair.errors import MissingDependencyError
from hingepair.measured.hinge_fit import fit as fit_pair
from hingepair.measured.inertial import fit_axis
from hingepair.pair.body_motion import BodyMotion

Array: TypeAlias = NDArray[np.float64]

# Names of the methods.
HINGEPAIR_FIT_NAME, CONSTRAINTS_FIT_NAME, EQUATIONS_FIT_NAME = (
    "hingepair.fit",
    "least_squares on E1, E2",
    "least_squares on E1, E5, every psi too",
)
AXIS_FIT_NAME, QMT_GYROSCOPES_NAME, QMT_NAME = (
    "hingepair.fit_axis",
    "qmt, gyroscopes alone",
    "qmt, accelerometers too",
)
_NUM_RECORDINGS_PER_SIZE = 5  # recordings of each length whose errors are averaged
# Explains the errors below the table.
_FIT_ERROR_COLUMN_NOTE = (
    "error: largest component of the errors of the hinge axis and, perpendicular to it, of the hinge point; "
    f"root mean square of {_NUM_RECORDINGS_PER_SIZE} recordings"
)
# Standard deviations of the noise of positions [m] and of rotation vectors [rad].
POSITION_NOISE, ANGLE_NOISE = 1e-3, 2e-3
# Standard deviations of the noise of gyroscopes [rad/s] and accelerometers [m/s^2], and of the gyroscopes' biases.
GYROSCOPE_NOISE, ACCELEROMETER_NOISE, GYROSCOPE_BIAS = 1e-2, 5e-2, 2e-2
_GRAVITY_VECTOR_IN_WORLD_AXES = np.array([0.0, 0.0, -9.81])  # [m/s^2]
_POSE_FINITE_DIFFERENCE_STEP_SECONDS = 1e-4  # [s] between the poses whose differences are rates and accelerations
_MIN_SAMPLES_FITTED_BY_HINGEPAIR_ALONE = 10**5  # recordings of this length and more are fitted by hingepair alone
_MAX_SAMPLES_OF_RECORDINGS_WITH_AXIS_FIT = 10**5  # longest recording of gyroscopes, which takes seconds
_WRONG_SIGNS_COLUMN_HEADING = "wrong signs"  # column: recordings of which n1 and n2 point against each other
# Explains the signs of the axes below the table.
_WRONG_SIGNS_COLUMN_NOTE = (
    "axes from gyroscopes: the error does not count the signs of n1 and n2; "
    f"{_WRONG_SIGNS_COLUMN_HEADING}: recordings in which the sign of n2 beside n1 is wrong"
)
# how to install the package qmt
_QMT_INSTALL_NOTE = "qmt: pip install qmt (its last wheels, of 2023, are for Python 3.11 and before)"
# The hinge of every recording: n, u1, u2 and the rotation vector of home [rad].
_TRUE_UNIT_HINGE_AXIS_IN_BODY1 = np.array([1.0, 2.0, -0.5]) / np.sqrt(5.25)
_TRUE_U1, _TRUE_U2 = np.array([0.3, 0.1, -0.2]), np.array([-0.2, 0.25, 0.1])
_TRUE_HOME_ROTVEC = np.array([0.3, -0.5, 0.2])  # rotation vector of home [rad]


class RecordedPoses(NamedTuple):
    """Recorded poses of both bodies: positions R1, R2 of shape (N, 3), and rotations S1, S2 from body to world axes,
    shape (N, 3, 3).
    """

    R1: Array
    S1: Array
    R2: Array
    S2: Array


class InertialRecording(NamedTuple):
    """Noisy readings on both bodies, as arrays of shape (N, 3), each in the axes of its body. The fields are omega1
    [rad/s] of the gyroscope and f1 [m/s^2] of the accelerometer on body 1, then omega2 and f2 of those on body 2.
    """

    omega1: Array  # [rad/s]
    f1: Array  # [m/s^2]
    omega2: Array
    f2: Array


class FittedHinge(NamedTuple):
    """The hinge that a method finds, as four arrays of shape (3,): the unit axis in the axes of body 1 (n) and of
    body 2 (n_body2), and the position of the hinge point relative to each body, in its axes (u1, u2).
    """

    n: Array  # axis in the axes of body 1
    n_body2: Array  # axis in the axes of body 2: home^T n
    u1: Array
    u2: Array


def measure_fits(sizes: Sequence[int], repeats: int) -> Report:
    """Measure run times and errors of fits of a hinge to poses, and of fits of a hinge axis to gyroscopes, by
    hingepair and other packages; return the Report. `sizes` are the numbers of samples of the recordings. Each fit is
    timed `repeats` times. Raise a MissingDependencyError without SciPy.
    """
    if find_spec("scipy") is None:
        raise MissingDependencyError("bench fit", "the package scipy: pip install 'hingepair[bench]'", "none")
    rows = _measure_pose_fits(sizes, repeats)
    axis_rows, notes = _measure_axis_fits(sizes, repeats)
    return Report([*rows, *axis_rows], "error [rad, m]", [_FIT_ERROR_COLUMN_NOTE, _WRONG_SIGNS_COLUMN_NOTE, *notes])


def _measure_pose_fits(sizes: Sequence[int], repeats: int) -> list[Row]:
    """Measure run times and errors of fits of a hinge to simulated poses, once with noise alone and once with noise
    and outliers; return a list of table rows. `sizes` are the numbers of samples of the recordings. Each fit is timed
    `repeats` times.
    """
    rows: list[Row] = []
    for count in sizes:
        for outliers, loss in ((0.0, "linear"), (0.3, "cauchy")):
            case = f"{'30 % outliers, cauchy' if outliers else 'noise'}, N = {count:,}"
            print_progress(f"{case}: {repeats} repeats")
            recordings = [
                make_pose_recording(count, outliers, seed)
                for seed in range(_NUM_RECORDINGS_PER_SIZE if count < _MIN_SAMPLES_FITTED_BY_HINGEPAIR_ALONE else 1)
            ]
            methods = {HINGEPAIR_FIT_NAME: fit_by_hingepair} | (
                {CONSTRAINTS_FIT_NAME: fit_by_constraints} if count < _MIN_SAMPLES_FITTED_BY_HINGEPAIR_ALONE else {}
            )
            if count <= 10**3 and not outliers:
                methods[EQUATIONS_FIT_NAME] = fit_by_equations
            times = time_interleaved(
                {name: functools.partial(method, recordings[0], loss) for name, method in methods.items()}, repeats
            )
            errors = {
                name: np.sqrt(np.mean([hinge_error(method(poses, loss)) ** 2 for poses in recordings]))
                for name, method in methods.items()
            }
            rows += make_rows(case, times, count, {name: float(error) for name, error in errors.items()})
    return rows


def _measure_axis_fits(sizes: Sequence[int], repeats: int) -> tuple[list[Row], list[str]]:
    """Measure run times and errors of fits of the hinge axis to simulated gyroscopes, without and with biases. Return
    a tuple of a list of table rows, and a list of notes on the methods whose package is not installed. `sizes` are
    the numbers of samples of the recordings; a method has no row for sizes that are too large for it. Each fit is
    timed `repeats` times.
    """
    methods, notes = available_methods(
        (
            Method(name, functools.partial(_axis_job, fit), max_samples=most, package=package)
            for name, fit, most, package in (
                (AXIS_FIT_NAME, axis_by_hingepair, _MAX_SAMPLES_OF_RECORDINGS_WITH_AXIS_FIT, ""),
                (QMT_GYROSCOPES_NAME, axis_by_qmt_gyroscopes, _MIN_SAMPLES_FITTED_BY_HINGEPAIR_ALONE - 1, "qmt"),
                (QMT_NAME, axis_by_qmt, _MIN_SAMPLES_FITTED_BY_HINGEPAIR_ALONE - 1, "qmt"),
            )
        ),
        {},
    )
    notes += [_QMT_INSTALL_NOTE] if notes else []
    rows: list[Row] = []
    for count in sizes:
        available = [method for method in methods if count <= method.max_samples]
        for bias in (0.0, GYROSCOPE_BIAS) if available else ():
            case = f"axis from {'biased ' if bias else ''}gyroscopes, N = {count:,}"
            print_progress(f"{case}: {repeats} repeats")
            rows += _axis_rows(case, available, count, bias, repeats)
    return rows, notes


def _axis_rows(case: str, methods: Sequence[Method], count: int, bias_std: float, repeats: int) -> list[Row]:
    """Measure run times and errors of each method that fits the hinge axis to recordings of `count` samples; return a
    list of the table rows of the case. `bias_std` is the standard deviation of the gyroscopes' biases [rad/s].
    """
    seeds = range(_NUM_RECORDINGS_PER_SIZE if count < _MIN_SAMPLES_FITTED_BY_HINGEPAIR_ALONE else 1)
    tasks = [(make_inertial_recording(count, bias_std, seed), bias_std) for seed in seeds]
    errors: dict[str, float] = {}
    signs: dict[str, dict[str, Any]] = {}
    for method in methods:
        sizes, are_wrong = zip(*(axis_errors(*method.make_job(task)()) for task in tasks), strict=True)
        errors[method.name] = float(np.sqrt(np.mean(np.square(sizes))))
        signs[method.name] = {_WRONG_SIGNS_COLUMN_HEADING: f"{sum(are_wrong)} of {len(tasks)}"}
    return measure_methods(case, methods, lambda _: tasks[0], count, repeats, errors, signs)


def _axis_job(
    fit: Callable[[InertialRecording, float], tuple[Array, Array]], task: tuple[InertialRecording, float]
) -> Callable[[], tuple[Array, Array]]:
    return lambda: fit(*task)


def _exact_poses(t: Array) -> tuple[tuple[Array, Any], tuple[Array, Any]]:
    """Return the poses of body 1 and of body 2 at instants t, shape (N,), as a tuple of two tuples. Each of these
    holds an array of positions, shape (N, 3), and a SciPy Rotation of N rotations.
    """
    from scipy.spatial.transform import Rotation

    psi = np.sin(2 * t) + 0.3 * np.cos(5 * t)
    first = Rotation.from_rotvec(np.stack((np.sin(0.7 * t), np.cos(1.1 * t), 0.5 * np.sin(t)), axis=-1))
    second = (
        first
        * Rotation.from_rotvec(psi[:, None] * _TRUE_UNIT_HINGE_AXIS_IN_BODY1)
        * Rotation.from_rotvec(_TRUE_HOME_ROTVEC)
    )
    R1 = np.stack((np.sin(t), np.cos(t), 0.1 * t), axis=-1)
    return (R1, first), (R1 + first.apply(_TRUE_U1) - second.apply(_TRUE_U2), second)


def make_inertial_recording(count: int, bias_std: float, seed: int) -> InertialRecording:
    """Simulate `count` noisy readings of gyroscopes and accelerometers on both bodies over ten seconds; return an
    InertialRecording. `bias_std` is the standard deviation of the gyroscopes' biases [rad/s]; `seed` determines noise
    and biases.

    Args:
        count: samples.
        bias_std: standard deviation of a component of the gyroscopes' biases [rad/s].
        seed: of noise and biases.
    """
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 10, count)
    before, now, after = (
        _exact_poses(t + step)
        for step in (-_POSE_FINITE_DIFFERENCE_STEP_SECONDS, 0.0, _POSE_FINITE_DIFFERENCE_STEP_SECONDS)
    )
    columns = []
    for body in (0, 1):
        (R_before, S_before), (R, S), (R_after, S_after) = (poses[body] for poses in (before, now, after))
        omega = (S_before.inv() * S_after).as_rotvec() / (2 * _POSE_FINITE_DIFFERENCE_STEP_SECONDS)
        acceleration = (R_after - 2 * R + R_before) / _POSE_FINITE_DIFFERENCE_STEP_SECONDS**2
        columns += [
            omega + bias_std * rng.standard_normal(3),
            S.inv().apply(acceleration - _GRAVITY_VECTOR_IN_WORLD_AXES),
        ]
    noise = rng.standard_normal((4, count, 3))
    sizes = (GYROSCOPE_NOISE, ACCELEROMETER_NOISE) * 2
    return InertialRecording(*(c + size * w for c, size, w in zip(columns, sizes, noise, strict=True)))


def axis_by_hingepair(recording: InertialRecording, bias_std: float) -> tuple[Array, Array]:
    """Return the hinge axis as a tuple (n1, n2) of unit vectors, shape (3,), in the axes of body 1 and of body 2, as
    `hingepair.fit_axis` fits it to the gyroscopes. `bias_std` is the standard deviation of the gyroscopes' biases
    [rad/s].
    """
    axis_fit = fit_axis(recording.omega1, recording.omega2, bias_std)
    return axis_fit.n1, axis_fit.n2


def axis_by_qmt_gyroscopes(recording: InertialRecording, _: float) -> tuple[Array, Array]:
    """Return the hinge axis as a tuple (n1, n2) of unit vectors, shape (3,), in the axes of body 1 and of body 2, as
    the package qmt fits it to the gyroscopes alone, which do not determine the sign of n2. The second argument is
    ignored.
    """
    return _axis_by_qmt(recording, {"residuals": [1]})


def axis_by_qmt(recording: InertialRecording, _: float) -> tuple[Array, Array]:
    """Return the hinge axis as a tuple (n1, n2) of unit vectors, shape (3,), in the axes of body 1 and of body 2, as
    the package qmt fits it to gyroscopes and accelerometers with its default settings. The second argument is
    ignored.
    """
    return _axis_by_qmt(recording, None)


def _axis_by_qmt(recording: InertialRecording, settings: dict[str, Any] | None) -> tuple[Array, Array]:
    """Return the hinge axis as a tuple (n1, n2) of unit vectors, shape (3,), in the axes of body 1 and of body 2, as
    the package qmt fits it to a recording. `settings` is a dict of options of qmt, or None for the defaults of qmt.
    """
    import qmt

    omega1, f1, omega2, f2 = recording
    with redirect_stdout(io.StringIO()):  # qmt prints every step
        n1, n2 = qmt.jointAxisEstHingeOlsson(f1, f2, omega1, omega2, estSettings=settings)
    return np.ravel(n1), np.ravel(n2)


def axis_errors(n1: Array, n2: Array) -> tuple[float, bool]:
    """Compare the fitted axes n1, n2 with the true ones. Return the largest absolute component of their errors, as a
    float, and whether the sign of n2 relative to n1 is wrong, as a bool. A wrong sign of an axis does not count as an
    error.
    """
    truth = true_hinge()
    signs = [float(np.sign(axis @ true)) for axis, true in ((n1, truth.n), (n2, truth.n_body2))]
    parts = (signs[0] * n1 - truth.n, signs[1] * n2 - truth.n_body2)
    return float(np.abs(np.concatenate(parts)).max()), signs[0] != signs[1]


def make_pose_recording(count: int, outlier_fraction: float, seed: int) -> RecordedPoses:
    """Simulate `count` noisy poses of both bodies over ten seconds; return a RecordedPoses. The fraction
    `outlier_fraction` of the poses of body 2 is wrong; `seed` determines the noise and which poses are wrong.

    Args:
        count: samples.
        outlier_fraction: fraction of the samples of body 2 that are wrong.
        seed: of the noise.
    """
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    t = np.linspace(0, 10, count)
    (R1, first), (R2, second) = _exact_poses(t)
    noise = rng.standard_normal((4, count, 3))
    first, second = (S * Rotation.from_rotvec(ANGLE_NOISE * w) for S, w in ((first, noise[0]), (second, noise[1])))
    is_outlier = rng.random(count) < outlier_fraction
    R2 = R2 + POSITION_NOISE * noise[3] + np.where(is_outlier[:, None], rng.standard_normal((count, 3)), 0.0)
    S2 = second.as_matrix()
    wrong_vectors = 3 * rng.standard_normal((int(is_outlier.sum()), 3))
    S2[is_outlier] = Rotation.from_rotvec(wrong_vectors).as_matrix()
    return RecordedPoses(R1 + POSITION_NOISE * noise[2], first.as_matrix(), R2, S2)


def relative_poses(poses: RecordedPoses) -> tuple[Array, Array]:
    """Return a tuple of the rotations (N, 3, 3) and positions (N, 3) of body 2 relative to body 1, in the axes of
    body 1.
    """
    S1_inverse = np.swapaxes(poses.S1, -1, -2)
    return S1_inverse @ poses.S2, (S1_inverse @ (poses.R2 - poses.R1)[..., None])[..., 0]


def fit_by_hingepair(poses: RecordedPoses, loss: str) -> FittedHinge:
    """Return the hinge that `hingepair.fit` finds with the named loss function."""
    pair = fit_pair(BodyMotion(R=poses.R1, S=poses.S1), BodyMotion(R=poses.R2, S=poses.S2), loss=loss).pair
    return FittedHinge(pair.n, pair.home.T @ pair.n, pair.u1, pair.u2)


def fit_by_constraints(poses: RecordedPoses, loss: str) -> FittedHinge:
    """Fit a hinge by SciPy's least_squares, with the loss function named `loss`, to the conditions that both bodies
    share the hinge point (E1) and the hinge axis; return it as a FittedHinge with unit axes. Each unknown starts at a
    random distance of about 0.2 from the true hinge.
    """
    from scipy.optimize import least_squares

    Q, p = relative_poses(poses)

    def residuals(x: Array) -> Array:
        n, n_body2, u1, u2 = x.reshape(4, 3)
        conditions = (n @ n - 1, n_body2 @ n_body2 - 1, n @ u1)
        return np.concatenate(((Q @ n_body2 - n).ravel(), (u1 - p - Q @ u2).ravel(), conditions))

    truth = np.concatenate(true_hinge())
    start = truth + 0.2 * np.random.default_rng(0).standard_normal(12)
    x: Any = least_squares(residuals, start, loss=loss, f_scale=3 * max(POSITION_NOISE, ANGLE_NOISE), x_scale="jac").x
    n, n_body2, u1, u2 = x.reshape(4, 3)
    return FittedHinge(n / np.linalg.norm(n), n_body2 / np.linalg.norm(n_body2), u1, u2)


def fit_by_equations(poses: RecordedPoses, loss: str) -> FittedHinge:
    """Fit a hinge by SciPy's least_squares, with the loss function named `loss`, to the equations of position (E1)
    and attitude (E5) of body 2; return it as a FittedHinge. The values of psi at all samples are unknowns too. The
    unknowns of the hinge start at a random distance of about 0.2 from the true ones.
    """
    from scipy.optimize import least_squares
    from scipy.sparse import lil_matrix
    from scipy.spatial.transform import Rotation

    Q, p = relative_poses(poses)
    count = len(p)

    def residuals(x: Array) -> Array:
        """Return an array of the residuals of the equations E1 and E5 at every sample, followed by the residuals of
        the constraints on the unknowns. `x` is the array of all unknowns.
        """
        n, turn, u1, u2, psi = x[:3], x[3:6], x[6:9], x[9:12], x[12:]
        hinge = Rotation.from_rotvec(psi[:, None] * n / np.linalg.norm(n)) * Rotation.from_rotvec(turn)
        rows = np.concatenate(((hinge.as_matrix() - Q).reshape(count, 9), u1 - p - Q @ u2), axis=-1)
        return np.append(
            rows.ravel(), (n @ n - 1, n @ u1, turn @ n - _TRUE_HOME_ROTVEC @ _TRUE_UNIT_HINGE_AXIS_IN_BODY1)
        )

    sparsity = lil_matrix((12 * count + 3, 12 + count), dtype=int)
    sparsity[:, :12] = 1
    for i in range(count):
        sparsity[12 * i : 12 * i + 9, 12 + i] = 1
    start = np.concatenate(
        (
            _TRUE_UNIT_HINGE_AXIS_IN_BODY1,
            _TRUE_HOME_ROTVEC,
            _TRUE_U1 - (_TRUE_U1 @ _TRUE_UNIT_HINGE_AXIS_IN_BODY1) * _TRUE_UNIT_HINGE_AXIS_IN_BODY1,
            _TRUE_U2,
        )
    )
    start += 0.2 * np.random.default_rng(0).standard_normal(12)
    psi = Rotation.from_matrix(Q).as_rotvec() @ start[:3]
    x: Any = least_squares(residuals, np.concatenate((start, psi)), jac_sparsity=sparsity, loss=loss).x
    n = x[:3] / np.linalg.norm(x[:3])
    return FittedHinge(n, Rotation.from_rotvec(x[3:6]).inv().apply(n), x[6:9], x[9:12])


def true_hinge() -> FittedHinge:
    """Return, as a FittedHinge, the hinge with which all recordings are made. The hinge point is the point of the
    axis that is closest to the origin of body 1.
    """
    from scipy.spatial.transform import Rotation

    n_body2 = Rotation.from_rotvec(_TRUE_HOME_ROTVEC).inv().apply(_TRUE_UNIT_HINGE_AXIS_IN_BODY1)
    along = _TRUE_U1 @ _TRUE_UNIT_HINGE_AXIS_IN_BODY1
    return FittedHinge(
        _TRUE_UNIT_HINGE_AXIS_IN_BODY1,
        n_body2,
        _TRUE_U1 - along * _TRUE_UNIT_HINGE_AXIS_IN_BODY1,
        _TRUE_U2 - along * n_body2,
    )


def hinge_error(fitted: FittedHinge) -> float:
    """Return the largest absolute difference of a fitted hinge from the true one, as a float. It is taken over the
    components of both axes and, perpendicular to the axis, of both hinge points. The sign that both axes have in
    common is not counted.
    """
    truth = true_hinge()
    sign = np.sign(fitted.n @ truth.n)
    perpendicular = [np.eye(3) - np.outer(axis, axis) for axis in (truth.n, truth.n_body2)]
    parts = (
        sign * fitted.n - truth.n,
        sign * fitted.n_body2 - truth.n_body2,
        perpendicular[0] @ (fitted.u1 - truth.u1),
        perpendicular[1] @ (fitted.u2 - truth.u2),
    )
    return float(np.abs(np.concatenate(parts)).max())
