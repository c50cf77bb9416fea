"""Findings: sentences on what the numbers of a fitted hinge do not say, such as what the motion did not show."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.measured.hinge import Hinge
from hingepair.measured.likelihood import Judged, Noise, seen_from
from hingepair.measured.relative_poses import RelativePoses, closed_form, compute_relative_poses
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import (
    matrix_to_quaternion,
    project_to_rotation,
    quaternion_to_matrix,
    rotation_vector,
)

_MAX_SCREENED = 2048  # samples that tell whether the bodies turn, and what other joint they have
_MAX_FINDING_SAMPLES = 65536  # samples that findings are made of
_MIN_TURNING = 0.05  # [rad]: below, noise and motion cannot be told apart by the scatter of relative attitudes
_MIN_AXIS_RATIO = 2.0  # of the turning about one axis to that about the next, where there is little of both
_MAX_CORRELATION = 0.5  # of neighbours' residuals; above, they are no noise
_OUTLIER_SIZE = 50.0  # of r^T C^-1 r, scaled so that its median is _MEDIAN_SIZE, from which a sample is an outlier
_MEDIAN_SIZE = 4.35  # median of chi-squared with 5 degrees of freedom
_RESIDUAL_ROUNDING = (
    1e-12  # residuals, in radians and in parts of the bodies' largest coordinate, that rounding explains
)
_MAX_TRIED = 400  # samples that causes are tried with
_MAX_CAUSE_RATIO, _MAX_CAUSE_MISFIT = 0.2, 0.1
"""Misfit that a cause may leave, in parts of that without it, and at all [rad, parts of the bodies' distance]."""
_MAX_PLAY = 0.02  # of the hinge point in parts of the levers' length, that is not at random and can be put up with
_MAX_AXIS_STD = np.radians(2.0)  # [rad]: an axis that is known less well is not to be relied on
_MAX_POINT_STD = 0.1  # likewise of the hinge point, in parts of the levers' length


class Finding(NamedTuple):
    """Sentence of a report on a fit, and whether the hinge can be relied on in spite of it.

    A harmless one says how large something is; any other says why there is no hinge to rely on.
    """

    text: str
    harmless: bool  # whether the hinge can be relied on in spite of it


def check_turning(poses: RelativePoses) -> None:
    """Refuse motions in which body 2 does not turn against body 1, beside the noise.

    Raises:
        FitError: says what was seen instead.
    """
    thin = poses.thinned(_MAX_SCREENED)
    Q = thin.Q.T.reshape(-1, 3, 3)
    mean = np.median(Q, axis=0)
    if np.linalg.det(mean) < 0.1:
        return
    off = rotation_vector(np.asarray(project_to_rotation(mean), dtype=np.float64).T @ Q)
    size = np.sqrt((off * off).sum(axis=-1))
    near = off[size <= 4 * np.median(size)]
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(near.T @ near / near.shape[0]), 0.0))[::-1]
    if spread[0] >= _MIN_TURNING or (spread[0] >= _MIN_AXIS_RATIO * spread[1] and spread[0] > 1e-12):
        return
    p = thin.p
    slide = float(np.sqrt(np.median(((p - np.median(p, axis=1, keepdims=True)) ** 2).sum(axis=0))))
    beside = f", and it slides by {slide:.2g} m: a sliding joint" if slide > 20 * spread[0] * _length(p) else ""
    about = " about any axis" if beside else ", about one axis no more than about others: a fixed pair"
    raise FitError(
        "body1, body2",
        "bodies that turn against each other about one axis",
        f"relative attitudes that scatter by {np.degrees(spread[0]):.2g} deg{about}{beside}",
    )


