"""Variants of a scene that differ in payload alone: one program computes them all, with an axis of variants.

The masses and moments of a robot's program are linear in those of a payload (T9). Their slopes are computed once, in
exact arithmetic; those of every variant follow in numbers of twice the precision, and are rounded once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.computations import RobotComputation
from hingepair.mechanism.constants import (
    RobotConstants,
    exact_mass_numbers,
    payload_derivatives,
    program_numbers,
    robot_constants,
    split_numbers,
)
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.states import MechanismForces, joint_results_class
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.numeric.twofold import Twofold, exact_product
from hingepair.pair.body import Body
from hingepair.plans.computation import Cache
from hingepair.scenes.pair_table import BODY_KEYS, construct_from_table
from hingepair.scenes.robot_scene import RobotResult, RobotScene
from hingepair.scenes.robot_table import with_payload
from hingepair.scenes.tables import Table


class _VariedProperty(NamedTuple):
    """Mass property of a payload that is varied."""

    column: int  # of its values among the varied numbers
    name: str  # mass, center_of_mass or inertia
    component: int  # index of its component or principal moment; 0 for the mass


class _VariedPayload(NamedTuple):
    """Payload with varied mass properties."""

    # mass properties of the payload in the scene file; its inertia is that of 1 kg where `inertia_per_mass`
    body: Body
    inertia_per_mass: bool  # whether the inertia is proportional to the mass
    varied: tuple[_VariedProperty, ...]  # the mass properties that are varied

    def mass_properties(self, numbers: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return the payload's mass (variants,), centre of mass (variants, 3) and inertia (variants, 3, 3) as three
        arrays in SI units.
        """
        count = len(numbers)
        mass = np.full(count, self.body.mass)
        centre = np.tile(self.body.center_of_mass, (count, 1))
        inertia = np.tile(self.body.inertia, (count, 1, 1))
        for column, name, component in self.varied:
            if name == "mass":
                mass = numbers[:, column]
            elif name == "center_of_mass":
                centre[:, component] = numbers[:, column]
            else:
                inertia[:, component, component] = numbers[:, column]
        return mass, centre, inertia * mass[:, None, None] if self.inertia_per_mass else inertia

    def is_clearly_valid(self, numbers: Float64Array) -> bool:
        """Return True if all mass properties of all variants are below 1e100 in SI units, all masses are positive,
        and varied principal moments of inertia are possible for a rigid body.
        """
        mass, centre, inertia = self.mass_properties(numbers)
        sizes = (np.abs(part).max(initial=0.0) for part in (mass, centre, inertia))
        if not (all(size < 1e100 for size in sizes) and (mass > 0).all()):  # products of three do not overflow
            return False
        if not any(number.name == "inertia" for number in self.varied):
            return True
        moments = np.diagonal(inertia, axis1=1, axis2=2)
        return bool(((moments > 0) & (2 * moments <= moments.sum(axis=1, keepdims=True))).all())

    def mass_moments(self, numbers: Float64Array) -> list[Twofold]:
        """Return the payload's ten mass moments about the origin of its link (the mass, 3 first and 6 second moments)
        as a list of Twofold numbers, pairs of arrays (variants,) with twice the precision of doubles.
        """
        mass, centre, inertia = self.mass_properties(numbers)
        first = [Twofold(*exact_product(mass, centre[:, i])) for i in range(3)]
        entries = [[Twofold(inertia[:, i, j]) for j in range(3)] for i in range(3)]
        half = (entries[0][0] + entries[1][1] + entries[2][2]) * Twofold(0.5)
        second = [
            (half - entries[i][j] if i == j else -entries[i][j]) + first[i] * Twofold(centre[:, j])
            for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
        ]
        return [Twofold(mass), *first, *second]


class PayloadVariantComputer:
    """Computer of the outputs of a robot's scene for many variants in one call of the method `compute`.

    Args:
        scene: scene as its file describes it.
        robot: robot without the payloads whose mass properties are varied.
        payloads: payloads whose mass properties are varied, by link.
        outputs: names of the outputs to compute for each variant; None for all that the scene has.
    """

    def __init__(
        self,
        scene: RobotScene,
        robot: Mechanism,
        payloads: Mapping[str, _VariedPayload],
        outputs: Sequence[str] | None,
    ) -> None:
        self._scene, self._robot, self._outputs = scene, robot, outputs
        self._payloads = tuple(payloads.values())
        self._links = tuple(payloads)

    def compute(self, numbers: Float64Array) -> tuple[Float64Array, dict[str, NDArray[Any]]] | None:
        """Return (t, arrays) for all variants: the instants [s] and a dict of read-only arrays of the outputs by
        name, shape (variants, samples, ...). Return None if a payload may be invalid, so that variants must be
        computed one by one. `numbers` are the values of the varied numbers; shape (variants, numbers).
        """
        if not all(payload.is_clearly_valid(numbers) for payload in self._payloads):
            return None
        result, program = self._result, self._program
        loaded = result if program is None else replace(result, forces=program.compute(self._mass_moments(numbers)))
        variants_and_samples = (len(numbers), len(result.t))
        arrays = {}
        for (name, array), unloaded in zip(
            loaded.requested_arrays().items(), result.requested_arrays().values(), strict=True
        ):
            by_variant = array if array.ndim > unloaded.ndim else array[None]
            arrays[name] = np.broadcast_to(by_variant, (*variants_and_samples, *unloaded.shape[1:]))
        return result.t, arrays

    def _mass_moments(self, numbers: Float64Array) -> list[Twofold]:
        return [moment for payload in self._payloads for moment in payload.mass_moments(numbers)]

    @lock_free_cached_property
    def _result(self) -> RobotResult:
        """Result of the scene as its file describes it, computed at first access."""
        result: RobotResult = self._scene.evaluate(self._outputs)
        return result

    @lock_free_cached_property
    def _program(self) -> _PayloadForceProgram | None:
        """Program that computes the forces, made at first access, or None if no force is an output."""
        forces = self._result.forces
        return (
            None if forces is None else _PayloadForceProgram(self._result, forces.outputs, self._robot, self._links)
        )


