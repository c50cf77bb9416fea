"""Motion of a robot by dynamics: the table [dynamics] of its scene, with a table of loads for each joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from hingepair.dynamics.run import SimulationError
from hingepair.dynamics.simulate_robot import SimulatedRobotMotion, simulate_robot
from hingepair.equations.quantities import ACCELERATION
from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.dynamics import DEFAULT_GRAVITY
from hingepair.pair.hinge_load import HingeLoad
from hingepair.scenes.instants import read_instants_array
from hingepair.scenes.motions.joints import (
    JointMotion,
    JointSamples,
    SampledBase,
    check_joint_names,
    read_base,
    refuse_joint,
)
from hingepair.scenes.motions.motion import PRESCRIBED
from hingepair.scenes.motions.simulated import (
    DOUBT,
    HINGE_LOAD_KEYS,
    estimate_or_nan,
    read_break_instants,
    read_hinge_torque,
    read_stops,
    warnings_of_scenes,
)
from hingepair.scenes.robot_table import read_joint_loads
from hingepair.scenes.tables import Key, Table, numbers_key

_BASES: Final = ("fixed", "free", "pinned", PRESCRIBED)
_NAMES: Final = ("q", "qd")  # in expressions of efforts, beside t
_START_KEYS: Final[dict[str, Key]] = {
    "R1_0": numbers_key(3),
    "S1_0": Table.rotation,
    "v1_0": numbers_key(3),
    "omega1_0": numbers_key(3),
}
_KEYS: Final[dict[str, Key]] = {
    **_START_KEYS,
    "base": lambda table, key: table.choice(key, _BASES),
    "joint_loads": Table.flag,
    "breaks": read_break_instants,
    "tol": Table.number,
    "max_steps": Table.number,
}
_JOINT_KEYS: Final[dict[str, Key]] = {
    "q_0": Table.number,
    "qd_0": Table.number,
    "tau": partial(read_hinge_torque, names=_NAMES),
    "stops": read_stops,
    **dict.fromkeys(HINGE_LOAD_KEYS, Table.number),
}


def read_simulated_joints(tables: Table, robot: Mechanism, gravity: tuple[float, ...] | None) -> JointMotion:
    """Simulate the motion of a robot that the tables [dynamics], [base] and [time] define."""
    table, prescribed = tables.table("dynamics"), read_base(tables)
    tables.table("motion", required=False).check_keys(("constants",))
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
    described = robot.joint_loads if read_joint_loads(tables) else {}
    rows = {
        name: _read_joint(table.table(name), robot, name, described) for name in robot.names if name in table.values
    }
    q0 = {name: rows[name][0].get("q_0", 0.0) if name in rows else 0.0 for name in robot.names}
    qd0 = {name: rows[name][0].get("qd_0", 0.0) if name in rows else 0.0 for name in robot.names}
    loads = {**described, **{name: load for name, (_, load) in rows.items()}}
    t = read_instants_array(tables.table("time"))
    named = {f"q0[{name!r}]": f"{name}.q_0" for name in robot.names} | {f"base_motion.{k[:-3]}": k for k in start}
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
                base="moving" if prescribed else base, **options,
            )  # fmt: skip
    except SimulationError as error:
        table.refuse("", "a motion that can be followed", f"none past t = {error.t:.6g}: {error.why}")
    return joint_motion(found, t, loads)


def joint_motion(found: SimulatedRobotMotion, t: Float64Array, loads: Mapping[str, HingeLoad]) -> JointMotion:
    """Return a simulated motion at the instants t as the motion of a scene; `loads` have the stops."""
    robot = found.robot
    units = {joint.name: joint.unit for joint in robot.tree.coordinates}
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
        t=t,
        source=JointSamples(tuple(tuple(values.T) for values in (found.q, found.qd, found.qdd))),
        origin="simulated from what acts",
        names=robot.names,
        moving=robot.names,
        base=SampledBase(found.base_motion) if moves else None,
        errors=errors,
        doubt=DOUBT,
        simulated=found,
        stops=tuple(loads.get(name, HingeLoad()).tightest_stops for name in robot.names),
    )


def _read_joint(
    table: Table, robot: Mechanism, name: str, described: dict[str, HingeLoad]
) -> tuple[dict[str, Any], HingeLoad]:
    """Return the values of the table of a joint, and its load, to which described ones contribute."""
    values: dict[str, Any] = table.read(_JOINT_KEYS)
    fields = {key: value for key, value in values.items() if key not in ("q_0", "qd_0", "tau")}
    if fields.get("stops") is True:
        lower, upper = robot.position_limits[robot.names.index(name)].tolist()
        if not np.isfinite((lower, upper)).all():
            table.fail("stops", "[lower, upper], or true of a joint that has limits")
        fields["stops"] = lower, upper
    load = described.get(name, HingeLoad())
    with table.naming():
        return values, replace(load, **fields, **({"motor": values["tau"]} if "tau" in values else {}))


def _moved(base: Any, t: Float64Array) -> BodyMotion:
    motion: BodyMotion = base.at(t, ACCELERATION)
    return motion