def findings(
    poses: RelativePoses,
    hinge: Hinge,
    noise: Noise,
    seen: Judged,
    far: NDArray[np.bool_],
    still: bool,
    std: dict[str, Float64Array],
) -> list[Finding]:
    """Return what the numbers of the fit do not say by themselves; `far` is what `outlying` returned."""
    every = slice(None, None, -(-poses.samples // _MAX_FINDING_SAMPLES))
    seen = seen._replace(
        **{name: getattr(seen, name)[..., every] for name in ("tilt", "gap", "psi", "sizes", "weights")}
    )
    poses, far = poses.thinned(_MAX_FINDING_SAMPLES), far[every]
    turning = _turning(seen.psi, seen.weights / seen.weights.sum())
    reach = max(float(np.linalg.norm(hinge.u1)), float(np.linalg.norm(hinge.u2)), _length(poses.p))
    outliers = _outliers(seen, poses, far)
    if any(not finding.harmless for finding in outliers):
        return outliers  # whatever else is seen is theirs
    axis = _axis(poses, seen, turning)
    if any(not finding.harmless for finding in axis):
        return [*outliers, *axis]
    found = [*outliers, *axis, *_point(poses, noise, seen, reach)]
    worst = float(np.sqrt((std["n"] ** 2).sum() / 2))
    if worst > _MAX_AXIS_STD:
        text = f"The axis is known to {np.degrees(worst):.2g} deg only: let the bodies turn further, or longer."
        found.append(Finding(text, False))
    vague = max(float(std["u1"].max()), float(std["u2"].max()))
    if vague > _MAX_POINT_STD * reach:
        found.append(Finding(f"The hinge point is known to {vague:.2g} m only, across the axis.", False))
    if not still:
        found.append(Finding("The steps of the fit did not come to rest.", False))
    if seen.unresolved_lag and not _residuals_are_rounding(seen, poses, np.ones_like(far)):
        text = (
            f"What is left of the samples is correlated over {seen.unresolved_lag} samples and more, too long beside "
            "the whole recording: the standard deviations are too small."
        )
        found.append(Finding(text, True))
    return sorted(found, key=lambda finding: finding.harmless)  # what decides the verdict comes first


def outlying(seen: Judged, poses: RelativePoses) -> NDArray[np.bool_]:
    """Return which samples are outliers: far off beside the others, at random and by more than rounding; (N,)."""
    far = _relative_sizes(seen) > _OUTLIER_SIZE
    if not far.any() or max(seen.alike) > _MAX_CORRELATION or _residuals_are_rounding(seen, poses, far):
        return np.zeros_like(far)
    return far


def _relative_sizes(seen: Judged) -> Float64Array:
    """Return r^T C^-1 r of each sample, scaled so that the median is that of noise; (N,)."""
    return seen.sizes / max(float(np.median(seen.sizes)), 1e-300) * _MEDIAN_SIZE


def _residuals_are_rounding(seen: Judged, poses: RelativePoses, samples: NDArray[np.bool_]) -> bool:
    """Return whether rounding explains what is left of some samples."""
    largest = max(np.abs(seen.gap[:, samples]).max() / poses.size, seen.tilt[samples].max())
    return bool(largest < _RESIDUAL_ROUNDING)


def _outliers(seen: Judged, poses: RelativePoses, far: NDArray[np.bool_]) -> list[Finding]:
    """Return what is to be said of outliers."""
    if not far.any():
        return []
    share = f"{100 * far.mean():.2g} % of the samples are outliers"
    if float(seen.weights[far].sum()) < 0.5 * far.sum() * poses.weights.mean():
        return [Finding(f"{share}; they count little.", True)]
    harmless = bool(seen.sizes[far].sum() < seen.sizes[~far].sum())
    return [Finding(f'{share}, and count like the others: loss="cauchy" makes them count little.', harmless)]


def _axis(poses: RelativePoses, seen: Judged, turning: float) -> list[Finding]:
    """Return what is to be said where the bodies do not turn about one axis."""
    weights = seen.weights / seen.weights.sum()
    tilt = float(np.sqrt(weights @ (seen.tilt * seen.tilt)))
    degrees = f"{np.degrees(tilt):.2g} deg rms"
    alike = seen.alike[0] > _MAX_CORRELATION
    if tilt < 0.03 * turning or tilt < 1e-9:
        return []
    if not alike and tilt < 0.2:
        if tilt < 0.2 * turning:
            return []
        text = f"They turn by {np.degrees(turning):.2g} deg rms, little beside attitudes that are off by {degrees}."
        return [Finding(text, False)]
    if tilt < 0.1 * turning:
        share = f"{100 * tilt / turning:.2g} % of the turning, and not at random"
        return [Finding(f"The axes tilt against each other by {degrees}, {share}: n is their mean.", True)]
    return [Finding(_not_one_axis(poses, tilt, degrees), False)]


def _not_one_axis(poses: RelativePoses, tilt: float, degrees: str) -> str:
    """Return what joint there is instead: two hinges in series, which leave a^T Q b constant, or a ball joint."""
    thin = poses.thinned(_MAX_SCREENED)
    vectors = np.linalg.eigh(np.cov(thin.Q))
    left, sizes, right = np.linalg.svd(vectors.eigenvectors[:, 0].reshape(3, 3))
    rest = float(np.sqrt(max(vectors.eigenvalues[0], 0.0)))
    no_hinge = f"They do not turn about one axis: it tilts by {degrees}"
    if rest < 0.2 * tilt and sizes[1] < 0.3:
        a, b = (", ".join(f"{c:.3g}" for c in axis) for axis in (left[:, 0], right[0]))
        return (
            f"{no_hinge}. Two hinges one after the other would do, about ({a}) in body 1 and ({b}) in body 2: "
            f"that leaves {np.degrees(rest):.2g} deg."
        )
    off = _off_one_point(thin)
    if off < 0.1 * _length(thin.p):
        return f"{no_hinge}. A ball joint: one point stays in both bodies to {off:.2g} m rms."
    return f"{no_hinge}, and no point stays in both bodies either."


def _off_one_point(poses: RelativePoses) -> float:
    """Return the rms distance [m] between the bodies at their best common point, whatever axes they turn about."""
    Q = poses.Q.T.reshape(-1, 3, 3)
    rows = np.concatenate((np.broadcast_to(np.eye(3), Q.shape), -Q), axis=-1).reshape(-1, 6)
    p = poses.p.T.ravel()
    rest = rows @ np.linalg.lstsq(rows, p)[0] - p
    return float(np.sqrt(3 * (rest @ rest) / rest.size))


def _point(poses: RelativePoses, noise: Noise, seen: Judged, reach: float) -> list[Finding]:
    """Return what is to be said where no point of the axis stays where it is in both bodies."""
    weights = seen.weights / seen.weights.sum()
    x, y, z = (float(weights @ (g * g)) for g in seen.gap)
    across, along = (x + y) / 2, z
    attitude = noise.attitude / 2 * float(weights @ (poses.p**2).sum(axis=0)) / 3
    size = float(np.sqrt(2 * across + along))
    alike = seen.alike[1] > _MAX_CORRELATION
    if size < max(1e-9 * poses.size, 0.005 * reach) or not (alike or size > 0.1 * reach):
        return []
    if along > 9 * across:
        kind = _Gap(
            float(np.sqrt(along)),
            "Body 2 slides along the axis, by {size:.2g} m rms: a sliding hinge, or a screw.",
            "Body 2 moves along the axis by {size:.2g} m rms",
        )
    elif across - along > 4 * (along + attitude):
        kind = _Gap(
            float(np.sqrt(2 * across)),
            "They turn about one direction, but no point stays: it is off by {size:.2g} m rms across the axis. Two "
            "parallel hinges one after the other, or an axis that wanders.",
            "The axis moves sideways by {size:.2g} m rms",
        )
    elif alike:
        kind = _Gap(
            size,
            "No hinge point stays in both bodies: it is off by {size:.2g} m rms, and not at random.",
            "The hinge point moves by {size:.2g} m rms",
        )
    else:
        text = f"The hinge point is off by {size:.2g} m rms at random: noise that is large beside the levers."
        return [Finding(text, False)]
    if size >= _MAX_PLAY * reach:
        return [Finding(kind.no_hinge.format(size=kind.size), False)]
    share = f"{100 * kind.size / reach:.2g} % of the levers, and not at random"
    return [Finding(f"{kind.play.format(size=kind.size)}, {share}: u1 and u2 name its mean place.", True)]


class _Gap(NamedTuple):
    """Size of a motion of the hinge point, and the sentences that report it."""

    size: float  # rms [m]
    no_hinge: str  # where the gap is too large for a hinge
    play: str  # where the gap is small beside the levers


def _turning(psi: Float64Array, weights: Float64Array) -> float:
    """Return the scatter of angles about their mean, at most 1 [rad]."""
    mean = np.hypot(weights @ np.cos(psi), weights @ np.sin(psi))
    about = np.arctan2(weights @ np.sin(psi), weights @ np.cos(psi))
    off = np.abs(2 * np.sin((psi - about) / 2))
    return float(min(np.sqrt(weights @ (off * off)), 1.0)) if mean < 1 else 0.0


def _length(p: Float64Array) -> float:
    return float(np.sqrt((p * p).sum() / max(p.shape[1], 1)))


class Poses(NamedTuple):
    """Poses of both bodies as they were given."""

    R1: NDArray[np.floating]  # shape (N, 3)
    S1: NDArray[np.floating]  # shape (N, 3, 3)
    R2: NDArray[np.floating]
    S2: NDArray[np.floating]

    def changed(self, bodies: str, letter: str, change: Callable[..., Any]) -> Poses:
        """Return the poses with the positions, or the attitudes, of some bodies changed."""
        return self._replace(**{f"{letter}{digit}": change(getattr(self, f"{letter}{digit}")) for digit in bodies})

    def misfit(self) -> float:
        """Return how badly a hinge fits: the medians of the tilt, and of the gap in parts of the bodies' distance."""
        poses = compute_relative_poses(*self, np.ones(self.R1.shape[0]))
        distance = _length(poses.p)
        _, seen = next(seen_from(poses, closed_form(poses)))
        tilt, gap = (np.sqrt(np.median((part**2).sum(axis=0))) for part in (seen.tilt, seen.gap))
        return float(tilt + gap / max(distance, 1e-300))


def causes(whole: Poses) -> list[str]:
    """Return a sentence on the mistake in units, orders or axes for which poses show no hinge, if there is one."""
    every = slice(None, None, -(-whole.R1.shape[0] // _MAX_TRIED))
    poses = Poses(*(array[every].astype(np.float64) for array in whole))
    before = poses.misfit()
    tried = [(changed.misfit(), text) for text, changed in _mistakes(poses)]
    left, text = min(tried)
    if left > _MAX_CAUSE_RATIO * before or left > _MAX_CAUSE_MISFIT:
        return []
    return [f"{text}: with that taken back, a hinge fits {before / max(left, 1e-12):.2g} times as well."]


def _mistakes(poses: Poses) -> Iterator[tuple[str, Poses]]:
    """Yield usual mistakes, each with the poses that are right if it was made."""
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
                poses.changed(bodies, "S", functools.partial(_reordered, scalar_first=written == "wxyz")),
            )


def _reordered(S: Float64Array, scalar_first: bool) -> Float64Array:
    """Return the rotations whose quaternions were written with the scalar first, or last, and read the other way."""
    read = matrix_to_quaternion(S)  # w, x, y, z
    written = np.roll(read, -1, axis=-1) if scalar_first else read
    return np.asarray(quaternion_to_matrix("quat", written, scalar_first=scalar_first), dtype=np.float64)
