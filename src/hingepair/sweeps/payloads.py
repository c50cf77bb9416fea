"""Variants of a scene that differ in payload alone: one call computes them all, with an axis of variants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.states import MechanismForces
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.scenes.pair_table import BODY_KEYS, CENTRES, construct_from_table
from hingepair.scenes.robot_scene import RobotResult, RobotScene
from hingepair.scenes.robot_table import with_payload
from hingepair.scenes.tables import Table


class _VariedProperty(NamedTuple):
    """Mass property of a payload that is varied."""

    column: int  # of its values among the varied numbers
    name: str  # mass, one of CENTRES, or inertia
    component: int  # index of its component or principal moment; 0 for the mass


class _VariedPayload(NamedTuple):
    """Payload with varied mass properties."""

    # mass properties of the payload in the scene file; its inertia is that of 1 kg where `inertia_per_mass`
    body: Body
    inertia_per_mass: bool  # whether the inertia is proportional to the mass
    varied: tuple[_VariedProperty, ...]  # the mass properties that are varied

    def mass_properties(self, numbers: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return masses (variants,), centres of mass (variants, 3) and inertias (variants, 3, 3), in SI units."""
        count = len(numbers)
        mass = np.full(count, self.body.mass)
        centre = np.tile(self.body.centre_of_mass, (count, 1))
        inertia = np.tile(self.body.inertia, (count, 1, 1))
        for column, name, component in self.varied:
            if name == "mass":
                mass = numbers[:, column]
            elif name in CENTRES:
                centre[:, component] = numbers[:, column]
            else:
                inertia[:, component, component] = numbers[:, column]
        return mass, centre, inertia * mass[:, None, None] if self.inertia_per_mass else inertia

    def is_clearly_valid(self, numbers: Float64Array) -> bool:
        """Return whether no variant needs a closer check: mass properties are below 1e100, masses positive, and
        varied principal moments those of a rigid body.
        """
        mass, centre, inertia = self.mass_properties(numbers)
        sizes = (np.abs(part).max(initial=0.0) for part in (mass, centre, inertia))
        if not (all(size < 1e100 for size in sizes) and (mass > 0).all()):  # products of three do not overflow
            return False
        if not any(number.name == "inertia" for number in self.varied):
            return True
        moments = np.diagonal(inertia, axis1=1, axis2=2)
        return bool(((moments > 0) & (2 * moments <= moments.sum(axis=1, keepdims=True))).all())


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
        """Return t, (samples,) s, and the outputs by name, read-only, (variants, samples, ...), for `numbers`
        (variants, numbers); None if a payload may be invalid, so that variants must be computed one by one.
        """
        if not all(payload.is_clearly_valid(numbers) for payload in self._payloads):
            return None
        result = self._result
        loaded = result
        if result.forces is not None:
            loaded = replace(result, forces=self._forces(numbers, result.forces.outputs))
        variants_and_samples = (len(numbers), len(result.t))
        arrays = {}
        for (name, array), unloaded in zip(
            loaded.requested_arrays().items(), result.requested_arrays().values(), strict=True
        ):
            by_variant = array if array.ndim > unloaded.ndim else array[None]
            arrays[name] = np.broadcast_to(by_variant, (*variants_and_samples, *unloaded.shape[1:]))
        return result.t, arrays

    @lock_free_cached_property
    def _result(self) -> RobotResult:
        """Result of the scene as its file describes it, computed at first access."""
        result: RobotResult = self._scene.evaluate(self._outputs)
        return result

    def _forces(self, numbers: Float64Array, outputs: tuple[str, ...]) -> MechanismForces:
        """Return the forces of all variants, arrays (variants, samples, ...)."""
        robot, result = self._robot, self._result
        for link, payload in zip(self._links, self._payloads, strict=True):
            mass, centre, inertia = (part[:, None] for part in payload.mass_properties(numbers))
            robot = robot.with_payload(link, mass=mass, centre_of_mass=centre, inertia=inertia)
        # By name, since "auto" would choose by the number of variants in a chunk, on which no bit may hang.
        return self._scene.inverse_dynamics(result.known, slice(None), outputs, robot=robot, backend="compiled")


def payload_variant_computer(
    scene: RobotScene,
    unloaded_robot: Mechanism,
    mechanism_table: Table,
    keys: Sequence[Sequence[str | int]],
    outputs: Sequence[str] | None,
) -> PayloadVariantComputer | None:
    """Return a PayloadVariantComputer if all varied numbers are masses, components of centres of mass or principal
    moments of payloads; otherwise None.

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
        is_supported = component == [] if name == "mass" else name in CENTRES and len(component) == 1
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
    """Return the payload of a Table, of which some properties are varied."""
    values = table.read(BODY_KEYS, ("mass",))
    per_mass = "inertia" not in values and any(number.name == "mass" for number in varied)
    return _VariedPayload(
        construct_from_table(table, Body, values | ({"mass": 1.0} if per_mass else {})), per_mass, varied
    )
