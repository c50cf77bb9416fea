"""What cannot be used is refused: the call, the class of the error and the argument that it names; no wording.

A row of a table is (argument, class of the error, values that are refused). The argument is the name that the error
carries, less what stands behind it in brackets.
"""

from __future__ import annotations

import functools
import math
import re

import numpy as np
import pandas as pd
import pytest

import hingepair as hp
from hingepair import errors
from support.asked import COUNT, ROWS, inputs_of, subject_of
from support.exported import ARM
from support.linkages import AT, bar, four_bar, open_four_bar
from support.recorded import bodies, recording

A, S, D, X, R = errors.ArgumentError, errors.ShapeError, errors.DtypeError, errors.AxisError, errors.RotationError
NAN, INF = math.nan, math.inf
EYE, TWO, THREE = np.eye(3), np.zeros((2, 3)), np.zeros((3, 3))


class C(dict):
    """Arguments that are changed together."""


def refused(call, argument, error):
    """Hold the error of a call against what it should be."""
    with pytest.raises(errors.HingePairError) as caught:
        call()
    found = caught.value
    assert type(found) is error
    said, where = (found.name, re.match) if hasattr(found, "name") else (str(found), re.search)
    assert where(rf"{re.escape(argument)}($|\W)", said), said
    assert "\n" not in str(found)


def table(rows):
    """Parameters (what, argument, error, value) of a dict of rows."""
    return [
        pytest.param(what, argument, error, value, id=f"{getattr(what, '__qualname__', what)}-{argument}-{i}")
        for what, own in rows.items()
        for i, (argument, error, value) in enumerate(
            (argument, error, value) for argument, error, *values in own for value in values
        )
    ]


# ---- constructors

LIGHT, BALL = hp.Body(mass=1, inertia=EYE), hp.Sphere(1)
GIVEN = {
    hp.HingePair: {"u1": (1, 0, 0), "u2": (0, 0, 0), "n": (0, 0, 1)},
    hp.PlanarPair: {"u1": (1, 0), "u2": (0, 0)},
    hp.Slider: {"u1": (1, 0, 0), "u2": (0, 0, 0), "n": (0, 0, 1)},
    hp.Screw: {"u1": (1, 0, 0), "u2": (0, 0, 0), "n": (0, 0, 1), "pitch": 0.1},
    hp.Body: {"mass": 2.0, "inertia": EYE},
    hp.Box: {"size": (1, 2, 3)},
    hp.Cylinder: {"radius": 1, "length": 2},
    hp.Sphere: {"radius": 1},
    hp.BodyMotion: {"R": (0, 0, 1), "S": EYE, "omega": TWO},
    hp.BodyMotion.from_quaternion_xyzw: {"R": (0, 0, 1), "quat_xyzw": (0, 0, 0, 2)},
    hp.BodyMotion.from_quaternion_wxyz: {"R": (0, 0, 1), "quat_wxyz": (0, 0, 0, 2)},
    hp.BodyMotion.from_rotvec: {"R": (0, 0, 1), "rotvec": (0, 0, 2)},
    hp.HingeLoad: {"stops": (0, 1)},
}
NO_VECTOR = ((S, (1, 0)), (A, (1, 0, NAN), (-INF, 0, 1)), (D, ("a", 0, 0), None))
NO_ROTATION = ((S, np.eye(2)), (R, np.diag([1, 1, -1]), EYE + 1e-8), (D, "x"))
NO_SIZE = ((A, 0, -1.0, NAN, INF, "1", True, (1, 2)),)
NO_MOTION = ((S, (1, 0, 0, 0)), (D, (1j, 0, 0), ("a", 0, 0), np.float16([1, 2, 3])))
NO_LIMIT = ((A, -1, NAN, "1", True),)


def each(argument, kinds):
    return [(argument, *kind) for kind in kinds]


CONSTRUCTORS = {
    hp.HingePair: [
        *each("u1", NO_VECTOR), *each("u2", NO_VECTOR), *each("home", NO_ROTATION),
        ("home", A, np.full((3, 3), NAN)), ("u1", S, [(1, 2, 3), (1, 2)]),
        ("n", S, (1, 0)), ("n", X, (0, 0, 0), (0, 0, NAN), (0, INF, 0), [(1, 0, 0), (0, 0, 0)]), ("n", D, "n", None),
        ("name", A, "", " \n", 5, None), ("limits", A, (1, -1), (0, INF), (NAN, 1)), ("limits", S, (1,), 1),
        ("body1", A, 2.5, BALL), ("body2", A, "door"), *each("torque_limit", NO_LIMIT), *each("rate_limit", NO_LIMIT),
        ("points1", A, {"R2": (0, 0, 0)}, {"home": (0, 0, 0)}, {"left edge": (0, 0, 0)}, {"tip_v": (0, 0, 0)},
         {"tip": (0, 0, NAN)}, [(0, 0, 0)]),
        ("points1", S, {"tip": (0, 0)}),
    ],
    hp.PlanarPair: [("u1", S, (1, 0, 0)), ("u1", A, (0, NAN)), ("u2", D, (1j, 0), None), ("name", A, "")],
    hp.Slider: [("n", X, (0, 0, 0)), ("pair", S, C(u1=TWO))],
    hp.Screw: [("pitch", A, 0, INF, "fine")],
    hp.Body: [
        *each("mass", NO_SIZE), ("centre_of_mass", S, (1, 0), TWO), ("centre_of_mass", A, (1, 0, NAN)),
        ("inertia", A, (0, 1, 1), (1, 1, -1), [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]], (1, 1, 2.005), EYE * NAN),
        ("inertia", S, np.eye(2), (1, 1)), ("shapes", A, ("box",), [BALL, LIGHT], BALL),
        ("shapes", A, C(shapes=(hp.Sphere(1e200),), inertia=None)),
    ],
    hp.Box: [("size", A, (1, 0, 1), (1, 2, INF)), ("size", S, 1, (1, 2)), ("center", S, TWO),
             *each("axes", NO_ROTATION)],
    hp.Cylinder: [*each("radius", NO_SIZE), *each("length", NO_SIZE), ("axis", X, (0, 0, 0)), ("axis", S, TWO)],
    hp.Sphere: each("radius", NO_SIZE),
    hp.BodyMotion: [
        *(row for name in ("R", "v", "a", "alpha") for row in each(name, NO_MOTION)), *each("S", NO_ROTATION),
        ("R", S, (1, 0)), ("a", S, THREE), ("R", D, None), ("R", D, pd.DataFrame(TWO, columns=["a", "b", "c"])),
    ],
    hp.BodyMotion.from_quaternion_xyzw: [("quat_xyzw", S, (0, 0, 0)), ("quat_xyzw", R, (0, 0, 0, 0))],
    hp.BodyMotion.from_quaternion_wxyz: [("quat_wxyz", D, "q"), ("quat_wxyz", R, (0, 0, 0, 0))],
    hp.BodyMotion.from_rotvec: [("rotvec", S, (0, 0))],
    hp.HingeLoad: [
        *((name, A, -1.0, "1") for name in ("stiffness", "damping", "friction", "stop_stiffness", "stop_damping")),
        ("friction_rate", A, 0, -1), ("rest", A, INF), ("stops", A, (1, -1), (1, 1), 1.0, (0, 1, 2), (0, NAN)),
        ("motor", A, "1", lambda t: t), ("stop_restitution", A, 1.1, -0.1),
        ("stop_damping", A, C(stop_restitution=0.5, stop_damping=1)),
        ("stop_stiffness", A, C(stop_restitution=0.5, stop_stiffness=3)),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("make", "argument", "error", "value"), table(CONSTRUCTORS))
