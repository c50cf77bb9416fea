"""The table of what can be asked of pairs and robots for one state or many: how each is called, and its truth.

The truth is computed with 60 digits, or by Pinocchio; `errors_of` holds results against it.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath
import numpy as np
import pinocchio as pin

import hingepair as hp
from hingepair.bench.truth import DIGITS, exactly, from_euler
from hingepair.formats.robots import robot_urdf
from support.exact import LETTERS, Exact, tree_of_model, tree_of_pair
from support.states import generator, rotations
from support.truths import BOUNDS

U = 2.0**-53
COUNT = 21  # samples: whole vectors of eight and a remainder
CHECKED = [0, 9, 20]  # which of them are computed with 60 digits
GRAVITY = (0.3, -0.2, -9.81)
RATES = ("q", "qd", "qdd")
HINGE = ("psi", "psid", "psidd")


# ---- what is asked

HOME = rotations(generator(41), 1)[0]
BODY1 = hp.Body(2.0, (0.1, -0.2, 0.05), (0.3, 0.4, 0.5))
BODY2 = hp.Body(1.5, (-0.15, 0.1, 0.2), ((0.2, 0.01, -0.02), (0.01, 0.3, 0.03), (-0.02, 0.03, 0.25)))
PAIR = hp.HingePair((0.5, 0.2, 0.1), (-0.25, 0.1, 0.3), (1, 2, -0.5), HOME, body1=BODY1, body2=BODY2)
FLAT = hp.PlanarPair((0.5, 0.2), (-0.25, 0.1))
LOCKED = {"panda_finger_joint1": 0.02}
TIP = {"ur5": "tool0", "panda": "panda_hand"}


@functools.cache
def robot_of(name, base="fixed"):
    return hp.load_robot(name, base=base, locked=LOCKED if name == "panda" else None)


@functools.cache
def model_of(name):
    """Pinocchio's model of the same robot, whose second finger follows the first."""
    model = pin.buildModelFromUrdf(str(robot_urdf(name)))
    held = [k for k, joint in enumerate(model.names) if "finger" in joint]
    q = pin.neutral(model)
    for k in held:
        q[model.joints[k].idx_q] = 0.02
    return pin.buildReducedModel(model, held, q)


def body1_of(given):
    return hp.BodyMotion(**{letter: given[letter] for letter in LETTERS if letter in given})


class Row(NamedTuple):
    """One call.

    Attributes:
        subject: what is asked: "pair", "flat", or a robot and how its base is held.
        names: the inputs that it takes.
        ask: ask(subject, inputs, **options) -> its results.
        exact: exact(tree) -> the truth by output, or the only output.
        bound: how far a component may be off, in u times the largest component of the output.
        prepared: the name for `prepare` and its inputs in order, if it has such.
    """

    subject: str
    names: tuple[str, ...]
    ask: Callable[..., Any]
    exact: Callable[[Exact], Any]
    bound: float = 16
    prepared: tuple[Any, ...] = ()


def of_body1(method, hinge, names, exact, prepared, bound=16, loads=(), **options):
    """A method of a pair whose body 1 moves as it is given."""

    def ask(pair, given, **run):
        own = {load: given[load] for load in loads}
        return getattr(pair, method)(
            body1_of(given), *(given[name] for name in HINGE[:hinge]), **own, **options, **run
        )

    return Row("pair", (*names, *HINGE[:hinge], *loads), ask, exact, bound, (method, *prepared))


def of_robot(subject, method, names, exact, bound=16, base=(), prepared=True, loads=(), wrench=False, **options):
    """A method of a robot."""
    extra = ("force2", "torque2") if wrench else ()

    def ask(robot, given, **run):
        own = {load: given[load] for load in loads}
        if base:
            own["base_motion"] = body1_of({letter: given[letter] for letter in base})
        if wrench:
            own["wrenches"] = {TIP[subject.split()[0]]: (given["force2"], given["torque2"])}
        return getattr(robot, method)(*(given[name] for name in names), **own, **options, **run)

    plain = prepared and not (base or loads or wrench)
    return Row(subject, (*names, *base, *loads, *extra), ask, exact, bound, (method, *names) if plain else ())


def motion_of(tree, *letters):
    return {letter: tree.motion[letter] for letter in letters}


def body2_of(tree, level):
    """The default outputs of a pair's body 2."""
    names = ("R", "S", "d", "v", "omega", "a", "alpha")[: (3, 5, 7)[level]]
    return {name if name == "d" else f"{name}2": tree.motion[name] for name in names}


def hinge_wrench(tree):
    """What body 2 needs beside its weight, at the hinge point."""
    with mpmath.workdps(DIGITS):
        (force, torque), axis = tree.wrenches[1], tree.axis(1)
        along = (torque * axis).sum(axis=-1)
        return {
            "hinge_force": force, "hinge_moment": torque, "hinge_torque": along,
            "bearing_torque": torque - along[:, None] * axis,
        }  # fmt: skip


