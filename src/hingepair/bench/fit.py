"""`hingepair bench fit`: fits of a hinge to recordings, beside SciPy's least_squares and the package qmt.

Poses: SciPy's least_squares on the constraint equations. Gyroscopes: the axis by qmt's `jointAxisEstHingeOlsson`
(Olsson, Kok, Seel and Halvorsen, Sensors 20 (2020), 3534), which takes accelerometers too. The recordings are
computed with SciPy's rotations, independently of hingepair.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.harness import Case, Method, Report, batch_case, installed, measure, print_progress
from hingepair.measured.hinge_fit import fit
from hingepair.measured.inertial.axis_and_point import fit_axis
from hingepair.pair.body_motion import BodyMotion

Array: TypeAlias = NDArray[np.float64]

POSITION_NOISE, ANGLE_NOISE = 1e-3, 2e-3  # m, rad: standard deviations
GYROSCOPE_NOISE, GYROSCOPE_BIAS, ACCELEROMETER_NOISE = 1e-2, 2e-2, 5e-2  # rad/s, rad/s, m/s^2
RECORDINGS = 5  # of each length; the rms of their errors counts
LONG = 10**5  # samples from which one recording is made, for hingepair alone: others would take minutes

# The hinge of every recording.
_N = np.array([1.0, 2.0, -0.5]) / np.sqrt(5.25)
_U1, _U2 = np.array([0.3, 0.1, -0.2]), np.array([-0.2, 0.25, 0.1])
_HOME = np.array([0.3, -0.5, 0.2])  # rotation vector


class Poses(NamedTuple):
    """Recorded poses of both bodies."""

    R1: Array  # (N, 3)
    S1: Array  # (N, 3, 3)
    R2: Array
    S2: Array


class Inertial(NamedTuple):
    """Readings of gyroscopes [rad/s] and accelerometers [m/s^2] on both bodies, (N, 3), in their axes."""

    omega1: Array
    f1: Array
    omega2: Array
    f2: Array


class Hinge(NamedTuple):
    """A hinge as each body sees it."""

    n: Array  # unit axis in the axes of body 1
    n_body2: Array
    u1: Array  # a point of the axis
    u2: Array


def bench_fit(sizes: Sequence[int], repeats: int) -> Report:
    """Measure fits of a hinge to poses and of its axis to gyroscopes.

    Args:
        sizes: numbers of samples of the recordings.
        repeats: of each measurement.
    """
    axis_methods, left_out = installed(AXIS_METHODS, {})
    if left_out:
        left_out.append("qmt: pip install qmt (its last wheels, of 2023, are for Python 3.11 and before)")
    rows = measure(pose_cases(sizes), repeats) + measure(axis_cases(axis_methods, sizes), repeats)
    notes = [
        "error: largest component of the errors of the hinge axis and, perpendicular to it, of the hinge point; "
        f"root mean square of {RECORDINGS} recordings",
        "axes from gyroscopes: the error does not count the signs of n1 and n2; wrong signs: recordings in which the "
        "sign of n2 beside n1 is wrong",
    ]
    return Report(rows, "error [rad, m]", notes + left_out)


def pose_cases(sizes: Sequence[int]) -> Iterator[Case]:
    """Yield a case of noise and one of noise with outliers for each size."""
    for size in sizes:
        fits = {"hingepair.fit": fit_by_hingepair}
        if size < LONG:
            fits["least_squares on E1, E2"] = fit_by_constraints
        for outliers, loss in ((0.0, "linear"), (0.3, "cauchy")):
            print_progress(f"poses, N = {size:,}: errors")
            recordings = [record_poses(size, outliers, seed) for seed in _seeds(size)]
            errors = {name: _rms(hinge_error(one(poses, loss)) for poses in recordings) for name, one in fits.items()}
            jobs = {name: functools.partial(one, recordings[0], loss) for name, one in fits.items()}
            noise = "30 % outliers, cauchy" if outliers else "noise"
            yield Case(f"{noise}, N = {size:,}", jobs, size, errors)


def axis_cases(methods: Sequence[Method], sizes: Sequence[int]) -> Iterator[Case]:
    """Yield cases without and with biases for each size; no method takes longer recordings than its largest."""
    for size in sizes:
        able = [method for method in methods if size <= method.max_samples]
        for bias in (0.0, GYROSCOPE_BIAS) if able else ():
            tasks = [(record_inertial(size, bias, seed), bias) for seed in _seeds(size)]
            errors: dict[str, float] = {}
            signs: dict[str, dict[str, Any]] = {}
            for method in able:
                found, wrong = zip(*(axis_errors(*method.make_job(task)()) for task in tasks), strict=True)
                errors[method.name] = _rms(found)
                signs[method.name] = {"wrong signs": f"{sum(wrong)} of {len(tasks)}"}
            name = f"axis from {'biased ' if bias else ''}gyroscopes"
            yield batch_case(name, able, functools.partial(_first, tasks), size, errors, signs)


def _first(tasks: Sequence[Any], _count: int) -> Any:
    return tasks[0]


def _seeds(size: int) -> range:
    return range(RECORDINGS if size < LONG else 1)


def _rms(errors: Any) -> float:
    return float(np.sqrt(np.mean(np.square([*errors]))))


def _exact_poses(t: Array) -> tuple[tuple[Array, Any], tuple[Array, Any]]:
    """Return positions, (N, 3), and SciPy's rotations of both bodies at instants t."""
    from scipy.spatial.transform import Rotation

    psi = np.sin(2 * t) + 0.3 * np.cos(5 * t)
    first = Rotation.from_rotvec(np.stack((np.sin(0.7 * t), np.cos(1.1 * t), 0.5 * np.sin(t)), axis=-1))
    second = first * Rotation.from_rotvec(psi[:, None] * _N) * Rotation.from_rotvec(_HOME)
    R1 = np.stack((np.sin(t), np.cos(t), 0.1 * t), axis=-1)
    return (R1, first), (R1 + first.apply(_U1) - second.apply(_U2), second)