def test_constructors(make, argument, error, value):
    made = make(**GIVEN[make])
    assert "object at" not in repr(made)
    with pytest.raises(TypeError, match="unexpected keyword argument"):
        make(**GIVEN[make], weight=1)
    changed = value if isinstance(value, C) else {argument: value}
    refused(lambda: make(**GIVEN[make] | changed), argument, error)


# ---- the table of what can be asked

WRONG = {
    "complex": (D, lambda x: x.astype(complex)),
    "objects": (D, lambda x: x.astype(object)),
    "text": (D, lambda x: x.astype(str)),
    "booleans": (D, lambda x: x > 0),
    "float16": (D, lambda x: x.astype(np.float16)),
    "masked": (D, lambda x: np.ma.masked_array(x, mask=True)),
    "another number of samples": (S, lambda x: np.concatenate((x, x))),
    "another width": (S, lambda x: x[..., :-1]),
}


@pytest.mark.parametrize("label", ROWS)
def test_inputs_of_calls(label):
    """Each input in turn, at the first call and at later ones; beyond an attitude, at the border of the call."""
    row = ROWS[label]
    given, subject = inputs_of(row), subject_of(row)
    for name, value in given.items():
        names = {"force2": "wrenches", "torque2": "wrenches"} if "wrenches" in label else {}
        for kind, (error, change) in WRONG.items():
            if (kind == "another width" and value.ndim < 2) or (
                error is S and kind != "another width" and len(given) < 2
            ):
                continue
            with pytest.raises(error) as caught:
                row.ask(subject, given | {name: change(value)}, backend="numpy")
            told = caught.value.name.split("[")[0].rsplit(".")[-1]
            shared = kind == "another number of samples"  # whichever of two does not fit the other
            assert told == names.get(name, name) or shared, (name, kind, caught.value.name)
        if name == "S":
            for bad in (2 * value, -value, value + 1e-6):
                with pytest.raises(errors.RotationError, match=r"S: "):
                    row.ask(subject, given | {name: bad}, backend="numpy")


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("label", ROWS)
def test_outputs_and_options_of_calls(label, backend):
    """What is refused is not written; the second time, the quick way refuses it, too."""
    row = ROWS[label]
    given, subject = inputs_of(row), subject_of(row)
    ask = functools.partial(row.ask, subject, given, backend=backend)
    found = ask()
    whole = isinstance(found, np.ndarray)
    name, value = ("", found) if whole else next(iter(found.arrays().items()))
    frozen = np.zeros(value.shape)
    frozen.flags.writeable = False
    for out in (
        frozen,
        np.zeros(value.shape, int),
        np.zeros(value.shape, np.float32),
        np.zeros((COUNT, 99)),
        3,
        None,
    ):
        if whole and out is None:
            continue
        for _ in range(2):
            with pytest.raises(errors.ArgumentError, match=r"^out"):
                ask(out=out if whole else {name: out})
            assert not np.any(frozen)
    if not whole:
        same = np.zeros(value.shape)
        for out in ([name], 3, {"lift": same}, {3: same}):
            with pytest.raises(errors.ArgumentError, match=r"^out: "):
                ask(out=out)
    taken = next(iter(given.values()))
    if "q" in given and taken.shape == value.shape:
        with pytest.raises(errors.ArgumentError, match=r"^out"):
            row.ask(subject, given | {next(iter(given)): (own := taken.copy())}, out=own if whole else {name: own})
    for options in ({"workers": 0}, {"workers": 1.5}, {"workers": True}, {"backend": "gpu"}, {"backend": ["numpy"]}):
        with pytest.raises(errors.ArgumentError, match=f"^{next(iter(options))}: "):
            row.ask(subject, given, **options)


# ---- calls with some arguments changed

