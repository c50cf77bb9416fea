"""Findings on a fitted hinge: what the motion does not show, and why it does not agree with a hinge."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.measured.findings import (
    RANDOM_CORRELATION,
    Finding,
    exceeded,
    few_samples_finding,
    is_reliable,
    memory_finding,
)
from hingepair.measured.hinge import result_derivatives
from hingepair.measured.hinge_model import PointModel, constraints
from hingepair.measured.most_likely import Estimate, evaluate, psi_derivatives
from hingepair.measured.relative_poses import RelativePoses, closed_form_hinge, compute_relative_poses
from hingepair.measured.statistics import OUTLIER, Loss, every_kth, median_variance, neighbour_correlation
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import (
    matrix_to_quaternion,
    project_to_rotation,
    quaternion_to_matrix,
    rotation_vector,
)
from hingepair.tables.sheets import percent

_RELIABLE_AXIS = np.radians(2.0)  # [rad]: an axis that is known less well is not to be relied on
_RELIABLE_POINT = 0.1  # likewise of the hinge point, in parts of the levers
# Rms play that is not random, in parts of the levers, or of a circle's radius: of more it is no hinge, of less none.
_MAX_PLAY, _LEAST_PLAY = 0.02, 0.005
_SOME_SAMPLES = 2048  # that tell whether the bodies turn, and what other joint they have
_FEW = 10  # samples, from which standard deviations hold
_ROUNDING = 1e-12  # rad, and parts of the size of the places; smaller residuals are rounding
_SHIFT_ERROR = 1e-6  # likewise where samples were moved in time, in parts of the radius


def check_turning(poses: RelativePoses) -> None:
    """Raise FitError if body 2 does not turn relative to body 1, or no more than by noise."""
    thin = poses.thinned(_SOME_SAMPLES)
    Q = thin.attitudes
    mean = np.median(Q, axis=0)
    if np.linalg.det(mean) < 0.1:
        return
    off = rotation_vector(np.asarray(project_to_rotation(mean), dtype=np.float64).T @ Q)
    size = np.sqrt((off * off).sum(axis=-1))
    near = off[size <= 4 * np.median(size)]
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(near.T @ near / near.shape[0]), 0.0))[::-1]
    # Below 0.05 rad, noise and motion are told apart by whether attitudes scatter about one axis alone.
    if spread[0] >= 0.05 or (spread[0] >= 2.0 * spread[1] and spread[0] > 1e-12):
        return
    p = thin.p
    slide = float(np.sqrt(np.median(((p - np.median(p, axis=1, keepdims=True)) ** 2).sum(axis=0))))
    beside = f", and it slides by {slide:.2g} m: a sliding joint" if slide > 20 * spread[0] * _rms_length(p) else ""
    about = " about any axis" if beside else ", about one axis no more than about others: a fixed pair"
    raise FitError(
        "body1, body2",
        "bodies that turn against each other about one axis",
        f"relative attitudes that scatter by {np.degrees(spread[0]):.2g} deg{about}{beside}",
    )


class Fitted:
    """A most likely model without its bias, by the rules of the user, and what it leaves of N samples.

    Args:
        estimate: the most likely model.
        poses: of all samples that are used, at its clock.
        loss: as of `fit`, and likewise `gauge`.
        gauge: rule for the hinge point.
        knows_split: whether it is known to which body the noise of attitudes belongs.
    """

    def __init__(
        self, estimate: Estimate, poses: RelativePoses, loss: Loss | None, gauge: str, knows_split: bool
    ) -> None:
        self.model: Any = estimate.model.moved(-estimate.model.bias(poses)).settled(gauge)
        self.poses, self.has_converged = poses, estimate.has_converged
        self.seen = evaluate(self.model, poses, estimate.clock, loss)
        # In axes along the hinge, or out of the plane and off the circle [m], (3, N) or (2, N); and [rad], (N,).
        self.gap, self.tilt = self.model.gap_and_tilt(poses)
        self.psi: Float64Array = self.model.psi(poses)  # with jumps by 2 pi [rad]; (N,)
        u1, u2, n, home = self.model.results(gauge)
        self.pair = HingePair(u1=u1, u2=u2, n=n, home=home)
        # Samples over which scores are still correlated at the longest sums, 0 where they are not.
        random, self.unresolved_lag = self.seen.covariance
        k = self.model.parameters
        doubt = np.zeros(len(random))
        if not knows_split:
            doubt[:k] = self.model.doubt(poses)
        whole = random + np.outer(doubt, doubt)
        change = result_derivatives(lambda step: self.model.moved(step).results(gauge), k)
        # Of u1, u2, n and home (12, 12): if the parts of the noise are known, and as it is.
        self.random_covariance, self.covariance = (change @ each[:k, :k] @ change.T for each in (random, whole))
        self.clock_std = np.sqrt(np.diagonal(whole)[k:])  # of offset and drift, or (0,) where they were not sought
        by_unknowns = psi_derivatives(self.model, poses)
        variances = self.model.psi_variances(poses, doubt) + (by_unknowns * (whole @ by_unknowns)).sum(axis=0)
        self.psi_std = np.sqrt(np.maximum(variances, 0.0))  # [rad]; (N,)

    @property
    def shares(self) -> Float64Array:
        """Weights of the samples by the loss, which add up to 1; (N,)."""
        return np.asarray(self.seen.weights / self.seen.weights.sum())

    @property
    def reach(self) -> float:
        """Length of the levers [m]."""
        return max(float(np.linalg.norm(lever)) for lever in (self.pair.u1, self.pair.u2))

    def correlation(self, part: slice) -> float:
        """Return the correlation of some whitened residuals with those of the next sample."""
        return neighbour_correlation(self.seen.weights * self.seen.whitened[part])

    def is_rounding(self) -> NDArray[np.bool_]:
        """Return whether rounding, or the moving of samples in time, explains the residuals of each sample (N,)."""
        largest = np.maximum(np.abs(self.gap).max(axis=0) / self.poses.size, np.nan_to_num(self.tilt))
        return np.asarray(largest < (_SHIFT_ERROR if len(self.poses.by_clock) else _ROUNDING))

    def is_outlier(self) -> NDArray[np.bool_]:
        """Return which samples have far larger residuals than most; none if residuals are not random."""
        squares = self.seen.squares
        far = squares > OUTLIER * max(median_variance(squares, self.model.components), 1e-300)
        far &= not self.is_rounding()[far].all()
        tilts, gaps = (slice(2), slice(2, None)) if self.model.components > 2 else (slice(1), slice(1, None))
        is_random = max(self.correlation(tilts), self.correlation(gaps)) <= RANDOM_CORRELATION
        return far & is_random


def judged(fitted: Fitted) -> list[Finding]:
    """Return findings on a fit, the serious ones first."""
    judge = _judge_circle if isinstance(fitted.model, PointModel) else _judge_hinge
    findings = judge(fitted)
    if not fitted.has_converged and is_reliable(findings):
        findings.append(Finding("steps", 1, 0, "The steps of the fit did not come to rest."))
    if not fitted.is_rounding().all():
        findings += exceeded(few_samples_finding(fitted.poses.samples, _FEW))
    return sorted(findings + _split_findings(fitted), key=lambda finding: finding.is_note)


def _judge_hinge(fitted: Fitted) -> list[Finding]:
    """Return findings on the hinge of two bodies."""
    # Serious outliers, or a serious tilt, explain whatever else is seen.
    findings = _outlier_findings(fitted)
    if not is_reliable(findings):
        return findings
    findings += _axis_findings(fitted)
    if not is_reliable(findings):
        return findings
    findings += _point_findings(fitted)
    if float(fitted.tilt.max()) < _ROUNDING < np.abs(fitted.gap).max() / fitted.poses.size:
        text = (
            "The bodies turn about the axis alone, as in recordings in the plane: the attitudes do not tell their "
            "noise, nor the standard deviation of psi."
        )
        findings.append(Finding("plane", 1, 0, text, harmless=True))
    lag = 0 if fitted.is_rounding().all() else fitted.unresolved_lag
    reach = max(fitted.reach, _rms_length(fitted.poses.p))
    return (
        findings
        + _certainty_findings(fitted, reach, "bodies turn further, or longer", ", across the axis")
        + exceeded(memory_finding(lag, "the samples"))
    )


def _certainty_findings(fitted: Fitted, reach: float, advice: str, where: str = "") -> list[Finding]:
    """Return findings if axis or point are known poorly; `reach` [m] is the length of the levers."""
    std = np.sqrt(np.diagonal(fitted.covariance))
    axis, point = float(np.sqrt((std[6:9] ** 2).sum() / 2)), float(std[:6].max())
    axis_text = f"The axis is known to {np.degrees(axis):.2g} deg only: let the {advice}."
    point_text = f"The hinge point is known to {point:.2g} m only{where}: let the {advice}."
    return exceeded(
        Finding("axis", axis, _RELIABLE_AXIS, axis_text),
        Finding("point", point, _RELIABLE_POINT * reach, point_text),
    )


def _outlier_findings(fitted: Fitted) -> list[Finding]:
    """Return a finding on the share of outliers, harmless if they count little, or if their squared residuals have
    less than half of the sum of all.
    """
    is_outlier, weights, squares = fitted.is_outlier(), fitted.seen.weights, fitted.seen.squares
    if not is_outlier.any():
        return []
    share = f"{percent(is_outlier.mean())} of the samples are outliers"
    if weights[is_outlier].mean() < 0.5 * weights.mean():
        return [Finding("outliers", is_outlier.mean(), 0, f"{share}; they count little.", harmless=True)]
    harmless = fitted.model.components > 2 and bool(squares[is_outlier].sum() < squares[~is_outlier].sum())
    text = f'{share}, and count like the others: loss="cauchy" makes them count little.'
    return [Finding("outliers", is_outlier.mean(), 0, text, harmless=harmless)]


def _judge_circle(fitted: Fitted) -> list[Finding]:
    """Return findings on the hinge of a body and a point: residuals that are not at random, and certainty."""
    findings, radius = _outlier_findings(fitted), fitted.model.radius
    ways = (
        ("The point leaves the plane of the circle", "a point that slides along the axis, or an axis that tilts"),
        ("The point leaves the circle", "a point whose distance from the axis changes"),
    )
    correlations = [fitted.correlation(slice(k, k + 1)) for k in (0, 1)]
    for correlation, square, (what, why) in zip(correlations, fitted.gap**2 @ fitted.shares, ways, strict=True):
        if correlation > RANDOM_CORRELATION:
            findings += _play_findings(what, float(np.sqrt(square)), radius, "radius", why)
    findings += _certainty_findings(fitted, fitted.reach, "point turn further")
    if max(correlations) <= RANDOM_CORRELATION:  # hardly an arc explains all else
        p = fitted.poses.p.T[(fitted.seen.weights > 0) & ~fitted.is_outlier()]
        widths = np.linalg.svd(p - p.mean(axis=0), compute_uv=False) / np.sqrt(p.shape[0])
        covariance, _ = fitted.seen.covariance
        what = "straight within" if covariance[5, 5] > (radius / 3) ** 2 else "hardly an arc beside"
        text = f"The path of the point is {what} its noise, {widths[2]:.2g} m: let the point turn further."
        findings = exceeded(Finding("arc", widths[2], widths[1] / 3, text)) or findings
    return findings


def _play_findings(what: str, rms: float, reach: float, parts: str, why: str) -> list[Finding]:
    """Return a finding on a hinge that moves by so much [m] beside `reach` [m]: it is none, or has play."""
    is_play = not rms >= _MAX_PLAY * reach
    limit = (_LEAST_PLAY if is_play else _MAX_PLAY) * reach
    text = f"{what} by {rms:.2g} m rms, {percent(rms / reach)} of the {parts}, and not at random: "
    text += "the fit is that of the mean." if is_play else f"no hinge, but {why}."
    return exceeded(Finding("play", rms, limit, text, harmless=is_play))


def _split_findings(fitted: Fitted) -> list[Finding]:
    """Return a finding if u1 and u2 are far less certain since it is not known to which body the noise of the
    attitudes belongs.
    """
    random, whole = fitted.random_covariance, fitted.covariance
    added = np.sqrt(np.maximum(np.diagonal(whole - random), 0.0))[:6]
    if not (added > np.maximum(0.5 * np.sqrt(np.diagonal(random))[:6], 1e-12)).any():
        return []
    how = f"u1 and u2 depend by {added.max():.2g} m on how the noise of the attitudes {fitted.model.unknown_split}."
    return [Finding("split", added.max(), 0, how, harmless=True)]


def _axis_findings(fitted: Fitted) -> list[Finding]:
    """Return a finding if the axes of the bodies tilt against each other."""
    turning = _angle_scatter(fitted.psi, fitted.shares)  # [rad]
    tilt = float(np.sqrt(fitted.shares @ fitted.tilt**2))
    degrees = f"{np.degrees(tilt):.2g} deg rms"
    is_systematic = fitted.correlation(slice(2)) > RANDOM_CORRELATION
    if tilt < 0.03 * turning or tilt < 1e-9:
        return []
    if not is_systematic and tilt < 0.2:
        text = f"They turn by {np.degrees(turning):.2g} deg rms, little relative to attitude errors of {degrees}."
        return exceeded(Finding("tilt", tilt, 0.2 * turning, text))
    if tilt < 0.1 * turning:
        share = f"{percent(tilt / turning)} of the turning, and not at random"
        text = f"The axes tilt against each other by {degrees}, {share}: n is their mean."
        return [Finding("tilt", tilt, 0.03 * turning, text, harmless=True)]
    return [Finding("tilt", tilt, 0.1 * turning, _other_joint_sentence(fitted.poses, tilt, degrees))]


def _other_joint_sentence(poses: RelativePoses, tilt: float, tilt_text: str) -> str:
    """Say which joint the poses show instead of a hinge: two hinges in series, a ball joint, or neither."""
    thin = poses.thinned(_SOME_SAMPLES)
    vectors = np.linalg.eigh(np.cov(thin.Q))
    left, sizes, right = np.linalg.svd(vectors.eigenvectors[:, 0].reshape(3, 3))
    axes_residual = float(np.sqrt(max(vectors.eigenvalues[0], 0.0)))
    no_hinge = f"They do not turn about one axis: it tilts by {tilt_text}"
    if axes_residual < 0.2 * tilt and sizes[1] < 0.3:
        a, b = (", ".join(f"{c:.3g}" for c in axis) for axis in (left[:, 0], right[0]))
        return (
            f"{no_hinge}. Two hinges one after the other would do, about ({a}) in body 1 and ({b}) in body 2: "
            f"that leaves {np.degrees(axes_residual):.2g} deg."
        )
    off = _common_point_distance(thin)
    if off < 0.1 * _rms_length(thin.p):
        return f"{no_hinge}. A ball joint: one point stays in both bodies to {off:.2g} m rms."
    return f"{no_hinge}, and no point stays in both bodies either."


def _common_point_distance(poses: RelativePoses) -> float:
    """Return the rms distance [m] between a point of body 1 and one of body 2, of the two that stay closest."""
    Q = poses.attitudes
    rows = np.concatenate((np.broadcast_to(np.eye(3), Q.shape), -Q), axis=-1).reshape(-1, 6)
    p = poses.p.T.ravel()
    gaps = rows @ np.linalg.lstsq(rows, p)[0] - p
    return float(np.sqrt(3 * (gaps @ gaps) / gaps.size))


def _point_findings(fitted: Fitted) -> list[Finding]:
    """Return a finding if the hinge point moves in the bodies."""
    poses, reach = fitted.poses, max(fitted.reach, _rms_length(fitted.poses.p))
    x, y, z = (fitted.gap**2 @ fitted.shares).tolist()
    across, along = (x + y) / 2, z
    attitude = fitted.model.noise.attitude / 2 * float(fitted.shares @ (poses.p**2).sum(axis=0)) / 3
    size = float(np.sqrt(x + y + z))
    is_systematic = fitted.correlation(slice(2, None)) > RANDOM_CORRELATION
    if size < 1e-9 * poses.size or not (is_systematic or size > 0.1 * reach):
        return []
    if along > 9 * across:
        what, why, size = "Body 2 slides along the axis", "a sliding hinge, or a screw", float(np.sqrt(along))
    elif across - along > 4 * (along + attitude):
        what, why = "The axis moves sideways", "two parallel hinges one after the other, or an axis that wanders"
    elif is_systematic:
        what, why = "The hinge point moves", "bodies that no point joins"
    else:
        text = f"The hinge point is off by {size:.2g} m rms at random: noise that is large relative to the levers."
        return exceeded(Finding("play", size, 0.1 * reach, text))
    return _play_findings(what, size, reach, "levers", why)


def _angle_scatter(psi: Float64Array, weights: Float64Array) -> float:
    """Return the rms scatter of angles about their circular mean, 1 rad at most; the weights add up to 1."""
    mean = np.hypot(weights @ np.cos(psi), weights @ np.sin(psi))
    about = np.arctan2(weights @ np.sin(psi), weights @ np.cos(psi))
    off = np.abs(2 * np.sin((psi - about) / 2))
    return float(min(np.sqrt(weights @ (off * off)), 1.0)) if mean < 1 else 0.0


def _rms_length(p: Float64Array) -> float:
    """Return the rms length of vectors (3, N)."""
    return float(np.sqrt((p * p).sum() / max(p.shape[1], 1)))


# ---- mistakes that hide a hinge

_TRIED = 400  # samples on which mistakes are tried, at most
_Y_UP = np.array(((1.0, 0, 0), (0, 0, -1), (0, 1, 0)))
_Change = Callable[[Any], Any]


def _reread(S: Float64Array, scalar_first: bool) -> Float64Array:
    """Return the rotations meant by quaternions that were written with `scalar_first` and read the other way."""
    read = matrix_to_quaternion(S)  # w, x, y, z
    written = np.roll(read, -1, axis=-1) if scalar_first else read
    return np.asarray(quaternion_to_matrix("quat", written, scalar_first=scalar_first), dtype=np.float64)


def _mistakes() -> Iterator[tuple[str, dict[str, _Change]]]:
    """Yield common mistakes in recorded poses, in words, and what takes them back, by the names of arrays."""
    for digit in "21":
        R, S = f"R{digit}", f"S{digit}"
        yield f"body{digit}.R looks like millimetres", {R: lambda R: 1e-3 * R}
        for up, other, turn in (("y", "z", _Y_UP), ("z", "y", _Y_UP.T)):
            text = f"body{digit} looks as if {up} were up in its world and {other} in that of the other body"
            yield text, {S: turn.__matmul__, R: turn.T.__rmatmul__}
    of_attitudes: dict[str, _Change] = {
        "like rotations from world to body, the transposes": lambda S: np.swapaxes(S, -1, -2),
        "like quaternions wxyz that were read as xyzw": lambda S: _reread(S, True),
        "like quaternions xyzw that were read as wxyz": lambda S: _reread(S, False),
    }
    for digits, name in (("1", "body1.S looks"), ("2", "body2.S looks"), ("12", "body1.S and body2.S look")):
        for text, change in of_attitudes.items():
            yield f"{name} {text}", {f"S{digit}": change for digit in digits}


def probable_mistakes(arrays: dict[str, Any]) -> list[str]:
    """Return a sentence on a mistake in recorded poses (units, axes, transposes, quaternions), if a hinge fits far
    better with the mistake taken back; `arrays` are R1, S1, R2 and S2, of which none may be missing.
    """
    if len(arrays["R1"]) < 2:
        return []
    every = every_kth(len(arrays["R1"]), _TRIED)
    poses: dict[str, Any] = {name: array[every].astype(np.float64) for name, array in arrays.items()}

    def misfit(changes: dict[str, _Change]) -> float:
        """Return the median tilt [rad] of the closed form plus its median gap in parts of the bodies' distance."""
        changed = compute_relative_poses(**poses | {name: change(poses[name]) for name, change in changes.items()})
        seen = constraints(closed_form_hinge(changed), changed)
        tilt, gap = (np.sqrt(np.median((part**2).sum(axis=0))) for part in (seen.tilt, seen.gap))
        return float(tilt + gap / max(_rms_length(changed.p), 1e-300))

    as_recorded, corrected = misfit({}), [(misfit(changes), text) for text, changes in _mistakes()]
    least = min(each for each, _ in corrected)
    text = next(text for each, text in corrected if each < 1.01 * least + 1e-12)
    if least > min(0.2 * as_recorded, 0.1):
        return []
    return [f"{text}: with that taken back, a hinge fits {as_recorded / max(least, 1e-12):.2g} times as well."]
