"""Motion by rates: the angular velocity of body 1 and the hinge rate, integrated (E12)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from hingepair.evaluation.backend import choose
from hingepair.integration.integrate import FRAMES
from hingepair.integration.methods import RULES
from hingepair.integration.signals import Signal
from hingepair.integration.solve import METHODS, Course, Solution, solve
from hingepair.integration.trajectory import rotations, world_vectors
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.pair.body_motion import BodyMotion
from hingepair.rotations.matrices import check_rotation
from hingepair.scenes.known_motion import ByBody1, ByCoordinates, HeldMotion, KnownMotion
from hingepair.scenes.tables import Table

START: Final = ("psi_0", "method")
"""Keys that every such motion may have in its table, beside S1_0 and frame in space, phi_0 in the plane."""

_NAMES: Final = ("omega1", "psi_dot")
_KEYS: Final = {"omega1(t)": "omega1", "psi_dot(t)": "psi_dot", "psid": "psi_dot"}


def _motion(t: Float64Array, given: KnownMotion, method: str, error: float, **notes: Any) -> HeldMotion:
    known = "unknown" if math.isnan(error) else f"about {error:.1g} rad"
    turning = f"omega1 and psi' integrated by {method}, error {known}"
    doubt = "too few samples to tell how far the integration is off"
    return HeldMotion(read_only(t), given, "integrated from rates", turning, error, doubt, **notes)


def integrated_in_space(
    table: Table,
    t: Float64Array,
    signals: tuple[Signal, Signal],
    known: Mapping[str, Float64Array],
    tol: float | None,
    **notes: Any,
) -> HeldMotion:
    """The motion from rates.

    Args:
        table: [motion], with what the motion starts from, frame and method.
        t: instants.
        signals: omega1 and psi'.
        known: at the instants R1, v1, omega1, psid, and a1, alpha1, psidd where these are known.
        tol: the error that is aimed at; refused where it is missed and the table asks for it.
        notes: switched and hint of the motion.
    """
    body = table.choice("frame", FRAMES) == "body"
    course = Course(t, table.choice("method", METHODS), tol, choose("auto", 1), body, _NAMES)
    with table.naming(**_KEYS):
        start = np.array(table.rotation("S1_0") if "S1_0" in table.values else np.eye(3))
        check_rotation("S1_0", start)
        found = _solved(table, course, signals, start)
    S1 = rotations(found.turned)
    rates = {name: known[name] for name in ("omega1", "alpha1") if name in known}
    if body:
        rates = {name: world_vectors(S1, values) for name, values in rates.items()}
    body1, angles = {"R": known["R1"], "S": S1, "v": known["v1"], "omega": rates["omega1"]}, [known["psid"]]
    if {"alpha1", "psidd", "a1"} <= known.keys():
        body1 |= {"a": known["a1"], "alpha": rates["alpha1"]}
        angles.append(known["psidd"])
    given = ByBody1(BodyMotion(**body1), (found.psi, *angles))
    return _motion(t, given, course.method, found.worst, **notes)


def integrated_in_plane(
    table: Table,
    t: Float64Array,
    signals: tuple[Signal, Signal],
    known: Mapping[str, Float64Array],
    tol: float,
    **notes: Any,
) -> HeldMotion:
    """The same of a planar pair (E11): two sums; `known` has x, y with their derivatives as R1, v1, a1."""
    method = table.choice("method", tuple(RULES))
    course = Course(t, method, tol, choose("auto", 1), False, _NAMES)
    with table.naming(**_KEYS):
        found = _solved(table, course, signals, table.number("phi_0", 0.0))
    derivatives = (
        (*known["R1"].T, found.turned, found.psi),
        (*known["v1"].T, known["omega1"], known["psid"]),
        (*known["a1"].T, known["alpha1"], known["psidd"]),
    )
    return _motion(t, ByCoordinates(t.size, derivatives, None), method, found.worst, **notes)


def _solved(table: Table, course: Course, rates: tuple[Signal, Signal], start: Float64Array | float) -> Solution:
    """What the rates come to. A tolerance is refused where the scene asks for it; else what is left is reported."""
    found = solve(course, *rates, start, table.number("psi_0", 0.0))
    if "tol" in table.values:
        found.check(course)
    return found
