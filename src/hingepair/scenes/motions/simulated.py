"""Motion by dynamics: the table [dynamics] of a scene, what holds the base, where it starts and what acts.

[dynamics.JOINT] has the start and the loads of a joint; psi is that of a pair.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.equations.quantities import ACCELERATION
from hingepair.errors import DynamicsWarning, SimulationError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.planar_pair import PLANAR_GRAVITY
from hingepair.motion.given import given_joint
from hingepair.motion.simulate import simulate
from hingepair.motion.simulated import SimulatedRobotMotion
from hingepair.rotations.matrices import rotation_exp
from hingepair.scenes.assembly import Assembly
from hingepair.scenes.motions.functions import FunctionsOfTime, base_of, read_functions, read_sequence
from hingepair.scenes.motions.known import PSI, RATE_SUFFIXES, EulerBase, Known
from hingepair.scenes.motions.motion import Motion, impact_sentences, read_instants
from hingepair.scenes.tables import Key, NamedSource, Table, numbers_key
from hingepair.symbolic.expressions import number, parse_expression
from hingepair.symbolic.time_functions import TimeFunctions
from hingepair.tables.sheets import instant_text

_simulate: Any = simulate  # of a mechanism

PRESCRIBED: Final = "prescribed"
"""Value of `base` for a body 1 or base that moves as [motion] says."""
_BASES: Final = ("fixed", "free", "pinned", PRESCRIBED)
_JOINT_NUMBERS: Final = (
    *("q_0", "qd_0", "stiffness", "rest", "damping", "friction", "friction_rate"),
    *("stop_stiffness", "stop_damping", "stop_restitution"),
)
_WRENCH: Final = ("force", "torque")  # keys of [dynamics.wrenches.LINK]
_START: Final = ("R1_0", "S1_0", "phi_0", "v1_0", "omega1_0")  # keys of the state of the base at the start
_SIMULATED: Final = (*_START, "force1", "torque1", "tol", "max_steps", "breaks", "until")
_QUIET: Final = frozenset({"base", "gravity", "joint_loads"})  # keys that by themselves simulate nothing


class Dynamics(NamedTuple):
    """What the table [dynamics] of a scene says."""

    #: fixed, free, pinned or PRESCRIBED
    base: str
    #: motion of body 1 or the base at the first instant; None if it is prescribed
    start: BodyMotion | None
    #: coordinates and rates at the first instant, by joint
    q0: dict[str, float]
    qd0: dict[str, float]
    #: loads by joint
    loads: dict[str, HingeLoad]
    #: (force, torque) on links by name; body 2 of a pair is the link psi
    wrenches: dict[str, tuple[Any, Any]]
    #: acceleration of free fall [m/s^2]; (3,)
    gravity: tuple[float, ...]
    #: further arguments of `simulate` by name, as far as the table has them
    options: dict[str, Any]


def default_gravity(assembly: Assembly) -> tuple[float, ...]:
    """Return the gravity of a scene that gives none [m/s^2]; (3,)."""
    return (*PLANAR_GRAVITY, 0.0) if assembly.planar else DEFAULT_GRAVITY


def simulates(tables: Table, assembly: Assembly) -> bool:
    """Return whether [dynamics] simulates joints or the base, not only loads beside the motion that [motion] gives:
    joints that nothing moves, unless the table has base, gravity and joint_loads alone; a base that is free or pinned
    and that [motion] does not move.
    """
    table, motion = (tables.table(name, required=False) for name in ("dynamics", "motion"))
    if "dynamics" not in tables.values or "file" in motion.values:
        return False
    moves_base = not motion.values.keys().isdisjoint(assembly.base_names)
    moved = set(assembly.moved_by(motion))
    if not moves_base and table.values.get("base") in ("free", "pinned"):
        return True
    is_given = bool(moved) or (moves_base and assembly.pair is None)
    is_quiet = is_given and bool(table.values) and table.values.keys() <= _QUIET
    return bool(set(assembly.names) - moved) and not is_quiet


def read_dynamics(tables: Table, assembly: Assembly) -> Dynamics:
    """Return what the table [dynamics] of a scene says, without simulating it."""
    table, motion = (tables.table(name, required=False) for name in ("dynamics", "motion"))
    names = tuple(name + rate for rate in RATE_SUFFIXES[:2] for name in assembly.names if name.isidentifier())
    readers = _readers(assembly, names)
    if "dynamics" in tables.values:
        for name in names:
            if name in table.constants:
                expected = f"another name, since {name} is of a joint in expressions of [dynamics]"
                NamedSource(table.file, "constants").refuse(name, expected, quoted(name))
        assembly.check_joint_names(table, readers)
        assembly.check_keys(table, readers)
    options = replace(table, values={key: value for key, value in table.values.items() if key in readers}).read(
        readers
    )
    moves_base = not motion.values.keys().isdisjoint({*assembly.base_names, "file"})
    simulated = simulates(tables, assembly)
    default = PRESCRIBED if moves_base else "free" if assembly.pair is not None and simulated else "fixed"
    base = options.pop("base", default)
    start: dict[str, Any] = {key: options.pop(key) for key in _START if key in options}
    for key in start if moves_base or base == PRESCRIBED else ():
        table.fail(key, f"no such key together with base = {PRESCRIBED!r}: [motion] moves the base")
    if base == PRESCRIBED and not moves_base:
        table.fail("base", f"another base, since {PRESCRIBED!r} needs coordinates such as x in [motion]")
    described = assembly.robot.joint_loads if options.pop("joint_loads", False) else {}
    if not simulated:  # a given motion may press on limits
        described = {name: replace(load, stops=None) for name, load in described.items()}
    joints = {name: table.table(name) for name in assembly.names if name in table.values}
    rows = {name: _read_joint(own, assembly, name, described.get(name, HingeLoad())) for name, own in joints.items()}
    keys = [key for key in table.values if key not in joints]
    keys += [f"{name}.{key}" for name, own in joints.items() for key in own.values]
    for key in keys if not simulated else ():
        if key in _SIMULATED or key.split(".")[-1] in {"q_0", "qd_0", "tau"}:
            wanted = "no such key, since [motion] gives all that moves: `hingepair forces` gives what motors exert"
            table.refuse(key, wanted, "a value")
    q0, qd0 = (
        {name: rows[name][0].get(key, 0.0) if name in rows else 0.0 for name in assembly.names}
        for key in ("q_0", "qd_0")
    )
    return Dynamics(
        base=base,
        start=None if moves_base else _base_at_start(table, start, assembly.planar),
        q0=q0,
        qd0=qd0,
        loads={**described, **{name: load for name, (_, load) in rows.items()}},
        wrenches=options.pop("wrenches", {}),
        gravity=(*options.pop("gravity", default_gravity(assembly)), 0.0)[:3],
        options=options,
    )


# ---- readers of keys


def _readers(assembly: Assembly, names: tuple[str, ...]) -> dict[str, Key]:
    """Return the keys of [dynamics] but joints, and their readers; `names` are the coordinates and rates of joints
    that expressions may use.
    """
    size = assembly.dimensions
    vector, turn = numbers_key(size), Table.number if size == 2 else numbers_key(3)
    force, torque = (partial(_read_vector, assembly=assembly, names=names, in_plane=form) for form in _FORMS[size])
    attitude: dict[str, Key] = {"phi_0": Table.number} if size == 2 else {"S1_0": Table.rotation}
    readers: dict[str, Key] = {
        "base": lambda table, key: table.choice(key, _BASES),
        **{"R1_0": vector, **attitude, "v1_0": vector, "omega1_0": turn},
        **{"gravity": vector, "force1": force, "torque1": torque},
        "wrenches": lambda table, key: _read_wrenches(table.table(key), assembly, force, torque),
        **{"tol": Table.number, "max_steps": Table.number, "breaks": _read_breaks},
        "until": lambda table, key: _read_until(table, key, assembly, names),
    }
    return readers if assembly.pair is not None else {**readers, "joint_loads": Table.flag}


_FORMS: Final = {2: ("xy", "z"), 3: ("", "")}  # of forces and torques in the plane and in space


def _function_of_state(table: Table, keys: tuple[str, ...], names: tuple[str, ...]) -> Any:
    """Return the values under `keys`: a list of floats, or, if any depends on t or `names`, a callable of (t, *names)
    that returns a tuple of all.
    """
    constants = {**table.constants, **dict.fromkeys(names, 0.0)}
    expressions = []
    for key in keys:
        value = table.values.get(key)
        with table.naming(key):
            if isinstance(value, str):
                expressions.append(parse_expression(key, value, constants, names))
            else:
                expressions.append(number(table.number(key)))
    if any(expression.names for expression in expressions):
        return TimeFunctions(expressions, names).values
    return [float(expression) for expression in expressions]


def _of_joints(call: Callable[..., Any], assembly: Assembly, names: tuple[str, ...]) -> Callable[..., Any]:
    """Return a callable of (t, now) of one of (t, *names), coordinates and rates of joints."""
    columns = [assembly.names.index(name) for name in names[: len(names) // 2]]
    return lambda t, now: call(t, *now.q.T[columns], *now.qd.T[columns])


def _read_vector(table: Table, key: str, *, assembly: Assembly, names: tuple[str, ...], in_plane: str) -> Any:
    """Return a force or torque: three floats, or a callable of (t, now) that returns (N, 3); in the plane two
    components, xy, or one about z, are given.
    """
    if in_plane != "z":
        table = table.entries(key, len(in_plane) or 3, "t and coordinates and rates of joints")
    components = _function_of_state(table, (key,) if in_plane == "z" else tuple(table.values), names)

    def in_space(values: Any) -> tuple[Any, ...]:
        return (0.0, 0.0, *values) if in_plane == "z" else (*values, 0.0)[:3]

    if not callable(components):
        return in_space(components)
    call = _of_joints(components, assembly, names)
    return lambda t, now: np.stack(np.broadcast_arrays(*in_space(call(t, now)), t)[:-1], axis=-1)


def _read_wrenches(table: Table, assembly: Assembly, force: Key, torque: Key) -> dict[str, tuple[Any, Any]]:
    """Return (force, torque), world axes, at the origin of a link, by its name; 0 where the table has none."""
    found = {}
    for link in table.values:
        if assembly.pair is not None and link != "body2":
            table.refuse(link, "body2 (force1 and torque1 act on body 1)", repr(link))
        values = table.table(link).read(dict(zip(_WRENCH, (force, torque), strict=True)))
        found[link if assembly.pair is None else PSI[0]] = values.get("force", 0), values.get("torque", 0)
    return found


def _read_breaks(table: Table, key: str) -> list[Any]:
    """Return the list of instants [s], of any length, under a key of a Table."""
    value = table.values[key]
    return table.numbers(key, len(value) if isinstance(value, list) else 1)


def _read_until(table: Table, key: str, assembly: Assembly, names: tuple[str, ...]) -> Any:
    """Return the expression that passes 0 at the event, as a callable of (t, now)."""
    value = _function_of_state(table, (key,), names)
    if not callable(value):
        table.fail(key, "an expression in t and coordinates and rates of joints, which passes 0 at the event")
    call = _of_joints(value, assembly, names)
    return lambda t, now: call(t, now)[0]


def _read_joint(
    table: Table, assembly: Assembly, name: str, described: HingeLoad
) -> tuple[dict[str, Any], HingeLoad]:
    """Return the values of a joint's table, and its load: the table's fields over those of the load `described`."""
    keys: dict[str, Key] = {
        **dict.fromkeys(_JOINT_NUMBERS, Table.number),
        "tau": partial(_read_effort, own=(name, f"{name}d") if name.isidentifier() else ()),
        "stops": lambda table, key: table.values[key] is True or tuple(table.numbers(key, 2)),
    }
    values: dict[str, Any] = table.read(keys)
    load = {"motor" if key == "tau" else key: value for key, value in values.items() if key not in ("q_0", "qd_0")}
    if load.get("stops") is True:
        joint = next(joint for joint in assembly.joints if joint.name == name)
        if not np.isfinite(joint.position_limits).any():
            table.fail("stops", "[lower, upper], or true of a joint that has limits")
        load["stops"] = joint.position_limits
    q, stops = values.get("q_0", 0.0), load.get("stops")
    if stops and "stop_restitution" in load and abs(q) > 2 * np.pi and not stops[0] <= q <= stops[1]:
        table.fail("q_0", f"a coordinate between the stops, {stops[0]:g} to {stops[1]:g} rad (deg(90) is 90 degrees)")
    if "stop_restitution" in load and "stop_stiffness" in load:
        table.refuse("stop_stiffness", "no value beside stop_restitution, of rigid stops", load["stop_stiffness"])
    with table.naming(motor="tau"):
        return values, replace(described, **load)


def _read_effort(table: Table, key: str, own: tuple[str, ...]) -> Any:
    """Return the effort of a motor: a float, or a callable of (t, q, qd) for an expression in t, q and qd, which may
    also be called by the joint's name.
    """
    effort = _function_of_state(table, (key,), ("q", "qd", *own))
    if not callable(effort):
        return effort[0]
    return lambda t, q, qd: effort(t, q, qd, *(q, qd)[: len(own)])[0]


def _base_at_start(table: Table, start: Mapping[str, Any], planar: bool) -> BodyMotion:
    """Return the motion of the base at the first instant; at rest at the origin but for `start`."""
    R, v = ((*start.get(key, (0, 0, 0)), 0)[:3] for key in ("R1_0", "v1_0"))
    omega = start.get("omega1_0", 0.0 if planar else (0, 0, 0))
    if planar:
        return BodyMotion(R=R, S=rotation_exp((0, 0, start.get("phi_0", 0.0))), v=v, omega=(0, 0, omega))
    with table.naming(S="S1_0"):
        return BodyMotion(R=R, S=start.get("S1_0", np.eye(3)), v=v, omega=omega)


# ---- simulation


def read_simulated_motion(tables: Table, assembly: Assembly, dynamics: Dynamics) -> Motion:
    """Simulate the motion of joints and base that [motion] does not give."""
    table, motion = tables.table("dynamics"), tables.table("motion", required=False)
    pair = assembly.pair
    for name in ("body1", "body2") if dynamics.base in ("free", "pinned") else ("body2",):
        if pair is not None and getattr(pair, name) is None:
            instead = ", or base = 'fixed' in [dynamics]" if name == "body1" else ""
            expected = f"mass properties, as in [pair.{name}] mass = 2.0{instead}"
            NamedSource(table.file, "pair").refuse(name, expected, "nothing")
    assembly.check_motion_keys(motion)
    moved = assembly.moved_by(motion)
    functions, sequence = read_functions(motion, assembly, moved), read_sequence(motion, assembly)
    t = read_instants(tables.table("time"))
    driven = {name: partial(_driven, functions, name) for name in moved}
    for name, move in driven.items():
        if name in table.values:
            table.fail(name, "no such table: [motion] moves this joint as given")
        with motion.naming(name):
            given_joint(name, move).check(t)

    def base_motion(t: Any) -> BodyMotion:
        base = base_of(assembly, functions.rows(t, ACCELERATION), sequence)
        return BodyMotion.at_rest() if base is None else base.body(len(t))

    moves_base, loads = dynamics.base == PRESCRIBED, {k: own for k, own in dynamics.loads.items() if k not in driven}
    held = "moving" if moves_base else dynamics.base
    named = {f"q0[{name!r}]": f"{name}.q_0" for name in assembly.names}
    named |= {f"loads[{name!r}]": name for name in assembly.names}
    named |= {"base_motion": "R1_0" if pair is not None else "base"}
    named |= {f"base_motion.{letter}": f"{letter}1_0" for letter in ("R", "S", "v", "omega")}
    for link in dynamics.wrenches:
        place = f"wrenches.{link if pair is None else 'body2'}"
        named |= {f"wrenches[{link!r}][{i}]": f"{place}.{_WRENCH[i]}" for i in (0, 1)}
    robot = assembly.robot.with_base("free" if held in ("free", "pinned") else "fixed")
    try:
        with table.naming(**named), warnings.catch_warnings():
            for said in (".* (leaves its|passes the) ", ".* is taken for ", ".* is it in seconds"):  # as notes do
                warnings.filterwarnings("ignore", said, DynamicsWarning)
            found = _simulate(
                robot, t, dynamics.q0, dynamics.qd0, loads=loads, gravity=dynamics.gravity, base=held, driven=driven,
                base_motion=base_motion if moves_base else dynamics.start, wrenches=dynamics.wrenches or None,
                **dynamics.options,
            )  # fmt: skip
    except SimulationError as error:
        table.refuse("", "a motion that can be followed", f"none past t = {error.t:.6g}: {error.why}")
    rests = held == "fixed" and not any(np.any(x) for x in (found.base_motion.R, found.base_motion.S - np.eye(3)))
    phi_0 = table.number("phi_0", 0.0) if assembly.planar and not moves_base else 0.0
    until = "until" in dynamics.options
    return simulated_motion(assembly, found, loads, moves=pair is not None or not rests, phi_0=phi_0, until=until)


def _driven(functions: FunctionsOfTime, name: str, t: Any) -> list[Any]:
    return [row[name] for row in functions.rows(t, ACCELERATION)]


def simulated_motion(
    assembly: Assembly,
    found: SimulatedRobotMotion,
    loads: Mapping[str, HingeLoad],
    *,
    moves: bool = True,
    phi_0: float = 0.0,
    until: bool = True,
) -> Motion:
    """Return a simulated motion as that of a scene, with the loads at joints. `moves` says whether the base is not at
    rest at the origin, `phi_0` which of the angles of a body 1 in the plane the first is, to whole turns, `until`
    whether only an event can have ended the motion.
    """
    units, is_free = {joint.name: joint.unit for joint in assembly.joints}, found.base in ("free", "pinned")

    def error(unit: str) -> float:
        try:
            own = [0.0] if unit == "m" else [found.attitude_error_estimate]
            own += [found.q_error_estimate[k] for k, one in enumerate(units.values()) if one == unit]
            return float(max(own))
        except SimulationError:  # the second run, with a smaller tolerance, has an end of its own
            return math.nan

    cause = "until ends the motion" if until else "the mechanism ends the motion, which a warning explains,"
    ended = [f"{cause} at t = {instant_text(found.t[-1])} s"] * found.ended_by_event
    base: Any = _base_in_plane(found, phi_0) if assembly.planar else found.base_motion if moves else None
    rows = tuple(tuple(rows.T) for rows in (found.q, found.qd, found.qdd))
    held = PRESCRIBED if found.base == "moving" else found.base
    return Motion(
        t=found.t,
        source=Known(assembly.names, len(found.t), rows, base),
        origin="simulated from what acts",
        how=f"simulated in {found.steps} steps, base {held}",
        moving=assembly.names,
        errors={unit: partial(error, unit) for unit in sorted({*units.values(), *["rad"] * is_free})},
        doubt="a second run with a smaller tolerance, which tells the error, cannot be followed",
        notes=(*impact_sentences(found.impacts, units), *ended),
        simulated=found,
        loads=loads,
    )


def _base_in_plane(found: SimulatedRobotMotion, phi_0: float) -> EulerBase:
    """Return the motion of a base that moves in the plane by x, y and phi, whose whole turns follow from its rate."""
    body, t = found.base_motion, found.t
    R, S, v, omega, a, alpha = (np.asarray(getattr(body, name)) for name in ("R", "S", "v", "omega", "a", "alpha"))
    angle = np.arctan2(S[:, 1, 0], S[:, 0, 0])
    rate, step = omega[:, 2], np.diff(t)
    # Hermite's rule: exact for cubic rates.
    turned = step * (rate[1:] + rate[:-1]) / 2 - step**2 * np.diff(alpha[:, 2]) / 12
    about = phi_0 + np.concatenate(([0.0], np.cumsum(turned)))
    phi = np.unwrap(angle - about) + about
    phi += 2 * np.pi * np.round((phi_0 - phi[0]) / (2 * np.pi))
    rows = ((R, phi), (v, rate), (a, alpha[:, 2]))
    return EulerBase(tuple((*vectors.T[:2], own) for vectors, own in rows), None)
