"""What a hinge leaves of two recorded bodies with attitudes: the constraints, and the covariance of their noise.

Each pose is off by isotropic noise, of place and of attitude. What the constraints leave of sample i, the tilt
Q m - n (two components) and the gap u1 - p - Q u2 (three), is linear in that noise, so that the most likely hinge,
with psi and every true pose eliminated, makes `sum r_i^T C_i^-1 r_i` least, C_i the covariance of r_i (the adjustment
of condition equations with parameters, Helmert 1872; Förstner and Wrobel, Photogrammetric Computer Vision, 2016,
4.8). All is written in axes along the hinge. There the tilt is seen free of the gap; half of the arms times the tilt
is taken from the gap, after which it is

    C = a + b (abs(p)^2 - p p^T) + c w w^T,   w = 2 n x (k S1 u1 + (1 - k) S2 u2),

a the variance of R2 - R1, k the part of body 1 in the variance s of the relative attitude, b = k (1 - k) s and
c = s / 4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from hingepair.measured.hinge import Hinge, Results, home_angle, home_of, slopes
from hingepair.measured.most_likely import Rows, noise_bias
from hingepair.measured.relative_poses import RelativePoses, closed_form_hinge, robust_closed_form_hinge
from hingepair.measured.statistics import Loss, median_variance
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.bounded import UNIT_ROUNDOFF

_NOISE_SAMPLES = 4096  # samples that the variances of the noise are estimated from
_ROUNDING = 4 * UNIT_ROUNDOFF  # of attitudes, and of places in parts of their size
_LEAST_NOISE = 1e-3  # least variance of positions, in parts of the mean squared residual
_OPPOSITE = -0.999999  # cosine of axes below which they point against each other


class Noise(NamedTuple):
    """Variances of the noise; means, where the user gave standard deviations of single samples."""

    place: float  # of a component of R2 - R1 [m^2]
    attitude: float  # of a component of the relative attitude [rad^2]


class Constraints(NamedTuple):
    """What a hinge leaves of M samples, in axes of which the third is the hinge axis."""

    q: Float64Array  # relative attitude, row by row; (9, M)
    p: Float64Array  # relative place [m]; (3, M)
    arms: Float64Array  # S1 u1 + S2 u2, by the parts of the bodies in the noise, k and 1 - k, doubled [m]; (3, M)
    tilt: Float64Array  # of Q m - n the direction, its length the chord; (2, M)
    gap: Float64Array  # of E1 [m]; (3, M)

    @property
    def psi(self) -> Float64Array:
        """Hinge angles (M,) in [-pi, pi] [rad], from the first axis of `Hinge.first` to that of `Hinge.second`."""
        return np.asarray(np.arctan2(self.q[3] - self.q[1], self.q[0] + self.q[4]))

    def free_gap(self, tilts: Float64Array, gaps: Float64Array) -> Float64Array:
        """Return gaps (..., 3, M) without the part that tilts (..., 2, M) cause."""
        x, y, z = self.arms
        across, along = 0.5 * z * tilts, -0.5 * (tilts[..., 0, :] * x + tilts[..., 1, :] * y)
        return np.asarray(gaps + np.concatenate((across, along[..., None, :]), axis=-2))


def constraints(hinge: Hinge, poses: RelativePoses, axes: Float64Array | None = None) -> Constraints:
    """Return what a hinge leaves, in its own axes or in others (3, 3) near them."""
    axes = hinge.first if axes is None else axes
    q, p = np.kron(axes.T, hinge.second.T) @ poses.Q, axes.T @ poses.p
    lever1, lever2 = (axes.T @ hinge.u1)[:, None], (hinge.second.T @ hinge.u2)[:, None]
    arm = (q.reshape(3, 3, -1) * lever2).sum(axis=1)
    n = axes.T @ hinge.n
    cosine = n @ q[2::3]
    tilt = (q[2:6:3] - n[:2, None]) / np.sqrt(np.maximum((1 + cosine) / 2, 1e-12))
    tilt[0] = np.where(cosine < _OPPOSITE, 2.0, tilt[0])
    share = poses.noise[2]
    return Constraints(q, p, 2 * (share * lever1 + (1 - share) * arm), tilt, lever1 - p - arm)


@dataclass(frozen=True, slots=True, eq=False)
class BodyModel:
    """A hinge of two bodies with attitudes, and the noise of their poses."""

    hinge: Hinge
    noise: Noise

    parameters: ClassVar = 9  # those of `Hinge.moved`
    angles: ClassVar = 4
    components: ClassVar = 5
    unknown_split: ClassVar = "is divided between the bodies, which is not known: give noise1 and noise2"

    @classmethod
    def start(cls, poses: RelativePoses, loss: Loss | None, /) -> BodyModel:
        """Return a first estimate."""
        hinge = closed_form_hinge(poses) if loss is None else robust_closed_form_hinge(poses)
        return cls(hinge, _noise_by_medians(constraints(hinge, poses), poses))

    def misfit(self, poses: RelativePoses, loss: Loss | None, /) -> float:
        """Return the negative log-likelihood of poses per sample: of the closed form of their own by means of squared
        residuals, or with a loss of this hinge by medians.
        """
        seen = constraints(closed_form_hinge(poses) if loss is None else self.hinge, poses)
        middle = np.mean if loss is None else np.median
        tilt, gap = (middle((part**2).sum(axis=0)) for part in (seen.tilt, seen.gap))
        return float(np.log(tilt + 1e-30) + 1.5 * np.log(gap + 1e-30 * poses.size**2))

    def moved(self, step: Float64Array) -> BodyModel:
        """Return the model after a step of `Hinge.moved`."""
        return replace(self, hinge=self.hinge.moved(step).balanced())

    def settled(self, gauge: str, /) -> BodyModel:
        """Return the model with the sign of n and the hinge point that the rules choose."""
        return replace(self, hinge=self.hinge.signed().in_gauge(gauge))

    def with_noise(self, poses: RelativePoses, loss: Loss | None) -> BodyModel:
        """Return the model with the most likely noise, or with a loss that of medians without samples far off."""
        seen = constraints(self.hinge, poses)
        if loss is None:
            start = _noise_by_medians(seen, poses)
            return replace(self, noise=_most_likely_noise(poses.thinned(_NOISE_SAMPLES), self.hinge, start))
        near = (self.rows_near(poses)(self, poses)[-1] ** 2).sum(axis=0) < 100.0
        near = near if 2 * near.sum() > near.size else np.ones_like(near)
        some = poses.part(near)
        return replace(self, noise=_noise_by_medians(constraints(self.hinge, some), some))

    def rows_near(self, poses: RelativePoses) -> Rows:
        """Return the function that gives whitened rows; residuals of a sample are two tilts and three gaps."""
        axes = self.hinge.first
        here = constraints(self.hinge, poses)
        whiten = _Whitener(here, poses, self.noise)

        def rows(model: BodyModel, moved: RelativePoses) -> Float64Array:
            seen = constraints(model.hinge, moved, axes)
            count = self.parameters + len(moved.by_clock) + 1
            tilts, gaps = np.zeros((count, 2, moved.samples)), np.zeros((count, 3, moved.samples))
            tilts[0, 0] = tilts[1, 1] = -1.0
            tilts[2], tilts[3], tilts[-1] = seen.q[0:6:3], seen.q[1:6:3], seen.tilt
            gaps[4, 0] = gaps[5, 1] = gaps[6, 2] = 1.0
            gaps[7], gaps[8], gaps[-1] = -seen.q[0::3], -seen.q[1::3], seen.gap
            for k, (dq, dp) in enumerate(model.clock_derivatives(moved, axes)):
                tilts[self.parameters + k] = dq[2:6:3]
                lever2 = (model.hinge.second.T @ model.hinge.u2)[:, None]
                gaps[self.parameters + k] = -dp - (dq.reshape(3, 3, -1) * lever2).sum(axis=1)
            return whiten(tilts, here.free_gap(tilts, gaps))

        return rows

    def clock_derivatives(
        self, poses: RelativePoses, axes: Float64Array | None = None
    ) -> list[tuple[Float64Array, Float64Array]]:
        """Return the derivatives of q (9, M) and p (3, M) by clock offset and drift."""
        axes = self.hinge.first if axes is None else axes
        turned = np.kron(axes.T, self.hinge.second.T)
        return [(turned @ change[:9], axes.T @ change[9:]) for change in poses.by_clock]

    def exact(self, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
        """Return the relative poses of the hinge at the angles of the samples."""
        psi = constraints(self.hinge, poses).psi
        c, s, zero = np.cos(psi), np.sin(psi), np.zeros_like(psi)
        turn = np.stack((c, -s, zero, s, c, zero, zero, zero, zero + 1), axis=-1).reshape(-1, 3, 3)
        Q = self.hinge.first @ turn @ self.hinge.second.T
        return Q, self.hinge.u1 - Q @ self.hinge.u2

    def bias(self, poses: RelativePoses, share: float | None = None) -> Float64Array:
        """Return the bias of the parameters, if body 1 has this share in the variance of the attitudes; None: that by
        which residuals are whitened.
        """
        reach = max(float(np.sqrt((poses.p**2).sum() / poses.samples)), 1e-300)
        size = np.sqrt(self.noise.attitude) + np.sqrt(self.noise.place) / reach
        if np.sqrt(poses.samples) * size < 0.1:  # in standard deviations
            return np.zeros(self.parameters)
        place, attitude, known = poses.noise * np.array(((self.noise.place,), (self.noise.attitude,), (1.0,)))
        part = known if share is None else np.full_like(known, share)
        return noise_bias(self, poses, np.stack((place, attitude * part, attitude * (1 - part))))

    def doubt(self, poses: RelativePoses) -> Float64Array:
        """Return the standard deviation of the parameters, all off alike (9,), if the share of body 1 in the noise of
        attitudes is not known.
        """
        # The variance of a number between 0 and 1 is 1/12.
        return np.asarray((self.bias(poses, 1.0) - self.bias(poses, 0.0)) / np.sqrt(12))

    def results(self, gauge: str) -> Results:
        """Return u1, u2, n and home."""
        return self.hinge.results(gauge)

    def psi(self, poses: RelativePoses) -> Float64Array:
        """Return the hinge angles [rad] (N,), with jumps by 2 pi."""
        return constraints(self.hinge, poses).psi - home_angle(self.hinge, home_of(self.hinge))

    def psi_derivatives(self, poses: RelativePoses) -> Float64Array:
        """Return the derivatives of psi by the parameters and the clock; (k, N)."""

        def zero(step: Float64Array) -> Float64Array:
            moved = self.hinge.moved(step)
            return np.asarray(np.exp(1j * home_angle(moved, home_of(moved))))

        # The axes shift all angles alike, and levers none.
        by_axes = -(slopes(zero, self.parameters) / zero(np.zeros(self.parameters))).imag
        q = constraints(self.hinge, poses).q
        c, s = q[0] + q[4], q[3] - q[1]
        by_clock = [
            (c * (dq[3] - dq[1]) - s * (dq[0] + dq[4])) / np.maximum(c * c + s * s, 1e-12)
            for dq, _ in self.clock_derivatives(poses)
        ]
        return np.stack((*np.broadcast_to(by_axes[:, None], (self.parameters, poses.samples)), *by_clock))

    def psi_variances(self, poses: RelativePoses, _doubt: Float64Array, /) -> Float64Array:
        """Return the variances of psi [rad^2] by the noise of each sample; (N,)."""
        return np.asarray(self.noise.attitude * poses.noise[1])

    def gap_and_tilt(self, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
        """Return the gap [m], in axes along the hinge, and the angle between the axes [rad]; (3, N) and (N,)."""
        seen = constraints(self.hinge, poses)
        return seen.gap, np.arctan2(np.hypot(seen.q[2], seen.q[5]), seen.q[8])


class _Whitener:
    """Divides residuals of M samples, or their derivatives, by the Cholesky factor of their covariance."""

    def __init__(self, seen: Constraints, poses: RelativePoses, noise: Noise) -> None:
        place, attitude, share = poses.noise
        a, s = noise.place * place, noise.attitude * attitude
        b, c = s * share * (1 - share), s / 4
        (p, q, r), (x, y, _) = seen.p, seen.arms
        # w = (-y, x, 0); no eigenvalue of the covariance is below a.
        xy, zx, yz = -b * p * q - c * x * y, -b * r * p, -b * q * r
        self._l1 = np.sqrt(a + b * (q * q + r * r) + c * y * y)
        self._l2, self._l3 = xy / self._l1, zx / self._l1
        self._m2 = np.sqrt(np.maximum(a + b * (r * r + p * p) + c * x * x - self._l2**2, a))
        self._m3 = (yz - self._l2 * self._l3) / self._m2
        self._n3 = np.sqrt(np.maximum(a + b * (p * p + q * q) - self._l3**2 - self._m3**2, a))
        self._tilt = np.sqrt(s)

    def __call__(self, tilts: Float64Array, free_gaps: Float64Array) -> Float64Array:
        """Return the whitened rows (k, 5, M) of tilts (k, 2, M) and of gaps without their part (k, 3, M)."""
        rows = np.empty((tilts.shape[0], 5, tilts.shape[2]))
        rows[:, :2] = tilts / self._tilt
        rows[:, 2] = free_gaps[:, 0] / self._l1
        rows[:, 3] = (free_gaps[:, 1] - self._l2 * rows[:, 2]) / self._m2
        rows[:, 4] = (free_gaps[:, 2] - self._l3 * rows[:, 2] - self._m3 * rows[:, 3]) / self._n3
        return rows


def _noise_by_medians(seen: Constraints, poses: RelativePoses) -> Noise:
    """Return the noise by medians of squared residuals, at least that of rounding."""
    place, scale, share = poses.noise
    tilt, gap = (seen.tilt**2).sum(axis=0) / scale, (seen.free_gap(seen.tilt, seen.gap) ** 2).sum(axis=0) / place
    attitude = max(median_variance(tilt, 2), _ROUNDING**2)
    # The variance of positions is what the gaps show beyond the effect of the attitudes.
    by_attitude = scale * (2 * share * (1 - share) * (seen.p**2).sum(axis=0) + (seen.arms[:2] ** 2).sum(axis=0) / 4)
    across = median_variance(gap, 3)
    variance = max(across - attitude * float((by_attitude / place).mean()) / 3, _LEAST_NOISE * across)
    return Noise(max(variance, (_ROUNDING * poses.size) ** 2, 1e-300), attitude)


def _most_likely_noise(poses: RelativePoses, hinge: Hinge, start: Noise) -> Noise:
    """Return the variance of attitudes that the tilts show, and the most likely one of positions beside it."""
    seen = constraints(hinge, poses)
    place, scale, share = poses.noise
    free = max(1 - BodyModel.parameters / (BodyModel.components * poses.samples), 0.1)
    attitude = max(float(((seen.tilt**2) / scale).mean()) / free, _ROUNDING**2)
    w = np.stack((-seen.arms[1], seen.arms[0], np.zeros_like(place)), axis=-1)
    p, b = seen.p.T, (share * (1 - share))[:, None, None]
    matrix = b * ((p * p).sum(axis=1)[:, None, None] * np.eye(3) - p[:, :, None] * p[:, None])
    # In these eigenvectors the parts of a gap are independent.
    values, axes = np.linalg.eigh(matrix + w[:, :, None] * w[:, None] / 4)
    squares = np.einsum("nij,in->nj", axes, seen.free_gap(seen.tilt, seen.gap)) ** 2 / place[:, None] / free
    by_attitude = attitude * (scale / place)[:, None] * np.maximum(values, 0.0)
    least, variance = max(_LEAST_NOISE * squares.mean(), (_ROUNDING * poses.size) ** 2, 1e-300), start.place
    for _ in range(25):  # Fisher scoring
        weights = (variance + by_attitude) ** -2.0
        before, variance = variance, max(float((weights * (squares - by_attitude)).sum() / weights.sum()), least)
        if abs(variance / before - 1) < 1e-3:
            break
    return Noise(variance, attitude)
