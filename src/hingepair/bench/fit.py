"""`hingepair bench fit`: the hinge from recordings, against SciPy's least_squares on the constraints as they are.

The recordings are made by SciPy's rotations; nothing of hingepair has a part in the truth.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.measure import Report, Row, interleaved, rows_of, tell
from hingepair.measured.hinge_fit import fit as fit_pair
from hingepair.pair.body_motion import BodyMotion

Array: TypeAlias = NDArray[np.float64]

OURS, GENERIC, RAW = "hingepair.fit", "least_squares on E1, E2", "least_squares on E1, E5, every psi too"
_NOTE = "error: largest of the axes and, across them, of the hinge point; root mean square of 5 recordings"
METRES, RADIANS = 1e-3, 2e-3
_RECORDINGS = 5
_N = np.array([1.0, 2.0, -0.5]) / np.sqrt(5.25)
_U1, _U2 = np.array([0.3, 0.1, -0.2]), np.array([-0.2, 0.25, 0.1])
_HOME = np.array([0.3, -0.5, 0.2])


class Poses(NamedTuple):
    """A recording of both bodies."""

    R1: Array
    S1: Array
    R2: Array
    S2: Array


class Line(NamedTuple):
    """What a way finds: the axis in either body, and the hinge point in either."""

    n: Array
    m: Array
    u1: Array
    u2: Array


def fit(sizes: Sequence[int], repeats: int) -> Report:
    """Recordings of several lengths, with noise, and with outliers."""
    rows: list[Row] = []
    for count in sizes:
        for outliers, loss in ((0.0, "linear"), (0.3, "cauchy")):
            case = f"{'30 % outliers, cauchy' if outliers else 'noise'}, N = {count:,}"
            tell(f"{case}: {repeats} repeats")
            made = [recording(count, outliers, seed) for seed in range(_RECORDINGS if count < 10**5 else 1)]
            ways = {OURS: ours} | ({GENERIC: generic} if count < 10**5 else {})
            if count <= 10**3 and not outliers:
                ways[RAW] = raw
            times = interleaved({n: functools.partial(way, made[0], loss) for n, way in ways.items()}, repeats)
            errors = {n: np.sqrt(np.mean([error_of(way(p, loss)) ** 2 for p in made])) for n, way in ways.items()}
            rows += rows_of(case, times, count, {name: float(error) for name, error in errors.items()})
    return Report(rows, "error [rad, m]", [_NOTE])


def recording(count: int, outliers: float, seed: int) -> Poses:
    """Ten seconds of two bodies with noise of 1 mm and 2 mrad each."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    t = np.linspace(0, 10, count)
    psi = np.sin(2 * t) + 0.3 * np.cos(5 * t)
    first = Rotation.from_rotvec(np.stack((np.sin(0.7 * t), np.cos(1.1 * t), 0.5 * np.sin(t)), axis=-1))
    second = first * Rotation.from_rotvec(psi[:, None] * _N) * Rotation.from_rotvec(_HOME)
    R1 = np.stack((np.sin(t), np.cos(t), 0.1 * t), axis=-1)
    R2 = R1 + first.apply(_U1) - second.apply(_U2)
    noise = rng.standard_normal((4, count, 3))
    first, second = (S * Rotation.from_rotvec(RADIANS * w) for S, w in ((first, noise[0]), (second, noise[1])))
    off = rng.random(count) < outliers
    R2 = R2 + METRES * noise[3] + np.where(off[:, None], rng.standard_normal((count, 3)), 0.0)
    S2 = second.as_matrix()
    S2[off] = Rotation.from_rotvec(3 * rng.standard_normal((int(off.sum()), 3))).as_matrix()
    return Poses(R1 + METRES * noise[2], first.as_matrix(), R2, S2)


def relative(poses: Poses) -> tuple[Array, Array]:
    """Attitude and place of body 2 in the axes of body 1."""
    back = np.swapaxes(poses.S1, -1, -2)
    return back @ poses.S2, (back @ (poses.R2 - poses.R1)[..., None])[..., 0]


