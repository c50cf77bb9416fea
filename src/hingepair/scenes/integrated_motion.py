"""Motion by rates: the angular velocity of body 1 and the hinge rate, integrated (E12)."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, SceneError
from hingepair.evaluation.backend import choose
from hingepair.integration.attitude_steps import RULES
from hingepair.integration.integrate import FRAMES
from hingepair.integration.later import Later
from hingepair.integration.routes import (
    METHODS,
    Course,
    check_reached,
    check_tolerance,
    hinge_angles,
    plain_steps,
    plane_angle,
    space_attitudes,
)
from hingepair.integration.signals import Constant, Signal
from hingepair.integration.trajectory import rotations
from hingepair.integration.trajectory_state import turned
from hingepair.numeric.arrays import check_choice, read_only
from hingepair.pair.body_motion import BodyMotion
from hingepair.rotations.matrices import check_rotation
from hingepair.scenes.known_motion import BodySamples, PlanarSamples, Rows, Samples
from hingepair.scenes.tables import Table

Float64Array: TypeAlias = NDArray[np.float64]

START: Final = ("psi_0", "method")
"""Keys that every such motion may have in its table, beside S1_0 and frame in space, phi_0 in the plane."""

_KEYS: Final = {"omega1(t)": "omega1", "psi_dot(t)": "psi_dot", "psid": "psi_dot"}

STILL: Final = Constant(np.zeros(()))


@dataclass(frozen=True, slots=True, eq=False)
class IntegratedMotion:
    """A motion found from rates.

    Attributes:
        t: instants; shape (N,) s.
        given: the motion at these instants.
        method: how it was found.
        error_estimate: how far attitude and psi are off at the worst instant [rad]; NaN where too few samples cannot
            tell.
    """

    t: Float64Array
    given: BodySamples | PlanarSamples
    method: str
    error_estimate: float
    origin: ClassVar[str] = "integrated from rates"

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

    def samples(self, rows: Rows, order: int) -> Samples:
        """The motion at some of the instants, with derivatives up to an order."""
        return self.given.part(rows, order)


def integrated_in_space(
    table: Table,
    t: Float64Array,
    signals: tuple[Signal, Signal],
    known: Mapping[str, Float64Array],
    tol: float | None,
) -> IntegratedMotion:
    """The motion from rates; `known` are R1 and derivatives at the instants, and psi from t = 0 where it is exact."""
    body = _choice(table, "frame", FRAMES) == "body"
    course = Course(t, _choice(table, "method", METHODS), tol, choose("auto", 1), body)
    omega, psid = signals if "psi" not in known else (signals[0], STILL)
    with _named(table):
        check_tolerance(tol)
        found = space_attitudes(course, omega, psid, _attitude(table))
        hinge = hinge_angles(course, psid, _number(table, "psi_0"), found.steps)
        _check_reached(table, tol, found.error, hinge.error)
        error = float(np.maximum(found.error(), hinge.error()))
    psi = hinge.values + _since_start(known, "psi")
    S1 = rotations(found.values)
    rates = {name: known[name] for name in ("omega1", "alpha1") if name in known}
    if body:
        rates = {name: turned(S1, values) for name, values in rates.items()}
    body1, angles = {"R": known["R1"], "S": S1, "v": known["v1"], "omega": rates["omega1"]}, [psi, known["psid"]]
    if {"alpha1", "psidd", "a1"} <= known.keys():
        body1 |= {"a": known["a1"], "alpha": rates["alpha1"]}
        angles.append(known["psidd"])
    given = BodySamples(BodyMotion(**body1), tuple(angles))
    return IntegratedMotion(read_only(t), given, course.method, error)


def integrated_in_plane(
    table: Table,
    t: Float64Array,
    signals: tuple[Signal, Signal],
    known: Mapping[str, Float64Array],
    tol: float,
) -> IntegratedMotion:
    """The same of a planar pair (E11): two sums; `known` has x, y with their derivatives as R1, v1, a1."""
    method = _choice(table, "method", tuple(RULES))
    course, rule = Course(t, method, tol, choose("auto", 1), False), RULES[method]
    rates = tuple(STILL if whole in known else signal for whole, signal in zip(("phi", "psi"), signals, strict=True))
    with _named(table):
        check_tolerance(tol)
        steps = plain_steps(course, rates, rule)
        phi, psi = (
            plane_angle(course, name, rate, _number(table, key), steps, rule)
            for name, rate, key in zip(("omega1", "psi_dot"), rates, ("phi_0", "psi_0"), strict=True)
        )
        _check_reached(table, tol, phi.error, psi.error)
        error = float(np.maximum(phi.error(), psi.error()))
    angles = phi.values + _since_start(known, "phi"), psi.values + _since_start(known, "psi")
    derivatives = (
        (*known["R1"].T, *angles),
        (*known["v1"].T, known["omega1"], known["psid"]),
        (*known["a1"].T, known["alpha1"], known["psidd"]),
    )
    return IntegratedMotion(read_only(t), PlanarSamples(t.size, derivatives), method, error)


def _check_reached(table: Table, tol: float | None, turn: Later, hinge: Later) -> None:
    """Refuse a tolerance that the scene asks for; where it asks for none, what is left is reported, not refused."""
    if "tol" in table.values:
        check_reached(tol, {"omega1": turn, "psi_dot": hinge})


def _since_start(known: Mapping[str, Float64Array], name: str) -> Float64Array | float:
    """What an angle has turned since the first instant, where it is known exactly."""
    return known[name] - known[name][0] if name in known else 0.0


@contextlib.contextmanager
def _named(table: Table) -> Iterator[None]:
    """Errors of integration as errors of the scene's keys."""
    try:
        yield
    except SceneError:
        raise
    except ArgumentError as error:
        raise SceneError(table.label(_KEYS.get(error.name, error.name)), error.expected, error.got) from None


def _number(table: Table, key: str) -> float:
    return table.number(key) if key in table.values else 0.0


def _choice(table: Table, key: str, known: tuple[str, ...]) -> str:
    value = table.text(key, default=known[0])
    try:
        check_choice(key, value, known)
    except ArgumentError as error:
        raise SceneError(table.label(key), error.expected, error.got) from None
    return value


def _attitude(table: Table) -> Float64Array:
    if "S1_0" not in table.values:
        return np.eye(3)
    S1_0 = np.array(table.numbers("S1_0", 3, 3), dtype=float)
    check_rotation("S1_0", S1_0)
    return S1_0
