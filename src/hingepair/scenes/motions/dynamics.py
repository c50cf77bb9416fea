"""Motion by dynamics: the table [dynamics] of a scene, what holds the base, where it starts and what acts.

[dynamics.JOINT] has the start and the loads of a joint; psi is that of a pair.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.equations.quantities import ACCELERATION
from hingepair.errors import SimulationError
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.planar_pair import PLANAR_GRAVITY
from hingepair.motion.given import given_joint
from hingepair.motion.simulate import simulate
from hingepair.motion.simulated import SimulatedRobotMotion
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import rotation_exp
from hingepair.scenes.motions.functions import read_base, read_functions
from hingepair.scenes.motions.known import PSI, RATE_SUFFIXES, EulerBase, Known
from hingepair.scenes.motions.motion import LazyValue, Motion, impact_sentences, read_instants
from hingepair.scenes.subject import Subject
from hingepair.scenes.tables import Key, NamedSource, Table, numbers_key
from hingepair.symbolic.expressions import number, parse_expression
from hingepair.symbolic.time_functions import TimeFunctions
from hingepair.tables.sheets import instant_text

_simulate: Any = simulate  # of a mechanism

PRESCRIBED: Final = "prescribed"
"""Value of `base` for a body 1 or base that moves as [motion] says."""
BASES: Final = ("fixed", "free", "pinned", PRESCRIBED)
"""Values of `base` in [dynamics]."""
HINGE_LOAD_KEYS: Final = (
    *("stiffness", "rest", "damping", "friction", "friction_rate"),
    *("stop_stiffness", "stop_damping", "stop_restitution"),
)
"""Keys of [dynamics.JOINT] for springs, dampers, friction and stops."""
DOUBT: Final = "a second run with a smaller tolerance, which tells the error, cannot be followed"
"""Why the error of a simulated motion may be unknown."""
_WRENCH: Final = ("force", "torque")  # keys of [dynamics.wrenches.LINK]
_START: Final = ("R1_0", "S1_0", "phi_0", "v1_0", "omega1_0")  # keys of the state of the base at the start
_QUIET: Final = frozenset({"base", "gravity", "joint_loads"})  # keys that by themselves simulate nothing
_BEFORE: Final = {  # keys of [dynamics] as scenes of pairs had them, and what they are now
    "psi_0": "q_0 in [dynamics.psi]",
    "psid_0": "qd_0 in [dynamics.psi]",
    "hinge_torque": "tau in [dynamics.psi]",
    "force2": "force in [dynamics.wrenches.body2]",
    "torque2": "torque in [dynamics.wrenches.body2]",
    **{key: f"{key} in [dynamics.psi]" for key in (*HINGE_LOAD_KEYS, "stops")},
}


class Dynamics(NamedTuple):
    """What the table [dynamics] of a scene says."""

    #: one of BASES
    base: str
    #: motion of body 1 or the base at the first instant; None if it is prescribed
    start: BodyMotion | None
    #: coordinates and rates at the first instant, by joint
    q0: dict[str, float]
    qd0: dict[str, float]
    #: loads by joint
    loads: dict[str, HingeLoad]
    #: acceleration of free fall [m/s^2]; (3,)
    gravity: tuple[float, ...]
    #: further arguments of `simulate` by name, as far as the table has them
    options: dict[str, Any]
    #: the keys of the table, those of joints as psi.damping
    keys: tuple[str, ...]


def default_gravity(subject: Subject) -> tuple[float, ...]:
    """Return the gravity of a scene that gives none [m/s^2]; (3,)."""
    return (*PLANAR_GRAVITY, 0.0) if subject.planar else DEFAULT_GRAVITY


def simulates(tables: Table, subject: Subject) -> bool:
    """Return whether [dynamics] simulates joints or the base, not only loads beside the motion that [motion] gives:
    joints that nothing moves, unless the table has base, gravity and joint_loads alone; a base that is free or pinned
    and that [motion] does not move.
    """
    if "dynamics" not in tables.values:
        return False
    table, motion = tables.table("dynamics"), tables.table("motion", required=False)
    if "file" in motion.values:
        return False
    moves_base = not motion.values.keys().isdisjoint(subject.base_names)
    moved = set(subject.moved_by(motion))
    if not moves_base and table.values.get("base") in ("free", "pinned"):
        return True
    is_given = bool(moved) or (moves_base and subject.pair is None)
    is_quiet = is_given and bool(table.values) and table.values.keys() <= _QUIET
    return bool(set(subject.names) - moved) and not is_quiet


def read_dynamics(tables: Table, subject: Subject) -> Dynamics:
    """Return what the table [dynamics] of a scene says, without simulating it."""
    table, motion = tables.table("dynamics", required=False), tables.table("motion", required=False)
    for key, now in _BEFORE.items() if subject.pair is not None else ():
        if key in table.values:
            table.refuse(key, now, "a key of [dynamics]")
    names = _variables(subject, table)
    readers = _readers(subject, names)
    if "dynamics" in tables.values:
        subject.check_joint_names(table, readers)
        subject.check_keys(table, readers)
    own = {key: value for key, value in table.values.items() if key in readers}
    options = replace(table, values=own).read(readers)
    moves_base = not motion.values.keys().isdisjoint({*subject.base_names, "file"})
    rest = "free" if subject.pair is not None and simulates(tables, subject) else "fixed"
    base = options.pop("base", PRESCRIBED if moves_base else rest)
    start: dict[str, Any] = {key: options.pop(key) for key in _START if key in options}
    for key in start if moves_base or base == PRESCRIBED else ():
        table.fail(key, f"no such key together with base = {PRESCRIBED!r}: [motion] moves the base")
    if base == PRESCRIBED and not moves_base:
        table.fail("base", f"another base, since {PRESCRIBED!r} needs coordinates such as x in [motion]")
    gravity = (*options.pop("gravity", default_gravity(subject)), 0.0)[:3]
    described = subject.robot.joint_loads if options.pop("joint_loads", False) else {}
    if not simulates(tables, subject):  # a given motion may press on limits
        described = {name: replace(load, stops=None) for name, load in described.items()}
    rows = {
        name: _read_joint(table.table(name), subject, name, described.get(name, HingeLoad()))
        for name in subject.names
        if name in table.values
    }
    loads = {**described, **{name: load for name, (_, load) in rows.items()}}
    keys = [key for key in table.values if key not in subject.names]
    keys += [f"{name}.{key}" for name in rows for key in table.table(name).values]
    first = None if moves_base else _base_at_start(table, start, subject.planar)
    q0, qd0 = ({name: values.get(key, 0.0) for name, (values, _) in rows.items()} for key in ("q_0", "qd_0"))
    return Dynamics(base, first, q0, qd0, loads, gravity, options, tuple(keys))


def _variables(subject: Subject, table: Table) -> tuple[str, ...]:
    """Return coordinates and rates of joints, such as psi and psid, that expressions of [dynamics] may use."""
    for letter in ("psi", "psid") if subject.pair is not None else ():
        if letter in table.constants:
            meaning = "psi and psid are the hinge angle and its rate in expressions of [dynamics]"
            NamedSource(table.file, "constants").refuse(letter, f"another name: {meaning}", repr(letter))
    joints = [name for name in subject.names if name.isidentifier() and name not in table.constants]
    return tuple(name + suffix for suffix in RATE_SUFFIXES[:2] for name in joints)


def _readers(subject: Subject, names: tuple[str, ...]) -> dict[str, Key]:
    """Return the keys of [dynamics] but joints, and their readers."""
    size = subject.dimensions
    vector, turn = numbers_key(size), Table.number if size == 2 else numbers_key(3)
    force, torque = (
        partial(_read_vector, subject=subject, names=names, size=n) for n in (size, 1 if size == 2 else 3)
    )
    attitude: dict[str, Key] = {"phi_0": Table.number} if size == 2 else {"S1_0": Table.rotation}
    readers: dict[str, Key] = {
        "base": lambda table, key: table.choice(key, BASES),
        **{"R1_0": vector, **attitude, "v1_0": vector, "omega1_0": turn},
        **{"gravity": vector, "force1": force, "torque1": torque},
        "wrenches": lambda table, key: _read_wrenches(table.table(key), subject, force, torque),
        **{"tol": Table.number, "max_steps": Table.number, "breaks": _read_breaks},
        "until": lambda table, key: _read_until(table, key, subject, names),
    }
    return readers if subject.pair is not None else {**readers, "joint_loads": Table.flag}


def _functions_of_state(table: Table, keys: tuple[str, ...], names: tuple[str, ...]) -> Any:
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


def _of_joints(call: Callable[..., Any], subject: Subject, names: tuple[str, ...]) -> Callable[..., Any]:
    """Return a callable of (t, now) of one of (t, *names), coordinates and rates of joints."""
    used = names[: len(names) // 2]
    columns = [subject.names.index(name) for name in used]
    return lambda t, now: call(t, *now.q.T[columns], *now.qd.T[columns])


def _read_vector(table: Table, key: str, *, subject: Subject, names: tuple[str, ...], size: int) -> Any:
    """Return a force or torque: three floats, or a callable of (t, now) that returns (N, 3); in the plane two
    components, or one about z, are given.
    """
    if size == 1:
        components = _functions_of_state(table, (key,), names)
    else:
        used = "t, psi and psid" if subject.pair is not None else "t and coordinates and rates of joints"
        entries = table.entries(key, size, used)
        components = _functions_of_state(entries, tuple(entries.values), names)

    def in_space(values: Any) -> tuple[Any, ...]:
        return (0.0, 0.0, *values) if size == 1 else (*values, 0.0)[:3]

    if not callable(components):
        return in_space(components)
    call = _of_joints(components, subject, names)
    return lambda t, now: np.stack(np.broadcast_arrays(*in_space(call(t, now)), t)[:-1], axis=-1)


def _read_wrenches(table: Table, subject: Subject, force: Key, torque: Key) -> dict[str, tuple[Any, Any]]:
    """Return (force, torque), world axes, at the origin of a link, by its name; 0 where the table has none."""
    found = {}
    for link in table.values:
        if subject.pair is not None and link != "body2":
            table.refuse(link, "body2 (force1 and torque1 act on body 1)", repr(link))
        values = table.table(link).read(dict(zip(_WRENCH, (force, torque), strict=True)))
        found[link] = values.get("force", 0), values.get("torque", 0)
    return found


def _read_breaks(table: Table, key: str) -> list[Any]:
    """Return the list of instants [s], of any length, under a key of a Table."""
    value = table.values[key]
    return table.numbers(key, len(value) if isinstance(value, list) else 1)


def _read_until(table: Table, key: str, subject: Subject, names: tuple[str, ...]) -> Any:
    """Return the expression that passes 0 at the event, as a callable of (t, now)."""
    value = _functions_of_state(table, (key,), names)
    if not callable(value):
        variables = "psi and psid" if subject.pair is not None else "coordinates and rates of joints"
        table.fail(key, f"an expression in t, {variables}, which passes 0 at the event")
    call = _of_joints(value, subject, names)
    return lambda t, now: call(t, now)[0]


def _read_stops(table: Table, key: str) -> Any:
    """Return two coordinates, or True, which means the limits of the joint."""
    return table.values[key] is True or tuple(table.numbers(key, 2))


def _read_joint(table: Table, subject: Subject, name: str, described: HingeLoad) -> tuple[dict[str, Any], HingeLoad]:
    """Return the values of a joint's table, and its load: the table's fields over those of the load `described`."""
    own = (name, f"{name}d") if name.isidentifier() and name not in table.constants else ()
    keys: dict[str, Key] = {
        **dict.fromkeys(("q_0", "qd_0", *HINGE_LOAD_KEYS), Table.number),
        "tau": partial(_read_effort, own=own),
        "stops": _read_stops,
    }
    values: dict[str, Any] = table.read(keys)
    fields = {key: value for key, value in values.items() if key not in ("q_0", "qd_0", "tau")}
    if fields.get("stops") is True:
        joint = next(joint for joint in subject.joints if joint.name == name)
        if not np.isfinite(joint.position_limits).any():
            of = "pair" if subject.pair is not None else "joint"
            table.fail("stops", f"[lower, upper], or true of a {of} that has limits")
        fields["stops"] = joint.position_limits
    q, stops = values.get("q_0", 0.0), fields.get("stops")
    if stops and "stop_restitution" in fields and abs(q) > 2 * np.pi and not stops[0] <= q <= stops[1]:
        table.fail("q_0", f"a coordinate between the stops, {stops[0]:g} to {stops[1]:g} rad (deg(90) is 90 degrees)")
    with table.naming(motor="tau"):
        return values, replace(described, **fields, **({"motor": values["tau"]} if "tau" in values else {}))


def _read_effort(table: Table, key: str, own: tuple[str, ...]) -> Any:
    """Return the effort of a motor: a float, or a callable of (t, q, qd) for an expression in t, q and qd, which may
    also be called by the joint's name.
    """
    names = ("q", "qd", *own)
    effort = _functions_of_state(table, (key,), names)
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


def read_simulated_motion(tables: Table, subject: Subject, dynamics: Dynamics) -> Motion:
    """Simulate the motion of joints and base that [motion] does not give."""
    table, motion = tables.table("dynamics"), tables.table("motion", required=False)
    _check_masses(table, subject, dynamics.base)
    subject.check_motion_keys(motion)
    base, sequence = read_base(motion, subject)
    if dynamics.base != PRESCRIBED:
        base = None
    t = read_instants(tables.table("time"))
    driven = _read_driven(motion, subject, t)
    for name in driven:
        if name in table.values:
            table.fail(name, "no such table: [motion] moves this joint as given")
    loads = {name: load for name, load in dynamics.loads.items() if name not in driven}
    options = dict(dynamics.options)
    wrenches = link_wrenches(subject, dynamics)
    options.pop("wrenches", None)
    named = {f"q0[{name!r}]": f"{name}.q_0" for name in subject.names}
    named |= {f"loads[{name!r}]": name for name in subject.names}
    named |= {"base_motion": "R1_0" if subject.pair is not None else "base"}
    named |= {f"base_motion.{letter}": f"{letter}1_0" for letter in ("R", "S", "v", "omega")}
    for name, link in zip(dynamics.options.get("wrenches", ()), wrenches, strict=True):
        named |= {f"wrenches[{link!r}][{i}]": f"wrenches.{name}.{_WRENCH[i]}" for i in (0, 1)}
    start: Any = dynamics.start if base is None else partial(_moved, base, sequence)
    held = "moving" if base is not None else dynamics.base
    robot = subject.robot.with_base("free" if held in ("free", "pinned") else "fixed")
    try:
        with table.naming(**named), _silent_warnings():
            found = _simulate(
                robot, t, dynamics.q0 | {name: 0.0 for name in subject.names if name not in dynamics.q0},
                dynamics.qd0 | {name: 0.0 for name in subject.names if name not in dynamics.qd0},
                loads=loads, gravity=dynamics.gravity, base_motion=start, base=held, driven=driven,
                wrenches=wrenches or None, **options,
            )  # fmt: skip
    except SimulationError as error:
        table.refuse("", "a motion that can be followed", f"none past t = {error.t:.6g}: {error.why}")
    moves: bool = held != "fixed" or any(np.any(x) for x in (found.base_motion.R, found.base_motion.S - np.eye(3)))
    phi_0 = table.number("phi_0", 0.0) if subject.planar and base is None else 0.0
    return simulated_motion(
        subject, found, loads, moves=moves or subject.pair is not None, phi_0=phi_0, until="until" in options
    )


def link_wrenches(subject: Subject, dynamics: Dynamics) -> dict[str, tuple[Any, Any]]:
    """Return (force, torque) on links by name; body2 of a pair is the link psi of its mechanism."""
    written = dynamics.options.get("wrenches", {})
    return written if subject.pair is None else dict(zip(PSI, written.values(), strict=False))


def _check_masses(table: Table, subject: Subject, base: str) -> None:
    """Refuse a pair of which a body that moves has no mass properties."""
    for name in ("body1", "body2") if base in {"free", "pinned"} else ("body2",):
        if subject.pair is not None and getattr(subject.pair, name) is None:
            instead = ", or base = 'fixed' in [dynamics]" if name == "body1" else ""
            expected = f"mass properties, as in [pair.{name}] mass = 2.0{instead}"
            NamedSource(table.file, "pair").refuse(name, expected, "nothing")


def simulated_motion(
    subject: Subject,
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
    is_pair, units = subject.pair is not None, {joint.name: joint.unit for joint in subject.joints}
    errors: dict[str, LazyValue] = {}
    base_error = {
        "rad of body 1" if is_pair else "rad of the base": estimate_or_nan(lambda: found.attitude_error_estimate)
    }
    if is_pair and found.base in {"free", "pinned"}:
        errors |= base_error
    for unit in sorted({*units.values()}):
        columns = [k for k, name in enumerate(subject.names) if units[name] == unit]
        error = estimate_or_nan(partial(lambda columns: float(found.q_error_estimate[columns].max()), columns))
        errors["rad of psi" if is_pair else f"{unit} of q"] = error
    if not is_pair and found.base in {"free", "pinned"}:
        errors |= base_error
    held = PRESCRIBED if found.base == "moving" else found.base
    base: Any = found.base_motion if moves else None
    if subject.planar:
        base = _base_in_plane(found, phi_0)
    origin = "simulated from what acts"
    return Motion(
        t=found.t,
        source=Known(
            subject.names, len(found.t), tuple(tuple(rows.T) for rows in (found.q, found.qd, found.qdd)), base
        ),
        origin=origin,
        how=f"{'simulated' if is_pair else origin} in {found.steps} steps, base {held}",
        moving=subject.names,
        errors=errors,
        doubt=DOUBT,
        notes=(*impact_sentences(found.impacts, units), *_end_notes(found, until)),
        simulated=found,
        loads=loads,
    )


def _end_notes(found: SimulatedRobotMotion, until: bool) -> Iterator[str]:
    """Yield a sentence if `until` ended the motion, and one if its instants are too far apart to show it."""
    if found.ended_by_event:
        cause = "until ends the motion" if until else "the mechanism ends the motion, which a warning explains,"
        yield f"{cause} at t = {instant_text(found.t[-1])} s"
    # A motion is over before the third instant where less than a millionth of its way is left.
    if len(found.t) > 20 and np.ptp(found.q, axis=0).max(initial=0) > 1e6 * np.ptp(found.q[2:], axis=0).max(
        initial=0
    ):
        yield f"all rests after the first instants, steps of {found.t[1] - found.t[0]:.3g} s: is [time] in seconds?"


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


@contextlib.contextmanager
def _silent_warnings() -> Iterator[None]:
    """Silence in a block the warnings of simulations that the notes of a scene repeat."""
    with warnings.catch_warnings():
        for said in (".* (leaves its|passes the) ", ".* is taken for ", ".* is it in seconds"):
            warnings.filterwarnings("ignore", said, DynamicsWarning)
        yield


def estimate_or_nan(estimate: Callable[[], float]) -> LazyValue:
    """Return an estimate of an error, NaN if the second run of the simulation, which tells it, fails."""

    def value() -> float:
        try:
            return float(estimate())
        except SimulationError:  # with a smaller tolerance it has an end of its own
            return math.nan

    return LazyValue(value)


def _read_driven(motion: Table, subject: Subject, t: Float64Array) -> dict[str, Any]:
    """Return the motions of the joints that [motion] moves, callables of t that return q, qd and qdd, by name."""
    names = subject.moved_by(motion)
    functions = read_functions(motion, names)
    driven = {name: partial(_driven, functions, k) for k, name in enumerate(names)}
    for name, move in driven.items():
        with motion.naming(name):
            given_joint(name, move).check(t)
    return driven


def _driven(functions: Any, k: int, t: Float64Array) -> tuple[Any, ...]:
    return tuple(row[k] for row in functions.derivatives(t, ACCELERATION))


def _moved(base: Any, sequence: str | None, t: Float64Array) -> BodyMotion:
    return EulerBase(base.derivatives(t, ACCELERATION), sequence).body(len(t))
