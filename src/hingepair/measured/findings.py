"""Findings: sentences on what the numbers of a fitted hinge do not say, such as what the motion did not show."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.measured.hinge import Hinge
from hingepair.measured.likelihood import HingeResiduals, Noise, iterate_residuals
from hingepair.measured.relative_poses import RelativePoses, closed_form_hinge, compute_relative_poses
from hingepair.measured.robust import OUTLIER, median_variance
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import (
    matrix_to_quaternion,
    project_to_rotation,
    quaternion_to_matrix,
    rotation_vector,
)
from hingepair.tables.sheets import percent

RANDOM_CORRELATION = 0.5  # of neighbouring residuals; above, they are not noise
RELIABLE_AXIS = np.radians(2.0)  # [rad]: an axis that is known less well is not to be relied on
RELIABLE_POINT = 0.1  # likewise of the hinge point, in parts of the levers
MAX_PLAY = 0.02  # rms play that is not random, in parts of the levers, or of a circle's radius; above, it is no hinge
_JOINT_SAMPLES = 2048  # that tell whether the bodies turn, and what other joint they have
_JUDGED_SAMPLES = 65536  # that are judged, at most
_MISTAKE_SAMPLES = 400  # on which mistakes are tried, at most


class Finding(str):
    """A sentence of a report on a fit, with what it was judged by.

    Attributes:
        name: what was judged, such as "axis".
        value: what was found of it.
        limit: the value above which it is a finding.
        severity: "serious" if a number of the fit may be wrong by more than its standard deviations, or "note".
    """

    name: str
    value: float
    limit: float
    severity: str

    def __new__(
        cls, name: str, value: float = np.nan, limit: float = 0.0, text: str = "", *, harmless: bool = False
    ) -> Finding:
        """Make a finding of its sentence `text`; a `harmless` one is a note."""
        made = super().__new__(cls, text or name)
        made.name, made.value, made.limit = name, float(value), float(limit)
        made.severity = "note" if harmless else "serious"
        return made

    @property
    def is_note(self) -> bool:
        """Whether the fit can be relied on in spite of it."""
        return self.severity == "note"


def notes(name: str, sentences: Iterable[str]) -> list[Finding]:
    """Return sentences that leave a fit reliable as findings."""
    return [Finding(name, 1, 0, sentence, harmless=True) for sentence in sentences]


def exceeded(*findings: Finding) -> list[Finding]:
    """Return the findings whose values are above their limits, or NaN."""
    return [finding for finding in findings if not finding.value <= finding.limit]


def is_reliable(findings: Iterable[Finding]) -> bool:
    """Return whether no finding says that a number may be wrong by more than its standard deviations."""
    return all(finding.is_note for finding in findings)


def check_turning(poses: RelativePoses) -> None:
    """Raise FitError if body 2 does not turn relative to body 1, or no more than by noise."""
    thin = poses.thinned(_JOINT_SAMPLES)
    Q = thin.Q.T.reshape(-1, 3, 3)
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
    beside = f", and it slides by {slide:.2g} m: a sliding joint" if slide > 20 * spread[0] * _rms_distance(p) else ""
    about = " about any axis" if beside else ", about one axis no more than about others: a fixed pair"
    raise FitError(
        "body1, body2",
        "bodies that turn against each other about one axis",
        f"relative attitudes that scatter by {np.degrees(spread[0]):.2g} deg{about}{beside}",
    )


def judge_hinge(
    poses: RelativePoses,
    hinge: Hinge,
    noise: Noise,
    residuals: HingeResiduals,
    is_outlier: NDArray[np.bool_],
    has_converged: bool,
    std: dict[str, Float64Array],
) -> list[Finding]:
    """Return findings on a fitted hinge, the serious ones first. `std` has the standard deviations of n, u1, u2."""
    every = slice(None, None, -(-poses.samples // _JUDGED_SAMPLES))
    residuals = residuals._replace(
        **{
            name: getattr(residuals, name)[..., every]
            for name in ("tilt", "gap", "psi", "whitened_squares", "weights")
        }
    )
    poses, is_outlier = poses.thinned(_JUDGED_SAMPLES), is_outlier[every]
    turning = _angle_scatter(residuals.psi, residuals.weights / residuals.weights.sum())
    reach = max(float(np.linalg.norm(hinge.u1)), float(np.linalg.norm(hinge.u2)), _rms_distance(poses.p))
    # Serious outliers, or a serious tilt, explain whatever else is seen.
    findings = outlier_finding(is_outlier, residuals.weights, residuals.whitened_squares)
    if not is_reliable(findings):
        return findings
    findings += _axis_findings(poses, residuals, turning)
    if not is_reliable(findings):
        return findings
    axis_std, point_std = float(np.sqrt((std["n"] ** 2).sum() / 2)), max(std["u1"].max(), std["u2"].max())
    lag = 0 if _residuals_are_rounding(residuals, poses, np.ones_like(is_outlier)) else residuals.unresolved_lag
    findings += _point_findings(poses, noise, residuals, reach)
    if float(residuals.tilt.max()) < 1e-12 < np.abs(residuals.gap).max() / poses.size:
        text = (
            "The bodies turn about the axis alone, as in recordings in the plane: the attitudes do not tell their "
            "noise, nor the standard deviation of psi."
        )
        findings.append(Finding("plane", 1, 0, text, harmless=True))
    findings += exceeded(
        Finding(
            "axis",
            axis_std,
            RELIABLE_AXIS,
            f"The axis is known to {np.degrees(axis_std):.2g} deg only: let the bodies turn further, or longer.",
        ),
        Finding(
            "point",
            point_std,
            RELIABLE_POINT * reach,
            f"The hinge point is known to {point_std:.2g} m only, across the axis.",
        ),
        Finding("steps", not has_converged, 0, "The steps of the fit did not come to rest."),
        Finding(
            "memory",
            lag,
            0,
            f"What is left of the samples is correlated over {lag} samples and more, too long "
            "relative to the whole recording: the standard deviations are rough.",
            harmless=True,
        ),
    )
    return sorted(findings, key=lambda finding: finding.is_note)


def split_findings(random: Float64Array, whole: Float64Array, how: str) -> list[Finding]:
    """Return a finding if u1 and u2 are far less certain by `whole` than by `random`, covariances (12, 12) with and
    without the doubt to which body the noise of the attitudes belongs. `how` ends the sentence.
    """
    added = np.sqrt(np.maximum(np.diagonal(whole - random), 0.0))[:6]
    if not (added > np.maximum(0.5 * np.sqrt(np.diagonal(random))[:6], 1e-12)).any():
        return []
    text = f"u1 and u2 depend by {added.max():.2g} m on how the noise of the attitudes {how}."
    return [Finding("split", added.max(), 0, text, harmless=True)]


def find_outliers(residuals: HingeResiduals, poses: RelativePoses) -> NDArray[np.bool_]:
    """Return which samples (N,) have far larger residuals than most; none if residuals are not random, or rounding
    explains them.
    """
    squares = residuals.whitened_squares
    is_outlier = np.asarray(squares > OUTLIER * max(median_variance(squares, 5), 1e-300))
    if (
        not is_outlier.any()
        or max(residuals.neighbour_correlations) > RANDOM_CORRELATION
        or _residuals_are_rounding(residuals, poses, is_outlier)
    ):
        return np.zeros_like(is_outlier)
    return is_outlier


def _residuals_are_rounding(residuals: HingeResiduals, poses: RelativePoses, samples: NDArray[np.bool_]) -> bool:
    """Return whether rounding explains the residuals of the given samples (N,)."""
    largest = max(np.abs(residuals.gap[:, samples]).max() / poses.size, residuals.tilt[samples].max())
    return bool(largest < 1e-12)


def outlier_finding(
    is_outlier: NDArray[np.bool_], weights: Float64Array, squares: Float64Array | None = None
) -> list[Finding]:
    """Return a finding on the share of outliers, harmless if they count little, or if their squared residuals have
    less than half of the sum of all `squares`.
    """
    if not is_outlier.any():
        return []
    share = f"{percent(is_outlier.mean())} of the samples are outliers"
    if weights[is_outlier].mean() < 0.5 * weights.mean():
        return [Finding("outliers", is_outlier.mean(), 0, f"{share}; they count little.", harmless=True)]
    harmless = squares is not None and bool(squares[is_outlier].sum() < squares[~is_outlier].sum())
    text = f'{share}, and count like the others: loss="cauchy" makes them count little.'
    return [Finding("outliers", is_outlier.mean(), 0, text, harmless=harmless)]


def _axis_findings(poses: RelativePoses, residuals: HingeResiduals, turning: float) -> list[Finding]:
    """Return a finding if the axes of the bodies tilt against each other; psi turns by `turning` [rad rms]."""
    weights = residuals.weights / residuals.weights.sum()
    tilt = float(np.sqrt(weights @ (residuals.tilt * residuals.tilt)))
    degrees = f"{np.degrees(tilt):.2g} deg rms"
    is_systematic = residuals.neighbour_correlations[0] > RANDOM_CORRELATION
    if tilt < 0.03 * turning or tilt < 1e-9:
        return []
    if not is_systematic and tilt < 0.2:
        if tilt < 0.2 * turning:
            return []
        text = f"They turn by {np.degrees(turning):.2g} deg rms, little relative to attitude errors of {degrees}."
        return [Finding("tilt", tilt, 0.2 * turning, text)]
    if tilt < 0.1 * turning:
        share = f"{percent(tilt / turning)} of the turning, and not at random"
        text = f"The axes tilt against each other by {degrees}, {share}: n is their mean."
        return [Finding("tilt", tilt, 0.03 * turning, text, harmless=True)]
    return [Finding("tilt", tilt, 0.1 * turning, _other_joint_sentence(poses, tilt, degrees))]


def _other_joint_sentence(poses: RelativePoses, tilt: float, tilt_text: str) -> str:
    """Say which joint the poses show instead of a hinge: two hinges in series, a ball joint, or neither."""
    thin = poses.thinned(_JOINT_SAMPLES)
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
    if off < 0.1 * _rms_distance(thin.p):
        return f"{no_hinge}. A ball joint: one point stays in both bodies to {off:.2g} m rms."
    return f"{no_hinge}, and no point stays in both bodies either."


def _common_point_distance(poses: RelativePoses) -> float:
    """Return the rms distance [m] between a point of body 1 and one of body 2, of the two that stay closest."""
    Q = poses.Q.T.reshape(-1, 3, 3)
    rows = np.concatenate((np.broadcast_to(np.eye(3), Q.shape), -Q), axis=-1).reshape(-1, 6)
    p = poses.p.T.ravel()
    gaps = rows @ np.linalg.lstsq(rows, p)[0] - p
    return float(np.sqrt(3 * (gaps @ gaps) / gaps.size))


def _point_findings(poses: RelativePoses, noise: Noise, residuals: HingeResiduals, reach: float) -> list[Finding]:
    """Return a finding if the hinge point moves in the bodies; `reach` [m] is the length of the levers."""
    weights = residuals.weights / residuals.weights.sum()
    x, y, z = (float(weights @ (g * g)) for g in residuals.gap)
    across, along = (x + y) / 2, z
    attitude = noise.attitude / 2 * float(weights @ (poses.p**2).sum(axis=0)) / 3
    size = float(np.sqrt(2 * across + along))
    is_systematic = residuals.neighbour_correlations[1] > RANDOM_CORRELATION
    if size < max(1e-9 * poses.size, 0.005 * reach) or not (is_systematic or size > 0.1 * reach):
        return []
    if along > 9 * across:
        rms = np.sqrt(along)
        no_hinge = f"Body 2 slides along the axis, by {rms:.2g} m rms: a sliding hinge, or a screw."
        play = "Body 2 moves along the axis"
    elif across - along > 4 * (along + attitude):
        rms = np.sqrt(2 * across)
        no_hinge = (
            f"They turn about one direction, but no point stays: it is off by {rms:.2g} m rms across the axis. Two "
            "parallel hinges one after the other, or an axis that wanders."
        )
        play = "The axis moves sideways"
    elif is_systematic:
        rms = size
        no_hinge = f"No hinge point stays in both bodies: it is off by {rms:.2g} m rms, and not at random."
        play = "The hinge point moves"
    else:
        text = f"The hinge point is off by {size:.2g} m rms at random: noise that is large relative to the levers."
        return [Finding("play", size, 0.1 * reach, text)]
    if size >= MAX_PLAY * reach:
        return [Finding("play", size, MAX_PLAY * reach, no_hinge)]
    share = f"{percent(float(rms) / reach)} of the levers, and not at random"
    text = f"{play} by {rms:.2g} m rms, {share}: u1 and u2 name its mean place."
    return [Finding("play", size, 0.005 * reach, text, harmless=True)]


def _angle_scatter(psi: Float64Array, weights: Float64Array) -> float:
    """Return the rms scatter of angles about their circular mean, 1 rad at most; the weights add up to 1."""
    mean = np.hypot(weights @ np.cos(psi), weights @ np.sin(psi))
    about = np.arctan2(weights @ np.sin(psi), weights @ np.cos(psi))
    off = np.abs(2 * np.sin((psi - about) / 2))
    return float(min(np.sqrt(weights @ (off * off)), 1.0)) if mean < 1 else 0.0


def _rms_distance(p: Float64Array) -> float:
    """Return the rms length of vectors (3, N)."""
    return float(np.sqrt((p * p).sum() / max(p.shape[1], 1)))


class BodyPoses(NamedTuple):
    """Poses of both bodies at all samples, as the user gave them."""

    R1: NDArray[np.floating]  # shape (N, 3)
    S1: NDArray[np.floating]  # shape (N, 3, 3)
    R2: NDArray[np.floating]
    S2: NDArray[np.floating]

    def changed(self, bodies: str, letter: str, change: Callable[..., Any]) -> BodyPoses:
        """Return the poses with the array R or S (`letter`) of the bodies "1", "2" or "12" changed."""
        return self._replace(**{f"{letter}{digit}": change(getattr(self, f"{letter}{digit}")) for digit in bodies})

    def misfit(self) -> float:
        """Return how badly the closed-form hinge fits: the median tilt [rad] plus the median gap in parts of the
        distance between the bodies.
        """
        poses = compute_relative_poses(*self)
        distance = _rms_distance(poses.p)
        _, seen = next(iterate_residuals(poses, closed_form_hinge(poses)))
        tilt, gap = (np.sqrt(np.median((part**2).sum(axis=0))) for part in (seen.tilt, seen.gap))
        return float(tilt + gap / max(distance, 1e-300))


def probable_mistakes(body_poses: BodyPoses) -> list[str]:
    """Return a sentence on a mistake in recorded poses (units, axes, transposes, quaternions), if a hinge fits far
    better with the mistake corrected.
    """
    every = slice(None, None, -(-body_poses.R1.shape[0] // _MISTAKE_SAMPLES))
    poses = BodyPoses(*(array[every].astype(np.float64) for array in body_poses))
    misfit = poses.misfit()
    corrected_misfits = [(changed.misfit(), text) for text, changed in _corrected_poses(poses)]
    least_misfit, text = min(corrected_misfits)
    if least_misfit > min(0.2 * misfit, 0.1):
        return []
    return [f"{text}: with that taken back, a hinge fits {misfit / max(least_misfit, 1e-12):.2g} times as well."]


def _corrected_poses(poses: BodyPoses) -> Iterator[tuple[str, BodyPoses]]:
    """Yield each common mistake, in words, and the poses with the mistake corrected."""
    for digit in "12":
        name = f"body{digit}"
        for unit, factor in (("millimetres", 1e-3), ("centimetres", 1e-2)):
            yield f"{name}.R looks like {unit}", poses.changed(digit, "R", functools.partial(np.multiply, factor))
        for pair, order in (("y and z", [0, 2, 1]), ("x and y", [1, 0, 2]), ("x and z", [2, 1, 0])):
            swap = functools.partial(np.take, indices=order, axis=1)
            yield f"{name}.R looks as if {pair} were exchanged", poses.changed(digit, "R", swap)
        for up, other, sign in (("y", "z", 1.0), ("z", "y", -1.0)):
            turn = np.array(((1.0, 0, 0), (0, 0, -sign), (0, sign, 0)))
            turned = poses.changed(digit, "S", functools.partial(np.matmul, turn))
            yield (
                f"{name} looks as if {up} were up in its world and {other} in that of the other body",
                turned.changed(digit, "R", functools.partial(np.einsum, "ij,nj->ni", turn)),
            )
    for bodies in ("1", "2", "12"):
        names, look = " and ".join(f"body{digit}.S" for digit in bodies), "looks" if len(bodies) == 1 else "look"
        turned = poses.changed(bodies, "S", lambda S: np.swapaxes(S, -1, -2))
        yield f"{names} {look} like rotations from world to body, the transposes", turned
        for written, read in (("wxyz", "xyzw"), ("xyzw", "wxyz")):
            yield (
                f"{names} {look} like quaternions {written} that were read as {read}",
                poses.changed(
                    bodies, "S", functools.partial(_with_reordered_quaternions, scalar_first=written == "wxyz")
                ),
            )


def _with_reordered_quaternions(S: Float64Array, scalar_first: bool) -> Float64Array:
    """Return the rotations meant by quaternions that were written with `scalar_first` and read the other way."""
    read = matrix_to_quaternion(S)  # w, x, y, z
    written = np.roll(read, -1, axis=-1) if scalar_first else read
    return np.asarray(quaternion_to_matrix("quat", written, scalar_first=scalar_first), dtype=np.float64)
