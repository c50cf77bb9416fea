"""Forces and motion of the pair: masses in, what must act out, or the other way round (D1-D8)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Vector
from hingepair.errors import ArgumentError
from hingepair.evaluation.plan import steps_of
from hingepair.evaluation.steps import ARM_STEPS, Step
from hingepair.numeric.arrays import FloatArray, one_constant, result_dtype, vectors
from hingepair.pair.body import Body
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import component, follow_steps

GRAVITY = (0.0, 0.0, -9.81)
"""Gravity unless given, world axes [m/s^2]."""

Bodies: TypeAlias = tuple[Body | None, Body | None]
_ZERO: Vector = (0.0, 0.0, 0.0)
_SINGULAR = 64 * 2.0**-53  # of the inertias: a pivot below is made of their round-off


class Forces(NamedTuple):
    """What must act for the pair to move as it does (D5).

    Attributes:
        force1: on body 1, world axes [N]; shape (..., 3).
        torque1: on body 1 about R1, world axes [N m]; shape (..., 3).
        hinge_torque: about the hinge axis, of body 1 on body 2, as a motor there gives it [N m]; shape (...).
    """

    force1: FloatArray
    torque1: FloatArray
    hinge_torque: FloatArray


class Accelerations(NamedTuple):
    """How the pair moves under what acts (D6).

    Attributes:
        a1: acceleration of body 1's reference point, world axes, classical [m/s^2]; shape (..., 3).
        alpha1: angular acceleration of body 1, world axes [rad/s^2]; shape (..., 3).
        psidd: of the hinge angle [rad/s^2]; shape (...).
    """

    a1: FloatArray
    alpha1: FloatArray
    psidd: FloatArray


class HingeWrench(NamedTuple):
    """What body 1 exerts on body 2 at the hinge point (D3, D4).

    Attributes:
        force: world axes [N]; shape (..., 3).
        torque: about the hinge point, world axes [N m]; shape (..., 3).
        hinge_torque: the part of the torque about the hinge axis, which a motor, spring or brake must give [N m];
            shape (...).
        bearing_torque: the rest of the torque, across the axis, which the bearing carries [N m]; shape (..., 3).
    """

    force: FloatArray
    torque: FloatArray
    hinge_torque: FloatArray
    bearing_torque: FloatArray


class Energy(NamedTuple):
    """The pair's energy (D7).

    Attributes:
        kinetic: of both bodies [J]; shape (...).
        potential: of both bodies in uniform gravity, zero at the world's origin [J]; shape (...).
    """

    kinetic: FloatArray
    potential: FloatArray


class Momentum(NamedTuple):
    """The pair's momentum (D8).

    Attributes:
        linear: of both bodies, world axes [kg m/s]; shape (..., 3).
        angular: of both bodies about the world's origin, world axes [kg m^2/s]; shape (..., 3).
    """

    linear: FloatArray
    angular: FloatArray


def mass_constants(bodies: Bodies, *needed: str) -> dict[str, Any]:
    """Masses, centres and inertias as constants of the equations.

    Raises:
        ArgumentError: a body that is needed has no mass properties; names it.
    """
    values: dict[str, Any] = {}
    for name, body in zip(("body1", "body2"), bodies, strict=True):
        if body is None:
            if name in needed:
                ways = f"HingePair(..., {name}=hp.Body(mass=2.0)), or in a scene [pair.{name}] mass = 2.0"
                raise ArgumentError(f"pair.{name}", f"mass properties, as in {ways}", None)
            continue
        digit = name[-1]
        values[f"m{digit}"] = body.mass
        values[f"c{digit}"] = tuple(body.center_of_mass.tolist())
        values[f"I{digit}"] = tuple(body.inertia.ravel().tolist())
    return values


_BOTH = lambda one, two: (one, two)  # noqa: E731

LEVERS = (
    *ARM_STEPS,
    Step("centre1", eq.rotate, ("S1", "c1")),
    Step("centre2", eq.rotate, ("S2", "c2")),
    Step("from_hinge", eq.subtract, ("c2", "u2")),
    Step("h", eq.rotate, ("S2", "from_hinge")),
    Step("e", eq.add, ("r1", "h")),
    Step("push", eq.cross, ("axis", "h")),
    Step("masses", _BOTH, ("m1", "m2")),
    Step("J1", dyn.world_inertia, ("S1", "I1")),
    Step("J2", dyn.world_inertia, ("S2", "I2")),
    Step("inertias", _BOTH, ("J1", "J2")),
)
"""Where the masses are, world axes (D1-D6)."""

_INVERSE = (
    *LEVERS,
    Step("f1", dyn.inertial_force, ("m1", "a1", "omega1", "alpha1", "centre1", "gravity")),
    Step("f2", dyn.inertial_force, ("m2", "a2", "omega2", "alpha2", "centre2", "gravity")),
    Step("t1", dyn.inertial_torque, ("S1", "I1", "omega1", "alpha1")),
    Step("t2", dyn.inertial_torque, ("S2", "I2", "omega2", "alpha2")),
    Step("moment", dyn.torque_about, ("t2", "h", "f2")),
    Step("hinge_torque", eq.dot, ("axis", "moment")),
    Step("about_axis", eq.scale, ("axis", "hinge_torque")),
    Step("bearing_torque", eq.subtract, ("moment", "about_axis")),
    Step("force1", eq.add, ("f1", "f2")),
    Step("about1", dyn.torque_about, ("t1", "centre1", "f1")),
    Step("about2", dyn.torque_about, ("t2", "e", "f2")),
    Step("torque1", eq.add, ("about1", "about2")),
    Step("mass_matrix", dyn.mass_matrix, ("masses", "centre1", "e", "inertias", "axis", "push")),
)
"""What must act (D1-D5), and the mass matrix of D6."""

_BIAS = {name: f"{name}_bias" for name in ("force1", "torque1", "hinge_torque")}
FORWARD = (
    *(step._replace(result=_BIAS.get(step.result, step.result)) for step in _INVERSE),
    Step("pushed", eq.add, ("force1", "force2")),
    Step("force", eq.subtract, ("pushed", "force1_bias")),
    Step("torque2_about1", dyn.torque_about, ("torque2", "d", "force2")),
    Step("turned", eq.add, ("torque1", "torque2_about1")),
    Step("torque", eq.subtract, ("turned", "torque1_bias")),
    Step("torque2_at_hinge", dyn.hinge_torque_of, ("axis", "torque2", "r2", "force2")),
    Step("motor", lambda own, other, bias: own + other - bias,
         ("psi_torque", "torque2_at_hinge", "hinge_torque_bias")),
    Step("solved", dyn.accelerations,
         ("masses", "centre1", "e", "inertias", "axis", "push", "force", "torque", "motor")),
    Step("a1_found", lambda solved: solved[0], ("solved",)),
    Step("alpha1_found", lambda solved: solved[1], ("solved",)),
    Step("psidd_found", lambda solved: solved[2], ("solved",)),
    Step("kept", lambda solved: solved[3], ("solved",)),
)  # fmt: skip
"""How the pair moves under what acts (D6)."""

_STATE = (
    *LEVERS,
    Step("v_centre1", dyn.point_velocity, ("v1", "omega1", "centre1")),
    Step("v_centre2", dyn.point_velocity, ("v2", "omega2", "centre2")),
    Step("velocities", _BOTH, ("v_centre1", "v_centre2")),
    Step("spins", _BOTH, ("omega1", "omega2")),
    Step("at1", eq.add, ("R1", "centre1")),
    Step("at2", eq.add, ("R1", "e")),
    Step("kinetic", dyn.kinetic_of_both, ("masses", "velocities", "spins", "inertias")),
    Step("potential", dyn.potential_energy, ("masses", "gravity", "at1", "at2")),
    Step("linear", dyn.linear_momentum, ("masses", "velocities")),
    Step("angular1", dyn.angular_momentum, ("m1", "at1", "v_centre1", "J1", "omega1")),
    Step("angular2", dyn.angular_momentum, ("m2", "at2", "v_centre2", "J2", "omega2")),
    Step("angular", eq.add, ("angular1", "angular2")),
)
"""Energy and momentum (D7, D8)."""


def mass_matrix(constants: Constants, bodies: Bodies, body1: BodyMotion, psi: ArrayLike) -> FloatArray:
    """M of D6; see `HingePair.mass_matrix`."""
    masses = mass_constants(bodies, "body1", "body2")
    tails = {"mass_matrix": (7, 7)}
    return _follow(constants, _INVERSE, tails, masses, motion_arrays("body1", body1, "S"), {"psi": psi})[
        "mass_matrix"
    ]


def inverse_dynamics(
    constants: Constants,
    bodies: Bodies,
    body1: BodyMotion,
    psi: ArrayLike,
    psid: ArrayLike,
    psidd: ArrayLike,
    gravity: ArrayLike,
) -> Forces:
    """What must act (D5); see `HingePair.inverse_dynamics`."""
    masses = mass_constants(bodies, "body1", "body2") | _gravity(gravity)
    given = motion_arrays("body1", body1, "S", "omega", "a", "alpha")
    tails = {"force1": (3,), "torque1": (3,), "hinge_torque": ()}
    return Forces(**_follow(constants, _INVERSE, tails, masses, given, {"psi": psi, "psid": psid, "psidd": psidd}))


def hinge_wrench(
    constants: Constants,
    bodies: Bodies,
    body1: BodyMotion,
    psi: ArrayLike,
    psid: ArrayLike,
    psidd: ArrayLike,
    gravity: ArrayLike,
) -> HingeWrench:
    """What the hinge carries (D3, D4); see `HingePair.hinge_wrench`."""
    masses = mass_constants(bodies, "body2") | _gravity(gravity)
    given = motion_arrays("body1", body1, "S", "omega", "a", "alpha")
    tails = {"f2": (3,), "moment": (3,), "hinge_torque": (), "bearing_torque": (3,)}
    found = _follow(constants, _INVERSE, tails, masses, given, {"psi": psi, "psid": psid, "psidd": psidd})
    return HingeWrench(*found.values())


def forward_dynamics(
    constants: Constants,
    bodies: Bodies,
    body1: BodyMotion,
    psi: ArrayLike,
    psid: ArrayLike,
    loads: Mapping[str, ArrayLike],
    hinge_torque: ArrayLike,
    gravity: ArrayLike,
) -> Accelerations:
    """How the pair moves (D6); see `HingePair.forward_dynamics`."""
    masses = mass_constants(bodies, "body1", "body2") | _gravity(gravity)
    still = {"a1": _ZERO, "alpha1": _ZERO, "psidd": 0.0}
    given = motion_arrays("body1", body1, "S", "omega")
    given |= {name: _load(name, value) for name, value in loads.items()}
    angles = {"psi": psi, "psid": psid, "psi_torque": hinge_torque}
    tails = {"a1_found": (3,), "alpha1_found": (3,), "psidd_found": (), "kept": (4,)}
    *found, kept = _follow(constants, FORWARD, tails, masses | still, given, angles).values()
    if (kept <= _SINGULAR).any():
        expected = "masses that resist every motion: body 2 has no inertia about the hinge axis, to round-off, or a"
        raise ArgumentError("pair.body2", f"{expected} body's inertia vanishes beside the other's", bodies[1])
    return Accelerations(*found)


def energy(
    constants: Constants, bodies: Bodies, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike, gravity: ArrayLike
) -> Energy:
    """The pair's energy (D7); see `HingePair.energy`."""
    masses = mass_constants(bodies, "body1", "body2") | _gravity(gravity)
    given = motion_arrays("body1", body1, "R", "S", "v", "omega")
    found = _follow(constants, _STATE, {"kinetic": (), "potential": ()}, masses, given, {"psi": psi, "psid": psid})
    return Energy(**found)


