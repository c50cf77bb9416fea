"""Motion by rates: the angular velocity of body 1 and the hinge rate, integrated (E12)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.evaluation.backend import choose
from hingepair.integration.integrate import FRAMES
from hingepair.integration.methods import RULES
from hingepair.integration.signals import Signal
from hingepair.integration.solve import METHODS, Course, Solution, solve
from hingepair.integration.trajectory import rotations, world_vectors
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.pair.body_motion import BodyMotion
from hingepair.rotations.matrices import check_rotation
from hingepair.scenes.instants import Rows
from hingepair.scenes.known_motion import ByBody1, ByCoordinates, KnownMotion
from hingepair.scenes.tables import Table

START: Final = ("psi_0", "method")
"""Keys that every such motion may have in its table, beside S1_0 and frame in space, phi_0 in the plane."""

_NAMES: Final = ("omega1", "psi_dot")
_KEYS: Final = {"omega1(t)": "omega1", "psi_dot(t)": "psi_dot", "psid": "psi_dot"}


@dataclass(frozen=True, slots=True, eq=False)
class IntegratedMotion:
    """A motion found from rates.

    Attributes:
        t: instants; shape (N,) s.
        given: the motion at these instants.
        method: how it was found.
        error_estimate: how far attitude and psi are off at the worst instant [rad]; NaN where too few samples cannot
            tell.
        switched: whether a rate has a kink or a jump between neighbouring instants; shape (N - 1,); None: none has.
        hint: how to get derivatives that are missing, for messages.
    """

    t: Float64Array
    given: ByBody1 | ByCoordinates
    method: str
    error_estimate: float
    switched: NDArray[np.bool_] | None = None
    hint: str = ""
    origin: ClassVar[str] = "integrated from rates"
    doubt: ClassVar[str] = "too few samples to tell how far the integration is off"

    @property
    def level(self) -> int:
        """The highest derivative that there is."""
        return self.given.level

    @property
    def sequence(self) -> None:
        """None: the attitude is no three Euler angles."""
        return

    @property
    def turning(self) -> str:
        """How body 1 turns, for a reader."""
        error = "unknown" if math.isnan(self.error_estimate) else f"about {self.error_estimate:.1g} rad"
        return f"omega1 and psi' integrated by {self.method}, error {error}"

    def kinks(self, start: int, stop: int) -> int:
        """How many of the intervals that end at these instants have a kink or a jump of a rate."""
        return 0 if self.switched is None else int(self.switched[max(start - 1, 0) : max(stop - 1, 0)].sum())

    def known(self, rows: Rows, order: int) -> KnownMotion:
        """The motion at some of the instants, with derivatives up to an order."""
        return self.given.part(rows, order)


def integrated_in_space(
    table: Table,
    t: Float64Array,
    signals: tuple[Signal, Signal],
    known: Mapping[str, Float64Array],
    tol: float | None,
    **notes: Any,
) -> IntegratedMotion:
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
    return IntegratedMotion(read_only(t), given, course.method, found.worst, **notes)


def integrated_in_plane(
    table: Table,
    t: Float64Array,
    signals: tuple[Signal, Signal],
    known: Mapping[str, Float64Array],
    tol: float,
    **notes: Any,
) -> IntegratedMotion:
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
    return IntegratedMotion(read_only(t), ByCoordinates(t.size, derivatives, None), method, found.worst, **notes)


def _solved(table: Table, course: Course, rates: tuple[Signal, Signal], start: Float64Array | float) -> Solution:
    """What the rates come to. A tolerance is refused where the scene asks for it; else what is left is reported."""
    found = solve(course, *rates, start, table.number("psi_0", 0.0))
    if "tol" in table.values:
        found.check(course)
    return found