PAIR = hp.HingePair((0.5, 0.2, 0.1), (-0.25, 0.1, 0.3), (1, 0, 0), body1=LIGHT, body2=LIGHT)
BARE = hp.HingePair((0.5, 0, 0), (0, 0, 0), (0, 0, 1))
MANY = hp.HingePair(TWO, (1, 0, 0), (0, 0, 1))
FLAT = hp.PlanarPair((1, 0), (0, 1), body1=LIGHT, body2=LIGHT)
NAMED = hp.HingePair((0.5, 0, 0), (0, 0, 0), (0, 0, 1), name="a")
STILL = hp.BodyMotion(S=EYE, **dict.fromkeys(("R", "v", "omega", "a", "alpha"), np.zeros(3)))
POSE, POINT = hp.BodyMotion(R=np.zeros(3), S=EYE), hp.BodyMotion(R=np.zeros(3))
T = np.linspace(0, 1, 11)
SCREW = hp.Screw((0, 0, 0), (0, 0, 0), (0, 0, 1), pitch=0.1, name="jack", body2=LIGHT)
NEEDLE = hp.Body(mass=1, inertia=(1, 1, 1e-30))


@functools.cache
def ur5():
    return hp.load_robot("ur5")


def arm():
    """Two hinges whose bodies have masses."""
    bar = hp.Body(1.0, centre_of_mass=(0.5, 0, 0), inertia=(0.01, 0.09, 0.09))
    return hp.Mechanism([hp.HingePair((k, 0, 0), (0, 0, 0), (0, 1, 0), body2=bar, name=f"j{k}") for k in (0, 1)])


def many_arms():
    return arm().with_payload("j1", mass=np.ones((3, 1)))


def spoiled(shape, index):
    array = np.ones(shape)
    array[index] = NAN
    return array


Q7, Q6 = np.zeros(7), np.zeros(6)
SEVEN = [np.zeros(7) for _ in range(7)]
FINE = hp.HingeLoad()
RIGID = hp.HingeLoad(stops=(0, 1e-14), stop_restitution=0.5)


def jumping(t):
    return 3.0 if t < 1 else 0.0


