"""Motion by dynamics: the table [dynamics] of a scene, what holds body 1, where it starts and what acts."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.dynamics.loads import MotionAtInstants
from hingepair.dynamics.simulate import BASES, SimulatedMotion, SimulatedPlanarMotion, SimulationError, simulate
from hingepair.integration.trajectory import LazyValue
from hingepair.numeric.arrays import Float64Array
from hingepair.pair.body import DynamicsWarning
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.hinge_load import HingeLoad
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.plans.plan import ACCELERATION
from hingepair.plans.steps import COORDINATES, PLANAR_COORDINATES
from hingepair.rotations.matrices import rotation_exp
from hingepair.scenes.expression_motion import read_coordinate_functions
from hingepair.scenes.instants import held_instants
from hingepair.scenes.known_motion import ByBody1, ByCoordinates
from hingepair.scenes.motion import Motion
from hingepair.scenes.tables import Key, Place, Table, numbers_key
from hingepair.symbolic.exact_constants import exact
from hingepair.symbolic.expressions import parse_expression
from hingepair.symbolic.kinks import constant_value
from hingepair.symbolic.time_functions import TimeFunctions

PRESCRIBED_BASE: Final = "prescribed"
"""Value of `base` in [dynamics] for a body 1 that moves as [motion] says."""

_HINGE_VARIABLES: Final = ("psi", "psid")
"""Names in expressions, beside t, for the hinge angle [rad] and its rate [rad/s]."""
_STOP_KEYS: Final = ("stop_stiffness", "stop_damping", "stop_restitution")
"""Keys of [dynamics] for the stops at the hinge's limits."""
_HINGE_LOAD_KEYS: Final = ("stiffness", "rest", "damping", "friction", "friction_rate", *_STOP_KEYS)
"""Keys of [dynamics] for springs, dampers, friction and stops of the hinge."""
_START_KEYS: Final = ("phi_0", "S1_0", "R1_0", "v1_0", "omega1_0")
"""Keys of [dynamics] for the state of body 1 at the first instant."""
_ARGUMENTS: Final = {"body1": "R1_0", "body1.v": "v1_0", "body1.omega": "omega1_0"}
"""Keys by the arguments of `simulate` that they become."""


def _functions(table: Table, keys: tuple[str, ...]) -> Any:
    """Read the numbers of some keys, or a callable of (t, psi, psi') that returns them."""
    known = {**table.constants, **dict.fromkeys(_HINGE_VARIABLES, 0.0)}
    found = []
    for key in keys:
        value = table.values.get(key)
        with table.naming(key):
            found.append(
                parse_expression(key, value, known, _HINGE_VARIABLES)
                if isinstance(value, str)
                else exact(table.number(key))
            )
    with table.naming():
        if any(expression.free_symbols for expression in found):
            return TimeFunctions(found, keys, _HINGE_VARIABLES).values
        return [constant_value(expression) for expression in found]


def _torque(table: Table, key: str) -> Any:
    """Read a torque at the hinge, or in the plane: a number, or a callable of (t, psi, psi')."""
    found = _functions(table, (key,))
    return (lambda t, psi, psid: found(t, psi, psid)[0]) if callable(found) else found[0]


def _read_load(table: Table, key: str, size: int) -> Any:
    """Read a force or a torque on a body: numbers, or a callable of (t, now)."""
    if size == 1:
        one = _torque(table, key)
        return (lambda t, now: one(t, now.psi, now.psid)) if callable(one) else one
    entries = table.entries(key, size, "t, psi and psid")
    found = _functions(entries, tuple(entries.values))

    def load(t: Float64Array, now: MotionAtInstants) -> Float64Array:
        return np.stack(np.broadcast_arrays(*found(t, now.psi, now.psid), t)[:-1], axis=-1)

    return load if callable(found) else found


def _stops(table: Table, key: str) -> Any:
    """Read stops: two angles, or true for the limits of the pair."""
    return table.values[key] is True or tuple(table.numbers(key, 2))


def _read_instants(table: Table, key: str) -> list[Any]:
    """Read instants, as many as there are."""
    value = table.values[key]
    return table.numbers(key, len(value) if isinstance(value, list) else 1)


def _keys(size: int) -> dict[str, Key]:
    """Return the keys of [dynamics] and their readers, for vectors of so many components."""
    vector, turn = numbers_key(size), Table.number if size == 2 else numbers_key(3)
    force, torque = partial(_read_load, size=size), partial(_read_load, size=1 if size == 2 else 3)
    return {
        **({"phi_0": Table.number} if size == 2 else {"S1_0": Table.rotation}),
        **{"R1_0": vector, "v1_0": vector, "omega1_0": turn, "psi_0": Table.number, "psid_0": Table.number},
        **{"hinge_torque": _torque, "stops": _stops, **dict.fromkeys(_HINGE_LOAD_KEYS, Table.number)},
        **{"force1": force, "torque1": torque, "force2": force, "torque2": torque, "gravity": vector},
        **{
            "tol": Table.number,
            "breaks": _read_instants,
            "base": lambda table, key: table.choice(key, (*BASES, PRESCRIBED_BASE)),
        },
    }


LOAD_KEYS: Final = tuple(_keys(3))
"""What the table [dynamics] may hold in space."""