def ours(poses: Poses, loss: str) -> Line:
    """What this library finds."""
    pair = fit_pair(BodyMotion(R=poses.R1, S=poses.S1), BodyMotion(R=poses.R2, S=poses.S2), loss=loss).pair
    return Line(pair.n, pair.home.T @ pair.n, pair.u1, pair.u2)


def generic(poses: Poses, loss: str) -> Line:
    """The constraints as they are, S1 n = S2 m and E1, from a start that is 0.2 off in every number."""
    from scipy.optimize import least_squares

    Q, p = relative(poses)

    def residuals(x: Array) -> Array:
        n, m, u1, u2 = x.reshape(4, 3)
        rules = (n @ n - 1, m @ m - 1, n @ u1)
        return np.concatenate(((Q @ m - n).ravel(), (u1 - p - Q @ u2).ravel(), rules))

    truth = np.concatenate(true_line())
    start = truth + 0.2 * np.random.default_rng(0).standard_normal(12)
    x: Any = least_squares(residuals, start, loss=loss, f_scale=3 * max(METRES, RADIANS), x_scale="jac").x
    n, m, u1, u2 = x.reshape(4, 3)
    return Line(n / np.linalg.norm(n), m / np.linalg.norm(m), u1, u2)


def raw(poses: Poses, loss: str) -> Line:
    """The equations as they are, psi of every sample an unknown: E1, and S2 = S1 Sh C (E5) element by element."""
    from scipy.optimize import least_squares
    from scipy.sparse import lil_matrix
    from scipy.spatial.transform import Rotation

    Q, p = relative(poses)
    count = len(p)

    def residuals(x: Array) -> Array:
        n, turn, u1, u2, psi = x[:3], x[3:6], x[6:9], x[9:12], x[12:]
        hinge = Rotation.from_rotvec(psi[:, None] * n / np.linalg.norm(n)) * Rotation.from_rotvec(turn)
        rows = np.concatenate(((hinge.as_matrix() - Q).reshape(count, 9), u1 - p - Q @ u2), axis=-1)
        return np.append(rows.ravel(), (n @ n - 1, n @ u1, turn @ n - _HOME @ _N))

    known = lil_matrix((12 * count + 3, 12 + count), dtype=int)
    known[:, :12] = 1
    for i in range(count):
        known[12 * i : 12 * i + 9, 12 + i] = 1
    start = np.concatenate((_N, _HOME, _U1 - (_U1 @ _N) * _N, _U2))
    start += 0.2 * np.random.default_rng(0).standard_normal(12)
    psi = Rotation.from_matrix(Q).as_rotvec() @ start[:3]
    x: Any = least_squares(residuals, np.concatenate((start, psi)), jac_sparsity=known, loss=loss).x
    n = x[:3] / np.linalg.norm(x[:3])
    return Line(n, Rotation.from_rotvec(x[3:6]).inv().apply(n), x[6:9], x[9:12])


def true_line() -> Line:
    """The hinge of every recording, its point the closest to R1."""
    from scipy.spatial.transform import Rotation

    m = Rotation.from_rotvec(_HOME).inv().apply(_N)
    return Line(_N, m, _U1 - (_U1 @ _N) * _N, _U2 - (_U1 @ _N) * m)


def error_of(found: Line) -> float:
    """Largest error of the axes and, across them, of the point."""
    truth = true_line()
    sign = np.sign(found.n @ truth.n)
    across = [np.eye(3) - np.outer(axis, axis) for axis in (truth.n, truth.m)]
    parts = (
        sign * found.n - truth.n,
        sign * found.m - truth.m,
        across[0] @ (found.u1 - truth.u1),
        across[1] @ (found.u2 - truth.u2),
    )
    return float(np.abs(np.concatenate(parts)).max())