CALLS = {
    "pair.forward_kinematics": (lambda **k: PAIR.forward_kinematics(**{"q": Q7, **k}), [
        ("q", S, np.zeros(6), np.zeros((7, 3)), 1.0, SEVEN), ("q", D, "x", Q7 > 0), ("q", A, None),
        ("q", A, {"x": 0.0}, pd.DataFrame(np.zeros((2, 7)))), ("qd", A, C(qd=None, qdd=Q7)),
        ("qd", S, np.zeros((2, 6))), ("outputs", A, ("R3",), (), "R3", 3, ({},)),
        ("qd", A, C(outputs=("v2",))), ("sequence", A, None, "XXY", "XyZ", 3),
    ]),
    "planar.forward_kinematics": (lambda **k: FLAT.forward_kinematics(**{"q": np.zeros(4), **k}), [
        ("q", S, np.zeros((5, 7))), ("outputs", A, ("S2",)), ("qd", A, C(qdd=np.zeros(4))),
    ]),
    "pair.from_body1": (lambda **k: PAIR.forward_kinematics_from_body1(**{"body1": POSE, "psi": 0.0, **k}), [
        ("body1", A, 3), ("psi", D, "x"), ("psi", A, None), ("psid", A, C(psidd=0.0)),
        ("body1.omega", A, C(psid=0.0, outputs=("v2",))), ("body1.S", A, C(body1=POINT)),
    ]),
    "pair.dynamics": (
        lambda pair=PAIR, body1=STILL, **k: pair.inverse_dynamics(body1, 0.0, **{"psid": 0.0, "psidd": 0.0, **k}),
        [("gravity", S, (0, -9.81)), ("gravity", A, (0, 0, NAN)), ("psid", A, None), ("pair.body1", A, C(pair=BARE)),
         ("body1.a", A, C(body1=hp.BodyMotion(R=(0, 0, 0), S=EYE, omega=(0, 0, 0), alpha=(0, 0, 0))))],
    ),
    "pair.forward_dynamics": (lambda **k: PAIR.forward_dynamics(STILL, 0.0, 0.0, **k), [
        ("force1", S, (1, 2)), ("hinge_torque", D, "much"),
    ]),
    "pair.masses": (lambda mass: hp.HingePair(
        (10, 0, 0), (0, 10, 0), (0, 0, 1), body1=LIGHT, body2=hp.Body(mass, inertia=(mass,) * 3)
    ).mass_matrix(STILL, 0.0), [("pair", A, C(mass=1e308))]),
    "pair.residuals": (lambda body1=POSE, body2=POSE, **k: PAIR.residuals(body1, body2, **k), [
        ("body2", A, 3), ("body1", A, None), ("tolerances", A, {"gaps": 1.0}, {"gap": 0.0}, {"tilt": NAN}, 1e-3),
        ("tolerances", A, {"gap_rate": 1e-9}), ("t", S, [0.0, 1.0]),
    ]),
    "pair.prepare": (lambda given="pose", **k: PAIR.prepare(given, **k), [
        ("given", A, "speed", 3, ("R1", "psi"), ("S1", "quat_xyzw", "psi")), ("outputs", A, (), ("r2",)),
        ("given", A, C(outputs=("v2",))), ("sequence", A, "XX"), ("backend", A, "cuda"),
    ]),
    "prepared": (lambda rows=(Q7, Q7), **k: PAIR.prepare("velocity")(*rows, **k), [
        ("q", S, C(rows=(Q6, Q7))), ("qd", A, C(rows=(Q7, None))), ("qd", S, C(rows=(Q7, np.zeros((4, 6))))),
        ("*given", A, C(rows=(Q7,)), C(rows=())), ("q", A, C(rows=(), q=Q7, qd=Q7)),
    ]),
    "slopes": (lambda given=(Q7, Q7), wrt="q": PAIR.prepare("velocity", outputs=("v2",)).jacobian(given, wrt=wrt), [
        ("wrt", A, "tau", ()), ("given", A, Q7),
    ]),
    "vjp": (lambda cotangents: PAIR.prepare("velocity", outputs=("v2",)).vjp((Q7, Q7), cotangents), [
        ("cotangents", A, np.ones(6), {"qdd": np.ones(6)}, {}), ("cotangents", S, {"v2": np.ones(5)}),
    ]),
    "rotations": (lambda **k: {
        "n": lambda x: hp.rodrigues(x, 0.1), "M": hp.project_to_rotation, "S": hp.rotation_log, "w": hp.skew,
        "phi": hp.euler_to_matrix, "sequence": lambda x: hp.euler_to_matrix(Q7[:3], x),
    }[next(iter(k))](*k.values()), [
        ("n", X, (0, 0, 0)), ("M", R, -EYE), ("S", R, 2 * EYE), ("w", S, (1, 0)), ("phi", S, (1, 0)),
        ("sequence", A, "XXY", 3),
    ]),
    "sampled attitudes": (lambda t=T, S=None, order=6: hp.angular_velocity_from_samples(
        t, np.broadcast_to(EYE, (len(T), 3, 3)) if S is None else S, order
    ), [
        ("order", A, 6.0, 5, True), ("t", S, T[:6], T[:, None]), ("t", A, np.minimum(T, 0.3), -T, spoiled(len(T), 5)),
        ("t", D, T + 0j), ("S", A, EYE, C(S=np.broadcast_to(EYE, (3, 3, 3)))),
        ("S", R, np.broadcast_to(2 * EYE, (len(T), 3, 3))),
    ]),
    "euler_rates": (lambda phi: hp.euler_rates(phi, np.ones(3)), [
        ("phi", errors.GimbalLockError, (0, np.pi / 2, 0)),
    ]),
    # ---- time
    "integrate": (lambda **k: hp.integrate(**{"pair": PAIR, "t": T, "omega1": (0, 0, 1), "psid": 1.0, **k}), [
        ("omega1", A, spoiled((11, 3), (7, 1)), (0, 0, 1e200), None),
        ("omega1", S, np.ones((10, 3)), np.ones((2, 11, 3)), lambda t: np.ones((3, len(t)))),
        ("omega1", A, lambda t: (math.sin(t), 0, 0)), ("psid", A, spoiled(11, 5), INF, None, math.cos),
        ("psid", D, 1j),
        ("t", A, [0, 1, 1], [0, NAN, 1]), ("t", S, [], 1.0), ("method", A, "euler", "midpoint", ["magnus6"]),
        ("frame", A, "hinge"), ("tol", A, 0.0, "fine"), ("psi_0", A, NAN), ("S1_0", R, 2 * EYE),
        ("S1_0", S, np.ones((2, 3))),
        ("R1", S, np.zeros((10, 3))), ("R1", A, lambda _: None), ("pair", A, None), ("outputs", A, ("R3",)),
        ("omega1", S, C(pair=FLAT)),
        ("alpha1", A, C(outputs=("a2",))), ("backend", A, "cuda"),
    ]),
    "simulate": (lambda pair=PAIR, t=T, **k: hp.simulate(
        pair, t, **{"body1": POSE, "psi_0": 0.0, "psid_0": 0.0, "base": "fixed", **k}
    ), [
        ("t", A, (0, 0)), ("tol", A, 0), ("base", A, "held"), ("body1", A, 3), ("psi_0", A, NAN, None),
        ("gravity", S, (0, 0)), ("force2", S, (1, 2)), ("force2", A, lambda t, _: (0, 0, 1) if t < 1 else (0, 0, 0)),
        ("force1", A, (1, 0, 0)), ("torque1", A, lambda t, _: np.zeros((len(t), 3))),
        ("hinge_torque", A, lambda *_: "much", lambda *_: None, lambda _t, psi, _: 3.0 if psi < 1 else 0.0, RIGID),
        ("breaks", A, [NAN], [[1.0]]), ("breaks", D, "now"),
        ("until", A, "closed", lambda _, now: 1.0 if now.psi > 0.3 else -1.0),
        ("until", S, lambda _, now: now.R1), ("until", D, lambda _, now: now.psi > 0.3, lambda *_: True),
        ("pair", A, C(pair=FLAT)),
        ("pair.body2", A, C(pair=BARE), C(pair=hp.HingePair((1, 0, 0), (0, 0, 0), (0, 0, 1), body2=NEEDLE))),
        ("pair.body1", A, C(pair=hp.HingePair((1, 0, 0), (0, 0, 0), (0, 0, 1), body2=LIGHT), base="free")),
    ]),
    "simulate to the end": (lambda **k: hp.simulate(PAIR, [0, 1], POSE, 0.0, 1.0, base="fixed", **k), [
        ("hinge_torque", errors.SimulationError, lambda _t, psi, _: np.where(psi > 0.05, NAN, 0.0)),
    ]),
    "simulate a robot": (lambda q0=(0.0, 0.0), **k: hp.simulate(arm(), [0.0, 1.0], q0, **k), [
        ("loads", A, {"j9": FINE}, {"j0": "much"}),
        ("q0", A, {"loads": {"j0": hp.HingeLoad(stops=(1, 2), stop_restitution=0)}}),
        ("q0", S, [0.0]), ("q0", A, None), ("tau", A, lambda t, _: np.zeros((len(t), 3))),
        ("tau", S, lambda _, now: -50 * now.q[0], lambda t, _: np.cos(t[0])),
        ("tau", A, lambda t: t), ("tau", S, np.zeros((11, 2))), ("wrenches", A, {"hand": (0, 0)}),
        ("until", S, lambda _, now: now.q[0] - 0.3),
        ("base", A, "floating"), ("base_motion", A, "moving"),
        ("driven", A, {"j1": lambda t: (t, 0 * t, 0 * t)}, {"j1": lambda: 0}, {"j7": np.sin}, 3),
        ("force1", A, (1, 0, 0)), ("breaks", A, [[1.0]]),
        ("tol", A, 1.0),
        ("base_motion.omega", A, C(base_motion=hp.BodyMotion(R=(0, 0, 0), S=EYE, omega=(1, 0, 0)))),
    ]),
    "linearize": (lambda psi_0=1.0, psid_0=0.0, **k: hp.linearize(PAIR, POSE, psi_0, psid_0, base="fixed", **k), [
        ("hinge_torque", A, "much", hp.HingeLoad(friction=30)),
        ("equilibrium", A, C(equilibrium=True, hinge_torque=50.0)),
        ("hinge_torque", A, C(equilibrium=True, hinge_torque=hp.HingeLoad(friction=0.1))),
        ("base, psid_0", A, C(psid_0=1.0, equilibrium=True)),
    ]),
    "linearize a robot": (lambda q=(0.0, 0.0), **k: hp.linearize(arm(), q, **k), [
        ("tau", A, lambda _, now: now.q),
        ("loads", A, {"j0": hp.HingeLoad(friction=1.0)}, {"stick": FINE}),
    ]),
    "rollout": (lambda q0=Q6, qd0=Q6, tau=0, dt=0.01, **k: ur5().rollout(q0, qd0, tau, dt, **{"steps": 1, **k}), [
        ("method", A, "euler"), ("steps", A, None), ("tau", S, np.zeros((4, 2))),
        ("tau", S, C(tau=np.zeros((4, 6)), steps=3)),
        ("tau.K", S, C(tau=hp.Feedback(np.zeros(2), 0, 0))), ("every", A, 0), ("dt", A, NAN, 0, None),
        ("effort_limits", A, -1),
        ("q0", S, np.zeros(2)), ("out", S, {"q": np.zeros((3, 6))}), ("base_motion", A, EYE),
    ]),
    "rollout.vjp": (lambda cotangents, wrt=None: ur5().rollout(Q6, Q6, 0, 0.01, steps=2).vjp(
        cotangents, **({} if wrt is None else {"wrt": wrt})
    ), [
        ("cotangents", A, {"x": 1}, {}), ("cotangents", S, {"q": np.zeros(2)}),
        ("wrt", A, C(cotangents={"q": 1}, wrt="K")),
    ]),
    # ---- robots
    "Mechanism": (lambda **k: hp.Mechanism(**{"pairs": [PAIR], **k}), [
        ("pairs", A, [], 3, [FLAT], [NAMED, NAMED]), ("parents", A, [0, 0], [1.0], [3]),
        ("base", A, "loose", None), ("name", A, " "),
        ("pairs", A, [hp.HingePair((0, 0, 1), (0, 0, 0), (0, 0, 1), name="base")]),
    ]),
    "order": (lambda parents: hp.Mechanism(
        [hp.HingePair((0, 0, 1), (0, 0, 0), (0, 0, 1), name=name) for name in "abc"], parents
    ), [("pairs", A, C(parents=[0, 0, 1])), ("parents", A, C(parents=[2, 1, 0]), C(parents=[0, 0]))]),
    "Mechanism.from_urdf": (lambda **k: hp.Mechanism.from_urdf(**{"path_or_text": ARM, **k}), [
        ("snap", A, 10, -1), ("base", A, "free ", 1),
        ("locked", A, {"ankle": 0}, {"elbow": NAN}, {"elbow": "0"}, ["elbow"]),
    ]),
    "robot.forward_kinematics": (lambda **k: ur5().forward_kinematics(**{"q": Q6, **k}), [
        ("frames", A, "tool1", (), ["tool0"] * 2), ("qd", A, C(outputs=("v",))), ("outputs", A, ("tau",)),
        ("base_motion", A, Q6), ("q", S, Q7), ("q", A, {"elbow_joint": 0.0}), ("q", S, np.zeros((1,) * 40 + (6,))),
        ("q", A, pd.DataFrame(np.zeros((2, 2)), columns=["a", "b"])), ("out", A, {"x": Q6}, Q6),
        ("base_motion.v", A, C(qd=Q6, base_motion=hp.BodyMotion(R=(0, 0, 0), S=EYE, a=(0, 0, 0)))),
    ]),
    "robot": (lambda **k: {
        "joint": lambda x: ur5()[x], "frame": lambda x: ur5().forward_kinematics(Q6)[x],
        "output": lambda x: PAIR.forward_kinematics(np.zeros(7))[x],
        "frames": lambda x: ur5().jacobian(Q6, x), "axes": lambda x: ur5().jacobian(Q6, "tool0", axes=x),
        "about": lambda x: ur5().momentum(Q6, Q6, about=x), "gravity": lambda x: ur5().gravity_forces(Q6, gravity=x),
        "wrenches": lambda x: ur5().inverse_dynamics(Q6, Q6, Q6, wrenches=x),
        "qdd": lambda x: ur5().inverse_dynamics(Q6, Q6, x),
        "force1": lambda x: ur5().forward_dynamics(Q6, Q6, Q6, force1=x), "given": lambda x: ur5().prepare(x),
        "joint_loads": lambda x: ur5().inverse_dynamics(Q6, Q6, Q6, joint_loads=x),
        "parameters": ur5().with_inertial_parameters, "loads": ur5().with_joint_loads, "locked": ur5().with_locked,
    }[next(iter(k))](*k.values()), [
        ("frame", errors.UnknownOutputError, "tool1"), ("output", errors.UnknownOutputError, "R3"),
        ("joint", A, "elbow", 3), ("frames", A, "tool1"), ("axes", A, "local"),
        ("about", A, "hand"), ("gravity", S, (1, 2)), ("wrenches", A, {"x": (0, 0)}, {"tool0": 0}), ("qdd", A, None),
        ("force1", A, (1, 2, 3)), ("given", A, "x", ("q", "x"), ("q", "q")), ("joint_loads", A, "yes"),
        ("parameters", S, Q6),
        ("loads", A, {"x": FINE}, {"elbow_joint": 3}, 3), ("locked", A, {"ankle": 0}),
    ]),
    "robot.with": (lambda link="tool0", **k: ur5().with_payload(link, **k), [
        ("link", A, "tool1"), ("body", A, 3, C()), ("mass", A, -1, [1, NAN]), ("mass", A, C(mass=1, body=LIGHT)),
        ("centre_of_mass", S, C(mass=1, centre_of_mass=(1, 2))),
        ("inertia", A, C(mass=1, inertia=np.diag((1, 1, 3)))),
    ]),
    "robot.with_frame": (lambda **k: ur5().with_frame(**{"name": "tip", "link": "tool0", **k}), [
        ("name", A, "tool0", "", "\udc80", 3), ("link", A, None), ("R", A, (1, 2, INF)), ("S", R, 2 * EYE),
    ]),
    "masses": (lambda pairs: hp.Mechanism(pairs).mass_matrix(np.zeros(len(pairs))), [
        ("body2 of 'a'", A, C(pairs=[hp.HingePair((0, 0, 1), (0, 0, 0), (0, 1, 0), name="a")])),
    ]),
    "inverse_kinematics": (lambda **k: ur5().inverse_kinematics(**{"R": (0, 0, 0), "frame": "tool0", **k}), [
        ("R", S, (0, 0)), ("R", A, None), ("S", R, 2 * EYE), ("q0", S, (1, 2)),
        ("q0", A, np.full(6, NAN), C(select="nearest")),
        ("select", A, "best"), ("frame", A, "tool1", C(R={"tool0": (0, 0, 0)})), ("angle_tolerance", A, -1),
        ("seed", A, 0.5),
        ("limits", A, 3, np.tile((1.0, -1.0), (6, 1))), ("direction", A, (0, 0, 0)),
        ("S", A, C(direction=(0, 0, 1), S=EYE)),
        ("prefer", A, "home"), ("solutions", A, 0), ("workers", A, 0),
        ("base_motion", A, POINT),
    ]),
    "inverse_kinematics_path": (lambda **k: ur5().inverse_kinematics_path(**{"R": TWO, "frame": "tool0", **k}), [
        ("R", S, (0, 0, 0)), ("max_change", A, 0),
    ]),
    "one robot": (lambda use: use(many_arms()), [
        ("robot", S, *(C(use=use) for use in (hp.to_urdf, hp.to_pinocchio,
         lambda robot: robot.with_locked({"j0": 0.1})))),
    ]),
    "from_pinocchio": (hp.Mechanism.from_pinocchio, [("model", A, 3)]),
    # ---- files
    "load_robot": (lambda robot="ur5", **k: hp.load_robot(robot, **k), [
        ("robot", A, None, 3, "", "no_such"), ("base", A, "x"),
    ]),
    "load_robot_hinge": (lambda joint: hp.load_robot_hinge("talos_reduced", joint), [
        ("joint", errors.URDFError, "arm", None),
    ]),
    "from_urdf": (lambda **k: hp.from_urdf(**{"path_or_text": ARM, "joint": "elbow", **k}), [
        ("joint", errors.URDFError, "weld", "knee", "", None), ("body1_frame", errors.URDFError, "hand"),
        ("path_or_text", errors.URDFError, "", "no/such.urdf", "a\x00b", None, 3.5),
    ]),
    "to_urdf": (lambda pair=PAIR, **k: hp.to_urdf(pair, **k), [
        ("pair", A, 7, FLAT), ("pair", S, MANY), ("base", A, "pinned"), ("body1", A, POSE),
        ("name", A, C(pair=hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), name="\x1b"))),
    ]),
    "to_mjcf": (lambda pair=PAIR, **k: hp.to_mjcf(pair, **k), [
        ("pair", A, 7), ("pair", S, MANY), ("base", A, "floating"), ("hinge_torque", A, 3.0),
        ("body1", A, (0, 0, 0), POINT, hp.BodyMotion(R=TWO, S=EYE)),
        ("gravity", S, (0, 1)), ("hinge_torque", A, C(pair=arm(), hinge_torque=FINE)),
        ("robot", A, C(pair=hp.Mechanism([SCREW]))),
    ]),
    "to_pinocchio": (hp.to_pinocchio, [("pair", A, Q7, FLAT), ("pair", S, MANY)]),
    "cross_validate": (lambda pair=PAIR, **k: hp.cross_validate(pair, Q7, **k), [
        ("pair", A, 3), ("frames", A, "arm"), ("base_motion", A, POSE), ("gravity", A, (0, 0, 0)),
    ]),
    "derive": (lambda source=None, **k: hp.derive(ur5() if source is None else source, **{"frame": "tool0", **k}), [
        ("frame", A, None, "tool"), ("symbolic", A, "u", ("n",), 3), ("frame", A, C(source=FLAT)),
    ]),
    # ---- pictures
    "plot": (lambda source=None, **k: hp.plot(arm() if source is None else source, **k), [
        ("q", A, None, C(source=PAIR, q=Q7)), ("q", S, Q7), ("t", S, C(q=np.zeros((7, 2)), t=[1, 2])),
        ("tau", S, C(q=np.zeros((7, 2)), tau=TWO)),
    ]),
    "plot of a fit": (lambda **k: hp.plot(hp.fit(*bodies(recording(50))), **k), [("outputs", A, ("R3",))]),
    "view": (lambda source=None, **k: hp.view(arm() if source is None else source, **k), [
        ("source", A, FLAT), ("pair", S, C(source=MANY)), ("path", A, "page.png"),
        ("u1", A, C(source=hp.HingePair((1e308, 0, 0), (0, 0, 0), (0, 0, 1)))),
        ("q", S, np.zeros(2), np.zeros((3, 8))),
        ("q", D, "sin(t)", np.zeros((3, 2), complex)), ("t", A, C(q=THREE[:, :2], t=[0, 2, 1])),
        ("base_motion", A, C(q=THREE[:, :2], base_motion=Q7)),
        ("base_motion.S", A, C(q=THREE[:, :2], base_motion=POINT)),
    ]),
    # ---- recordings
    "fit": (lambda **k: hp.fit(**dict(zip(("body1", "body2"), bodies(recording(50)), strict=True)) | k), [
        ("loss", A, "tukey"), ("gauge", A, "middle"), ("weights", S, [1.0, 2.0]), ("weights", A, -np.ones(50)),
        ("t", S, np.arange(3.0)), ("clock_offset", A, C(t=np.arange(50.0), clock_offset=0.01)),
        ("body2", S, hp.BodyMotion(R=THREE, S=EYE)), ("body2", A, 3), ("body1", A, C(body1={"x1": [1.0]})),
        ("body1, body2", errors.FitError, C(body1=hp.BodyMotion(R=np.full((50, 3), NAN), S=EYE))),
        ("noise2", A, C(noise1=(1e-3, 1e-3)), C(noise1=(1e-3, 1e-3), noise2=1e-3)),
        ("noise1", A, C(noise1=(0, 1), noise2=(0, 1), body2=hp.BodyMotion(R=bodies(recording(50))[1].R))),
    ]),
    "smooth": (lambda **k: hp.smooth(**{"t": T, "body": np.sin(T), **k}), [
        ("body", A, spoiled(11, slice(0, 5))), ("bandwidth", A, -1, 1e-9, 1e6),
        ("body", S, T[1:]), ("loss", A, "tukey"),
        ("body", A, C(t=np.arange(400) / 100, body=(2 * np.arange(400) + 180) % 360 - 180)),
    ]),
    "resample": (lambda **k: hp.resample(**{"t": T, "values": T, "to": [0.5], **k}), [
        ("values", S, [1.0], POSE), ("gaps", A, 0),
        ("values", A, np.outer(np.where(T > 0.5, 1.0, -1.0), (0.5, 0.5, 0.5, 0.5))),
    ]),
    "fit_imus": (lambda **k: hp.fit_imus(*[hp.ImuRecording(T, np.ones((11, 3)), np.ones((11, 3)))] * 2, **k), [
        ("gaps", A, 0),
    ]),
    "fit_cluster": (lambda markers=None, reference=None: hp.fit_cluster(
        np.random.default_rng(0).normal(size=(5, 4, 3)) if markers is None else markers, reference
    ), [("markers", S, np.zeros((5, 2, 3))), ("reference", A, THREE)]),
    "fit_masses": (lambda **k: hp.fit_masses(
        **{"robot": ur5(), **dict.fromkeys(("q", "qd", "qdd", "tau"), np.zeros((8, 6))), **k}
    ), [
        ("joint_terms", A, ("stiction",), "viscous"), ("loss", A, "l2"),
        ("unknown", A, ["tool"], ["base_link"]), ("robot", A, "panda"),
        ("q", S, np.zeros((2, 8, 6))),
        ("q", errors.FitError, np.zeros((8, 6))), ("qd", S, np.zeros((4, 6))),
    ]),
    "sample_pairs": (lambda pair=PAIR, count=10, **k: hp.sample_pairs(pair, count, **k), [
        ("u1", A, C(), "+-0 mm", "0.2 mm", ("+-1 mm", "+-1 mm")), ("u2", A, "+-0.2", 2e-4), ("home", A, "+-0.2 mm"),
        ("u1_std", A, -1), ("u1_std", S, (1, 2)), ("home_std", A, INF), ("covariance", S, np.eye(11)),
        ("covariance", A, np.zeros((12, 12)), np.diag([1.0] * 11 + [-1.0])), ("u1_std", A, C(u1="+-1 mm", u1_std=1)),
    ]),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning", "ignore:invalid value")
