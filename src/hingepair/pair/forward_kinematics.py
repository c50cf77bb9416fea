"""Forward kinematics: the state of a pair from its coordinates, or from the motion of body 1."""

from __future__ import annotations

from typing import Any

from hingepair.engine.outputs import Out
from hingepair.errors import ArgumentError
from hingepair.pair.body_motion import BodyMotion, motion_inputs
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import COORDINATES, compute
from hingepair.plans.arguments import Arguments, Outputs, read_arguments, requested_outputs
from hingepair.plans.plan import SPATIAL_MOTION_KIND, MotionKind, default_outputs
from hingepair.rotations.sequences import find_sequence


def coordinate_rows(q: Any, qd: Any, qdd: Any) -> dict[str, Any]:
    """Return q, qd and qdd by name, as far as given.

    Raises:
        ArgumentError: second derivatives without first, or no coordinates.
    """
    if qdd is not None and qd is None:
        raise ArgumentError("qd", "the first derivatives too, since the second are given", None)
    if q is None:
        raise ArgumentError("q", "coordinates", None)
    return {name: row for name, row in (("q", q), ("qd", qd), ("qdd", qdd)) if row is not None}


def read_rows(kind: MotionKind, q: Any, qd: Any = None, qdd: Any = None) -> Arguments:
    """Check the coordinates of a pair and their derivatives, and return them in the form that calls take."""
    return read_arguments(coordinate_rows(q, qd, qdd), kind.shapes, COORDINATES[kind])


def from_coordinates(
    kind: MotionKind,
    pair: Constants,
    q: Any,
    qd: Any,
    qdd: Any,
    outputs: Outputs,
    out: Out,
    sequence: str | None,
    backend: str,
    workers: int,
) -> Any:
    """Compute the state of a pair from coordinates and, if given, their derivatives (E1-E11).

    Raises:
        ArgumentError: an argument cannot be used.
    """
    rows = (q,) if qd is None and qdd is None else (q, qd) if qdd is None else (q, qd, qdd)
    if type(outputs) is list:
        outputs = tuple(outputs)
    added = tuple(out) if outputs is None and type(out) is dict else None  # outputs that `out` asks for
    key = outputs, added, sequence, backend, len(rows)
    state = pair.cache.again(key, rows, out, workers)
    if state is not None:
        return state
    given = coordinate_rows(q, qd, qdd)
    if sequence is not None or kind is SPATIAL_MOTION_KIND:
        find_sequence(sequence)  # type: ignore[arg-type]
    names = requested_outputs(outputs, out, kind.levels, default_outputs(len(given) - 1, kind))
    lasts = isinstance(outputs, tuple | None) and (out is None or type(out) is dict)
    return compute(
        kind, pair, names, given, out=out, sequence=sequence, backend=backend, workers=workers,
        key=key if lasts else None,
    )  # fmt: skip


def from_body1(
    pair: Constants,
    body1: BodyMotion,
    psi: Any,
    psid: Any,
    psidd: Any,
    outputs: Outputs,
    out: Out,
    backend: str,
    workers: int,
) -> Any:
    """Compute the state of a pair from the motion of body 1 and the hinge angle (E1, E2, E5-E9).

    Raises:
        ArgumentError: an argument cannot be used.
    """
    given = body1_inputs(body1, psi, psid, psidd)
    level = ("psid" in given) + ("psidd" in given)
    names = requested_outputs(outputs, out, SPATIAL_MOTION_KIND.levels, default_outputs(level))
    return compute(SPATIAL_MOTION_KIND, pair, names, given, out=out, backend=backend, workers=workers)


def body1_inputs(body1: BodyMotion, psi: Any, psid: Any = None, psidd: Any = None) -> dict[str, Any]:
    """Return the motion of body 1 and the hinge angle by input name.

    Raises:
        ArgumentError: `body1` is no BodyMotion, or a derivative is given without those before it.
    """
    if psidd is not None and psid is None:
        raise ArgumentError("psid", "the first derivative too, since the second is given", None)
    if psi is None:
        raise ArgumentError("psi", "hinge angles", None)
    hinge = {name: value for name, value in (("psi", psi), ("psid", psid), ("psidd", psidd)) if value is not None}
    return {**motion_inputs("body1", body1), **hinge}
