"""Body 2 as seen from body 1, sample by sample, and the hinge that it tells in closed form.

With m = C^T n, the axis in body 2's axes, E5 says Q m = n of every relative attitude Q = S1^T S2, and E1 says
p = u1 - Q u2 of every relative place p = S1^T (R2 - R1); psi is in neither. So the two axes are the leading singular
vectors of the mean of Q - isotropic noise shrinks that mean and does not turn it - and the levers solve six linear
equations.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.measured.hinge import Hinge
from hingepair.measured.statistics import every_kth
from hingepair.numeric.arrays import Float64Array, FloatArray
from hingepair.rotations.matrices import rotation_vector

FEW_SAMPLES = 300  # for what is computed for many candidates, at most
_BLOCK = 4096  # samples that are computed at a time, which fit the caches


class RelativePoses(NamedTuple):
    """Poses of body 2 relative to body 1 over N samples, which are on the last axis."""

    Q: Float64Array  # S1^T S2, row by row; shape (9, N)
    p: Float64Array  # S1^T (R2 - R1) [m]; shape (3, N)
    size: float  # largest coordinate of either body, for what rounding leaves [m]
    variances: Float64Array  # of the noise of each sample, divided by that of a usual one; shape (N,)
    share: float  # of body 1 in the variance of attitudes
    by_clock: Float64Array  # of Q and p, by clock offset [1/s, m/s] and drift; shape (2, 12, N), (0, 12, N) if known

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.p.shape[1])

    @property
    def attitudes(self) -> Float64Array:
        """Q as matrices (N, 3, 3)."""
        return self.Q.T.reshape(-1, 3, 3)

    def part(self, rows: Any) -> RelativePoses:
        """Return some of the samples."""
        own = (np.ascontiguousarray(array[..., rows]) for array in (self.Q, self.p, self.variances, self.by_clock))
        Q, p, variances, by_clock = own
        return self._replace(Q=Q, p=p, variances=variances, by_clock=by_clock)

    def thinned(self, max_samples: int) -> RelativePoses:
        """Return every k-th sample, with the smallest k that leaves at most `max_samples`."""
        return self.part(every_kth(self.samples, max_samples)) if self.samples > max_samples else self

    def blocks(self) -> Iterator[RelativePoses]:
        """Yield all samples in blocks that fit the caches."""
        for start in range(0, self.samples, _BLOCK):
            yield self.part(slice(start, start + _BLOCK))

    def at_clock(self, change: Float64Array) -> RelativePoses:
        """Return the poses after a small change of clock offset and drift, to first order."""
        moved = np.einsum("c,ckn->kn", change, self.by_clock)
        return self._replace(Q=self.Q + moved[:9], p=self.p + moved[9:])


def compute_relative_poses(
    R1: FloatArray,
    S1: FloatArray,
    R2: FloatArray,
    S2: FloatArray,
    variances: Float64Array | None = None,
    share: float = 0.5,
) -> RelativePoses:
    """Return the poses of body 2 relative to body 1 from poses in the world, all finite."""
    count = R1.shape[0]
    first, second = (S.astype(np.float64, copy=False) for S in (S1, S2))
    Q = np.ascontiguousarray((np.swapaxes(first, 1, 2) @ second).reshape(count, 9).T)
    p = np.ascontiguousarray(np.einsum("nji,nj->ni", first, np.subtract(R2, R1, dtype=np.float64)).T)
    size = float(max(np.abs(R1).max(initial=0.0), np.abs(R2).max(initial=0.0)))
    return RelativePoses(
        Q, p, size, np.ones(count) if variances is None else variances, share, np.zeros((0, 12, count))
    )


def closed_form_hinge(poses: RelativePoses) -> Hinge:
    """Return the least-squares hinge in closed form: the axes for which `Q m - n` is least, and for them the levers
    with the least gaps (E1). The hinge point is equally far along the axis from both bodies' reference points.
    """
    weights = 1 / poses.variances
    weights /= weights.sum()
    Q = (poses.Q @ weights).reshape(3, 3)
    p = poses.p @ weights
    place2 = np.array([(poses.Q[j::3] * poses.p).sum(axis=0) @ weights for j in range(3)])
    left, _, right = np.linalg.svd(Q)
    n, m = left[:, 0], right[0]
    # (1 - Q^T Q) u2 = Q^T p - mean(Q^T p), across m: along it u2 is free.
    across = right[1:].T
    u2 = across @ np.linalg.lstsq(across.T @ (across - Q.T @ (Q @ across)), across.T @ (Q.T @ p - place2))[0]
    return Hinge.along(n, m, p + Q @ u2, u2).balanced()


def robust_closed_form_hinge(poses: RelativePoses) -> Hinge:
    """Return the hinge whose medians of tilt and gap have the least product (Rousseeuw 1984), among the closed form
    of all samples and the hinges of random pairs (fixed seed): the screw that takes one relative pose to the other.
    Up to half of the samples may be outliers.
    """
    judges, usual = poses.thinned(FEW_SAMPLES), closed_form_hinge(poses)
    pairs = _hinges_of_sample_pairs(poses, *np.random.default_rng(0).choice(poses.samples, (2, 200)))
    n, m, u1, u2 = (
        np.concatenate((one[None], others))
        for one, others in zip((usual.n, usual.m, usual.u1, usual.u2), pairs, strict=True)
    )
    Q = judges.attitudes
    tilt = np.einsum("nij,kj->kni", Q, m) - n[:, None]
    gap = u1[:, None] - judges.p.T - np.einsum("nij,kj->kni", Q, u2)
    best = int(np.argmin(np.median((tilt**2).sum(-1), axis=1) * np.median((gap**2).sum(-1), axis=1)))
    return Hinge.along(n[best], m[best], u1[best], u2[best]).balanced()


def _hinges_of_sample_pairs(
    poses: RelativePoses, first_indices: NDArray[np.intp], second_indices: NDArray[np.intp]
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return n, m, u1 and u2, each (k, 3), of the hinges that pairs of samples determine between which body 2 turns
    by a degree or more.
    """
    Q, Q_second = (poses.attitudes[rows] for rows in (first_indices, second_indices))
    turn = rotation_vector(Q_second @ np.swapaxes(Q, -1, -2))
    angle = np.linalg.norm(turn, axis=-1)
    is_turned = angle > 0.017
    Q, angle = Q[is_turned], angle[is_turned]
    n = turn[is_turned] / angle[:, None]
    p = poses.p.T[first_indices[is_turned]]
    apart = p - poses.p.T[second_indices[is_turned]]
    apart = apart - (apart * n).sum(axis=-1, keepdims=True) * n
    lever = -(apart + np.cross(n, apart) / np.tan(angle / 2)[:, None]) / 2
    back = np.swapaxes(Q, -1, -2)
    return n, (back @ n[..., None])[..., 0], p + lever, (back @ lever[..., None])[..., 0]