@pytest.mark.parametrize(("call", "argument", "error", "value"), table({k: v[1] for k, v in CALLS.items()}))
def test_calls(call, argument, error, value):
    changed = value if isinstance(value, C) else {argument: value}
    refused(lambda: CALLS[call][0](**changed), argument, error)


# ---- linkages, struts and the goals of inverse kinematics

LID = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 1, 0), name="lid", body2=LIGHT)
HATCH = hp.Mechanism([LID]).with_frame("a", "base", R=(0.3, 0, -0.2)).with_frame("b", "lid", R=(0.5, 0, 0))
SPRUNG = HATCH.with_strut("a", "b", "strut", force=lambda length, _: length[:2])
OPEN, FOUR_BAR = open_four_bar(), four_bar()
TWICE = hp.Mechanism(
    [
        bar("crank1", (0, 0, 0), 0.3), bar("coupler1", (0.3, 0, 0), 0.9), bar("crank2", (0, 0, 0), 0.3),
        bar("coupler2", (0.3, 0, 0), 0.9), bar("rocker1", (1, 0, 0), 0.7), bar("rocker2", (1, 0, 0), 0.7),
    ],
    parents=[0, 1, 0, 3, 0, 0],
)  # fmt: skip
for k in "12":
    TWICE = TWICE.with_frame(f"a{k}", f"coupler{k}", R=(0.9, 0, 0)).with_frame(f"b{k}", f"rocker{k}", R=(0.7, 0, 0))