def momentum(constants: Constants, bodies: Bodies, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> Momentum:
    """The pair's momentum (D8); see `HingePair.momentum`."""
    masses = mass_constants(bodies, "body1", "body2")
    given = motion_arrays("body1", body1, "R", "S", "v", "omega")
    found = _follow(constants, _STATE, {"linear": (3,), "angular": (3,)}, masses, given, {"psi": psi, "psid": psid})
    return Momentum(**found)


def _follow(
    constants: Constants,
    steps: tuple[Step, ...],
    tails: Mapping[str, tuple[int, ...]],
    known: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
    angles: Mapping[str, ArrayLike],
) -> dict[str, NDArray[Any]]:
    """Some results of steps at all samples."""
    for name, value in angles.items():
        if value is None:
            raise ArgumentError(name, "a value, since it is needed here", None)
    values = {**arrays, **{name: component(name.replace("psi_", "hinge_"), v) for name, v in angles.items()}}
    ranks = {name: 2 if name == "S1" else 1 for name in arrays}
    shapes = {name: v.shape[: v.ndim - ranks[name]] for name, v in arrays.items()}
    shapes |= {name: np.shape(values[name]) for name in angles}
    every = (*steps_of(None, "home" in constants.values), *steps)
    dtype = result_dtype(values.values())
    return follow_steps(every, tails, constants, {**known, **values}, shapes, dtype)


def _gravity(gravity: ArrayLike) -> dict[str, Any]:
    return {"gravity": tuple(one_constant("gravity", gravity, 3).tolist())}


def _load(name: str, value: ArrayLike) -> NDArray[Any]:
    """A force or a torque; the number 0 says that there is none."""
    return np.zeros(3) if isinstance(value, int | float) and value == 0 else vectors(name, value, 3)
