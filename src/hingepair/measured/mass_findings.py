"""Findings on fitted masses: what the motion does not determine, and what of the torques masses do not explain.

What a wrong model does to the torques - gravity that is tilted, a joint whose zero is off, a link of another length,
torques that are late - is a column beside those of the parameters. Where what is left has more of a column than
chance leaves, the parameters are off by what the column has of theirs.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from hingepair.measured.findings import (
    RANDOM_CORRELATION,
    Finding,
    exceeded,
    few_samples_finding,
    memory_finding,
)
from hingepair.measured.statistics import OUTLIER, every_kth, neighbour_correlation, score_scatter
from hingepair.measured.torques import TERMS, Found, base_units, column_rms
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.numeric.arrays import Float64Array
from hingepair.tables.sheets import percent

_HARDLY_KNOWN, _UNKNOWN = 0.5, 2.0  # from these standard deviations on, in parts of what such a body may have
_FEW = 50  # samples, from which standard deviations hold
_POOR = 0.2  # of a joint's torque: a larger rest that is not random cannot be filtered noise alone
_GROWTH = 10.0  # of the squares of what is left, in variances of noise per parameter; more is worse than by chance
_JUDGED_SAMPLES = 65536  # samples whose order is judged
_FAR_OFF = 10.0  # squares of outliers, times those of the others; more decides on the parameters
_DEPENDENT = 5.0  # of squares of means, times what noise makes of them
_ORDERED_SAMPLES = 4096  # that tell errors of the model
_SHOWN = 6.0  # standard deviations from which an error of the model is shown
_SHIFTED = 2.0  # standard deviations by which it may shift a parameter
_DELAYED = 0.5  # samples by which torques may be late: friction bears the whole of a delay
_LARGEST = 30  # joints; of more, derivatives by lengths are large programs
_FACTORS = {"m": (1e3, "mm"), "rad": (180 / np.pi, "deg")}


def judged(found: Found, robot: Mechanism, grown: float, is_robust: bool) -> list[Finding]:
    """Return findings on fitted masses, the serious ones first.

    Args:
        found: what was found of the recording.
        robot: the robot with fitted masses.
        grown: squares of what rigid bodies leave more, in variances.
        is_robust: whether a loss made torques that are far off count little.
    """
    recording = found.recording
    has_rotors = bool(recording.robot.armature.any()) and "armature" not in recording.terms
    rotors = ", and are the rotors as light as `armature` says" if has_rotors else ""
    text = (
        "No rigid bodies have these base parameters, and the nearest rigid bodies, those of `robot`, do not explain "
        f"the torques: do tau and qdd have the same sign{rotors}?"
    )
    findings = [
        *exceeded(Finding("bodies", grown, _GROWTH * len(found.estimate), text)),
        *_undetermined_findings(found),
        *_rest_findings(found, is_robust),
        *_unit_findings(found),
    ]
    if recording.is_ordered:
        findings += [*_model_findings(found, robot), *_motion_noise_finding(found)]
    elif found.inexact.any():
        findings += exceeded(few_samples_finding(len(found.left), _FEW))
    return sorted(findings, key=lambda finding: finding.is_note)


def _rest_findings(found: Found, is_robust: bool) -> list[Finding]:
    """Return findings on what is left of the torques: what depends on the motion, resembles its neighbours, or is
    far off.
    """
    left, joints, inexact = found.left, np.array(found.recording.robot.names), found.inexact
    depends = np.where(inexact, _dependence(found), 0.0)
    text = f"What is left of the torques of {', '.join(joints[depends > _DEPENDENT])} depends on the motion: the "
    text += "parameters lack something, such as other friction, or the dimensions or gravity are wrong."
    findings = exceeded(Finding("dependence", depends.max(), _DEPENDENT, text))
    random = max(RANDOM_CORRELATION, 5 / np.sqrt(len(left)))
    correlated = inexact & (np.array([neighbour_correlation(column) for column in left.T]) > random)
    if correlated.any():
        share = float((column_rms(left) / found.torque_sizes)[correlated].max())
        text = (
            f"What is left of the torques of {', '.join(joints[correlated])}, up to {percent(share)} of them, is not "
            "random: filtered noise, or what the parameters lack, such as other friction and elastic gears."
        )
        findings.append(Finding("not random", share, 0, text, harmless=share < _POOR))
        findings += exceeded(memory_finding(found.unresolved_lag, "the torques"))
    # Where a joint turns round, noise of its rate decides on the sign of dry friction.
    turns = np.diff(np.sign(found.recording.values["qd"]), axis=0) != 0
    turns = np.pad(turns, ((1, 1), (0, 0)))[1:] | np.pad(turns, ((1, 1), (0, 0)))[:-1]
    is_spike = (left**2 > OUTLIER * found.usual_left) & inexact & ~correlated & ~turns
    if is_spike.any():
        few = (left[is_spike] ** 2).sum() < _FAR_OFF * (left[~is_spike] ** 2).sum()
        text = f"{percent(float(is_spike.mean()))} of the torques are outliers, far off the others"
        text += "." if is_robust else ': loss="cauchy" makes them count little.'
        findings.append(Finding("outliers", is_spike.mean(), 0, text, harmless=is_robust or bool(few)))
    return findings


def _unit_findings(found: Found) -> list[Finding]:
    """Return a finding if the torques are hundreds of times those of the robot as described, or hundredths."""
    recording = found.recording
    if not recording.robot.inertial_parameters[::10].all():
        return []
    of_robot = column_rms(recording.explained(recording.described))
    loaded = of_robot > 1e-6 * of_robot.max()  # others have no torque but rounding
    if not loaded.any():
        return []
    ratio = float(np.median(column_rms(recording.values["tau"])[loaded] / of_robot[loaded]))
    text = f"The torques are {ratio:.4g} times those of the robot as described: are they in N m, or N of sliders?"
    return exceeded(Finding("unit", max(ratio, 1 / max(ratio, 1e-300)), 100, text)) if ratio else []


def _weighted_rows(found: Found, part: slice) -> Float64Array:
    """Return the columns of the parameters for some samples in parts of the noise; (n * dof, k)."""
    return (found.recording.rows(part) / found.noise[:, None]).reshape(-1, found.estimate.size)


def _model_findings(found: Found, robot: Mechanism) -> list[Finding]:
    """Return a finding on the error of the model that explains most of what is left, and on those that explain as
    much; a note if it hardly shifts the parameters.
    """
    if not found.inexact.any():
        return []
    part = slice(0, _ORDERED_SAMPLES)
    A, rest = _weighted_rows(found, part), (found.left[part] / found.noise).ravel()
    known = np.isfinite(found.std)
    inverse = np.linalg.pinv(A.T @ A, hermitian=True)
    shown = []
    for name, text, unit, columns in _errors_of_model(found, robot, part):
        weighted = (columns / found.noise[:, None]).reshape(rest.size, -1)
        of_parameters = inverse @ (A.T @ weighted)
        own = weighted - A @ of_parameters
        own[:, (own**2).sum(axis=0) < 1e-12 * (weighted**2).sum(axis=0)] = 0.0  # parameters do the same
        size = np.linalg.lstsq(own, rest)[0]
        explains = own @ size
        scores = (explains * (rest - explains)).reshape(-1, found.noise.size).sum(axis=1)
        score = float(explains @ explains) / max(float(np.sqrt(score_scatter(scores[None])[0][0, 0])), 1e-300)
        shift = float((np.abs(of_parameters @ size)[known] / np.maximum(found.std[known], 1e-300)).max(initial=0.0))
        factor, name_of_unit = _FACTORS.get(unit, (1.0, ""))
        length = float(np.linalg.norm(size))
        by = f" by {factor * length:.2g} {name_of_unit}" if unit else ""
        is_delayed = name == "delay" and length > _DELAYED
        shown.append((score, shift, is_delayed, name, text + by))
    most = max(shown)
    alike = [each for each in shown if each[0] > 0.9 * most[0]]
    _, shifts, are_delayed, names, causes = zip(*alike, strict=True)
    most_shift = max(shifts)
    harmless = most_shift <= _SHIFTED and not any(are_delayed)
    text = f"A probable cause of what is left of the torques is {' or '.join(causes)}, which "
    text += "hardly changes" if harmless else "makes wrong"
    text += f" the parameters, by about {most_shift:.2g} standard deviations."
    return exceeded(Finding(names[0], most[0], _SHOWN, text, harmless=harmless))


def _errors_of_model(found: Found, robot: Mechanism, part: slice) -> Iterator[tuple[str, str, str, Float64Array]]:
    """Yield errors that the model may have: their names, sentences and units ("" if the sentence has their size), and
    what a unit of them adds to the torques, (n, dof, .).
    """
    recording = found.recording
    q, qd, qdd = (recording.values[name][part] for name in ("q", "qd", "qdd"))
    delay, change = _delay(found, part)
    step = float((np.diff(q, axis=0) * qd[1:]).sum() / max((qd[1:] ** 2).sum(), 1e-300))  # [s]
    text = f"torques that are {'late' if delay > 0 else 'early'} by {1e3 * abs(delay * step):.2g} ms "
    yield "delay", f"{text}({abs(delay):.2g} samples)", "", change
    size = float(np.linalg.norm(recording.gravity))
    if size:
        across = size * np.linalg.svd(np.reshape(recording.gravity, (1, 3)))[2][1:]
        tilts = [
            robot.torque_regressor(q, 0 * qd, 0 * qdd, gravity=axis) @ robot.inertial_parameters for axis in across
        ]
        yield "gravity", "gravity that is tilted", "rad", np.stack(tilts, axis=-1)
    if robot.dof > _LARGEST:
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of masses that no rigid body has
        torques = robot.prepare("inverse_dynamics", outputs=("tau",), gravity=recording.gravity)
        slopes: dict[str, Any] = torques.jacobian((q, qd, qdd), wrt=("q", "lengths"))["tau"]
    for k, joint in enumerate(tree_of(robot).coordinates):
        yield "zero", f"a zero of {joint.name} that is off", joint.unit, slopes["q"][..., k, None]
    for k, moved in enumerate(tree_of(robot).joints):
        yield "length", f"a place of {moved.name} that is off", "m", slopes["lengths"][..., k, :]


def _delay(found: Found, part: slice) -> tuple[float, Float64Array]:
    """Return by how many samples torques are late, by steps of Gauss and Newton, and what a sample more changes of
    them (n, dof, 1).
    """
    recording, A = found.recording, _weighted_rows(found, part)
    tau, known = recording.values["tau"][part], recording.known[part]
    place, delay = np.arange(len(tau)), 0.0
    project = np.linalg.pinv(A.T @ A, hermitian=True) @ A.T
    for _ in range(8):
        moved = np.stack([np.interp(place + delay, place, column) for column in tau.T], axis=1)
        both = [each / found.noise for each in (moved - known, np.gradient(moved, axis=0))]
        rest, slope = (each.ravel() - A @ (project @ each.ravel()) for each in both)
        delay -= float(slope @ rest / max(slope @ slope, 1e-300))
    return delay, np.gradient(tau - found.left[part], axis=0)[..., None]


def _dependence(found: Found) -> Float64Array:
    """Return by how much what is left of each torque depends on q, qd or qdd of a joint (dof,): the squares of means
    over sixteenths of the samples, in order of one of these, in parts of what noise makes of them.
    """
    thin = every_kth(len(found.left), _JUDGED_SAMPLES)
    columns = np.concatenate([found.recording.values[name][thin].T for name in ("q", "qd", "qdd")])
    largest = np.zeros(found.left.shape[1])
    for k, (rest, variance) in enumerate(zip(found.left[thin].T, found.usual_left, strict=True)):
        usual = np.clip(
            rest, -3 * np.sqrt(variance), 3 * np.sqrt(variance)
        )  # spikes tell nothing of the whole motion
        scatter, _ = score_scatter(usual[None])
        noise = max(float(scatter[0, 0]), float(usual @ usual), 1e-300) / usual.size  # of a sample
        for one in columns:
            parts = np.array_split(usual[np.argsort(one, kind="stable")], 16)
            squares = [part.sum() ** 2 / part.size for part in parts if part.size]
            largest[k] = max(largest[k], float(np.mean(squares)) / noise)
    return largest


def _undetermined_findings(found: Found) -> list[Finding]:
    """Return findings on what the motion does not determine, and on friction below 0."""
    recording, findings = found.recording, []
    robot, base, tree = recording.robot, recording.base, tree_of(recording.robot)
    doubt = found.std[: len(base.names)] / base_units(recording)
    for number, name in enumerate(tree.body_names[1:]):
        of_body = np.flatnonzero(~(doubt <= _HARDLY_KNOWN) & (base.columns // 10 == number))
        if not of_body.size:
            continue
        is_hardly = bool((doubt[of_body] <= _UNKNOWN).all())
        text = (
            f"{', '.join(base.names[k].removeprefix(f'{name} ') for k in of_body)} of {name} "
            f"{'are' if of_body.size > 1 else 'is'} {'hardly' if is_hardly else 'not'} determined by this motion: "
            f"let {tree.joints[number].name} and the joints that carry it turn further and faster."
        )
        harmless = is_hardly or recording.is_partial
        findings.append(Finding("undetermined", doubt[of_body].max(), _HARDLY_KNOWN, text, harmless=harmless))
    values, std = (recording.parts(array)[1] for array in (found.estimate, found.std))
    for k, joint in enumerate(robot.names):
        lost = [term for term in recording.terms if np.isinf(std[term][k])]
        if lost:
            which = (
                f"{' and '.join(lost)} {'terms are' if len(lost) > 1 else 'term is'} not determined by this motion"
            )
            moves = recording.values["qd"][:, k].any()
            text = f"Of {joint}, the {which}." if moves else f"{joint} does not move: its {which}."
            findings.append(Finding("undetermined", np.inf, 0, text))
    below = np.zeros(robot.dof, dtype=bool)
    for term in recording.terms:
        below |= (values[term] + 4 * std[term] < 0) & (not TERMS[term].signed)
    joints = ", ".join(np.array(robot.names)[below])
    text = f"Friction or a rotor of {joints} is below 0: do tau and qd have the same sign?"
    return findings + exceeded(Finding("sign", below.sum(), 0, text))


def _motion_noise_finding(found: Found) -> list[Finding]:
    """Return a finding if noise of q, qd and qdd makes parameters wrong by more than their standard deviations.

    Noise in the regressor adds to the normal matrix, by which parameters come out small. Its size is that of fourth
    differences, in which a motion that is sampled well enough has no part.
    """
    recording, part = found.recording, slice(0, _ORDERED_SAMPLES)
    A, rng, noisy, sizes = _weighted_rows(found, part), np.random.default_rng(0), {}, {}
    for name in ("q", "qd", "qdd"):
        values = recording.values[name][part]
        sizes[name] = np.sqrt((np.diff(values, 4, axis=0) ** 2).mean(axis=0) / 70)
        noisy[name] = values + sizes[name] * rng.standard_normal(values.shape)
    moved = found._replace(recording=recording._replace(values=noisy))
    known = np.isfinite(found.std)
    A, off = A[:, known], (_weighted_rows(moved, part) - A)[:, known]
    bias = np.abs(np.linalg.lstsq(A.T @ A, off.T @ (off @ found.estimate[known]), rcond=1e-12)[0])
    scores = bias / np.maximum(found.std[known], 1e-300)
    usual = np.abs(found.estimate)  # beside what such bodies may have
    bodies = len(recording.base.names)
    usual[:bodies] += base_units(recording)
    usual[bodies:] += np.tile(found.torque_sizes, len(recording.terms))
    scores[bias < 0.01 * usual[known]] = 0.0
    rate = float(np.sqrt(np.mean(sizes["qdd"] ** 2)))
    worst = float(scores.max(initial=0.0))
    text = (
        f"Noise of the motion, of accelerations about {rate:.2g} rad/s^2 or m/s^2, makes parameters wrong, by up to "
        f"{worst:.2g} standard deviations: hp.smooth derives rates and accelerations with less."
    )
    return exceeded(Finding("noise of the motion", worst, _SHIFTED, text))
