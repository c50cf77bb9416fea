"""Two clocks: relative poses for any offset between the clock of body 2 and that of body 1.

Each sample of body 2 is moved along its own smoothed motion, from the instant at which it was recorded to that of the
sample of body 1, so that its noise stays what it is. Interpolation would average the noise of neighbours, and so
prefer offsets of half a step. The derivatives by the offset come from the smoothed motion too: at its own sample a
derivative has no part of that sample's noise, so that the estimate is not biased.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hingepair.measured.hinge import Hinge
from hingepair.measured.likelihood import Loss, seen_from
from hingepair.measured.relative_poses import RelativePoses, closed_form, compute_relative_poses
from hingepair.measured.samples import Samples
from hingepair.measured.smooth import smoothed_arrays
from hingepair.measured.spline import FEWEST
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.numeric.instants import split_at_gaps
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations
from hingepair.rotations.matrices import rotation_exp, skew

_MAX_SHIFT = 0.75  # of the usual step: the longest time over which a sample is moved along the smoothed motion
_MAX_GAP = 0.05  # [s] without a sample of body 2 that its smoothed motion bridges
_SCANNED_SAMPLES = 256  # samples that offsets are tried with
_MAX_SCANNED_OFFSET, _MAX_SCANNED_SHARE = 0.5, 0.25  # [s], and in parts of the recording
_SCAN_STEP = 0.1  # of the time in which body 2's motion changes
_MAX_OFFSET_TRIALS = 60  # offsets that are tried, on either side of 0
_MIN_MENTIONED_OFFSET = 0.05  # of the usual step
_MIN_GAIN = (
    0.5  # in the logarithm of the likelihood of a sample, by which a far offset must be better than a near one
)


class ClockedPoses:
    """Relative poses by clock offset: by how much later body 2 was recorded than body 1 at equal stamps."""

    def __init__(self, samples: Samples, loss: Loss | None) -> None:
        """Smooth the motion of body 2."""
        self._samples, self._t = samples, np.asarray(samples.t)
        self._rows = np.flatnonzero(samples.known1)
        t, known2 = self._t, samples.known2
        hidden = ~known2
        R2, S2 = (array.astype(np.float64) for array in (samples.R2, samples.S2))
        R2[hidden], S2[hidden] = np.nan, np.nan
        arrays, parts = smoothed_arrays(t, R2, S2, None, _MAX_GAP, loss)
        self._rates = np.stack([np.nan_to_num(arrays[name]) for name in ("v", "omega", "a", "alpha")])
        self._smooth: NDArray[np.bool_] = np.asarray(np.isfinite(arrays["a"] + arrays["alpha"]).all(axis=1))
        self._rate_noise = parts["R"].errors[1], parts["S"].errors[1]
        self._step = float(np.median(np.diff(t)))

    @staticmethod
    def possible(t: Float64Array, known2: NDArray[np.bool_]) -> bool:
        """Return whether there are enough samples of body 2 in a row to smooth it."""
        return bool(split_at_gaps(t, known2, _MAX_GAP, FEWEST))

    def rows(self, offset: float, most: int | None = None) -> NDArray[np.intp]:
        """Return which samples of body 1 have a sample of body 2 at the same time."""
        return self._matched(offset, most)[0]

    def _matched(self, offset: float, most: int | None) -> tuple[NDArray[np.intp], NDArray[np.intp], Float64Array]:
        """Return samples of body 1, those of body 2 nearest in time, and how much later they are needed [s]."""
        rows = self._rows[:: 1 if most is None else -(-self._rows.size // most)]
        instants = self._t[rows] - offset
        after = np.clip(np.searchsorted(self._t, instants), 1, self._t.size - 1)
        near = after - (instants - self._t[after - 1] < self._t[after] - instants)
        shift = instants - self._t[near]
        movable = self._smooth[near] & (np.abs(shift) <= _MAX_SHIFT * self._step)
        kept = self._samples.known2[near] & (movable | (shift == 0))
        return rows[kept], near[kept], shift[kept]

    def at(self, offset: float, most: int | None = None) -> RelativePoses:
        """Return relative poses at a clock offset, with their derivatives by it, of so many samples at most."""
        rows, near, shift = self._matched(offset, most)
        v, omega, a, alpha = self._rates[:, near]
        dt = shift[:, None]
        return self._poses(rows, *self._moved(near, shift), v + a * dt, omega + alpha * dt)

    def _moved(self, near: NDArray[np.intp], shift: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return R and S of samples of body 2 that are moved along its motion by some time [s]."""
        v, omega, a, alpha = self._rates[:, near]
        dt = shift[:, None]
        turn = np.asarray(rotation_exp((omega + alpha * (dt / 2)) * dt))
        return self._samples.R2[near] + (v + a * (dt / 2)) * dt, turn @ self._samples.S2[near]

    def body2(self, offset: float) -> BodyMotion:
        """Return body 2 at the instants of body 1, NaN where it was not recorded."""
        rows, near, shift = self._matched(offset, None)
        R, S = np.full((self._t.size, 3), np.nan), np.full((self._t.size, 3, 3), np.nan)
        R[rows], S[rows] = self._moved(near, shift)
        return motion_of_rotations(R=read_only(R), S=read_only(S))

    def noise_at(self, offset: float, most: int | None = None) -> RelativePoses:
        """Return relative poses whose derivatives are as large as the noise that smoothing leaves in them."""
        rows, near, _ = self._matched(offset, most)
        rng = np.random.default_rng(0)
        v, omega = (size * rng.standard_normal((rows.size, 3)) for size in self._rate_noise)
        return self._poses(rows, self._samples.R2[near], self._samples.S2[near], v, omega)

    def _poses(
        self,
        rows: NDArray[np.intp],
        R2: NDArray[np.floating],
        S2: NDArray[np.floating],
        v: Float64Array,
        omega: Float64Array,
    ) -> RelativePoses:
        """Return the relative poses of some samples, with the velocities of body 1 turned into its own axes."""
        own = self._samples
        S1 = own.S1[rows]
        poses = compute_relative_poses(own.R1[rows], S1, R2, S2, own.weights[rows])
        v1, omega1 = (np.einsum("nji,nj->ni", S1, vector) for vector in (v, omega))
        dQ = -np.asarray(skew(omega1)) @ poses.Q.T.reshape(-1, 3, 3)
        return poses._replace(
            rates=np.concatenate((dQ.reshape(-1, 9).T, -v1.T)),
            told=None if own.told is None else own.told[:, rows],
            encoder=None if own.encoder is None else own.encoder[rows],
        )

    def offset_suspicions(self, offset: float) -> list[str]:
        """Return a sentence on an offset that is more than a small part of the time between samples."""
        if abs(offset) < _MIN_MENTIONED_OFFSET * self._step:
            return []
        order = "later" if offset > 0 else "earlier"
        return [f"Body 2 was recorded {1e3 * abs(offset):.3g} ms {order} than its stamps say; this is taken out."]

    @property
    def time_scale(self) -> float:
        """Return the time in which the motion of body 2 changes: the ratio of its rates to their changes [s]."""
        v, omega, a, alpha = (float(np.sqrt(np.median((rate**2).sum(axis=1)))) for rate in self._rates)
        scales = [rate / change for rate, change in ((v, a), (omega, alpha)) if rate > 0 and change > 0]
        return min(scales, default=1.0)

    def likeliest(self, misfit: Callable[[RelativePoses], float]) -> float:
        """Return the offset to start from [s]: the best of a scan, or that near 0 unless a far one is clearly better.

        Args:
            misfit: minus the logarithm of the likelihood of a sample of the poses at an offset.
        """
        length = float(self._t[-1] - self._t[0])
        span = min(max(_MAX_SCANNED_OFFSET, 10 * self._step), _MAX_SCANNED_SHARE * length)
        count = int(np.clip(np.ceil(span / max(_SCAN_STEP * self.time_scale, self._step / 2)), 2, _MAX_OFFSET_TRIALS))
        offsets = np.linspace(-span, span, 2 * count + 1)
        trials = [self.at(offset, _SCANNED_SAMPLES) for offset in offsets]
        costs = np.array([np.inf if poses.samples < FEWEST else misfit(poses) for poses in trials])
        place = count
        while True:
            near = [k for k in (place - 1, place, place + 1) if 0 <= k < costs.size]
            best = min(near, key=lambda k: (costs[k], abs(k - place)))
            if best == place:
                break
            place = best
        far = int(np.argmin(costs))
        return float(offsets[far if costs[far] < costs[place] - _MIN_GAIN else place])


def hinge_misfit(poses: RelativePoses, start: Hinge | None) -> float:
    """Return how badly a hinge fits poses: minus the logarithm of the likelihood of a sample.

    A hinge `start` is judged by medians; without one the poses get their own hinge in closed form.
    """
    hinge = closed_form(poses) if start is None else start
    seen = [seen for _, seen in seen_from(poses, hinge)]
    tilt, gap = (
        np.concatenate([(getattr(each, name) ** 2).sum(axis=0) for each in seen]) for name in ("tilt", "gap")
    )
    middle = np.mean if start is None else np.median
    return float(np.log(middle(tilt) + 1e-30) + 1.5 * np.log(middle(gap) + 1e-30 * poses.size**2))
