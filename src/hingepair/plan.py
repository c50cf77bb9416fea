"""What to compute: the equations as a graph of steps, of which a plan takes those that the outputs need.

Every way to evaluate the pair - one state in Python floats, blocks of NumPy arrays, SymPy symbols, mpmath numbers -
runs the steps of one plan, so the equations are put together here and nowhere else.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from hingepair import equations as eq
from hingepair.blocks import angle_terms, hinge_terms
from hingepair.errors import ArgumentError, choices
from hingepair.euler import find_sequence


class Output(NamedTuple):
    """One thing that can be asked for: its shape per sample, and the level at which it is a default output."""

    tail: tuple[int, ...]
    default_level: int | None


POSE, VELOCITY, ACCELERATION = 0, 1, 2

OUTPUTS = {
    "R2": Output((3,), POSE),
    "S2": Output((3, 3), POSE),
    "d": Output((3,), POSE),
    "v2": Output((3,), VELOCITY),
    "omega2": Output((3,), VELOCITY),
    "a2": Output((3,), ACCELERATION),
    "alpha2": Output((3,), ACCELERATION),
    "R1": Output((3,), None),
    "S1": Output((3, 3), None),
    "v1": Output((3,), None),
    "omega1": Output((3,), None),
    "a1": Output((3,), None),
    "alpha1": Output((3,), None),
}
"""Everything of both bodies by name; without a default level, only computed when named."""


class Step(NamedTuple):
    """One equation: result = function(*arguments), all by name."""

    result: str
    function: Callable[..., Any]
    arguments: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The steps that lead from what is given to the outputs, in order.

    Attributes:
        outputs: names, in the order asked for.
        steps: what is computed.
        inputs: which of the given things are needed.
        skipped: the results of the steps that nothing needs.
        sequence: of the Euler angles; None where S1, omega1 and alpha1 are given.
        home: whether C differs from the identity.
    """

    outputs: tuple[str, ...]
    steps: tuple[Step, ...]
    inputs: frozenset[str]
    skipped: tuple[str, ...]
    sequence: str | None
    home: bool

    def run(self, values: dict[str, Any]) -> dict[str, Any]:
        """Run the steps on values by name; the results join the values."""
        for result, function, arguments in self.steps:
            values[result] = function(*[values[name] for name in arguments])
        return values


HINGE_STEPS = (
    Step("Sh", eq.hinge_rotation, ("n", "hinge")),
    Step("S2", eq.attitude2, ("S1", "Sh", "home")),
    Step("r1", eq.rotate, ("S1", "u1")),
    Step("r2", eq.rotate, ("S2", "u2")),
    Step("d", eq.subtract, ("r1", "r2")),
    Step("R2", eq.position2, ("R1", "d")),
    Step("axis", eq.rotate, ("S1", "n")),
    Step("omega2", eq.angular_velocity2, ("omega1", "axis", "psid")),
    Step("v2", eq.velocity2, ("v1", "omega1", "r1", "omega2", "r2")),
    Step("alpha2", eq.angular_acceleration2, ("alpha1", "omega1", "axis", "psid", "psidd")),
    Step("a2", eq.acceleration2, ("a1", "omega1", "alpha1", "r1", "omega2", "alpha2", "r2")),
)
"""Body 2 from body 1 and the hinge (E1, E2, E5-E9)."""

_WITHOUT_HOME = Step("S2", eq.compose, ("S1", "Sh"))

Terms: TypeAlias = tuple[Callable[..., Any], Callable[..., Any]]
NUMERIC: Terms = (angle_terms, hinge_terms)
"""How floats and arrays make the sines and cosines of phi and of psi."""


@functools.lru_cache(maxsize=256)
def make_plan(
    outputs: tuple[str, ...], sequence: str | None = "XYZ", home: bool = True, terms: Terms = NUMERIC
) -> Plan:
    """The plan for some outputs.

    Args:
        outputs: names out of OUTPUTS.
        sequence: of the Euler angles; None where S1, omega1 and alpha1 are given.
        home: whether C differs from the identity.
        terms: what makes (sin, cos) of the three angles and (sin, 1 - cos) of psi in the numbers at hand.
    """
    steps = _all_steps(sequence, home, terms)
    needed = set(outputs)
    taken = []
    for step in reversed(steps):
        if step.result in needed:
            taken.append(step)
            needed.update(step.arguments)
    made = {step.result for step in taken}
    skipped = tuple(step.result for step in steps if step.result not in made)
    return Plan(outputs, tuple(reversed(taken)), frozenset(needed - made), skipped, sequence, home)


@functools.cache
def default_outputs(level: int) -> tuple[str, ...]:
    """The outputs that a level brings without being named."""
    return tuple(
        name for name, output in OUTPUTS.items() if output.default_level is not None and output.default_level <= level
    )


def check_outputs(outputs: Any) -> tuple[str, ...]:
    """The names asked for, each once.

    Raises:
        ArgumentError: not a collection of known names.
    """
    if isinstance(outputs, str):
        raise ArgumentError("outputs", "a tuple of names such as ('R2', 'v2')", outputs)
    try:
        names = tuple(dict.fromkeys(outputs))
    except TypeError:
        raise ArgumentError("outputs", "a tuple of names such as ('R2', 'v2')", outputs) from None
    if not names:
        raise ArgumentError("outputs", "at least one name", "none")
    for name in names:
        if name not in OUTPUTS:
            raise ArgumentError("outputs", choices(tuple(OUTPUTS)), name)
    return names


def _euler_steps(sequence: str) -> tuple[Step, ...]:
    """Body 1 from its Euler angles (E4, E10)."""
    order = find_sequence(sequence)
    if sequence == "XYZ":
        return (
            Step("S1", eq.tait_bryan_attitude, ("trig",)),
            Step("axes", eq.tait_bryan_axes, ("trig",)),
            Step("omega1", eq.angular_velocity1, ("axes", "phid")),
            Step("alpha1", eq.angular_acceleration1, ("axes", "phid", "phidd")),
        )
    return (
        Step("S1", order.attitude, ("trig",)),
        Step("axes", order.axes, ("trig",)),
        Step("omega1", order.angular_velocity, ("axes", "phid")),
        Step("alpha1", order.angular_acceleration, ("axes", "phid", "phidd")),
    )


def _all_steps(sequence: str | None, home: bool, terms: Terms) -> list[Step]:
    angle_terms, hinge_terms = terms
    steps = [Step("hinge", hinge_terms, ("psi",))]
    if sequence == "XYZ":
        steps.append(Step("trig", angle_terms, ("phi",)))
    elif sequence is not None:
        steps.append(Step("angles", find_sequence(sequence).angles, ("phi",)))
        steps.append(Step("trig", angle_terms, ("angles",)))
    if sequence is not None:
        steps += _euler_steps(sequence)
    steps += HINGE_STEPS
    return steps if home else [_WITHOUT_HOME if step.result == "S2" else step for step in steps]