def forces_of(tree, hinge=None):
    names = ("force1", "torque1", "hinge_torque") if hinge else ("tau", "force1", "torque1")
    force1, torque1, tau = tree.forces
    values = (force1, torque1, tau[:, 0]) if hinge else (tau, force1, torque1)
    return dict(zip(names, values, strict=True))


def accelerations_of(tree):
    """What the loads among the inputs cause."""
    given = tree.inputs
    wrench = np.concatenate((given["force2"], given["torque2"]), axis=-1) if "force2" in given else None
    if not tree.free:
        return {"qdd": tree.accelerations(given["tau"], wrench)}
    tau = given["tau"] if "tau" in given else given["hinge_torque"][:, None]
    found = tree.accelerations(np.concatenate((given["force1"], given["torque1"], tau), axis=-1), wrench)
    joints = {"qdd": found[:, 6:]} if "tau" in given else {"psidd": found[:, 6]}
    return {"a1": found[:, :3], "alpha1": found[:, 3:6]} | joints


def momentum_of_robot(tree):
    linear, angular = tree.momentum().values()
    return {"linear": linear, "angular_about_origin": angular}


def regressor(tree):
    """Pinocchio's own."""
    model = model_of("ur5").copy()
    model.gravity.linear = np.array(GRAVITY)
    data = model.createData()
    given = (tree.inputs[name] for name in RATES)
    return np.array([pin.computeJointTorqueRegressor(model, data, *one) for one in zip(*given, strict=True)])


