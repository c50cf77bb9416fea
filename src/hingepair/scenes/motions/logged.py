"""Motion by a log: its samples as they are, smoothed, or, of a log of rates, integrated (E12)."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.equations.quantities import ACCELERATION
from hingepair.measured.smoothing.smooth import longest_filled, smooth
from hingepair.measured.smoothing.spline import MIN_PIECE
from hingepair.measured.statistics import LOSSES
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.motion.integrate import METHODS, RATE_FRAME_NAMES, integrate
from hingepair.motion.trajectory import rotate_to_world
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.euler import euler_to_matrix
from hingepair.rotations.sequences import SEQUENCE_NAMES
from hingepair.scenes.assembly import Assembly
from hingepair.scenes.motions.functions import base_of, read_functions
from hingepair.scenes.motions.known import PSI, RATE_SUFFIXES, EulerBase, Known
from hingepair.scenes.motions.log_columns import EULER, HINGE_NAMES, LOG_ARRAYS, POSITION, QUATERNION, Log, log_path
from hingepair.scenes.motions.motion import Motion
from hingepair.scenes.tables import Table
from hingepair.tables.instants import MeasurementWarning, split_at_gaps
from hingepair.tables.suspicions import suspicions

_SMOOTHING_KEYS: Final = ("smooth", "loss", "gaps")
_INTEGRATION_KEYS: Final = ("psi_0", "method", "S1_0")
Parts = dict[str, list[Any]]  # quantities with their derivatives, by the name of the quantity; None if unknown


def read_log(tables: Table, folder: Path, assembly: Assembly) -> Motion:
    """Return the motion of the log that [motion] names, as it is, smoothed or integrated."""
    table = tables.table("motion")
    if assembly.planar:
        table.fail(
            "file",
            "no such key beside planar = true: without it, u1 and u2 have three numbers, n = [0, 0, 1], and a log in "
            "the plane needs no z, phi_x and phi_y",
        )
    if "time" in tables.values:
        tables.fail("time", "no such table, since the column t of motion.file has the instants")
    integrates, smooths = assembly.pair is not None and table.flag("integrate"), table.flag("smooth")
    options = ("file", "columns", "frame", *_SMOOTHING_KEYS, *(_INTEGRATION_KEYS if integrates else ("sequence",)))
    options = (*options, *(assembly.base_names if assembly.pair is None else ("integrate",)))
    assembly.check_joint_names(table, options)
    for key in _INTEGRATION_KEYS if assembly.pair is not None and not integrates else ():
        if key in table.values:
            table.fail(key, "no such key without integrate = true, which integrates a log of rates")
    table.check_keys(options)
    for key in _SMOOTHING_KEYS[1:] if not smooths else ():
        if key in table.values:
            table.fail(key, "no such key without smooth = true")
    if smooths and integrates:
        table.fail("smooth", "no such key together with integrate: smoothing computes all rates")
    log = Log(log_path(table, folder), assembly, table)
    return _integrated(table, log, assembly) if integrates else _sampled(table, log, assembly, smooths)


def _sampled(table: Table, log: Log, assembly: Assembly, smooths: bool) -> Motion:
    """Return the motion of the samples of a log, with derivatives up to the highest order that the log has, or with
    all of them where it is smoothed.
    """
    is_pair = assembly.pair is not None
    attitude = _attitude_names(log) if assembly.base_names else ()
    if is_pair and not attitude:
        log.notes.append("body 1 rests at the origin, since the log has psi alone")
    sequence = table.choice("sequence", SEQUENCE_NAMES, "XYZ")
    if attitude is QUATERNION and "sequence" in table.values:
        table.fail("sequence", "nothing, since the file has quaternions")
    groups = [POSITION, attitude] if attitude else []
    for name in assembly.names:
        names = tuple(name + ending for ending in RATE_SUFFIXES)
        if is_pair or not {*names}.isdisjoint(log.columns):
            groups.append(names)
    parts = {names[0]: log.derivatives(names) for names in groups}
    moving = tuple(name for name in assembly.names if name in parts)
    if not moving:
        log.refuse(assembly.names[0] if assembly.names else "t", "a column for each joint that moves", "none of them")
    base: Any
    if smooths:
        level = ACCELERATION
        base, parts, sure = _smoothed_parts(table, log, parts, attitude, sequence)
    else:
        sure, level = None, max(order for own in parts.values() for order in range(3) if own[order] is not None)
        for names in groups:
            for order in range(level + 1):
                if parts[names[0]][order] is None:
                    column = log.columns_of(names[order])[0]
                    log.refuse(column, "a column, since the log has other rates", "no such column")
        base = _base_of_samples(log, parts, attitude, sequence, _velocity_frame(table, log), level)
        if not level and is_pair:
            log.notes.append("the log has no rates: smooth = true in [motion] gives v2, a2, ...")
    functions = None if attitude or is_pair else read_functions(table, assembly, ())
    if functions is not None:
        base = base_of(assembly, functions.rows(log.t, level), sequence)
    rests = assembly.rests
    joints = tuple(
        tuple(_float_if_constant(parts[n][k]) if n in parts else rests[n] * (k == 0) for n in assembly.names)
        for k in range(level + 1)
    )
    return Motion(
        t=log.t,
        source=Known(assembly.names, log.t.size, joints, base),
        origin=f"samples in a file{', smoothed, with their rates' * smooths}",
        hint="" if smooths else log.hint,
        notes=tuple(log.notes),
        functions=functions,
        moving=moving,
        sure=sure,
    )


def _base_of_samples(
    log: Log, parts: Parts, attitude: tuple[str, ...], sequence: str, frame: str, level: int
) -> BodyMotion | EulerBase | None:
    """Return the motion of body 1 or the base that a log has, None without any."""
    if not attitude:
        return None
    turns, places = parts[attitude[0]], parts["R1"]
    if attitude is EULER:
        rows = [np.column_stack((places[k], turns[k])) for k in range(level + 1)]
        return EulerBase(tuple(tuple(map(_float_if_constant, row.T)) for row in rows), sequence)
    S = log.rotations(turns[0])
    rates = [rotate_to_world(S, own) if frame == "body" and own is not None else own for own in turns[1:]]
    arrays = {"R": places[0], "S": S, "v": places[1], "omega": rates[0], "a": places[2], "alpha": rates[1]}
    return BodyMotion(**dict([*arrays.items()][: 2 * level + 2]))


def _velocity_frame(table: Table, log: Log) -> str:
    """Return the axes of angular velocities, "body" or "world"; only a log that has some has the key `frame`."""
    rates = [column for name in QUATERNION[1:] for column in LOG_ARRAYS[name] if column in log.columns]
    if "frame" in table.values and not rates:
        table.fail("frame", "no such key, since the log has no omega1_x, omega1_y, omega1_z")
    if rates and "frame" not in table.values:
        axes = 'those of body 1, as a gyroscope has them, or "world", as hingepair writes them'
        table.fail("frame", f'the axes of {rates[0].partition("_")[0]} in the log: "body", {axes}')
    return table.choice("frame", RATE_FRAME_NAMES)


def _attitude_names(log: Log) -> tuple[str, ...]:
    """Return EULER or QUATERNION, whichever the log has, or nothing if it has no columns of body 1 or the base;
    refuse both, and a position without an attitude.
    """
    has = {name: any(column in log.columns for column in LOG_ARRAYS[name]) for name in LOG_ARRAYS}
    attitude_names, other_names = (EULER, QUATERNION) if has["phi"] else (QUATERNION, EULER)
    if not has[attitude_names[0]]:
        if not any(has[name] for name in (*POSITION, *EULER, *QUATERNION)):
            return ()
        hint = ", or motion.integrate = true for a log of rates" if has["omega1"] else ""
        log.refuse("phi_x", f"columns phi_x, phi_y, phi_z, or qx, qy, qz, qw{hint}", "neither")
    for column in (column for name in other_names for column in LOG_ARRAYS[name]):
        if column in log.columns:
            log.refuse(column, f"no such column in a log with {LOG_ARRAYS[attitude_names[0]][0]}", "a column")
    return attitude_names


def _float_if_constant(column: Float64Array) -> float | Float64Array:
    """Return a column, or one float if all its values are equal."""
    column = np.ascontiguousarray(column)
    return float(column[0]) if (column == column[0]).all() else column


# ---- smoothing


def _smoothed_parts(
    table: Table, log: Log, parts: Parts, attitude: tuple[str, ...], sequence: str
) -> tuple[BodyMotion | None, Parts, NDArray[np.bool_]]:
    """Return the smoothed motion of body 1 or the base, if the log has it, the coordinates of joints with their
    derivatives, and at which instants second derivatives are as accurate as elsewhere; add notes on noise and gaps.
    """
    _check_columns(log, parts, "samples of positions, attitudes and coordinates of joints alone", "smooth")
    samples: dict[str, Any] = {name: own[0] for name, own in parts.items() if name not in (*POSITION, *attitude)}
    if attitude:
        turns = parts[attitude[0]][0]
        S1 = np.asarray(euler_to_matrix(turns, sequence)) if attitude is EULER else log.rotations(turns)
        samples = {"body": BodyMotion(R=parts["R1"][0], S=S1), **samples}
    loss = table.choice("loss", tuple(LOSSES))
    with table.naming():
        longest = longest_filled(log.since, table.number("gaps") if "gaps" in table.values else None)
    texts: list[str] = []
    noise: list[str] = []
    body, joints, sure = None, Parts(), np.ones(log.t.size, dtype=bool)
    quantities: dict[str, tuple[NDArray[Any], NDArray[Any]]] = {}
    for name, own in samples.items():
        is_shift = name != "body" and log.unit_of(name) != "rad"
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", MeasurementWarning)
            with log.naming(body=name):
                # The shift of a slider is no angle, whose jumps might be whole turns: it is smoothed as a position.
                moved: Any = smooth(log.since, _along_x(own) if is_shift else own, gaps=longest, loss=loss)
        said = [str(warning.message) for warning in caught]
        if isinstance(own, np.ndarray):  # the log itself says whether angles may be degrees
            said = [text for text in said if text not in suspicions("angle", "body", own)]
        texts += [re.sub(r"\bbody\b|^angle(?=:)", name, text) for text in said]
        for rate in ("a", "alpha") if name == "body" else ("a",) if is_shift else ("psidd",):
            std = moved.std[rate].reshape(log.t.size, -1)[:, 0]
            sure &= ~(std > 2 * np.nanmedian(std))
        if name == "body":
            body = BodyMotion(**{letter: getattr(moved, letter) for letter in ("R", "S", "v", "omega", "a", "alpha")})
            noise += [f"{moved.noise['R']:.2g} m of position", f"{moved.noise['S']:.2g} rad of attitude"]
            quantities |= {"position": (own.R, moved.R), "attitude": (own.S, moved.S)}
        else:
            joints[name] = [array[:, 0] for array in (moved.R, moved.v, moved.a)] if is_shift else [*moved]
            noise.append(f"{moved.noise['R' if is_shift else 'psi']:.2g} {log.unit_of(name)} of {name}")
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
) -> Iterator[str]:
    """Yield sentences on samples that are missing or in series that are too short, and on the gaps [s] that cut the
    smoothing; `quantities` are the samples and what smoothing made of them, by name.
    """
    for name, (samples, result) in quantities.items():
        known, filled = (np.isfinite(array.reshape(len(t), -1)).all(axis=1) for array in (samples, result))
        if count := int((~known | ~filled).sum()):
            lost = f"{int((~known).sum())} of {len(t)} samples missing, {int((~known & filled).sum())} of them filled"
            alone = f"{int((known & ~filled).sum())} in series of fewer than {MIN_PIECE} between gaps left out"
            yield f"{name}: {lost}, {alone}; the first of these {count} at t = {t[~known | ~filled][0]:.6g} s"
        if cuts := split_at_gaps(t, known, gaps)[1:]:
            yield (
                f"{name}: smoothing is cut {len(cuts)} times, first before t = {t[cuts[0][0]]:.6g} s; rates beside a "
                "cut are as inaccurate as at the ends. gaps in [motion] is the longest time that is filled [s]"
            )


# ---- integration


def _integrated(table: Table, log: Log, assembly: Assembly) -> Motion:
    """Return the motion of a pair by rates (E12); without columns of its position, body 1 stays at the origin."""
    known = (*POSITION, *QUATERNION[1:], *HINGE_NAMES[1:])
    _check_columns(log, known, "columns of rates and of R1", "integrate")
    (omega1, alpha1), (psid, psidd) = log.derivatives(QUATERNION[1:]), log.derivatives(HINGE_NAMES[1:])
    log.check_finite("omega1", omega1)
    log.check_finite("psid", psid)
    moves = any(column in log.columns for name in POSITION for column in LOG_ARRAYS[name])
    R1, v1, a1 = log.derivatives(POSITION) if moves else [np.zeros((log.t.size, 3))] * 3
    if v1 is None:
        log.refuse("v1_x", "a column, since the log has x", "no such column")
    frame, method = _velocity_frame(table, log), table.choice("method", METHODS)
    start = table.rotation("S1_0") if "S1_0" in table.values else None
    with table.naming(psid="psi_dot"), warnings.catch_warnings():
        warnings.simplefilter("ignore", MeasurementWarning)  # notes say it
        found = integrate(
            assembly.pair, log.since, omega1, psid, S1_0=start, psi_0=table.number("psi_0", 0.0), method=method,
            frame=frame, outputs=(),
        )  # fmt: skip
    level = 2 if all(own is not None for own in (a1, alpha1, psidd)) else 1
    turns = [own if frame == "world" or own is None else rotate_to_world(found.S1, own) for own in (omega1, alpha1)]
    arrays = {"R": R1, "S": found.S1, "v": v1, "omega": turns[0], "a": a1, "alpha": turns[1]}
    body1 = BodyMotion(**dict([*arrays.items()][: 2 * level + 2]))
    return Motion(
        t=log.t,
        source=Known(PSI, log.t.size, tuple((own,) for own in (found.psi, psid, psidd)[: level + 1]), body1),
        moving=PSI,
        origin="integrated from rates",
        how=f"omega1 and psi' integrated by {method}",
        errors={"rad": lambda: float(np.maximum(found.error_estimate, found.psi_error_estimate))},
        doubt="too few samples to tell how far the integration is off",
        notes=tuple(log.notes),
    )


def _check_columns(log: Log, arrays: Iterable[str], wanted: str, key: str) -> None:
    """Refuse columns of a log that are none of those of `arrays`."""
    known = {"t", *(column for name in arrays for column in log.columns_of(name))}
    for column in log.columns:
        if column not in known:
            log.refuse(column, f"{wanted}, since motion.{key} is true", "a column")