class _PayloadForceProgram:
    """Program whose method `compute` computes a robot's joint and base forces along a scene's motion for many
    variants of the payloads in one call.
    """

    def __init__(self, result: RobotResult, outputs: Sequence[str], robot: Mechanism, links: Sequence[str]) -> None:
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
        self._problem = RobotComputation(self._with_payload_parameters(constants), tuple(outputs), free, (), (), kind)
        coordinates = dict(zip(("q", "qd", "qdd"), result.known.arguments(), strict=True))
        self._values = self._problem.read(coordinates, result.known.base, {})
        arguments = (*self._values.values, "constants")
        # By name, since "auto" would choose by the number of variants in a chunk, on which no bit may hang.
        self._call = self._problem.call(arguments, "compiled", result.scene.gravity)

    def _with_payload_parameters(self, constants: RobotConstants) -> RobotConstants:
        """Return a copy of the RobotConstants `constants` in which each number that depends on a payload is an
        argument of the program instead of a constant.
        """
        parameters = tuple(self._numbers[self._parameters].tolist())
        form = constants.form._replace(known=tuple(self._known))
        return replace(constants, form=form, numbers=parameters, cache=Cache())

    @property
    def _parameters(self) -> list[int]:
        return [column for column, known in enumerate(self._known) if known is None]

    def compute(self, mass_moments: Sequence[Twofold]) -> MechanismForces:
        """Return the MechanismForces of all variants, arrays (variants, samples, ...)."""
        numbers = np.tile(self._numbers, (len(mass_moments[0].high), 1))
        for column, exact, slopes in zip(self._varied, self._exact, self._slopes, strict=True):
            total = exact
            for k, slope in slopes:
                total = total + mass_moments[k] * slope
            numbers[:, column] = total.high
        constants = np.ascontiguousarray(numbers[:, None, self._parameters] + 0.0)
        shapes = {**self._values.shapes, "payload": constants.shape[:-1]}
        forces: MechanismForces = self._call.run({**self._values.values, "constants": constants}, shapes)
        return forces


def _twofold(number: Fraction) -> Twofold:
    """Return the number of twice the precision of a double that is nearest to a fraction."""
    high = float(number)
    return Twofold(high, float(number - Fraction(high)))


def payload_variant_computer(
    scene: RobotScene,
    unloaded_robot: Mechanism,
    mechanism_table: Table,
    keys: Sequence[Sequence[str | int]],
    outputs: Sequence[str] | None,
) -> PayloadVariantComputer | None:
    """Return a PayloadVariantComputer of variants of a RobotScene if all `keys`, paths of the varied numbers in
    the scene file, lead to masses, centres of mass or principal inertias of payloads; otherwise return None.

    Args:
        scene: scene as its file describes it.
        unloaded_robot: the robot without any payload.
        mechanism_table: the scene's table [mechanism].
        keys: paths of keys and indices that lead to the varied numbers.
        outputs: names of the outputs to compute for each variant; None for all that the scene has.
    """
    payload = mechanism_table.table("payload", required=False)
    varied: dict[str, list[_VariedProperty]] = {}
    for column, steps in enumerate(keys):
        if tuple(steps[:2]) != ("mechanism", "payload") or len(steps) not in {4, 5}:
            return None
        link, name, *component = steps[2:]
        body = payload.table(str(link)).values
        is_supported = component == [] if name == "mass" else name == "center_of_mass" and len(component) == 1
        if not is_supported and not (name == "inertia" and len(component) == 1 and len(body["inertia"]) == 3):
            return None
        varied.setdefault(str(link), []).append(
            _VariedProperty(column, str(name), int(component[0]) if component else 0)
        )
    payloads = {link: _read_payload(payload.table(link), tuple(numbers)) for link, numbers in varied.items()}
    others = {link: values for link, values in payload.values.items() if link not in varied}
    robot = with_payload(
        unloaded_robot, replace(mechanism_table, values={**mechanism_table.values, "payload": others})
    )
    return PayloadVariantComputer(scene, robot, payloads, outputs)


def _read_payload(table: Table, varied: tuple[_VariedProperty, ...]) -> _VariedPayload:
    """Return the _VariedPayload with the body that the Table of a payload describes, and with the tuple `varied` of
    _VariedProperty records.
    """
    values = table.read(BODY_KEYS, ("mass",))
    per_mass = "inertia" not in values and any(number.name == "mass" for number in varied)
    return _VariedPayload(
        construct_from_table(table, Body, values | ({"mass": 1.0} if per_mass else {})), per_mass, varied
    )