LOOPS = [hp.Loop(f"a{k}", f"b{k}") for k in "12"]
LEGS = hp.Mechanism(
    [hp.HingePair((0, k, 0), (0, 0, 0), (1, 0, 0), name=name, limits=(-1, 1), body1=LIGHT if k == 1 else None,
                  body2=LIGHT) for k, name in ((1, "left"), (-1, "right"))],
    [0, 0], base="free",
)  # fmt: skip
GOAL, FEET = {"left": (0, 0, 0)}, ("left", "right")


def strut(frame1="a", frame2="b", name="strut", **k):
    return HATCH.with_strut(frame1, frame2, name, **k)


def closed(*loops, robot=OPEN, coordinates="crank", at=AT):
    return robot.closed(*loops or [hp.Loop("a", "b")], coordinates=coordinates, at=at)


def goal(**k):
    return LEGS.inverse_kinematics(GOAL, **k)


def prepared_goal(frames=FEET, **k):
    return LEGS.prepare("inverse_kinematics", frames=frames, **k)


LINKED = {
    "struts": [
        ("robot", A, lambda: SPRUNG.prepare("forward_dynamics"), lambda: hp.to_urdf(strut()),
         lambda: SPRUNG.inverse_dynamics_derivatives([0.1], [0], [0]),
         lambda: SPRUNG.rollout([[0.1]], [[0]], np.zeros((1, 3, 1)), 0.1)),
        ("force of strut 'strut'", A, lambda: SPRUNG.struts(np.linspace(-1, 0, 9)[:, None])),
        ("limits", A, lambda: strut(limits=(0.4, 0.3))), ("name", A, lambda: strut(name="lid")),
        ("frame2", A, lambda: strut("b", "lid"), lambda: strut(frame2="c")),
        ("free_length", A, lambda: strut(stiffness=9),
         lambda: strut(force=hp.GasSpring(300, 400, 350), free_length=0.65)),
        ("force", A, lambda: strut(force=([0.2, 0.1], [1, 2])), lambda: strut(force="300")),
        ("F2", A, lambda: hp.GasSpring(300, 200, 0.2)), ("stroke", A, lambda: hp.GasSpring(300, 400, 0)),
    ],
    "loops": [
        ("coordinates", A, lambda: closed(coordinates=()), lambda: closed(coordinates=("crank", "rocker")),
         lambda: closed(coordinates=("crank", "crank")),
         lambda: closed(coordinates="crnk"),
         lambda: closed(*LOOPS, robot=TWICE, coordinates=("crank1", "rocker1"),
                        at={n + k: AT[n] for n in AT for k in "12"})),
        ("guess", A, lambda: FOUR_BAR.follow([[0.3]], guess={"crnk": 1})), ("q", S, lambda: FOUR_BAR.follow([0.3])),
        ("loads['rocker']", A, lambda: hp.simulate(
            FOUR_BAR, [0, 1], [0.3], loads={"rocker": hp.HingeLoad(friction=1.0)}
        )),
        ("at", A, lambda: closed(robot=open_four_bar(0.1, 0.1, 0.1), at=None),
         lambda: closed(robot=open_four_bar(0.6, 0.5, 0.6),  # at a dead point
                        at={"crank": np.arccos((0.6**2 + 1 - 1.1**2) / 1.2), "coupler": 0, "rocker": 2.0})),
        ("loop a-coupler", A, lambda: OPEN.closed(hp.Loop("a", "coupler"))), ("loops", A, lambda: OPEN.closed("a")),
        ("axis", A, lambda: hp.Loop("a", "b", kind="hinge")),
        ("length", A, lambda: hp.Loop("a", "b", kind="distance", length=-1)),
        ("robot", A, lambda: closed(robot=FOUR_BAR), lambda: hp.to_urdf(FOUR_BAR),
         lambda: hp.to_pinocchio(FOUR_BAR), lambda: FOUR_BAR.error_bounds([0.3]),
         lambda: FOUR_BAR.with_locked({"crank": 0.3}), lambda: FOUR_BAR.joint_wrenches([0.3], [0], [0]),
         lambda: OPEN.loop_wrenches(*np.zeros((3, 3))), lambda: FOUR_BAR.prepare("joint_wrenches")),
        ("given", A, lambda: FOUR_BAR.prepare("loop_wrenches"), lambda: FOUR_BAR.prepare("tree_tau")),
    ],
    "goals": [
        ("base", A, lambda: LEGS.with_base("fixed").inverse_kinematics(GOAL, base="solve")),
        ("q0", A, lambda: prepared_goal("left")((0, 0, 0), q0=np.full(2, NAN))),
        ("relative_to", A, lambda: goal(relative_to={"right": "left"})),
        ("coordinates", A, lambda: goal(coordinates={"arm": 1}), lambda: goal(coordinates=["left"])),
        ("coordinates['left']", A, lambda: goal(coordinates={"left": 2})),
        ("frames", A, lambda: prepared_goal(5)), ("frame", A, lambda: prepared_goal(frame="left")),
        ("outputs", A, lambda: prepared_goal(outputs=("q",))),
        ("R", S, lambda: prepared_goal()((0, 0, 0))),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("_", "argument", "error", "call"), table(LINKED))
def test_linked_calls(_, argument, error, call):
    refused(call, argument, error)


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda: arm().gravity_forces([0, 0], gravity=9.81), S, "such as (0, 0, -9.81)"),
        (lambda: arm().with_payload("hand", mass=1, inertia=-EYE), A, "above the sum of the other two"),
        (lambda: hp.simulate(arm(), [0, 1], q_0=[0, 0]), TypeError, "simulate() got .* 'q_0' (nearest: q0)"),
        (lambda: hp.simulate(arm()), TypeError, "simulate() missing a required argument: 't'"),
        (lambda: hp.simulate("panda", [0, 1]), A, "pair: .* or a Mechanism, got 'panda'"),
        (lambda: hp.simulate(PAIR, [0, 1], None, 0, 0, bas="fixed"), TypeError, "simulate() got .* (nearest: base)"),
        (lambda: hp.Slider((0, 0, 0), (0, 0, 0)), TypeError, "Slider.* missing .* 'n'"),
        (lambda: hp.Slider((0, 0, 0), (0, 0, 0), (0, 0, 1), limit=(0, 1)), TypeError, "Slider() got .*: limits)"),
    ],
)
def test_a_refusal_says_what_helps(call, error, said):
    with pytest.raises(error, match=re.escape(said).replace(r"\.\*", ".*")):
        call()