class DynamicsSetup(NamedTuple):
    """Content of the table [dynamics].

    Attributes:
        base: "free", "pinned", "fixed" or "prescribed".
        body1: where body 1 starts; None of a base that is prescribed.
        hinge: arguments of a `HingeLoad` by name, but for its motor.
        others: arguments of `simulate` by name, as far as they are given.
        keys: the keys of the table.
    """

    base: str
    body1: BodyMotion | None
    hinge: dict[str, Any]
    others: dict[str, Any]
    keys: tuple[str, ...]


def read_setup(table: Table, pair: HingePair | PlanarPair) -> DynamicsSetup:
    """Read the table [dynamics]; nothing is simulated."""
    planar = isinstance(pair, PlanarPair)
    others = table.read(_keys(2 if planar else 3))
    base = others.pop("base", BASES[0])
    start: dict[str, Any] = {key: others.pop(key) for key in _START_KEYS if key in others}
    hinge: dict[str, Any] = {key: others.pop(key) for key in (*_HINGE_LOAD_KEYS, "stops") if key in others}
    if hinge.get("stops") is True:
        hinge["stops"] = getattr(pair, "limits", None)
        if hinge["stops"] is None:
            table.fail("stops", "[lower, upper], or true of a pair that has limits")
    if base == PRESCRIBED_BASE:
        for key in start:
            table.fail(key, f"nothing beside base = {PRESCRIBED_BASE!r}, whose body 1 moves as [motion] says")
    body1 = None if base == PRESCRIBED_BASE else _read_start(table, start, planar)
    for letter in _HINGE_VARIABLES:
        if letter in table.constants:
            own = "psi and psid are the hinge angle and its rate in expressions of [dynamics]"
            Place(table.file, "motion.constants").refuse(letter, f"another name: {own}", repr(letter))
    return DynamicsSetup(base, body1, hinge, others, tuple(table.values))


def read_dynamics(table: Table, motion: Table, time: Table, pair: HingePair | PlanarPair) -> Motion:
    """Simulate the motion that the tables [dynamics], [motion] and [time] describe."""
    kind, body1, hinge, given, _ = read_setup(table, pair)
    for name in ("body1", "body2") if kind in {"free", "pinned"} else ("body2",):
        if getattr(pair, name) is None:
            instead = ", or base = 'fixed' in [dynamics]" if name == "body1" else ""
            expected = f"mass properties, as in [pair.{name}] mass = 2.0{instead}"
            Place(table.file, "pair").refuse(name, expected, "nothing")
    base: Any = kind
    if kind == PRESCRIBED_BASE:
        base = _carried(motion, pair)
    else:
        motion.check_keys(("constants",))
    t = held_instants(time)
    angles = given.pop("psi_0", 0.0), given.pop("psid_0", 0.0)
    try:
        with table.naming(**_ARGUMENTS), warnings.catch_warnings():
            warnings.filterwarnings("ignore", "psi (leaves|passes)", DynamicsWarning)  # the scene's notes say it
            torque = HingeLoad(motor=given.pop("hinge_torque", 0.0), **hinge)
            found = simulate(pair, t, body1, *angles, hinge_torque=torque, base=base, **given)
    except SimulationError as error:
        table.refuse("", "a motion that can be followed", f"none past t = {error.t:.6g}: {error.why}")
    errors = {"rad of psi": LazyValue(lambda: found.psi_error_estimate)}
    if kind in {"free", "pinned"}:
        errors = {"rad of body 1": LazyValue(lambda: found.error_estimate), **errors}
    how = f"simulated in {found.steps} steps, base {kind}"
    return Motion(
        t, _known_motion(found), "simulated from what acts", how, errors, simulated=found, stops=torque.tightest_stops
    )


def _known_motion(found: SimulatedMotion | SimulatedPlanarMotion) -> ByBody1 | ByCoordinates:
    """Return a simulated motion as a scene holds it: by body 1 in space, by coordinates in the plane."""
    hinge = found.psi, found.psid, found.psidd
    if isinstance(found, SimulatedMotion):
        return ByBody1(found.body1, hinge)
    R, v, omega, a, alpha = motion_arrays("body1", found.body1, "R", "v", "omega", "a", "alpha").values()
    rows = zip((R, v, a), (found.phi, omega[:, 2], alpha[:, 2]), hinge, strict=True)
    return ByCoordinates(len(found.t), tuple((*vector.T[:2], angle, psi) for vector, angle, psi in rows), None)


def _read_start(table: Table, given: dict[str, Any], planar: bool) -> BodyMotion:
    """Return the start of body 1; at rest at the origin unless given."""
    R, v = ((*given.get(key, (0, 0, 0)), 0)[:3] for key in ("R1_0", "v1_0"))
    if planar:
        S: Any = rotation_exp((0, 0, given.get("phi_0", 0.0)))
        return BodyMotion(R=R, S=S, v=v, omega=(0, 0, given.get("omega1_0", 0.0)))
    with table.naming(S="S1_0"):
        return BodyMotion(R=R, S=given.get("S1_0", np.eye(3)), v=v, omega=given.get("omega1_0", (0, 0, 0)))


def _carried(motion: Table, pair: HingePair | PlanarPair) -> Callable[[Float64Array], BodyMotion]:
    """Return a callable of t for body 1 as the coordinates of [motion] move it."""
    names = PLANAR_COORDINATES if isinstance(pair, PlanarPair) else COORDINATES
    functions, sequence = read_coordinate_functions(motion, names[:-1])

    def moved(t: Float64Array) -> BodyMotion:
        rows = tuple((*row, 0.0) for row in functions.derivatives(t, ACCELERATION))
        return ByCoordinates(len(t), rows, sequence).in_space(pair).body1

    return moved
