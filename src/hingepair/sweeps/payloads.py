"""Variants of a scene that differ in payload alone: one program computes them all, with an axis of variants.

The masses and moments of a robot's program are linear in those of a payload (T9). Their slopes are computed once, in
exact arithmetic; those of every variant follow in numbers of twice the precision, and are rounded once.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.arguments import read_arguments
from hingepair.mechanism.constants import (
    RobotConstants,
    exact_mass_numbers,
    payload_derivatives,
    program_numbers,
    robot_constants,
    split_numbers,
)
from hingepair.mechanism.evaluate import RobotComputation
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.states import MechanismForces, joint_results_class
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.twofold import Twofold, exact_product
from hingepair.pair.body import Body
from hingepair.scenes.mechanisms.mechanism_table import with_payload
from hingepair.scenes.mechanisms.scene import MechanismScene, MechanismSceneResult
from hingepair.scenes.pair_table import BODY_KEYS, made
from hingepair.scenes.tables import Table

_PAYLOAD_PATH: Final = ("mechanism", "payload")
"""Keys that lead to the payload in a scene of a mechanism."""
_MAX_SIZE: Final = 1e100  # of mass, lever and inertia, in SI units; products of three of them do not overflow
_MOMENT_ENTRIES: Final = (
    (0, 0),
    (0, 1),
    (0, 2),
    (1, 1),
    (1, 2),
    (2, 2),
)  # entries of a second moment, in their order


class _Varied(NamedTuple):
    """A varied number of a body: its place among the varied numbers, and which property it is."""

    place: int
    name: str  # mass, center_of_mass or inertia
    component: int


class _Payload(NamedTuple):
    """A payload of which numbers are varied.

    Attributes:
        body: the properties that are not varied; its inertia is for each kilogram where `inertia_per_mass`.
        inertia_per_mass: whether the inertia follows from the mass.
        varied: its varied numbers.
    """

    body: Body
    inertia_per_mass: bool
    varied: tuple[_Varied, ...]

    def properties(self, rows: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return mass (variants,), centre of mass (variants, 3) and inertia (variants, 3, 3) of all variants."""
        count = len(rows)
        mass = np.full(count, self.body.mass)
        centre = np.tile(self.body.center_of_mass, (count, 1))
        inertia = np.tile(self.body.inertia, (count, 1, 1))
        for place, name, component in self.varied:
            if name == "mass":
                mass = rows[:, place]
            elif name == "center_of_mass":
                centre[:, component] = rows[:, place]
            else:
                inertia[:, component, component] = rows[:, place]
        return mass, centre, inertia * mass[:, None, None] if self.inertia_per_mass else inertia

    def is_plain(self, rows: Float64Array) -> bool:
        """Return whether a rigid body certainly has the properties of every variant, which need no other check."""
        mass, centre, inertia = self.properties(rows)
        sizes = (np.abs(part).max(initial=0.0) for part in (mass, centre, inertia))
        if not (all(size < _MAX_SIZE for size in sizes) and (mass > 0).all()):
            return False
        if not any(own.name == "inertia" for own in self.varied):
            return True
        moments = np.diagonal(inertia, axis1=1, axis2=2)
        return bool(((moments > 0) & (2 * moments <= moments.sum(axis=1, keepdims=True))).all())

    def moments(self, rows: Float64Array) -> list[Twofold]:
        """Return mass, first moment and second moment about the frame's origin: ten numbers of all variants."""
        mass, centre, inertia = self.properties(rows)
        first = [Twofold(*exact_product(mass, centre[:, i])) for i in range(3)]
        entries = [[Twofold(inertia[:, i, j]) for j in range(3)] for i in range(3)]
        half = (entries[0][0] + entries[1][1] + entries[2][2]) * Twofold(0.5)
        second = [
            (half - entries[i][j] if i == j else -entries[i][j]) + first[i] * Twofold(centre[:, j])
            for i, j in _MOMENT_ENTRIES
        ]
        return [Twofold(mass), *first, *second]


class PayloadVariants:
    """Variants of a scene of a robot that differ in the mass properties of payloads.

    Args:
        scene: as its file has it.
        robot: without the payloads whose numbers are varied.
        payloads: those whose numbers are varied, by link.
        outputs: what is computed of each variant; None for all that the scene has.
    """

    def __init__(
        self,
        scene: MechanismScene,
        robot: Mechanism,
        payloads: Mapping[str, _Payload],
        outputs: Sequence[str] | None,
    ) -> None:
        self._scene, self._robot, self._outputs = scene, robot, outputs
        self._payloads = tuple(payloads.values())
        self._links = tuple(payloads)

    def compute(self, rows: Float64Array) -> tuple[Float64Array, dict[str, NDArray[Any]]] | None:
        """Return the instants, (samples,), and the outputs of all variants by name, (variants, samples, ...).

        Args:
            rows: the varied numbers; (variants, numbers).

        Returns:
            None where the properties of a variant need a closer look, which reading its scene takes.
        """
        if not all(payload.is_plain(rows) for payload in self._payloads):
            return None
        result, program = self._result, self._program
        loaded = result if program is None else replace(result, forces=program.forces(self._moments(rows)))
        lead = (len(rows), len(result.t))
        arrays = {}
        for (name, array), plain in zip(loaded.chosen().items(), result.chosen().values(), strict=True):
            own = array if array.ndim > plain.ndim else array[None]
            arrays[name] = np.broadcast_to(own, (*lead, *plain.shape[1:]))
        return result.t, arrays

    def _moments(self, rows: Float64Array) -> list[Twofold]:
        return [moment for payload in self._payloads for moment in payload.moments(rows)]

    @functools.cached_property
    def _result(self) -> MechanismSceneResult:
        """The scene as its file has it, of which all but the forces is that of every variant."""
        return self._scene.evaluate(self._outputs)

    @functools.cached_property
    def _program(self) -> _Program | None:
        """Computation of the forces; None where no force is an output."""
        forces = self._result.forces
        return None if forces is None else _Program(self._result, forces.outputs, self._robot, self._links)


