"""`hingepair bench fit`: fits of a hinge to recordings, beside SciPy's least_squares on the constraint equations.

The recordings are computed with SciPy's rotations, independently of hingepair.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.measure import Report, Row, make_rows, print_progress, time_interleaved
from hingepair.measured.hinge_fit import fit as fit_pair
from hingepair.pair.body_motion import BodyMotion

Array: TypeAlias = NDArray[np.float64]

# Names of the methods.
HINGEPAIR_FIT_NAME, CONSTRAINTS_FIT_NAME, EQUATIONS_FIT_NAME = (
    "hingepair.fit",
    "least_squares on E1, E2",
    "least_squares on E1, E5, every psi too",
)
_RECORDINGS_COUNT = 5  # recordings of each length whose errors are averaged
_ERROR_NOTE = (
    "error: largest component of the errors of the hinge axis and, perpendicular to it, of the hinge point; "
    f"root mean square of {_RECORDINGS_COUNT} recordings"
)
# Standard deviations of the noise of positions [m] and of rotation vectors [rad].
POSITION_NOISE, ANGLE_NOISE = 1e-3, 2e-3
# The hinge of every recording: n, u1, u2 and the rotation vector of home [rad].
_TRUE_N = np.array([1.0, 2.0, -0.5]) / np.sqrt(5.25)
_TRUE_U1, _TRUE_U2 = np.array([0.3, 0.1, -0.2]), np.array([-0.2, 0.25, 0.1])
_TRUE_HOME = np.array([0.3, -0.5, 0.2])


class RecordedPoses(NamedTuple):
    """The recorded poses of both bodies; positions of shape (N, 3), rotations of shape (N, 3, 3)."""

    R1: Array
    S1: Array
    R2: Array
    S2: Array


class FittedHinge(NamedTuple):
    """The hinge that a method finds: its axis and its point, in the axes of each body."""

    n: Array  # axis in the axes of body 1
    n_body2: Array  # axis in the axes of body 2: home^T n
    u1: Array
    u2: Array


def measure_fits(sizes: Sequence[int], repeats: int) -> Report:
    """Measure fits to recordings of several lengths, with noise alone and with outliers too."""
    rows: list[Row] = []
    for count in sizes:
        for outliers, loss in ((0.0, "linear"), (0.3, "cauchy")):
            case = f"{'30 % outliers, cauchy' if outliers else 'noise'}, N = {count:,}"
            print_progress(f"{case}: {repeats} repeats")
            recordings = [
                make_recording(count, outliers, seed) for seed in range(_RECORDINGS_COUNT if count < 10**5 else 1)
            ]
            methods = {HINGEPAIR_FIT_NAME: fit_by_hingepair} | (
                {CONSTRAINTS_FIT_NAME: fit_by_constraints} if count < 10**5 else {}
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
    return Report(rows, "error [rad, m]", [_ERROR_NOTE])


def make_recording(count: int, outliers: float, seed: int) -> RecordedPoses:
    """Return ten seconds of noisy poses of two bodies.

    Args:
        count: samples.
        outliers: fraction of the samples of body 2 that are wrong.
        seed: of the noise.
    """
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    t = np.linspace(0, 10, count)
    psi = np.sin(2 * t) + 0.3 * np.cos(5 * t)
    first = Rotation.from_rotvec(np.stack((np.sin(0.7 * t), np.cos(1.1 * t), 0.5 * np.sin(t)), axis=-1))
    second = first * Rotation.from_rotvec(psi[:, None] * _TRUE_N) * Rotation.from_rotvec(_TRUE_HOME)
    R1 = np.stack((np.sin(t), np.cos(t), 0.1 * t), axis=-1)
    R2 = R1 + first.apply(_TRUE_U1) - second.apply(_TRUE_U2)
    noise = rng.standard_normal((4, count, 3))
    first, second = (S * Rotation.from_rotvec(ANGLE_NOISE * w) for S, w in ((first, noise[0]), (second, noise[1])))
    is_outlier = rng.random(count) < outliers
    R2 = R2 + POSITION_NOISE * noise[3] + np.where(is_outlier[:, None], rng.standard_normal((count, 3)), 0.0)
    S2 = second.as_matrix()
    wrong_vectors = 3 * rng.standard_normal((int(is_outlier.sum()), 3))
    S2[is_outlier] = Rotation.from_rotvec(wrong_vectors).as_matrix()
    return RecordedPoses(R1 + POSITION_NOISE * noise[2], first.as_matrix(), R2, S2)


def relative_poses(poses: RecordedPoses) -> tuple[Array, Array]:
    """Return rotation (N, 3, 3) and position (N, 3) of body 2 relative to body 1, in the axes of body 1."""
    S1_inverse = np.swapaxes(poses.S1, -1, -2)
    return S1_inverse @ poses.S2, (S1_inverse @ (poses.R2 - poses.R1)[..., None])[..., 0]


def fit_by_hingepair(poses: RecordedPoses, loss: str) -> FittedHinge:
    """Fit the hinge by `hingepair.fit`."""
    pair = fit_pair(BodyMotion(R=poses.R1, S=poses.S1), BodyMotion(R=poses.R2, S=poses.S2), loss=loss).pair
    return FittedHinge(pair.n, pair.home.T @ pair.n, pair.u1, pair.u2)


def fit_by_constraints(poses: RecordedPoses, loss: str) -> FittedHinge:
    """Fit the hinge by SciPy to the constraints S1 n = S2 (home^T n) and E1, from a start that is about 0.2 off."""
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
    """Fit the hinge by SciPy to E1 and the elements of E5, S2 = S1 Sh C; psi of every sample is an unknown."""
    from scipy.optimize import least_squares
    from scipy.sparse import lil_matrix
    from scipy.spatial.transform import Rotation

    Q, p = relative_poses(poses)
    count = len(p)

    def residuals(x: Array) -> Array:
        n, turn, u1, u2, psi = x[:3], x[3:6], x[6:9], x[9:12], x[12:]
        hinge = Rotation.from_rotvec(psi[:, None] * n / np.linalg.norm(n)) * Rotation.from_rotvec(turn)
        rows = np.concatenate(((hinge.as_matrix() - Q).reshape(count, 9), u1 - p - Q @ u2), axis=-1)
        return np.append(rows.ravel(), (n @ n - 1, n @ u1, turn @ n - _TRUE_HOME @ _TRUE_N))

    sparsity = lil_matrix((12 * count + 3, 12 + count), dtype=int)
    sparsity[:, :12] = 1
    for i in range(count):
        sparsity[12 * i : 12 * i + 9, 12 + i] = 1
    start = np.concatenate((_TRUE_N, _TRUE_HOME, _TRUE_U1 - (_TRUE_U1 @ _TRUE_N) * _TRUE_N, _TRUE_U2))
    start += 0.2 * np.random.default_rng(0).standard_normal(12)
    psi = Rotation.from_matrix(Q).as_rotvec() @ start[:3]
    x: Any = least_squares(residuals, np.concatenate((start, psi)), jac_sparsity=sparsity, loss=loss).x
    n = x[:3] / np.linalg.norm(x[:3])
    return FittedHinge(n, Rotation.from_rotvec(x[3:6]).inv().apply(n), x[6:9], x[9:12])


def true_hinge() -> FittedHinge:
    """Return the hinge that all recordings are made with; its point is the one closest to R1."""
    from scipy.spatial.transform import Rotation

    n_body2 = Rotation.from_rotvec(_TRUE_HOME).inv().apply(_TRUE_N)
    along = _TRUE_U1 @ _TRUE_N
    return FittedHinge(_TRUE_N, n_body2, _TRUE_U1 - along * _TRUE_N, _TRUE_U2 - along * n_body2)


def hinge_error(fitted: FittedHinge) -> float:
    """Return the largest component of the errors of the axes and of the perpendicular errors of the points."""
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
