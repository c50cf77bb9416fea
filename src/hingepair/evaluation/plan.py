"""What to compute: the equations as a graph of steps, of which a plan takes those that the outputs need.

Every way to evaluate the pair - one state in Python floats, blocks of NumPy arrays, SymPy symbols, mpmath numbers -
runs the steps of one plan, so the equations are put together here and nowhere else.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.evaluation.steps import (
    GIVEN_S1,
    HINGE_STEPS,
    LEVER_STEPS,
    PLANAR_STEPS,
    WITHOUT_HOME,
    Step,
    same,
)
from hingepair.evaluation.trace import name_lines
from hingepair.numeric.blocks import angle_terms, hinge_cosine, hinge_terms
from hingepair.rotations.sequences import find_sequence


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

PLANAR_OUTPUTS = {
    "R2": Output((2,), POSE),
    "phi2": Output((), POSE),
    "d": Output((2,), POSE),
    "v2": Output((2,), VELOCITY),
    "omega2": Output((), VELOCITY),
    "a2": Output((2,), ACCELERATION),
    "alpha2": Output((), ACCELERATION),
}
"""Everything of body 2 of a planar pair."""

SPATIAL, PLANAR = "spatial", "planar"
"""Kinds of plan: motion in space, and in two coordinates (E11)."""

INPUTS: dict[str, tuple[int, ...]] = {
    **dict.fromkeys(("R1", "v1", "omega1", "a1", "alpha1", "R2", "v2", "omega2", "a2", "alpha2"), (3,)),
    **dict.fromkeys(("phi", "phid", "phidd", "u1", "u2", "n", "along", "across", "around"), (3,)),
    **dict.fromkeys(("psi", "psid", "psidd", "phi1", "phi1d", "phi1dd", "psid_given", "hinge_torque"), ()),
    **dict.fromkeys(("S1", "S2"), (3, 3)),
    **dict.fromkeys(("q", "qd", "qdd"), (7,)),
    **dict.fromkeys(("home", "I1", "I2"), (9,)),
    **dict.fromkeys(("m1", "m2"), ()),
}
"""The shape of one sample of what can be given in space."""

PLANAR_INPUTS = {
    **INPUTS,
    **dict.fromkeys(("R1", "v1", "a1", "u1", "u2"), (2,)),
    **dict.fromkeys(("q", "qd", "qdd"), (4,)),
}
"""The same in the plane."""


_LABELS = {
    "hinge": ("sin_psi", "versine_psi", "cos_psi"),
    "trig": ("sin_x", "cos_x", "sin_y", "cos_y", "sin_z", "cos_z"),
    "turn1": ("sin_phi", "cos_phi"),
    "axes": ("b_y", "b_z", "c_x", "c_y", "c_z"),
}
"""What components are called in generated code, where their step's name and a letter would say less."""


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
        kind: SPATIAL or PLANAR.
    """

    outputs: tuple[str, ...]
    steps: tuple[Step, ...]
    inputs: frozenset[str]
    skipped: tuple[str, ...]
    sequence: str | None
    home: bool
    kind: str

    def run(self, values: dict[str, Any]) -> dict[str, Any]:
        """Run the steps on values by name; the results join the values."""
        for result, function, arguments in self.steps:
            made = values[result] = function(*[values[name] for name in arguments])
            name_lines(result, made, _LABELS.get(result))
        return values


Terms: TypeAlias = tuple[Callable[..., Any], Callable[..., Any]]
NUMERIC: Terms = (angle_terms, hinge_terms)
"""How floats and arrays make the sines and cosines of phi and of psi."""


def make_plan(
    outputs: tuple[str, ...],
    sequence: str | None = "XYZ",
    home: bool = True,
    terms: Terms = NUMERIC,
    kind: str = SPATIAL,
) -> Plan:
    """The plan for some outputs.

    Args:
        outputs: names out of OUTPUTS.
        sequence: of the Euler angles; None where S1, omega1 and alpha1 are given.
        home: whether C differs from the identity.
        terms: what makes (sin, cos) of the three angles and (sin, 1 - cos) of psi in the numbers at hand. Exact
            numbers (other terms than NUMERIC) go through LEVER_STEPS as well; doubles find them done in the pair.
        kind: SPATIAL or PLANAR; the latter takes phi1 for the three angles.

    Returns:
        The same object for the same arguments, however they are given: programs and kernels hang on it.
    """
    return _plan(outputs, sequence, home, terms, kind)


@functools.lru_cache(maxsize=1024)
def _plan(outputs: tuple[str, ...], sequence: str | None, home: bool, terms: Terms, kind: str) -> Plan:
    steps = steps_of(sequence, home, terms) if kind == SPATIAL else _planar_steps(terms)
    taken, inputs = needed_steps(steps, outputs)
    made = {step.result for step in taken}
    skipped = tuple(step.result for step in steps if step.result not in made)
    return Plan(outputs, taken, inputs, skipped, sequence, home, kind)


def needed_steps(steps: Iterable[Step], outputs: Iterable[str]) -> tuple[tuple[Step, ...], frozenset[str]]:
    """Those of the steps that lead to the outputs, and what must be given for them."""
    needed = set(outputs)
    taken = []
    for step in reversed(tuple(steps)):
        if step.result in needed:
            taken.append(step)
            needed.update(step.arguments)
    return tuple(reversed(taken)), frozenset(needed - {step.result for step in taken})


def outputs_of(kind: str) -> dict[str, Output]:
    """What a kind of plan can compute."""
    return PLANAR_OUTPUTS if kind == PLANAR else OUTPUTS


@functools.cache
def default_outputs(level: int, kind: str = SPATIAL) -> tuple[str, ...]:
    """The outputs that a level brings without being named."""
    levels = {name: output.default_level for name, output in outputs_of(kind).items()}
    return tuple(name for name, own in levels.items() if own is not None and own <= level)


def check_outputs(outputs: Any, kind: str = SPATIAL, also: tuple[str, ...] = ()) -> tuple[str, ...]:
    """The names asked for, each once, out of what a kind of plan can compute, and of `also`."""
    return check_names(outputs, (*outputs_of(kind), *also))


def check_names(outputs: Any, known: Collection[str]) -> tuple[str, ...]:
    """The names asked for, each once.

    Raises:
        ArgumentError: not a collection of known names.
    """
    try:
        names = () if isinstance(outputs, str) else tuple(dict.fromkeys(outputs))
    except TypeError:
        names = ()
    if not names:
        raise ArgumentError("outputs", "a tuple of names such as ('R2', 'v2')", quoted(outputs))
    for name in names:
        if name not in known:
            raise ArgumentError("outputs", choices(tuple(known)), quoted(name))
    return names


@functools.lru_cache(maxsize=256)
def steps_of(sequence: str | None, home: bool, terms: Terms = NUMERIC) -> tuple[Step, ...]:
    """All steps of motion in space; the arguments are those of `make_plan`."""
    angle_terms, hinge_terms = terms
    if terms is NUMERIC:
        steps = [Step("hinge", hinge_terms, ("psi",)), Step("cosine", hinge_cosine, ("hinge",))]
    else:
        arm = LEVER_STEPS[0] if home else Step("arm", same, ("u2",))
        steps = [Step("hinge", hinge_terms, ("psi",)), Step("cosine", eq.cosine, ("hinge",)), arm, *LEVER_STEPS[1:]]
    if sequence == "XYZ":
        steps.append(Step("trig", angle_terms, ("phi",)))
    elif sequence is not None:
        steps.append(Step("angles", find_sequence(sequence).angles, ("phi",)))
        steps.append(Step("trig", angle_terms, ("angles",)))
    if sequence is not None:  # body 1 from its Euler angles (E4, E10)
        order = find_sequence(sequence)
        steps += (
            Step("S1", order.attitude, ("trig",)),
            Step("axes", order.axes, ("trig",)),
            Step("omega1", order.angular_velocity, ("axes", "phid")),
            Step("alpha1", order.angular_acceleration, ("axes", "phid", "phidd")),
        )
    own = GIVEN_S1 if sequence is None else {}
    for step in HINGE_STEPS:
        steps += own.get(step.result, (step,))
    return tuple(steps if home else [WITHOUT_HOME if step.result == "S2" else step for step in steps])


def _planar_steps(terms: Terms) -> tuple[Step, ...]:
    """The steps of a planar pair; numbers of another kind make the two turns their own way."""
    if terms == NUMERIC:
        return PLANAR_STEPS
    angle_terms, hinge_terms = terms
    own: dict[str, Callable[..., Any]] = {
        "hinge": hinge_terms,
        "cosine": eq.cosine,
        "turn1": lambda phi1: angle_terms((phi1,)),
    }
    return tuple(step._replace(function=own.get(step.result, step.function)) for step in PLANAR_STEPS)