def record_poses(count: int, outliers: float, seed: int) -> Poses:
    """Return noisy poses over ten seconds, of which a fraction of body 2's is wrong."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    (R1, first), (R2, second) = _exact_poses(np.linspace(0, 10, count))
    noise = rng.standard_normal((4, count, 3))
    first, second = (S * Rotation.from_rotvec(ANGLE_NOISE * w) for S, w in ((first, noise[0]), (second, noise[1])))
    is_wrong = rng.random(count) < outliers
    R2 = R2 + POSITION_NOISE * noise[3] + np.where(is_wrong[:, None], rng.standard_normal((count, 3)), 0.0)
    S2 = second.as_matrix()
    S2[is_wrong] = Rotation.from_rotvec(3 * rng.standard_normal((int(is_wrong.sum()), 3))).as_matrix()
    return Poses(R1 + POSITION_NOISE * noise[2], first.as_matrix(), R2, S2)


def record_inertial(count: int, bias_std: float, seed: int) -> Inertial:
    """Return noisy readings over ten seconds; the gyroscopes' biases have the standard deviation `bias_std`."""
    rng = np.random.default_rng(seed)
    h = 1e-4  # s, of the differences
    before, now, after = (_exact_poses(np.linspace(0, 10, count) + step) for step in (-h, 0.0, h))
    columns = []
    for body in (0, 1):
        (R_before, S_before), (R, S), (R_after, S_after) = (poses[body] for poses in (before, now, after))
        omega = (S_before.inv() * S_after).as_rotvec() / (2 * h)
        a = (R_after - 2 * R + R_before) / h**2
        columns += [omega + bias_std * rng.standard_normal(3), S.inv().apply(a - np.array([0.0, 0.0, -9.81]))]
    noise = rng.standard_normal((4, count, 3))
    sizes = (GYROSCOPE_NOISE, ACCELEROMETER_NOISE) * 2
    return Inertial(*(c + size * w for c, size, w in zip(columns, sizes, noise, strict=True)))


def fit_by_hingepair(poses: Poses, loss: str) -> Hinge:
    """Return the hinge that `hingepair.fit` finds."""
    pair = fit(BodyMotion(R=poses.R1, S=poses.S1), BodyMotion(R=poses.R2, S=poses.S2), loss=loss).pair
    return Hinge(pair.n, pair.home.T @ pair.n, pair.u1, pair.u2)


