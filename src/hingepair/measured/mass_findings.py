"""Findings on fitted masses: what the motion does not determine, and what of the torques masses do not explain.

What a wrong model does to the torques - gravity that is tilted, a joint whose zero is off, a link of another length,
torques that are late - is a column beside those of the parameters. Where what is left has more of a column than
chance leaves, the parameters are off by what the column has of theirs.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from hingepair.measured.findings import RANDOM_CORRELATION, Finding, exceeded, memory_finding, notes
from hingepair.measured.statistics import OUTLIER, median_variance, neighbour_correlation, score_scatter
from hingepair.measured.torques import TERMS, Found, Recording, column_rms, inertial_units
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.robots.inertial_parameters import body_names
from hingepair.numeric.arrays import Float64Array
from hingepair.tables.sheets import percent

_HARDLY_KNOWN, _UNKNOWN = 0.5, 2.0  # from these standard deviations on, in parts of what such a body may have
_WORSE = 1.5  # times the error of the samples fitted to; above, the parameters do not hold for new ones
_POOR = 0.2  # of a joint's torque: a larger rest that is not random cannot be filtered noise alone
_GROWTH = 10.0  # of the squares of what is left, in variances of noise per parameter; more is worse than by chance
_JUDGED_SAMPLES = 65536  # samples whose order is judged
_FAR_OFF = 10.0  # squares of outliers, times those of the others; more decides on the parameters
_DEPENDENT = 5.0  # of squares of means, times what noise makes of them
_ORDERED, _ORDERED_SAMPLES = 0.9, 4096  # correlation and number of neighbours that tell errors of the model
_SHOWN = 6.0  # standard deviations from which an error of the model is shown
_SHIFTED = 2.0  # standard deviations by which it may shift a parameter
_LONGEST_DELAY = 20  # samples by which torques are tried to be late or early
_LARGEST = 30  # joints; of more, derivatives by lengths are large programs
_FACTORS = {"m": (1e3, "mm"), "rad": (180 / np.pi, "deg")}


class Explained(NamedTuple):
    """A recording of N samples, the first of which were fitted to, and what fitted parameters explain."""

    recording: Recording
    found: Found
    estimate: Float64Array  # parameters; (k,)
    left: Float64Array  # of the torques; (N, dof)
    num_fitted: int
    robot: Mechanism  # with fitted masses
    grown: float  # squares of what rigid bodies leave more, in variances
    is_robust: bool  # whether a loss made torques that are far off count little

    @property
    def inexact(self) -> Any:
        """Of which joints more is left than rounding (dof,)."""
        return column_rms(self.left[: self.num_fitted]) > 1e-6 * self.torque_sizes

    @property
    def torque_sizes(self) -> Float64Array:
        """Root mean square of the torques (dof,)."""
        return np.maximum(column_rms(self.recording.values["tau"][: self.num_fitted]), 1e-300)

    @property
    def is_ordered(self) -> bool:
        """Whether neighbouring samples are of neighbouring positions."""
        q = self.recording.values["q"][: self.num_fitted]
        q = (q - q.mean(axis=0))[:, np.ptp(q, axis=0) > 0]
        return self.num_fitted >= 50 and neighbour_correlation(q.T) > _ORDERED


def judged(explained: Explained) -> list[Finding]:
    """Return findings on fitted masses, the serious ones first."""
    findings = [
        *_body_findings(explained),
        *_undetermined_findings(explained),
        *_rest_findings(explained),
        *_test_findings(explained),
        *_unit_findings(explained),
    ]
    if explained.is_ordered:
        findings += [*_model_findings(explained), *_motion_noise_finding(explained)]
    elif explained.inexact.any():
        text = (
            "Neighbouring samples are of unrelated positions, so that their order does not tell noise from what the "
            "parameters lack: compare `noise` with that of the sensors."
        )
        findings += notes("order", [text])
    return sorted(findings, key=lambda finding: finding.is_note)


def _rest_findings(explained: Explained) -> list[Finding]:
    """Return findings on what is left of the torques fitted to: what depends on the motion, resembles its neighbours,
    or is far off.
    """
    recording, left, found = explained.recording, explained.left[: explained.num_fitted], explained.found
    joints, inexact, findings = np.array(recording.robot.names), explained.inexact, []
    depends = np.where(inexact, _dependence(explained), 0.0)
    which = ", ".join(joints[depends > _DEPENDENT])
    text = f"What is left of the torques of {which} depends on the motion: the parameters lack something, such as "
    text += "other friction, or the dimensions or gravity are wrong."
    findings += exceeded(Finding("dependence", depends.max(), _DEPENDENT, text))
    random = max(RANDOM_CORRELATION, 5 / np.sqrt(len(left)))
    correlated = inexact & (np.array([neighbour_correlation(column) for column in left.T]) > random)
    if correlated.any():
        share = float((column_rms(left) / explained.torque_sizes)[correlated].max())
        text = (
            f"What is left of the torques of {', '.join(joints[correlated])}, up to {percent(share)} of them, is not "
            "random: filtered noise, or what the parameters lack, such as other friction and elastic gears."
        )
        findings.append(Finding("not random", share, 0, text, harmless=share < _POOR))
        findings += exceeded(memory_finding(found.unresolved_lag, "the torques"))
    usual = np.sqrt([max(median_variance(column**2, 1), 1e-300) for column in left.T])
    # Where a joint turns round, noise of its rate decides on the sign of dry friction.
    turns = np.diff(np.sign(recording.values["qd"][: explained.num_fitted]), axis=0) != 0
    turns = np.pad(turns, ((1, 1), (0, 0)))[1:] | np.pad(turns, ((1, 1), (0, 0)))[:-1]
    is_spike = (left**2 > OUTLIER * usual**2) & inexact & ~correlated & ~turns
    if is_spike.any():
        few = (left[is_spike] ** 2).sum() < _FAR_OFF * (left[~is_spike] ** 2).sum()
        text = f"{percent(float(is_spike.mean()))} of the torques are outliers, far off the others"
        text += "." if explained.is_robust else ': loss="cauchy" makes them count little.'
        findings.append(Finding("outliers", is_spike.mean(), 0, text, harmless=explained.is_robust or bool(few)))
    return findings


def _test_findings(explained: Explained) -> list[Finding]:
    """Return a finding if the torques kept for the test are off by more than those fitted to."""
    left, left_test = np.split(explained.left, [explained.num_fitted])
    if not len(left_test):
        return []
    # Ends of nine tenths: where dry friction turns round, single samples are far off.
    ends, ends_test = (np.quantile(np.abs(rows), 0.9, axis=0) for rows in (left, left_test))
    worse = ends_test > np.maximum(_WORSE * ends, 1e-6 * explained.torque_sizes)
    ratios = np.where(worse, ends_test / np.maximum(ends, 1e-300), 0.0)
    names, k = np.array(explained.recording.robot.names), int(np.argmax(ratios))
    text = (
        f"In the samples kept for the test, the torques of {', '.join(names[worse])} are off by more than in those "
        f"fitted to, that of {names[k]} by {column_rms(left_test)[k]:.3g} instead of {column_rms(left)[k]:.3g} N m "
        "rms: the parameters do not hold for other motions."
    )
    return exceeded(Finding("test", ratios[k], _WORSE, text))


def _unit_findings(explained: Explained) -> list[Finding]:
    """Return a finding if the torques are hundreds of times those of the robot as described, or hundredths."""
    recording, count = explained.recording, explained.num_fitted
    if recording.is_partial or not recording.robot.inertial_parameters[::10].all():
        return []
    torques = recording.torques(slice(0, count))
    of_robot = column_rms(torques - recording.left(recording.described)[:count])
    loaded = of_robot > 1e-6 * of_robot.max()  # others have no torque but rounding
    if not loaded.any():
        return []
    ratio = float(np.median(column_rms(torques)[loaded] / of_robot[loaded]))
    text = f"The torques are {ratio:.4g} times those of the robot as described: are they in N m, or N of sliders?"
    return exceeded(Finding("unit", max(ratio, 1 / max(ratio, 1e-300)), 100, text)) if ratio else []


def _model_findings(explained: Explained) -> list[Finding]:
    """Return a finding on the error of the model that explains most of what is left, and on those that explain as
    much; a note if it hardly shifts the parameters.
    """
    part = slice(0, min(explained.num_fitted, _ORDERED_SAMPLES))
    recording, found = explained.recording, explained.found
    if not explained.inexact.any():
        return []
    A = (recording.rows(part) / found.noise[:, None]).reshape(-1, recording.described.size)
    rest = (explained.left[part] / found.noise).ravel()
    known = np.isfinite(found.std)
    inverse = np.linalg.pinv(A.T @ A, hermitian=True)
    shown = []
    for name, text, unit, columns in _errors_of_model(explained, part):
        weighted = (columns / found.noise[:, None]).reshape(rest.size, -1)
        of_parameters = inverse @ (A.T @ weighted)
        own = weighted - A @ of_parameters
        own[:, (own**2).sum(axis=0) < 1e-12 * (weighted**2).sum(axis=0)] = 0.0  # parameters do the same
        size = np.linalg.lstsq(own, rest)[0]
        explains = own @ size
        scores = (explains * (rest - explains)).reshape(len(explained.left[part]), -1).sum(axis=1)
        score = float(explains @ explains) / max(float(np.sqrt(score_scatter(scores[None])[0][0, 0])), 1e-300)
        shift = float((np.abs(of_parameters @ size)[known] / np.maximum(found.std[known], 1e-300)).max(initial=0.0))
        factor, name_of_unit = _FACTORS.get(unit, (1.0, ""))
        by = f" by {factor * float(np.linalg.norm(size)):.2g} {name_of_unit}" if unit else ""
        shown.append((score, shift, name, text + by))
    most = max(shown)
    alike = [each for each in shown if each[0] > 0.9 * most[0]]
    causes, most_shift = " or ".join(text for *_, text in alike), max(shift for _, shift, *_ in alike)
    text = f"A probable cause of what is left of the torques is {causes}: parameters are wrong by "
    text += f"about {most_shift:.2g} standard deviations."
    return exceeded(Finding(alike[0][2], most[0], _SHOWN, text, harmless=most_shift <= _SHIFTED))


def _errors_of_model(explained: Explained, part: slice) -> Iterator[tuple[str, str, str, Float64Array]]:
    """Yield errors that the model may have: their names, sentences and units ("" if the sentence has their size), and
    what a unit of them adds to the torques, (n, dof, .).
    """
    recording, robot = explained.recording, explained.robot
    q, qd, qdd = (recording.values[name][part] for name in ("q", "qd", "qdd"))
    # Torques that are late are off by their change from sample to sample.
    fitted = recording.torques(part) - explained.left[part]
    yield "delay", _delay_text(explained, part), "", np.gradient(fitted, axis=0)[..., None]
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
        found: dict[str, Any] = torques.jacobian((q, qd, qdd), wrt=("q", "lengths"))["tau"]
    for k, joint in enumerate(tree_of(robot).coordinates):
        yield "zero", f"a zero of {joint.name} that is off", joint.unit, found["q"][..., k, None]
    for k, moved in enumerate(tree_of(robot).joints):
        yield "length", f"a place of {moved.name} that is off", "m", found["lengths"][..., k, :]


def _delay_text(explained: Explained, part: slice) -> str:
    """Say whether torques are late or early, and by how many samples if fewer than the most tried fit them best."""
    recording, noise, count = explained.recording, explained.found.noise, part.stop
    most = min(_LONGEST_DELAY, count // 8)
    A = (recording.rows(slice(most, count - most)) / noise[:, None]).reshape(-1, recording.described.size)
    tau = recording.values["tau"][part]
    known = (tau - recording.torques(part))[most : count - most]  # of the motion, not late with the torques
    lags = np.arange(-most, most + 1)
    moved = np.stack(
        [((tau[most + lag : count - most + lag] - known) / noise).ravel() for lag in lags.tolist()], axis=-1
    )
    off = ((moved - A @ (np.linalg.pinv(A.T @ A, hermitian=True) @ (A.T @ moved))) ** 2).sum(axis=0)
    best = int(np.argmin(off))
    order = "late" if lags[best] > 0 else "early"
    if abs(lags[best]) == most:
        return f"torques that are {order}"
    before, least, after = off[best - 1 : best + 2]
    found = float(lags[best] + (before - after) / max(2 * (before - 2 * least + after), 1e-300))
    if abs(found) < 0.1:
        return "torques that are late or early"
    return f"torques that are {'late' if found > 0 else 'early'} by {abs(found):.2g} sample{'s' * (abs(found) > 1)}"


def _dependence(explained: Explained) -> Float64Array:
    """Return by how much what is left of each torque depends on q, qd or qdd of a joint (dof,): the squares of means
    over sixteenths of the samples, in order of one of these, in parts of what noise makes of them.
    """
    left, values = explained.left[: explained.num_fitted], explained.recording.values
    thin = slice(None, None, -(-len(left) // _JUDGED_SAMPLES))
    columns = [values[name][: explained.num_fitted][thin].T for name in ("q", "qd", "qdd")]
    largest = np.zeros(left.shape[1])
    for k, rest in enumerate(left[thin].T):
        bend = 3 * np.sqrt(max(median_variance(rest**2, 1), 1e-300))
        usual = np.clip(rest, -bend, bend)  # spikes tell nothing of the whole motion
        scatter, _ = score_scatter(usual[None])
        noise = max(float(scatter[0, 0]), float(usual @ usual), 1e-300) / usual.size  # of a sample
        for one in np.concatenate(columns):
            parts = np.array_split(usual[np.argsort(one, kind="stable")], 16)
            squares = [part.sum() ** 2 / part.size for part in parts if part.size]
            largest[k] = max(largest[k], float(np.mean(squares)) / noise)
    return largest


def _undetermined_findings(explained: Explained) -> list[Finding]:
    """Return findings on what the motion does not determine, and on friction below 0."""
    recording, found = explained.recording, explained.found
    robot, base, terms = recording.robot, recording.base, recording.terms
    rates = recording.values["qd"][: explained.num_fitted]
    findings, count = [], len(base.names)
    doubt = found.std[:count] / np.sqrt((base.matrix**2) @ (inertial_units(robot) ** 2))
    for number, name in enumerate(body_names(tree_of(robot), False)):
        of_body = np.flatnonzero(~(doubt <= _HARDLY_KNOWN) & (base.columns // 10 == number))
        if of_body.size:
            which = ", ".join(base.names[k].removeprefix(f"{name} ") for k in of_body)
            harmless = bool((doubt[of_body] <= _UNKNOWN).all()) or recording.is_partial
            degree = "hardly" if (doubt[of_body] <= _UNKNOWN).all() else "not"
            how = f"{'are' if of_body.size > 1 else 'is'} {degree} determined"
            advice = f"let {tree_of(robot).joints[number].name} and the joints that carry it turn further and faster"
            text = f"{which} of {name} {how} by this motion: {advice}."
            findings.append(Finding("undetermined", doubt[of_body].max(), _HARDLY_KNOWN, text, harmless=harmless))
    values, std = (recording.parts(array)[1] for array in (explained.estimate, found.std))
    for k, joint in enumerate(robot.names):
        lost = [term for term in terms if np.isinf(std[term][k])]
        if lost:
            which = (
                f"{' and '.join(lost)} {'terms are' if len(lost) > 1 else 'term is'} not determined by this motion"
            )
            still = not rates[:, k].any()
            text = f"{joint} does not move: its {which}." if still else f"Of {joint}, the {which}."
            findings.append(Finding("undetermined", np.inf, 0, text))
    unsigned = [term for term in terms if not TERMS[term].signed]
    below = np.logical_or.reduce(
        [values[term] + 4 * std[term] < 0 for term in unsigned] or [np.zeros(robot.dof, np.bool_)]
    )
    if below.any():
        joints = ", ".join(np.array(robot.names)[below])
        text = f"Friction or a rotor of {joints} is below 0: do tau and qd have the same sign?"
        findings.append(Finding("sign", below.sum(), 0, text))
    return findings


def _body_findings(explained: Explained) -> list[Finding]:
    """Return a finding if rigid bodies explain the torques less well than the parameters, and not by chance."""
    recording = explained.recording
    known_rotors = recording.robot.armature.any() and "armature" not in recording.terms
    text = (
        "No rigid bodies have these base parameters, and the nearest rigid bodies, those of `robot`, do not explain "
        "the torques: do tau and qdd have the same sign"
        f"{', and are the rotors as light as `armature` says' if known_rotors else ''}?"
    )
    return exceeded(Finding("bodies", explained.grown, _GROWTH * len(explained.estimate), text))


def _motion_noise_finding(explained: Explained) -> list[Finding]:
    """Return a finding if noise of q, qd and qdd makes parameters wrong by more than their standard deviations.

    Noise in the regressor adds to the normal matrix, by which parameters come out small. Its size is that of fourth
    differences, in which a motion that is sampled well enough has no part.
    """
    recording, found = explained.recording, explained.found
    part = slice(0, min(explained.num_fitted, _ORDERED_SAMPLES))
    weighted_rows = (recording.rows(part) / found.noise[:, None]).reshape(-1, recording.described.size)
    rng, noisy, sizes = np.random.default_rng(0), {}, {}
    for name in ("q", "qd", "qdd"):
        values = recording.values[name][part]
        sizes[name] = np.sqrt((np.diff(values, 4, axis=0) ** 2).mean(axis=0) / 70)
        noisy[name] = values + sizes[name] * rng.standard_normal(values.shape)
    moved = recording._replace(values=recording.values | noisy)
    off = moved.rows(slice(0, len(noisy["q"]))) / found.noise[:, None]
    off = off.reshape(weighted_rows.shape) - weighted_rows
    known = np.isfinite(found.std)
    normal = weighted_rows[:, known].T @ weighted_rows[:, known]
    estimate = explained.estimate[known]
    bias = np.abs(np.linalg.lstsq(normal, off[:, known].T @ (off[:, known] @ estimate), rcond=1e-12)[0])
    scores = bias / np.maximum(found.std[known], 1e-300)
    usual = np.abs(explained.estimate)  # beside what such bodies may have
    bodies = len(recording.base.names)
    usual[:bodies] += np.sqrt((recording.base.matrix**2) @ inertial_units(recording.robot) ** 2)
    usual[bodies:] += np.tile(column_rms(recording.values["tau"]), len(recording.terms))
    scores[bias < 0.01 * usual[known]] = 0.0
    if not scores.size:
        return []
    worst = int(np.argmax(scores))
    rate = float(np.sqrt(np.mean(sizes["qdd"] ** 2)))
    text = (
        f"Noise of the motion, of accelerations about {rate:.2g} rad/s^2 or m/s^2, makes parameters wrong, by up to "
        f"{scores[worst]:.2g} standard deviations: hp.smooth derives rates and accelerations with less."
    )
    return exceeded(Finding("noise of the motion", scores[worst], _SHIFTED, text))
