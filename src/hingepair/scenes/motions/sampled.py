"""Motion by a log: its samples as they are, smoothed, or, of a log of rates, integrated (E12)."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.equations.quantities import ACCELERATION
from hingepair.measured.smoothing.smooth import longest_filled, smooth
from hingepair.measured.smoothing.spline import MIN_PIECE
from hingepair.measured.statistics import LOSSES
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.motion.integrate import METHODS, RATE_FRAME_NAMES, integrate
from hingepair.motion.trajectory import rotate_to_world
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.euler import euler_to_matrix
from hingepair.rotations.sequences import SEQUENCE_NAMES
from hingepair.scenes.motions.functions import base_of, base_phrase, read_functions
from hingepair.scenes.motions.known import PSI, RATE_SUFFIXES, EulerBase, Known, known_by_body1
from hingepair.scenes.motions.logs import EULER, HINGE_NAMES, LOG_ARRAYS, POSITION, QUATERNION, Log, Part, log_path
from hingepair.scenes.motions.motion import LazyValue, Motion
from hingepair.scenes.subject import Subject
from hingepair.scenes.tables import Table
from hingepair.tables.instants import MeasurementWarning, split_at_gaps
from hingepair.tables.suspicions import suspicions

_SMOOTHING_KEYS: Final = ("smooth", "loss", "gaps")
_INTEGRATION_KEYS: Final = ("psi_0", "method", "S1_0")


def read_log(tables: Table, folder: Path, subject: Subject) -> Motion:
    """Return the motion of the log that [motion] names, as it is, smoothed or integrated."""
    table = tables.table("motion")
    if subject.planar:
        table.fail(
            "file",
            "no such key beside planar = true: without it, u1 and u2 have three numbers, n = [0, 0, 1], and a log in "
            "the plane needs no z, phi_x and phi_y",
        )
    if "time" in tables.values:
        tables.fail("time", "no such table, since the column t of motion.file has the instants")
    options: tuple[str, ...] = ("file", "columns", "ignore", "frame", *_SMOOTHING_KEYS)
    pair = subject.pair if isinstance(subject.pair, HingePair) and table.flag("integrate") else None
    integrated = pair is not None
    if subject.mechanism is not None:
        subject.check_joint_names(table, options)
        options = (*options, "sequence", *subject.base_names)
    else:
        for key in _INTEGRATION_KEYS:
            if key in table.values and not integrated:
                table.fail(key, "no such key without integrate = true, which integrates a log of rates")
        options = (*options, "integrate", *(_INTEGRATION_KEYS if integrated else ("sequence",)))
    table.check_keys(options)
    smooths = table.flag("smooth")
    for key in _SMOOTHING_KEYS[1:]:
        if key in table.values and not smooths:
            table.fail(key, "no such key without smooth = true")
    if smooths and integrated:
        table.fail("smooth", "no such key together with integrate: smoothing computes all rates")
    log = Log(log_path(table, folder), subject, table)
    return _integrated(table, log, pair) if pair is not None else _sampled(table, log, subject, smooths)


def _sampled(table: Table, log: Log, subject: Subject, smooths: bool) -> Motion:
    """Return the motion of the samples of a log, with derivatives up to the highest order that the log has, or with
    all of them where it is smoothed.
    """
    is_pair = subject.pair is not None
    attitude = _attitude_names(log, required=is_pair)
    sequence = table.choice("sequence", SEQUENCE_NAMES, "XYZ")
    if attitude is QUATERNION and "sequence" in table.values:
        table.fail("sequence", "nothing, since the file has quaternions")
    groups = (POSITION, attitude) if attitude else ()
    for name in subject.names:
        names = tuple(name + ending for ending in RATE_SUFFIXES)
        if is_pair or not {*names}.isdisjoint(log.columns):
            groups = (*groups, names)
    parts = {names[0]: log.quantity_and_rates(names) for names in groups}
    moving = tuple(name for name in subject.names if name in parts)
    if not moving:
        log.refuse(subject.names[0] if subject.names else "t", "a column for each joint that moves", "none of them")
    sure = None
    if smooths:
        level = ACCELERATION
        body, rows, sure = _smoothed_parts(table, log, parts, attitude, sequence, is_pair)
        base: Any = body
        how = "smoothed, with their rates"
    else:
        level, frame = _highest_derivative(log, groups, parts), _velocity_frame(table, log)
        rows = {name: [parts[name][name + ending] for ending in RATE_SUFFIXES[: level + 1]] for name in moving}
        base, how = _base_of_samples(log, parts, attitude, sequence, frame, level)
        if not level and is_pair:
            log.notes.append("the log has no rates: smooth = true in [motion] gives v2, a2, ...")
    functions = None if attitude or is_pair else read_functions(table, subject, ())
    if functions is not None:
        base = base_of(subject, functions.rows(log.t, level), sequence)
    joints = tuple(
        tuple(
            _float_if_constant(rows[name][k]) if name in rows else subject.rests[name] * (k == 0)
            for name in subject.names
        )
        for k in range(level + 1)
    )
    return Motion(
        t=log.t,
        source=Known(subject.names, log.t.size, joints, base),
        origin="samples in a file, smoothed, with their rates" if smooths and not is_pair else "samples in a file",
        how=how if is_pair else "",
        hint="" if smooths else log.hint,
        notes=tuple(log.notes),
        functions=functions,
        moving=moving,
        sure=sure,
    )


def _base_of_samples(
    log: Log, parts: Mapping[str, Part], attitude: tuple[str, ...], sequence: str, frame: str, level: int
) -> tuple[Any, str]:
    """Return the motion of body 1 or the base that a log has, None without any, and how it turns."""
    if attitude is EULER:
        angles = [np.column_stack((parts["R1"][POSITION[k]], parts["phi"][EULER[k]])) for k in range(level + 1)]
        base = EulerBase(tuple(tuple(map(_float_if_constant, rows.T)) for rows in angles), sequence)
        return base, base_phrase(True, sequence)
    if attitude is not QUATERNION:
        return None, ""
    arrays = parts["R1"] | parts["quat_xyzw"]
    arrays["S1"] = log.rotations(arrays["quat_xyzw"])
    if frame == "body":
        rates = [name for name in QUATERNION[1:] if name in arrays]
        arrays |= {name: rotate_to_world(arrays["S1"], arrays[name]) for name in rates}
    return known_by_body1((), ((),) * (level + 1), arrays).base, "attitude as quaternions"


def _velocity_frame(table: Table, log: Log) -> str:
    """Return the axes of angular velocities, "body" or "world"; only a log that has some has the key `frame`."""
    rates = [column for name in QUATERNION[1:] for column in LOG_ARRAYS[name] if column in log.columns]
    if "frame" in table.values and not rates:
        table.fail("frame", "no such key, since the log has no omega1_x, omega1_y, omega1_z")
    if rates and "frame" not in table.values:
        axes = 'those of body 1, as a gyroscope has them, or "world", as hingepair writes them'
        table.fail("frame", f'the axes of {rates[0].partition("_")[0]} in the log: "body", {axes}')
    return table.choice("frame", RATE_FRAME_NAMES)


def _attitude_names(log: Log, *, required: bool) -> tuple[str, ...]:
    """Return EULER or QUATERNION, whichever the log has; refuse both and, if `required`, neither."""
    euler = any(column in log.columns for column in LOG_ARRAYS["phi"])
    attitude_names, other_names = (EULER, QUATERNION) if euler else (QUATERNION, EULER)
    if not euler and not any(column in log.columns for column in LOG_ARRAYS["quat_xyzw"]):
        if not required and not any(column in log.columns for column in LOG_ARRAYS["R1"]):
            return ()
        hint = ", or motion.integrate = true for a log of rates" if "omega1_x" in log.columns else ""
        log.refuse("phi_x", f"columns phi_x, phi_y, phi_z, or qx, qy, qz, qw{hint}", "neither")
    for column in (column for name in other_names for column in LOG_ARRAYS[name]):
        if column in log.columns:
            log.refuse(column, f"no such column in a log with {LOG_ARRAYS[attitude_names[0]][0]}", "a column")
    return attitude_names


def _highest_derivative(log: Log, groups: Sequence[tuple[str, ...]], parts: Mapping[str, Part]) -> int:
    """Return the highest derivative order, 0 to 2, that any quantity has; refuse a log in which another lacks it."""
    level = max(i for names in groups for i in range(3) if names[i] in parts[names[0]])
    for names in groups:
        for name in names[: level + 1]:
            if name not in parts[names[0]]:
                column = log.layout.columns_of(name)[0]
                log.refuse(column, "a column, since the log has other rates", "no such column")
    return level


def _float_if_constant(column: Float64Array) -> float | Float64Array:
    """Return a column, or one float if all its values are equal."""
    column = np.ascontiguousarray(column)
    return float(column[0]) if (column == column[0]).all() else column


# ---- smoothing


def _smoothed_parts(
    table: Table, log: Log, parts: Mapping[str, Part], attitude: tuple[str, ...], sequence: str, is_pair: bool
) -> tuple[BodyMotion | None, dict[str, list[Float64Array]], NDArray[np.bool_]]:
    """Return the smoothed motion of body 1 or the base, if the log has it, the coordinates of joints with their
    derivatives, and at which instants second derivatives are as accurate as elsewhere; add notes on noise and gaps.
    """
    _check_columns(
        log, [name for name in (*parts, "quat_xyzw") if name != "quat_xyzw" or attitude],
        "samples of x, y, z, of an attitude and of psi" if is_pair else "coordinates of joints alone", "smooth",
    )  # fmt: skip
    samples: dict[str, Any] = {name: part[name] for name, part in parts.items() if name not in (*POSITION, *attitude)}
    if attitude:
        turns = parts[attitude[0]][attitude[0]]
        S1 = np.asarray(euler_to_matrix(turns, sequence)) if attitude is EULER else log.rotations(turns)
        samples = {"body": BodyMotion(R=parts["R1"]["R1"], S=S1), **samples}
    loss = table.choice("loss", tuple(LOSSES))
    with table.naming():
        longest = longest_filled(log.since, table.number("gaps") if "gaps" in table.values else None)
    texts: list[str] = []
    noise: list[str] = []
    body, joints, sure = None, {}, np.ones(log.t.size, dtype=bool)
    quantities: dict[str, tuple[NDArray[Any], NDArray[Any]]] = {}
    for name, own in samples.items():
        is_shift = name != "body" and log.layout.unit_of(name) != "rad"
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", MeasurementWarning)
            with log.naming(body=name):
                # The shift of a slider is no angle, whose jumps might be whole turns: it is smoothed as a position.
                moved: Any = smooth(log.since, _along_x(own) if is_shift else own, gaps=longest, loss=loss)
        said = [str(warning.message) for warning in caught]
        if isinstance(own, np.ndarray):  # the log itself says whether angles may be degrees
            said = [text for text in said if text not in suspicions("angle", "body", own)]
        texts += [re.sub(r"\bbody\b|^angle(?=:)", name, text) for text in said]
        std = moved.std["a" if isinstance(moved, BodyMotion) else "psidd"].reshape(log.t.size, -1)[:, 0]
        sure &= ~(std > 2 * np.nanmedian(std))
        if name == "body":
            body = BodyMotion(**{letter: getattr(moved, letter) for letter in ("R", "S", "v", "omega", "a", "alpha")})
            turning = moved.std["alpha"].reshape(log.t.size, -1)[:, 0]
            sure &= ~(turning > 2 * np.nanmedian(turning))
            noise += [f"{moved.noise['R']:.2g} m of position", f"{moved.noise['S']:.2g} rad of attitude"]
            quantities |= {"position": (own.R, moved.R), "attitude": (own.S, moved.S)}
        else:
            joints[name] = [array[:, 0] for array in (moved.R, moved.v, moved.a)] if is_shift else [*moved]
            noise.append(f"{moved.noise['R' if is_shift else 'psi']:.2g} {log.layout.unit_of(name)} of {name}")
            quantities[name] = own, joints[name][0]
    log.notes += _missing_sample_sentences(log.t, quantities, longest)
    log.notes.append(f"smoothed: noise of {', '.join(noise)} (standard deviation of a component)")
    python = re.compile(r"""hingepair\.smooth with the loss (["']\w+["'])""")
    log.notes += [python.sub(r"loss = \1 in [motion]", text) for text in texts]
    if sure.any() and not sure.all():
        first, last = log.t[np.flatnonzero(sure)[[0, -1]]]
        log.notes.append(
            "rates at the ends of what is smoothed are inaccurate: their smallest and largest are from "
            f"t = {first:.6g} to {last:.6g} s"
        )
    log.notes = list(dict.fromkeys(log.notes))
    return body, joints, sure


def _along_x(samples: Float64Array) -> BodyMotion:
    """Return a body that is shifted along x."""
    R = np.zeros((samples.size, 3))
    R[:, 0] = samples
    return BodyMotion(R=R, S=np.broadcast_to(np.eye(3), (samples.size, 3, 3)))


def _missing_sample_sentences(
    t: Float64Array, quantities: Mapping[str, tuple[NDArray[Any], NDArray[Any]]], gaps: float
) -> list[str]:
    """Return sentences on samples that are not finite or in series that are too short, and on the gaps [s] that cut
    the smoothing; `quantities` are the samples and what smoothing made of them, by name.
    """
    names_by_sentence: dict[str, list[str]] = {}
    for name, (samples, result) in quantities.items():
        known, filled = (np.isfinite(array.reshape(len(t), -1)).all(axis=1) for array in (samples, result))
        for rows, verdict in (
            (~known & filled, "filled"),
            (~known & ~filled, "not filled, in gaps that are too long"),
        ):
            if count := int(rows.sum()):
                first = f"the first at t = {t[rows][0]:.6g} s"
                sentence = f"{count} of {len(t)} samples missing and {verdict}; {first}"
                names_by_sentence.setdefault(sentence, []).append(name)
        pieces = split_at_gaps(t, known, gaps)
        if len(pieces) > 1:
            cuts = [f"{t[a[-1]]:.6g} to {t[b[0]]:.6g} s" for a, b in pairwise(pieces)]
            more = f" and in {len(cuts) - 3} more gaps" if len(cuts) > 3 else ""
            sentence = (
                f"smoothing is cut, with no samples from {', '.join(cuts[:3])}{more}; rates beside a cut are as "
                "inaccurate as at the ends. gaps in [motion] is the longest time that is filled [s]"
            )
            names_by_sentence.setdefault(sentence, []).append(name)
        if short := [piece for piece in pieces if piece.size < MIN_PIECE]:
            sentence = (
                f"samples recorded but left out, in series of fewer than {MIN_PIECE} between gaps: "
                f"{sum(piece.size for piece in short)}; the first at t = {t[short[0][0]]:.6g} s"
            )
            names_by_sentence.setdefault(sentence, []).append(name)
    return [f"{', '.join(names)}: {sentence}" for sentence, names in names_by_sentence.items()]


# ---- integration


def _integrated(table: Table, log: Log, pair: HingePair) -> Motion:
    """Return the motion by rates (E12); without columns of its position, body 1 stays at the origin."""
    _check_columns(
        log, (*POSITION, *QUATERNION[1:], *HINGE_NAMES[1:]), "columns of rates and of R1", "integrate"
    )  # fmt: skip
    turning, hinge = log.quantity_and_rates(QUATERNION[1:]), log.quantity_and_rates(HINGE_NAMES[1:])
    for part in (turning, hinge):
        name, array = next(iter(part.items()))
        log.check_finite(name, array)
    moves = any(column in log.columns for name in POSITION for column in LOG_ARRAYS[name])
    position = log.quantity_and_rates(POSITION) if moves else dict.fromkeys(POSITION, np.zeros((log.t.size, 3)))
    if "v1" not in position:
        log.refuse("v1_x", "a column, since the log has x", "no such column")
    arrays = position | turning | hinge
    frame, method = _velocity_frame(table, log), table.choice("method", METHODS)
    start = table.rotation("S1_0") if "S1_0" in table.values else None
    with table.naming(psid="psi_dot"), warnings.catch_warnings():
        warnings.simplefilter("ignore", MeasurementWarning)  # notes say it
        found = integrate(
            pair, log.since, arrays["omega1"], arrays["psid"], S1_0=start, psi_0=table.number("psi_0", 0.0),
            method=method, frame=frame, outputs=(),
        )  # fmt: skip
    arrays |= {"psi": found.psi, "S1": found.S1}
    if frame == "body":
        rates = [name for name in ("omega1", "alpha1") if name in arrays]
        arrays |= {name: rotate_to_world(arrays["S1"], arrays[name]) for name in rates}
    joints = tuple((arrays[name],) for name in HINGE_NAMES if name in arrays)
    return Motion(
        t=log.t,
        source=known_by_body1(PSI, joints if {"a1", "alpha1"} <= arrays.keys() else joints[:2], arrays),
        moving=PSI,
        origin="integrated from rates",
        how=f"omega1 and psi' integrated by {method}",
        errors={"rad": LazyValue(lambda: float(np.maximum(found.error_estimate, found.psi_error_estimate)))},
        doubt="too few samples to tell how far the integration is off",
        notes=tuple(log.notes),
    )


def _check_columns(log: Log, arrays: Sequence[str], wanted: str, key: str) -> None:
    """Refuse columns of a log that are none of those of `arrays`."""
    known = {"t", *(column for name in arrays for column in log.layout.columns_of(name))}
    for column in log.columns:
        if column not in known:
            log.refuse(column, f"{wanted}, since motion.{key} is true", "a column")