def fit_by_constraints(poses: Poses, loss: str) -> Hinge:
    """Return the hinge for which both bodies share point (E1) and axis (E2) best, by SciPy's least_squares.

    Each unknown starts about 0.2 from the true hinge.
    """
    from scipy.optimize import least_squares

    S1_inverse = np.swapaxes(poses.S1, -1, -2)
    Q, p = S1_inverse @ poses.S2, (S1_inverse @ (poses.R2 - poses.R1)[..., None])[..., 0]

    def residuals(x: Array) -> Array:
        n, n_body2, u1, u2 = x.reshape(4, 3)
        conditions = (n @ n - 1, n_body2 @ n_body2 - 1, n @ u1)
        return np.concatenate(((Q @ n_body2 - n).ravel(), (u1 - p - Q @ u2).ravel(), conditions))

    start = np.concatenate(true_hinge()) + 0.2 * np.random.default_rng(0).standard_normal(12)
    x: Any = least_squares(residuals, start, loss=loss, f_scale=3 * max(POSITION_NOISE, ANGLE_NOISE), x_scale="jac").x
    n, n_body2, u1, u2 = x.reshape(4, 3)
    return Hinge(n / np.linalg.norm(n), n_body2 / np.linalg.norm(n_body2), u1, u2)


def true_hinge() -> Hinge:
    """Return the hinge of all recordings; the hinge point is the closest to the origin of body 1."""
    from scipy.spatial.transform import Rotation

    n_body2 = Rotation.from_rotvec(_HOME).inv().apply(_N)
    along = _U1 @ _N
    return Hinge(_N, n_body2, _U1 - along * _N, _U2 - along * n_body2)


def hinge_error(found: Hinge) -> float:
    """Return the largest error of a component of the axes or, perpendicular to them, of the points.

    The sign that both axes have in common is not counted.
    """
    truth = true_hinge()
    sign = np.sign(found.n @ truth.n)
    across = [np.eye(3) - np.outer(axis, axis) for axis in (truth.n, truth.n_body2)]
    parts = (
        sign * found.n - truth.n,
        sign * found.n_body2 - truth.n_body2,
        across[0] @ (found.u1 - truth.u1),
        across[1] @ (found.u2 - truth.u2),
    )
    return float(np.abs(np.concatenate(parts)).max())


def axis_by_hingepair(recording: Inertial, bias_std: float) -> tuple[Array, Array]:
    """Return n1 and n2 as `hingepair.fit_axis` finds them from the gyroscopes."""
    found = fit_axis(recording.omega1, recording.omega2, bias_std)
    return found.n1, found.n2


def axis_by_qmt(recording: Inertial, _bias_std: float, settings: dict[str, Any] | None = None) -> tuple[Array, Array]:
    """Return n1 and n2 as qmt finds them from gyroscopes and accelerometers, or as its settings say."""
    import qmt

    omega1, f1, omega2, f2 = recording
    with redirect_stdout(io.StringIO()):  # qmt prints every step
        n1, n2 = qmt.jointAxisEstHingeOlsson(f1, f2, omega1, omega2, estSettings=settings)
    return np.ravel(n1), np.ravel(n2)


def axis_by_qmt_gyroscopes(recording: Inertial, bias_std: float) -> tuple[Array, Array]:
    """Return n1 and n2 as qmt finds them from the gyroscopes alone, which do not determine the sign of n2."""
    return axis_by_qmt(recording, bias_std, {"residuals": [1]})


def axis_errors(n1: Array, n2: Array) -> tuple[float, bool]:
    """Return the largest error of a component of both axes, signs apart, and whether their signs disagree."""
    truth = true_hinge()
    signs = [float(np.sign(axis @ true)) for axis, true in ((n1, truth.n), (n2, truth.n_body2))]
    parts = (signs[0] * n1 - truth.n, signs[1] * n2 - truth.n_body2)
    return float(np.abs(np.concatenate(parts)).max()), signs[0] != signs[1]


def _axis_method(name: str, find: Callable[[Inertial, float], tuple[Array, Array]], **options: Any) -> Method:
    return Method(name, lambda task: functools.partial(find, *task), **options)


AXIS_METHODS = (  # ratios refer to the first
    _axis_method("hingepair.fit_axis", axis_by_hingepair, max_samples=LONG),
    _axis_method("qmt, gyroscopes alone", axis_by_qmt_gyroscopes, max_samples=LONG - 1, package="qmt"),
    _axis_method("qmt, accelerometers too", axis_by_qmt, max_samples=LONG - 1, package="qmt"),
)