PLACE, TURNING, FORCED = ("R", "S"), ("R", "S", "omega"), ("R", "S", "omega", "a", "alpha")
PUSHED = ("force1", "torque1", "hinge_torque", "force2", "torque2")
FREE = "panda free"
FK = "forward_kinematics"
ROWS = {
    **{
        f"pair.{FK}({', '.join(RATES[: level + 1])})": Row(
            "euler", RATES[: level + 1],
            lambda pair, given, **run: pair.forward_kinematics(*(given[k] for k in RATES if k in given), **run),
            functools.partial(body2_of, level=level), prepared=(name, *RATES[: level + 1]),
        )
        for level, name in enumerate(("pose", "velocity", "acceleration"))
    },
    "pair.forward_kinematics(outputs)": Row(
        "euler", RATES,
        lambda pair, given, **run: pair.forward_kinematics(
            *(given[name] for name in RATES), outputs=("S1", "omega1", "alpha1", "a2"), **run
        ),
        None,
    ),
    **{
        f"pair.{FK}_from_body1({', '.join(HINGE[: level + 1])})": of_body1(
            f"{FK}_from_body1", level + 1, ("R", "S", "v", "omega", "a", "alpha")[: 2 * level + 2],
            functools.partial(body2_of, level=level), (),
        )
        for level in range(3)
    },
    "pair.jacobian": of_body1("jacobian", 1, PLACE, Exact.jacobian, ("S", "psi")),
    "pair.acceleration_bias": of_body1(
        "acceleration_bias", 2, TURNING, Exact.acceleration_bias, (*TURNING[1:], "psi", "psid")
    ),
    "pair.mass_matrix": of_body1("mass_matrix", 1, PLACE, Exact.mass_matrix, ("S", "psi")),
    "pair.inverse_dynamics": of_body1(
        "inverse_dynamics", 3, FORCED, functools.partial(forces_of, hinge=True), (*FORCED[1:], *HINGE),
        gravity=GRAVITY,
    ),
    "pair.forward_dynamics": of_body1(
        "forward_dynamics", 2, TURNING, accelerations_of, (), 64, PUSHED, gravity=GRAVITY
    ),
    "pair.hinge_wrench": of_body1(
        "hinge_wrench", 3, FORCED, hinge_wrench, (*FORCED[1:], *HINGE), gravity=GRAVITY
    ),
    "pair.energy": of_body1(
        "energy", 2, ("R", "S", "v", "omega"), Exact.energy, ("R", "S", "v", "omega", "psi", "psid"), gravity=GRAVITY
    ),
    "pair.momentum": of_body1(
        "momentum", 2, ("R", "S", "v", "omega"), Exact.momentum, ("R", "S", "v", "omega", "psi", "psid")
    ),
    **{
        f"planar.{FK}({', '.join(RATES[: level + 1])})": Row(
            "flat", RATES[: level + 1],
            lambda flat, given, **run: flat.forward_kinematics(*(given[k] for k in RATES if k in given), **run),
            functools.partial(body2_of, level=level), prepared=(name, *RATES[: level + 1]),
        )
        for level, name in enumerate(("pose", "velocity", "acceleration"))
    },
    "robot.forward_kinematics(q)": of_robot(
        "panda", FK, RATES[:1], lambda tree: motion_of(tree, "R", "S", "d"), prepared=False, frames=TIP["panda"]
    ),
    "robot.forward_kinematics(q, qd, qdd)": of_robot(
        "panda", FK, RATES, lambda tree: motion_of(tree, "R", "S", "d", "v", "omega", "a", "alpha"), prepared=False,
        frames=TIP["panda"],
    ),
    "robot.forward_kinematics(base_motion)": of_robot(
        FREE, FK, RATES, lambda tree: motion_of(tree, "R", "S", "d", "v", "omega", "a", "alpha"), base=LETTERS,
        frames=TIP["panda"],
    ),
    "robot.jacobian": of_robot("panda", "jacobian", ("q",), Exact.jacobian, prepared=False, frames=TIP["panda"]),
    "robot.jacobian(free)": of_robot(
        FREE, "jacobian", ("q",), Exact.jacobian, base=("R", "S"), frames=TIP["panda"]
    ),
    "robot.acceleration_bias": of_robot(
        "panda", "acceleration_bias", RATES[:2], Exact.acceleration_bias, prepared=False, frames=TIP["panda"]
    ),
    "robot.inverse_dynamics": of_robot("panda", "inverse_dynamics", RATES, forces_of, gravity=GRAVITY),
    "robot.inverse_dynamics(free)": of_robot(
        FREE, "inverse_dynamics", RATES, forces_of, base=LETTERS, gravity=GRAVITY
    ),
    "robot.forward_dynamics(wrenches)": of_robot(
        "ur5", "forward_dynamics", ("q", "qd", "tau"), accelerations_of, 64, wrench=True, gravity=GRAVITY
    ),
    "robot.forward_dynamics(free)": of_robot(
        FREE, "forward_dynamics", ("q", "qd", "tau"), accelerations_of, 64, base=LETTERS[:4],
        loads=("force1", "torque1"), gravity=GRAVITY,
    ),
    "robot.mass_matrix": of_robot("panda", "mass_matrix", ("q",), Exact.mass_matrix),
    "robot.mass_matrix(free)": of_robot(FREE, "mass_matrix", ("q",), Exact.mass_matrix, base=("R", "S")),
    "robot.bias_forces": of_robot("panda", "bias_forces", RATES[:2], Exact.bias_forces, gravity=GRAVITY),
    "robot.gravity_forces": of_robot("panda", "gravity_forces", RATES[:1], Exact.gravity_forces, gravity=GRAVITY),
    "robot.centre_of_mass": of_robot("panda", "centre_of_mass", ("q",), Exact.centre_of_mass),
    "robot.centre_of_mass_jacobian": of_robot(
        "panda", "centre_of_mass_jacobian", ("q",), Exact.centre_of_mass_jacobian
    ),
    "robot.energy": of_robot("panda", "energy", RATES[:2], Exact.energy, gravity=GRAVITY),
    "robot.momentum": of_robot("panda", "momentum", RATES[:2], momentum_of_robot, prepared=False),
    "robot.inverse_dynamics_derivatives": of_robot(
        "ur5", "inverse_dynamics_derivatives", RATES, Exact.torque_slopes, prepared=False, gravity=GRAVITY
    ),
    "robot.forward_dynamics_derivatives": of_robot(
        "ur5", "forward_dynamics_derivatives", ("q", "qd", "tau"),
        lambda tree: tree.acceleration_slopes(tree.inputs["tau"]), 64, prepared=False,
        gravity=GRAVITY,
    ),
    "robot.torque_regressor": of_robot("ur5", "torque_regressor", RATES, regressor, gravity=GRAVITY),
}  # fmt: skip


def subject_of(row):
    """What a row is asked of."""
    if row.subject in ("pair", "euler", "flat"):
        return FLAT if row.subject == "flat" else PAIR
    return robot_of(*row.subject.split())


@functools.cache
def states(subject):
    """All inputs that a subject may be given, of COUNT samples."""
    rng = generator(42, len(subject))
    dof = {"euler": 7, "pair": 1, "flat": 4}.get(subject) or subject_of(Row(subject, *[None] * 3)).dof
    made = dict(zip(RATES, rng.uniform(-1.5, 1.5, (3, COUNT, dof)), strict=True))
    made |= dict(zip(HINGE, rng.uniform(-2, 2, (3, COUNT)), strict=True))
    made |= dict(zip(("R", "v", "omega", "a", "alpha"), rng.normal(size=(5, COUNT, 3)), strict=True))
    made |= dict(zip(("force1", "torque1", "force2", "torque2"), 10 * rng.normal(size=(4, COUNT, 3)), strict=True))
    made |= {"S": rotations(rng, COUNT), "hinge_torque": 5 * rng.normal(size=COUNT)}
    made["tau"] = 10 * rng.normal(size=(COUNT, dof))
    for array in made.values():
        array.flags.writeable = False
    return made


