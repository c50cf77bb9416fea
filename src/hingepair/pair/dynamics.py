"""Dynamics of the pair: forces from a motion, and a motion from forces (D1-D8)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.calls import Call
from hingepair.engine.results import writable_arrays
from hingepair.equations.spatial import Vector
from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import FloatArray, is_zero, one_constant, vectors
from hingepair.pair.body import Body, warn_of_dynamics
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import cached_call
from hingepair.pair.forward_kinematics import read_component
from hingepair.plans.dynamics_steps import (
    FORWARD_DYNAMICS_LOAD_NAMES,
    FORWARD_DYNAMICS_OUTPUT_NAMES,
    INVERSE_DYNAMICS_OUTPUT_NAMES,
)
from hingepair.plans.plan import SPATIAL_MOTION_KIND, make_plan

DEFAULT_GRAVITY_VECTOR = (0.0, 0.0, -9.81)
"""Acceleration of free fall unless given, world axes [m/s^2]."""

Bodies: TypeAlias = tuple[Body | None, Body | None]
_ZERO_VECTOR_COMPONENTS: Vector = (0.0, 0.0, 0.0)  # of a load or a vector that is zero
_DEFAULT_GRAVITY_ARRAY = np.array(DEFAULT_GRAVITY_VECTOR)  # made once, for calls with the default
_ZERO_LOAD_ARRAY = np.zeros(3)  # a force or torque of 0, which becomes a constant of the program
# The loads that are vectors: forces and torques on the bodies.
_VECTOR_LOAD_NAMES = tuple(name for name in FORWARD_DYNAMICS_LOAD_NAMES if name != "hinge_torque")
_MASSLESS_BODY1_CONSTANTS = {
    "m1": 0.0,
    "c1": _ZERO_VECTOR_COMPONENTS,
    "I1": (0.0,) * 9,
}  # constants of a body 1 without mass
MIN_MASS_MATRIX_PIVOT_TO_DIAGONAL_RATIO = 64 * 2.0**-53
"""Pivots of the mass matrix that are at most this share of their diagonal elements consist of round-off."""


def _one_line_repr(self: Any) -> str:
    """Return the `repr` of a named tuple of arrays as one line of text. It shows the numbers of each field, or only
    the shape if the field has more than nine numbers.
    """
    shapes = {n: getattr(v, "shape", ()) for n, v in self._asdict().items()}
    parts = (
        f"{n}={v!r}" if math.prod(shapes[n]) <= 9 else f"{n}: shape {shapes[n]}" for n, v in self._asdict().items()
    )
    return f"{type(self).__name__}({', '.join(parts)})"


class Forces(NamedTuple):
    """Forces and torques that a motion of the pair requires (D5), as a named tuple of arrays: `force1` and `torque1`
    act on body 1 at its reference point, and `hinge_torque` acts on body 2 about the hinge axis.

    Attributes:
        force1: force that must act on body 1 at R1, world axes [N]; shape (..., 3), or (..., 2) for a planar pair.
        torque1: torque that must act on body 1 about R1, world axes [N m]; shape (..., 3), or (...,) for a planar
            pair.
        hinge_torque: torque that body 1 must exert on body 2 about the hinge axis [N m]; shape (...,). It is the sum
            of motor, spring, damper, friction and stops.
    """

    force1: FloatArray
    torque1: FloatArray
    hinge_torque: FloatArray

    def __repr__(self) -> str:
        return _one_line_repr(self)


class Accelerations(NamedTuple):
    """Accelerations of a pair that forces and torques cause (D6), as a named tuple of arrays: `a1` and `alpha1` of
    body 1, and `psidd` of the hinge angle.

    Attributes:
        a1: acceleration of body 1's reference point, the second time derivative of R1, world axes [m/s^2]; shape
            (..., 3).
        alpha1: angular acceleration of body 1, world axes [rad/s^2]; shape (..., 3).
        psidd: second time derivative of the hinge angle [rad/s^2]; shape (...,).
    """

    a1: FloatArray
    alpha1: FloatArray
    psidd: FloatArray

    def __repr__(self) -> str:
        return _one_line_repr(self)


class HingeWrench(NamedTuple):
    """Force and torque that body 1 exerts on body 2 at the hinge point (D3, D4), as a named tuple of arrays: `force`,
    `torque`, `hinge_torque`, which is the component of `torque` along the hinge axis, and `bearing_torque`, which is
    the rest of `torque`, perpendicular to the axis.

    Attributes:
        force: force at the hinge point, world axes [N]; shape (..., 3), or (..., 2) for a planar pair.
        torque: torque about the hinge point, world axes [N m]; shape (..., 3), or (...,) for a planar pair.
        hinge_torque: component of the torque along the hinge axis [N m]; shape (...,). It is the sum of motor,
            spring, damper, friction and stops.
        bearing_torque: part of the torque perpendicular to the hinge axis, which the bearing carries, world axes
            [N m]; shape (..., 3), or (...,) for a planar pair.
    """

    force: FloatArray
    torque: FloatArray
    hinge_torque: FloatArray
    bearing_torque: FloatArray

    def __repr__(self) -> str:
        return _one_line_repr(self)


class Energy(NamedTuple):
    """Energy of both bodies of a pair (D7), as a named tuple of arrays: the kinetic energy `kinetic` and the
    potential energy `potential`.

    Attributes:
        kinetic: kinetic energy of both bodies [J]; shape (...,).
        potential: potential energy of both bodies in uniform gravity, zero at the world's origin [J]; shape (...,).
    """

    kinetic: FloatArray
    potential: FloatArray

    def __repr__(self) -> str:
        return _one_line_repr(self)


class Momentum(NamedTuple):
    """Momentum of both bodies of a pair (D8), as a named tuple of arrays: the linear momentum `linear`, and the
    angular momentum `angular` about the world's origin.

    Attributes:
        linear: linear momentum of both bodies, world axes [kg m/s]; shape (..., 3), or (..., 2) for a planar pair.
        angular: angular momentum of both bodies about the world's origin, world axes [kg m^2/s]; shape (..., 3), or
            (...,) for a planar pair.
    """

    linear: FloatArray
    angular: FloatArray

    def __repr__(self) -> str:
        return _one_line_repr(self)


def mass_constants(bodies: Mapping[str, Body | None], hint_without_body1: str = "") -> dict[str, Any]:
    """Return the masses, centres of mass and inertias of `bodies`, a dict of Bodies with the keys "body1" and
    "body2". The result is a dict of floats and tuples of floats with the keys m1, c1, I1, m2, c2 and I2. Issue a
    DynamicsWarning for each assumed value. Raise ArgumentError for a body that is None; if the body is body1, the
    message ends with `hint_without_body1`.

    The hint says what to call instead.

    Raises:
        ArgumentError: a body has no mass properties; names it.
    """
    values: dict[str, Any] = {}
    for name, body in bodies.items():
        if body is None:
            examples = f"HingePair(..., {name}=hp.Body(mass=2.0)), or in a scene [pair.{name}] mass = 2.0"
            hint = hint_without_body1 if name == "body1" else ""
            raise ArgumentError(f"pair.{name}", f"mass properties, as in {examples}{hint}", None)
        centre, inertia = tuple(body.center_of_mass.tolist()), tuple(body.inertia.ravel().tolist())
        values |= {f"m{name[-1]}": body.mass, f"c{name[-1]}": centre, f"I{name[-1]}": inertia}
        for sentence in body.assumed:
            warn_of_dynamics(f"pair.{name}: {sentence}")
    return values


def _extended_constants(constants: Constants, extra_values: Mapping[str, Any]) -> Constants:
    """Return new Constants of a pair, extended by values by name: floats and tuples of components."""
    extra_arrays = {name: np.array(value) for name, value in extra_values.items()}
    return Constants({**constants.values, **extra_values}, {**constants.arrays, **extra_arrays}, constants.shape)


def with_loads_and_masses(
    constants: Constants, bodies: Bodies, gravity: ArrayLike, needed_names: Iterable[str]
) -> Constants:
    """Return new Constants of a pair, extended by gravity, by loads of zero, and by the mass properties of the bodies
    that are needed: body 1 if `needed_names` contains m1, c1 or I1, body 2 if it contains m2, c2 or I2. `bodies` is
    (body1, body2), each a Body or None. Issue a DynamicsWarning for each assumed value. Raise ArgumentError if a
    needed body is None or gravity is unusable.

    Raises:
        ArgumentError: a body that is needed has no mass properties, or gravity cannot be used; names it.
    """
    needed_bodies = {
        name: body for name, body in _bodies_by_name(bodies) if {f"{c}{name[-1]}" for c in "mcI"} & {*needed_names}
    }
    zero_loads = {
        name: 0.0 if name == "hinge_torque" else _ZERO_VECTOR_COMPONENTS for name in FORWARD_DYNAMICS_LOAD_NAMES
    }
    gravity_vector = tuple(one_constant("gravity", gravity, 3).tolist())
    return _extended_constants(constants, {"gravity": gravity_vector, **zero_loads, **mass_constants(needed_bodies)})


def _bodies_by_name(bodies: Bodies) -> Iterable[tuple[str, Body | None]]:
    """Return an iterable of the pairs ("body1", its Body or None) and ("body2", its Body or None)."""
    return zip(("body1", "body2"), bodies, strict=True)


@dataclass(frozen=True, slots=True, eq=False)
class DynamicsComputationSpec:
    """Specification of a computation of dynamics, an argument of `compute_dynamics`. `outputs` are the names of the
    outputs, `letters` the names of the arrays of body 1's motion that the computation needs, and `bodies` the names
    of the bodies whose masses it needs. `hint_without_body1` is a hint that ends the error message if body 1 has no
    mass.
    """

    outputs: tuple[str, ...]
    letters: tuple[str, ...]  # of the motion of body 1
    bodies: tuple[str, ...] = ("body1", "body2")  # whose masses it needs
    hint_without_body1: str = ""  # end of the message if body 1 has no mass: what to call instead


MASS_MATRIX_COMPUTATION_SPEC = DynamicsComputationSpec(("mass_matrix",), ("S",))  # D6
# Inverse dynamics, D1-D5.
INVERSE_DYNAMICS_COMPUTATION_SPEC = DynamicsComputationSpec(
    INVERSE_DYNAMICS_OUTPUT_NAMES,
    ("S", "omega", "a", "alpha"),
    hint_without_body1="; or pair.hinge_wrench, for which body 2 suffices",
)
# The wrench of body 1 on body 2, D3, D4.
HINGE_WRENCH_COMPUTATION_SPEC = DynamicsComputationSpec(
    ("f2", "moment", "hinge_torque", "bearing_torque"), ("S", "omega", "a", "alpha"), ("body2",)
)
FORWARD_DYNAMICS_COMPUTATION_SPEC = DynamicsComputationSpec(
    (*FORWARD_DYNAMICS_OUTPUT_NAMES, "pivot_ratios"), ("S", "omega")
)  # forward dynamics, D6
# D7.
ENERGY_COMPUTATION_SPEC = DynamicsComputationSpec(("kinetic", "potential"), ("R", "S", "v", "omega"), ("body2",))
MOMENTUM_COMPUTATION_SPEC = DynamicsComputationSpec(("linear", "angular"), ("R", "S", "v", "omega"))  # D8


def compute_dynamics(
    spec: DynamicsComputationSpec,
    constants: Constants,
    bodies: Bodies,
    body1: BodyMotion,
    gravity: ArrayLike = DEFAULT_GRAVITY_VECTOR,
    **hinge_and_loads: ArrayLike,
) -> tuple[FloatArray, ...]:
    """Compute the outputs that a DynamicsComputationSpec names, at all samples, and return a tuple of writable arrays
    in the order of `spec.outputs`. `bodies` is (body1, body2), each a Body or None; `body1` is a BodyMotion; psi,
    psid, psidd and loads are keyword arguments. The compiled call is cached in `constants.prepared` unless a mass is
    assumed. Raise ArgumentError for unusable arguments and missing masses; issue a DynamicsWarning for each assumed
    value.

    Raises:
        ArgumentError: an argument cannot be used; names it.
    """
    gravity_array = (
        _DEFAULT_GRAVITY_ARRAY if gravity is DEFAULT_GRAVITY_VECTOR else one_constant("gravity", gravity, 3)
    )
    inputs = {
        name: _load_array(name, value) if name in _VECTOR_LOAD_NAMES else value
        for name, value in hinge_and_loads.items()
    }
    rows = (*(getattr(body1, letter, None) for letter in spec.letters), gravity_array, *inputs.values())
    call: Call | None = constants.prepared.get(spec)
    if call is not None and type(body1) is BodyMotion:
        state = call.rows(*rows)
        if state is not None:
            return tuple(writable_arrays(state).values())
    constants_with_masses = with_masses(spec, constants, bodies)
    values: dict[str, Any] = motion_arrays("body1", body1, *spec.letters)
    for name, value in inputs.items():
        if value is None:
            raise ArgumentError(name, f"a value, as in {name}=0.0 or an array: an output needs it", None)
    values["gravity"] = tuple(gravity_array.tolist())
    for name, value in inputs.items():  # a zero load is a constant of the program
        values[name] = (
            read_component(name, value)
            if name not in _VECTOR_LOAD_NAMES
            else _ZERO_VECTOR_COMPONENTS
            if value is _ZERO_LOAD_ARRAY
            else value
        )
    shapes = {name: np.shape(v)[: np.ndim(v) - len(SPATIAL_MOTION_KIND.shapes[name])] for name, v in values.items()}
    plan = make_plan(spec.outputs, None, "home" in constants.values, given_names=tuple(values))
    call = cached_call(constants_with_masses, plan, tuple(values), "auto")
    if not any(
        body is not None and body.assumed for body in bodies
    ):  # with an assumed value, every call issues a warning
        constants.prepared[spec] = call
    state = call.rows(*rows)
    return tuple(writable_arrays(call.run(values, shapes) if state is None else state).values())


def with_masses(spec: DynamicsComputationSpec, constants: Constants, bodies: Bodies) -> Constants:
    """Return the Constants of a pair, extended by the mass properties of `bodies`, which is (body1, body2). If body 1
    is None and the computation `spec` does not need its mass, body 1 gets the mass 0. The result is cached in
    `constants.prepared`. Raise ArgumentError if a needed body is None; issue a DynamicsWarning for assumed values.

    Raises:
        ArgumentError: a body that the computation needs has no mass properties; names it.
    """
    present = {name: body for name, body in _bodies_by_name(bodies) if body is not None or name in spec.bodies}
    masses = _MASSLESS_BODY1_CONSTANTS | mass_constants(present, spec.hint_without_body1)  # for all computations
    extended: Constants = constants.prepared.get("masses") or _extended_constants(constants, masses)
    constants.prepared["masses"] = extended
    return extended


def make_accelerations(bodies: Bodies, outputs: Iterable[FloatArray]) -> Accelerations:
    """Return the Accelerations (a1, alpha1, psidd) from `outputs`: the arrays a1, alpha1 and psidd, and the pivot
    ratios of the mass matrix (D6). Raise ArgumentError, whose message shows body 2 of `bodies`, if a pivot ratio
    shows that the mass matrix is singular.

    Raises:
        ArgumentError: the mass matrix is singular.
    """
    *accelerations, pivot_ratios = outputs
    if (pivot_ratios <= MIN_MASS_MATRIX_PIVOT_TO_DIAGONAL_RATIO).any():
        expected = "masses that resist every motion: body 2 has no inertia about the hinge axis, to round-off, or a"
        raise ArgumentError(
            "pair.body2", f"{expected} body's inertia is negligible relative to the other's", bodies[1]
        )
    return Accelerations(*accelerations)


def check_nonsingular_mass_matrix(constants: Constants, bodies: Bodies) -> None:
    """Raise ArgumentError if the mass matrix of a pair is singular at psi = 0, so that forces do not determine the
    accelerations. `constants` holds the Constants of the pair; `bodies` is (body1, body2), each a Body or None. Issue
    a DynamicsWarning for assumed masses.

    Raises:
        ArgumentError: as for `make_accelerations`.
    """
    resting_body1 = BodyMotion(R=_ZERO_VECTOR_COMPONENTS, S=np.eye(3), omega=_ZERO_VECTOR_COMPONENTS)
    loads = dict.fromkeys(FORWARD_DYNAMICS_LOAD_NAMES, 0.0)
    outputs = compute_dynamics(
        FORWARD_DYNAMICS_COMPUTATION_SPEC,
        constants,
        bodies,
        resting_body1,
        gravity=_ZERO_VECTOR_COMPONENTS,
        psi=0.0,
        psid=0.0,
        **loads,
    )
    make_accelerations(bodies, outputs)


def _load_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return a force or a torque as an array of shape (..., 3); for the number 0, return zeros of shape (3,). Raise
    ShapeError, which names the argument `name`, for another shape.
    """
    return _ZERO_LOAD_ARRAY if is_zero(value) else vectors(name, value, 3)
