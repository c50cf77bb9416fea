"""Two clocks: relative poses for any offset and drift of the clock of body 2 against that of body 1.

Each sample of body 2 is moved along its own smoothed motion, from the instant at which it was recorded to that of the
sample of body 1, so that its noise stays what it is. Interpolation would average the noise of neighbours, and so
prefer offsets of half a step. The derivatives by the clock come from the smoothed motion too: at its own sample a
derivative has no part of that sample's noise, so that the estimate is not biased.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hingepair.measured.findings import Finding
from hingepair.measured.relative_poses import RelativePoses, compute_relative_poses
from hingepair.measured.samples import Samples
from hingepair.measured.smoothing.smooth import smoothed_arrays
from hingepair.measured.smoothing.spline import MIN_PIECE
from hingepair.measured.statistics import Loss, every_kth
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.rotations.matrices import rotation_exp, skew
from hingepair.tables.instants import split_at_gaps

MAX_SHIFT = 0.75  # median time steps by which a sample of body 2 may be moved along its smoothed motion
_HELD = 0.2  # median time steps by which a clock may change and samples stay matched
_MAX_GAP = 0.05  # s without a sample of body 2 that its smoothed motion bridges
_TRIAL_SAMPLES = 256  # at most, at each trial offset
_NOISE_SAMPLES = 4096  # that tell the noise of rates, at most
_REPEATED = 0.995  # correlation of a motion with itself later, above which it repeats
_MAX_LAGS = 2**16  # samples of the search for a period


def nearest_samples(t: Float64Array, instants: Float64Array) -> NDArray[np.intp]:
    """Return the indices of the samples at instants t (N,), increasing, that are nearest to other instants (M,)."""
    after = np.clip(np.searchsorted(t, instants), 1, t.size - 1)
    return np.asarray(after - (instants - t[after - 1] < t[after] - instants))


class ClockedPoses:
    """Relative poses of two recordings by clock: the time [s] by which body 2 was recorded later than body 1 at equal
    stamps, in the middle of the recording, and its growth in a second. The motion of body 2 is smoothed once.
    """

    def __init__(self, samples: Samples, loss: Loss | None) -> None:
        """Smooth the motion of body 2."""
        self._samples, self._t = samples, np.asarray(samples.t)
        self._rows = np.flatnonzero(samples.known1)
        self._variances = samples.variances
        hidden = ~samples.known2
        R2, S2 = (array.astype(np.float64) for array in (samples.R2, samples.S2))
        R2[hidden], S2[hidden] = np.nan, np.nan
        arrays, parts = smoothed_arrays(self._t, R2, S2, None, _MAX_GAP, loss)
        self._rates = np.stack([np.nan_to_num(arrays[name]) for name in ("v", "omega", "a", "alpha")])
        self._smooth: NDArray[np.bool_] = np.asarray(np.isfinite(arrays["a"] + arrays["alpha"]).all(axis=1))
        every = every_kth(self._t.size, _NOISE_SAMPLES).step
        self._rate_noise = [float(np.nanmedian(parts[letter].deviations(1, every))) for letter in "RS"]
        self._step = float(np.median(np.diff(self._t)))
        self._since_middle = self._t - (self._t[0] + self._t[-1]) / 2
        self._matched_at = np.zeros(2)  # the clock at which samples are matched
        # Offsets on both sides of 0 that are tried [s].
        self._span = min(max(0.5, 10 * self._step), 0.25 * float(np.ptp(self._t)))

    @staticmethod
    def has_enough_samples(samples: Samples) -> bool:
        """Return whether body 2 has enough samples in a row to be smoothed."""
        return bool(split_at_gaps(np.asarray(samples.t), samples.known2, _MAX_GAP, MIN_PIECE))

    def _matched(
        self, clock: Float64Array, max_samples: int
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Float64Array]:
        """Return the indices of usable samples of body 1, thinned evenly to at most so many, of the nearest samples
        of body 2, and the times by which these were taken earlier [s].

        Small changes of the clock keep the match: halfway between samples of body 2, each change of it would bring
        the noise of other samples, and rounds of a fit would go to and fro.
        """
        change = clock - self._matched_at
        if abs(change[0]) + abs(change[1]) * self._since_middle[-1] > _HELD * self._step:
            self._matched_at = clock
        rows = self._rows[every_kth(self._rows.size, max_samples)]
        matched, instants = (
            self._t[rows] - offset - drift * self._since_middle[rows] for offset, drift in (self._matched_at, clock)
        )
        near = nearest_samples(self._t, matched)
        movable = self._smooth[near] & (np.abs(matched - self._t[near]) <= MAX_SHIFT * self._step)
        shift = instants - self._t[near]
        is_usable = self._samples.known2[near] & (movable | (shift == 0))
        return rows[is_usable], near[is_usable], shift[is_usable]

    def poses_at(self, clock: Float64Array, max_samples: int) -> RelativePoses:
        """Return the poses at a clock, with their derivatives by it, thinned evenly to at most so many samples."""
        rows, near, shift = self._matched(clock, max_samples)
        v, omega, a, alpha = self._rates[:, near]
        dt = shift[:, None]
        return self._relative_poses(rows, *self._shifted_body2(near, shift), v + a * dt, omega + alpha * dt)

    def _shifted_body2(
        self, sample_indices: NDArray[np.intp], time_shifts: Float64Array
    ) -> tuple[Float64Array, Float64Array]:
        """Return R and S of samples of body 2, each moved along the smoothed motion by its time shift [s]."""
        v, omega, a, alpha = self._rates[:, sample_indices]
        dt = time_shifts[:, None]
        turn = np.asarray(rotation_exp((omega + alpha * (dt / 2)) * dt))
        return self._samples.R2[sample_indices] + (v + a * (dt / 2)) * dt, turn @ self._samples.S2[sample_indices]

    def body2(self, clock: Float64Array) -> BodyMotion:
        """Return R and S of body 2 at the instants of body 1, NaN where it has no sample near enough."""
        rows, near, shift = self._matched(clock, self._t.size)
        R, S = np.full((self._t.size, 3), np.nan), np.full((self._t.size, 3, 3), np.nan)
        R[rows], S[rows] = self._shifted_body2(near, shift)
        return motion_of_rotations(R=read_only(R), S=read_only(S))

    def noise_poses_at(self, clock: Float64Array, max_samples: int) -> RelativePoses:
        """Return the poses at a clock, with noise (fixed seed) in place of derivatives, as large as their errors.
        They tell whether the motion determines the offset.
        """
        rows, near, _ = self._matched(clock, max_samples)
        rng = np.random.default_rng(0)
        v, omega = (size * rng.standard_normal((rows.size, 3)) for size in self._rate_noise)
        return self._relative_poses(rows, self._samples.R2[near], self._samples.S2[near], v, omega)

    def _relative_poses(
        self,
        rows: NDArray[np.intp],
        R2: NDArray[np.floating],
        S2: NDArray[np.floating],
        v: Float64Array,
        omega: Float64Array,
    ) -> RelativePoses:
        """Return the poses of body 2 at samples of body 1, with derivatives by the clock from its velocities."""
        samples = self._samples
        S1, share = samples.S1[rows], 0.5 if samples.share is None else samples.share
        poses = compute_relative_poses(samples.R1[rows], S1, R2, S2, self._variances[rows], share)
        v1, omega1 = (np.einsum("nji,nj->ni", S1, vector) for vector in (v, omega))
        dQ = -np.asarray(skew(omega1)) @ poses.attitudes
        by_offset = np.concatenate((dQ.reshape(-1, 9).T, -v1.T))
        return poses._replace(by_clock=np.stack((by_offset, by_offset * self._since_middle[rows])))

    def findings(self, clock: Float64Array, std: Float64Array) -> list[Finding]:
        """Return findings on an estimated clock with standard deviations `std`, if it differs from that of body 1, or
        may be off by a whole period of the motion.
        """
        found, (offset, drift) = [], clock.tolist()
        if abs(offset) > max(4 * std[0], 0.05 * self._step):
            order = "later" if offset > 0 else "earlier"
            text = (
                f"Body 2 was recorded {1e3 * abs(offset):.3g} ms {order} than its time stamps say; the fit corrects "
            )
            found.append(Finding("clock", offset, 0.05 * self._step, text + "this.", harmless=True))
        grown = drift * float(np.ptp(self._t))
        if abs(drift) > 4 * std[1] and abs(grown) > 0.05 * self._step:
            text = f"The clocks drift apart by {1e6 * abs(drift):.3g} us in a second; the fit corrects this."
            found.append(Finding("drift", drift, 0, text, harmless=True))
        period = self._period()
        if period is not None:
            text = (
                f"The motion repeats after {period:.3g} s, and the clock offset may be off by this: record a motion "
                "that does not repeat, or give both one clock and clock_offset=0."
            )
            # Clocks that hardly differ are more likely than clocks that differ by a long period.
            small = abs(offset) <= 0.05 * period and period > self._span
            found.append(Finding("period", abs(offset), 0.05 * period, text, harmless=small))
        return found

    def _period(self) -> float | None:
        """Return the shortest time [s] after which body 2 moves as before, from the correlation of its velocities
        with themselves; None if there is none, up to half of the recording.
        """
        from scipy.signal import correlate

        rates = self._rates[:2].transpose(1, 0, 2).reshape(self._t.size, 6)[:_MAX_LAGS]
        rates = (rates - rates.mean(axis=0)) / np.maximum(rates.std(axis=0), max(1e-3 * rates.std(), 1e-300))
        count = len(rates)
        products = sum(correlate(rate, rate, method="fft")[count - 1 :][: count // 2] for rate in rates.T)
        lags, power = np.arange(count // 2), np.concatenate(([0.0], np.cumsum((rates**2).sum(axis=1))))
        correlation = products / np.maximum(np.sqrt(power[count - lags] * (power[count] - power[lags])), 1e-300)
        later = np.flatnonzero(correlation < 0.9)  # beyond the lags of one and the same moment
        again = np.flatnonzero((correlation > _REPEATED) & (lags > later[0])) if later.size else later
        return float(again[0] * self._step) if again.size else None

    @property
    def time_scale(self) -> float:
        """Time [s] in which v or omega of body 2 changes, their median over that of a or alpha; 1 at rest."""
        v, omega, a, alpha = (float(np.sqrt(np.median((rate**2).sum(axis=1)))) for rate in self._rates)
        scales = [rate / change for rate, change in ((v, a), (omega, alpha)) if rate > 0 and change > 0]
        return min(scales, default=1.0)

    def most_likely_offset(self, misfit: Callable[[RelativePoses], float]) -> float:
        """Scan clock offsets on both sides of 0; return the local minimum of the misfit, a negative log-likelihood
        per sample, that descent from 0 reaches, or the global minimum if that is clearly smaller.
        """
        span = self._span
        count = int(np.clip(np.ceil(span / max(0.1 * self.time_scale, self._step / 2)), 2, 60))
        offsets = np.linspace(-span, span, 2 * count + 1)
        trials = [self.poses_at(np.array((offset, 0.0)), _TRIAL_SAMPLES) for offset in offsets]
        costs = np.array([np.inf if poses.samples < MIN_PIECE else misfit(poses) for poses in trials])
        # Downhill from 0.
        place = count
        while True:
            near = [k for k in (place - 1, place, place + 1) if 0 <= k < costs.size]
            best = min(near, key=lambda k: (costs[k], abs(k - place)))
            if best == place:
                break
            place = best
        far = int(np.argmin(costs))
        is_far_better = costs[far] < costs[place] - 0.5
        return float(offsets[far if is_far_better else place])