def inputs_of(row, samples=slice(None)):
    return {name: states(row.subject)[name][samples] for name in row.names}


def tree_of(row):
    """The checked samples of a row in 60 digits."""
    given = inputs_of(row, CHECKED)
    if row.subject == "pair":
        tree, frame = tree_of_pair(PAIR)
        joints = {name: given[own][:, None] for name, own in zip(RATES, HINGE, strict=True) if own in given}
        made = Exact(tree, frame, True, given | joints, GRAVITY)
    elif row.subject == "flat":
        made = in_the_plane(given)
    else:
        name, *base = row.subject.split()
        tree, frame = tree_of_model(model_of(name), TIP[name])
        made = Exact(tree, frame, bool(base), given, GRAVITY)
    made.inputs = given
    return made


def in_the_plane(given):
    """A planar pair as the pair in space that it is."""
    tree, frame = tree_of_pair(FLAT.to_spatial())
    zero = np.zeros((len(CHECKED), 1))
    parts = [np.split(exactly(given.get(name, 0 * given["q"])), 4, axis=-1) for name in RATES]
    R, v, a = (np.concatenate((x, y, zero), axis=-1) for x, y, *_ in parts)
    phi, omega, alpha = (np.concatenate((zero, zero, turn), axis=-1) for _, _, turn, _ in parts)
    with mpmath.workdps(DIGITS):
        c, s = np.frompyfunc(mpmath.cos, 1, 1)(phi[:, 2:]), np.frompyfunc(mpmath.sin, 1, 1)(phi[:, 2:])
        S = np.concatenate((c, -s, zero, s, c, zero, zero, zero, zero + 1), axis=-1).reshape(-1, 3, 3)
    base = dict(zip(LETTERS, (R, S, v, omega, a, alpha), strict=True))
    joints = {name: part[3] for name, part in zip(RATES, parts, strict=True)}
    return Exact(tree, frame, True, base | joints, (*GRAVITY[:2], 0))


@functools.cache
def truth_of(label):
    """The truth of a row by output, and what its errors are measured in, by output: (3,) each."""
    row = ROWS[label]
    if row.subject == "euler":
        given = inputs_of(row, CHECKED)
        constants = PAIR.u1, PAIR.u2, (1, 2, -0.5), HOME
        truth = from_euler(constants, *given.values())
        return truth.values, {name: BOUNDS[name] * scale for name, scale in truth.scales.items()}
    exact = row.exact(tree_of(row))
    values = exact if isinstance(exact, dict) else {"": exact}
    if row.subject == "flat":
        values = flattened(row, values)
    sizes = {name: row.bound * float(np.abs(value).max()) for name, value in values.items()}
    return values, {name: np.full(len(CHECKED), size) for name, size in sizes.items()}


def flattened(row, values):
    """Of vectors in the plane their two components, of angular ones their third, and the angle for S2."""
    plane = ("R2", "d", "v2", "a2", "force1")
    turns = ("omega2", "alpha2", "torque1")
    found = {name: value[:, :2] if name in plane else value for name, value in values.items()}
    found = {name: value[:, 2] if name in turns else value for name, value in found.items()}
    if "S2" in found:
        q = inputs_of(row, CHECKED)["q"]
        found["phi2"] = exactly(q[:, 2]) + exactly(q[:, 3])
        del found["S2"]
    return found


def arrays_of(result):
    """The arrays of a result by output."""
    return {"": result} if isinstance(result, np.ndarray) else dict(result.arrays())


def errors_of(label, arrays):
    """By output, the largest error of the checked samples in parts of what is allowed."""
    exact, sizes = truth_of(label)
    if ROWS[label].subject == "euler":
        exact = {name: exact[name] for name in arrays}
    assert arrays.keys() == exact.keys()
    found = {}
    for name, value in arrays.items():
        with mpmath.workdps(DIGITS):
            gap = np.abs(value.astype(object) - exact[name]).reshape(len(CHECKED), -1).max(axis=-1).astype(float)
        found[name] = float((gap / (U * sizes[name])).max())
    return found


def asked(label, given, **run):
    """The arrays of a row by output."""
    row = ROWS[label]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "panda: left out are damping", hp.DynamicsWarning)
        return arrays_of(row.ask(subject_of(row), given, **run))


def prepared(label, backend):
    """What `prepare` gives for a row, which is called with the row's inputs by name."""
    row = ROWS[label]
    kind, *order = row.prepared
    gravity = {} if row.subject == "flat" else {"gravity": GRAVITY}
    call = subject_of(row).prepare(kind, **gravity, backend=backend)

    def ask(given):
        arrays = arrays_of(call(*(given[name] for name in order)))
        return {"": arrays[kind]} if arrays.keys() == {kind} else arrays

    return ask