class _Program:
    """Computation of a robot's forces along a scene's motion for many payloads.

    Args:
        result: the scene's result, which knows the motion.
        outputs: out of tau, force1 and torque1.
        robot: without the payloads.
        links: those that carry one.
    """

    def __init__(
        self, result: MechanismSceneResult, outputs: Sequence[str], robot: Mechanism, links: Sequence[str]
    ) -> None:
        tree, free = robot.tree, robot.base == "free"
        slopes = [row for link in links for row in payload_derivatives(tree, free, tree.known_frame("link", link))]
        exact = exact_mass_numbers(tree, free)
        self._varied = [column for column in range(len(exact)) if any(row[column] for row in slopes)]
        self._exact = [_twofold(exact[column]) for column in self._varied]
        self._slopes = [
            [(k, _twofold(row[column])) for k, row in enumerate(slopes) if row[column]] for column in self._varied
        ]
        constants = robot_constants(tree, free)
        numbers = program_numbers(constants)
        self._known = [
            None if column in self._varied else known for column, known in enumerate(split_numbers(numbers)[0])
        ]
        self._numbers = np.array(numbers)
        kind: Any = joint_results_class(MechanismForces, constants.names)
        self._problem = RobotComputation(self._with_parameters(constants), tuple(outputs), free, (), (), kind)
        coordinates = dict(zip(("q", "qd", "qdd"), result.known.arguments(), strict=True))
        self._values = read_arguments(constants.names, coordinates, result.known.base, self._problem.inputs, {})
        given = (*self._values.parts, "constants")
        self._call = self._problem.call(given, result.scene.gravity, result.scene.backend)

    def _with_parameters(self, constants: RobotConstants) -> RobotConstants:
        """Return the constants of a robot whose programs fold no number that payloads change."""
        parameters = tuple(self._numbers[self._parameters].tolist())
        form = constants.form._replace(known=tuple(self._known))
        return replace(constants, form=form, numbers=parameters, bounds=(0.0,) * len(parameters), cache={})

    @property
    def _parameters(self) -> list[int]:
        return [column for column, known in enumerate(self._known) if known is None]

    def forces(self, moments: Sequence[Twofold]) -> MechanismForces:
        """Return the forces of all variants, by the ten moments of every payload; (variants, samples, ...)."""
        numbers = np.tile(self._numbers, (len(moments[0].high), 1))
        for column, exact, slopes in zip(self._varied, self._exact, self._slopes, strict=True):
            total = exact
            for k, slope in slopes:
                total = total + moments[k] * slope
            numbers[:, column] = total.high
        own = np.ascontiguousarray(numbers[:, None, self._parameters] + 0.0)
        shapes = {**self._values.shapes, "payload": own.shape[:-1]}
        forces: MechanismForces = self._call.run({**self._values.parts, "constants": own}, shapes)
        return forces


def _twofold(number: Fraction) -> Twofold:
    """Return the number of twice the precision that is nearest to an exact one."""
    high = float(number)
    return Twofold(high, float(number - Fraction(high)))


def payload_variants(
    scene: MechanismScene,
    bare: Mechanism,
    mechanism: Table,
    keys: Sequence[Sequence[str | int]],
    outputs: Sequence[str] | None,
) -> PayloadVariants | None:
    """Return the variants of a scene if they differ in masses, centres and principal moments of payloads alone.

    Args:
        scene: as its file has it.
        bare: the robot without any payload.
        mechanism: the table [mechanism].
        keys: steps that lead to the varied numbers.
        outputs: what is computed of each variant; None for all that the scene has.

    Returns:
        None where another number is varied.
    """
    payload = mechanism.table("payload", required=False)
    varied: dict[str, list[_Varied]] = {}
    for place, steps in enumerate(keys):
        if tuple(steps[:2]) != _PAYLOAD_PATH or len(steps) not in {4, 5}:
            return None
        link, name, *component = steps[2:]
        body = payload.table(str(link)).values
        fits = component == [] if name == "mass" else name == "center_of_mass" and len(component) == 1
        if not fits and not (name == "inertia" and len(component) == 1 and len(body["inertia"]) == 3):
            return None
        varied.setdefault(str(link), []).append(_Varied(place, str(name), int(component[0]) if component else 0))
    payloads = {link: _payload(payload.table(link), tuple(own)) for link, own in varied.items()}
    others = {link: values for link, values in payload.values.items() if link not in varied}
    robot = with_payload(bare, replace(mechanism, values={**mechanism.values, "payload": others}))
    return PayloadVariants(scene, robot, payloads, outputs)


def _payload(table: Table, varied: tuple[_Varied, ...]) -> _Payload:
    values = table.read(BODY_KEYS, ("mass",))
    per_mass = "inertia" not in values and any(own.name == "mass" for own in varied)
    return _Payload(made(table, Body, values | ({"mass": 1.0} if per_mass else {})), per_mass, varied)
