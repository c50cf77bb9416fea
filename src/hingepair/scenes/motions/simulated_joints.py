"""Motion of a robot by dynamics: the table [dynamics] of its scene, with a table of loads for each joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from hingepair.equations.quantities import ACCELERATION
from hingepair.errors import SimulationError
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import HingeLoad, stop_range
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.motion.given_motions import given_joint
from hingepair.motion.simulate import simulate_robot
from hingepair.motion.simulated import SimulatedRobotMotion
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.instants import read_instants_array
from hingepair.scenes.motions.joints import (
    RATE_SUFFIXES,
    JointMotion,
    JointSamples,
    SampledBase,
    check_joint_names,
    moving_joints,
    read_base,
    refuse_joint,
)
from hingepair.scenes.motions.motion import PRESCRIBED, impact_sentences
from hingepair.scenes.motions.simulated import (
    DOUBT,
    HINGE_LOAD_KEYS,
    end_notes,
    estimate_or_nan,
    read_break_instants,
    read_functions_of_state,
    read_hinge_torque,
    read_stops,
    warnings_of_scenes,
)
from hingepair.scenes.robot_table import read_joint_loads
from hingepair.scenes.tables import Key, Table, numbers_key

_BASES: Final = ("fixed", "free", "pinned", PRESCRIBED)  # values of `base` in [dynamics]
_NAMES: Final = ("q", "qd")  # in expressions of efforts, beside t
_WRENCH: Final = ("force", "torque")  # keys of [dynamics.wrenches.LINK]


def _read_vector(table: Table, key: str) -> Any:
    """Return the force or torque under a key of a Table: three floats, or a callable of (t, now) that returns (N, 3)
    for expressions in t.
    """
    entries = table.entries(key, 3, "t")
    components = read_functions_of_state(entries, tuple(entries.values), ())
    if not callable(components):
        return components
    return lambda t, _: np.stack(np.broadcast_arrays(*components(t), t)[:-1], axis=-1)


def _read_wrenches(table: Table) -> dict[str, tuple[Any, Any]]:
    """Return (force, torque), world axes, at the origin of a link, by its name; 0 where the table has none."""
    found = {}
    for link in table.values:
        values = table.table(link).read(dict.fromkeys(_WRENCH, _read_vector))
        found[link] = values.get("force", 0), values.get("torque", 0)
    return found


_START_KEYS: Final[dict[str, Key]] = {  # of [dynamics], for the start of the base, and their readers
    "R1_0": numbers_key(3),
    "S1_0": Table.rotation,
    "v1_0": numbers_key(3),
    "omega1_0": numbers_key(3),
}
_KEYS: Final[dict[str, Key]] = {  # all of [dynamics] but the joints
    **_START_KEYS,
    "base": lambda table, key: table.choice(key, _BASES),
    "joint_loads": Table.flag,
    "breaks": read_break_instants,
    "until": Table.text,
    "force1": _read_vector,
    "torque1": _read_vector,
    "wrenches": lambda table, key: _read_wrenches(table.table(key)),
    "tol": Table.number,
    "max_steps": Table.number,
}
_JOINT_KEYS: Final[dict[str, Key]] = {  # of [dynamics.JOINT]
    "q_0": Table.number,
    "qd_0": Table.number,
    "tau": partial(read_hinge_torque, names=_NAMES),
    "stops": read_stops,
    **dict.fromkeys(HINGE_LOAD_KEYS, Table.number),
}


def read_simulated_joints(tables: Table, robot: Mechanism, gravity: tuple[float, ...] | None) -> JointMotion:
    """Simulate the motion of a robot that the tables [dynamics], [motion], [base] and [time] define. Joints of
    [motion] move as given.
    """
    table, prescribed = tables.table("dynamics"), read_base(tables)
    t = read_instants_array(tables.table("time"))
    driven = _read_driven(tables.table("motion", required=False), robot, t)
    for name in driven:
        if name in table.values:
            table.fail(name, "no such table: [motion] moves this joint as given")
    check_joint_names(table, robot, tuple(_KEYS))
    for key in table.values:
        if key not in _KEYS and key not in robot.names:
            refuse_joint(table, key, robot)
    options = replace(table, values={key: value for key, value in table.values.items() if key in _KEYS}).read(_KEYS)
    base = options.pop("base", PRESCRIBED if prescribed else robot.base)
    if (base == PRESCRIBED) != (prescribed is not None):
        table.fail("base", f"{PRESCRIBED!r} together with a table [base], and only then")
    start = {key: options.pop(key) for key in _START_KEYS if key in options}
    for key in start if prescribed else ():
        table.fail(key, "no such key together with [base], which moves the base")
    options.pop("joint_loads", None)
    if "until" in options:
        options["until"] = _read_until(table, robot)
    wrenches = options.get("wrenches", {})
    described = robot.joint_loads if read_joint_loads(tables) else {}
    described = {name: load for name, load in described.items() if name not in driven}
    rows = {
        name: _read_joint(table.table(name), robot, name, described) for name in robot.names if name in table.values
    }
    q0 = {name: rows[name][0].get("q_0", 0.0) if name in rows else 0.0 for name in robot.names}
    qd0 = {name: rows[name][0].get("qd_0", 0.0) if name in rows else 0.0 for name in robot.names}
    loads = {**described, **{name: load for name, (_, load) in rows.items()}}
    named = {f"q0[{name!r}]": f"{name}.q_0" for name in robot.names} | {f"base_motion.{k[:-3]}": k for k in start}
    named["base_motion"] = "base"
    named |= {f"wrenches[{link!r}][{i}]": f"wrenches.{link}.{_WRENCH[i]}" for link in wrenches for i in (0, 1)}
    try:
        with table.naming(**named), warnings_of_scenes():
            base_motion: Any = (
                partial(_moved, prescribed)
                if prescribed
                else BodyMotion(
                    R=start.get("R1_0", np.zeros(3)), S=start.get("S1_0", np.eye(3)), v=start.get("v1_0"),
                    omega=start.get("omega1_0"),
                )
            )  # fmt: skip
            found = simulate_robot(
                robot, t, q0, qd0, loads=loads, gravity=gravity or DEFAULT_GRAVITY, base_motion=base_motion,
                base="moving" if prescribed else base, driven=driven, **options,
            )  # fmt: skip
    except SimulationError as error:
        table.refuse("", "a motion that can be followed", f"none past t = {error.t:.6g}: {error.why}")
    return joint_motion(found, loads)


def joint_motion(found: SimulatedRobotMotion, loads: Mapping[str, HingeLoad]) -> JointMotion:
    """Return a simulated motion as that of a scene, with the stops that `loads` have, by joint."""
    robot = found.robot
    units = {joint.name: joint.unit for joint in tree_of(robot).coordinates}
    errors = {}
    for unit in sorted({*units.values()}):
        columns = [k for k, name in enumerate(robot.names) if units[name] == unit]
        errors[f"{unit} of q"] = estimate_or_nan(
            partial(lambda columns: float(found.q_error_estimate[columns].max()), columns)
        )
    if found.base in {"free", "pinned"}:
        errors["rad of the base"] = estimate_or_nan(lambda: found.attitude_error_estimate)
    moves = found.base != "fixed" or any(np.any(x) for x in (found.base_motion.R, found.base_motion.S - np.eye(3)))
    return JointMotion(
        t=found.t,
        source=JointSamples(tuple(tuple(values.T) for values in (found.q, found.qd, found.qdd))),
        origin="simulated from what acts",
        names=robot.names,
        moving=robot.names,
        base=SampledBase(found.base_motion) if moves else None,
        errors=errors,
        doubt=DOUBT,
        notes=(*impact_sentences(found.impacts, units), *end_notes(found.ended_by_event, found.t)),
        simulated=found,
        stops=tuple(stop_range(loads.get(name, HingeLoad())) for name in robot.names),
    )


def _read_joint(
    table: Table, robot: Mechanism, name: str, described: dict[str, HingeLoad]
) -> tuple[dict[str, Any], HingeLoad]:
    """Return the values of a joint's table, and its load: the table's fields over those of the one in `described`."""
    values: dict[str, Any] = table.read(_JOINT_KEYS)
    fields = {key: value for key, value in values.items() if key not in ("q_0", "qd_0", "tau")}
    if fields.get("stops") is True:
        lower, upper = robot.position_limits[robot.names.index(name)].tolist()
        if not np.isfinite((lower, upper)).any():
            table.fail("stops", "[lower, upper], or true of a joint that has limits")
        fields["stops"] = lower, upper
    load = described.get(name, HingeLoad())
    with table.naming():
        return values, replace(load, **fields, **({"motor": values["tau"]} if "tau" in values else {}))


def _read_driven(motion: Table, robot: Mechanism, t: Float64Array) -> dict[str, Any]:
    """Return the motions of the joints that [motion] moves, callables of t that return q, qd and qdd, by name."""
    from hingepair.scenes.motions.functions import read_functions

    names = moving_joints(motion, robot)
    functions = read_functions(motion, names)
    driven = {name: partial(_driven, functions, k) for k, name in enumerate(names)}
    for name, move in driven.items():
        with motion.naming(name):
            given_joint(name, move).check(t)
    return driven


def _driven(functions: Any, k: int, t: Float64Array) -> tuple[Any, ...]:
    return tuple(row[k] for row in functions.derivatives(t, ACCELERATION))


def _read_until(table: Table, robot: Mechanism) -> Any:
    """Return the expression in t, coordinates and rates (elbow, elbowd) that passes 0 at the event, as a callable of
    (t, now).
    """
    joints = [k for k, name in enumerate(robot.names) if name.isidentifier() and name not in table.constants]
    names = tuple(robot.names[k] + suffix for suffix in RATE_SUFFIXES[:2] for k in joints)
    value = read_functions_of_state(table, ("until",), names)
    if not callable(value):
        table.fail("until", "an expression in t and coordinates and rates of joints, which passes 0 at the event")
    return lambda t, now: value(t, *now.q.T[joints], *now.qd.T[joints])[0]


def _moved(base: Any, t: Float64Array) -> BodyMotion:
    motion: BodyMotion = base.at(t, ACCELERATION)
    return motion
