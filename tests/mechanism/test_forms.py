"""What a robot's methods take and give: arrays of every kind, tables, values by joint, and what they refuse."""

from __future__ import annotations

import copy
import pickle
import warnings

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.mechanism import tree_of
from support.near import U, assert_near
from support.trees import Robot, base_motion, random_model, record_of, weightless, with_mimics


@pytest.fixture(scope="module")
def robot():
    return hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})


@pytest.fixture(scope="module")
def motion(robot):
    return np.random.default_rng(4).uniform(-1, 1, (3, 4, 5, robot.dof))


def check_same(found, expected, allowed=1e-12):
    assert found.keys() == expected.keys()
    for name, array in found.items():
        size = max(1.0, np.abs(expected[name]).max())
        np.testing.assert_allclose(array, expected[name], rtol=0, atol=allowed * size, err_msg=name)


def test_tables_and_values_by_joint_are_read_by_name(robot, motion):
    pandas = pytest.importorskip("pandas")
    q, qd = motion[:2, 0]
    expected = robot.forward_kinematics(q, qd, frames="panda_hand")
    names = robot.names[::-1]
    table = pandas.DataFrame(q, columns=robot.names)[list(names)]
    rates = pandas.DataFrame(qd, columns=[f"{name}_dot" for name in robot.names])
    check_same(robot.forward_kinematics(table, rates, frames="panda_hand").arrays(), expected.arrays())
    by_name = {name: q[:, robot.names.index(name)] for name in names}
    found = robot.forward_kinematics(by_name, qd, frames="panda_hand")
    check_same(found.arrays(), expected.arrays())
    held = by_name | {"panda_joint2": 0.25, "panda_joint5": 0}
    full = q.copy()
    full[:, [1, 4]] = 0.25, 0.0
    expected = robot.inverse_dynamics(full, qd, qd)
    check_same(robot.inverse_dynamics(held, qd, qd).arrays(), expected.arrays())


@pytest.mark.slow
def test_a_free_base_needs_no_acceleration_where_it_is_not_computed_with():
    """Its velocities are enough for accelerations, biases and the bias of the centre of mass."""
    robot = hp.load_robot("solo12", base="free")
    q, rng = np.full(12, 0.3), np.random.default_rng(11)
    v, omega, S = rng.normal(size=3), rng.normal(size=3), hp.rotation_exp(rng.normal(size=3))
    moving = hp.BodyMotion(R=np.zeros(3), S=S, v=v, omega=omega)
    told = hp.BodyMotion(R=np.zeros(3), S=S, v=v, omega=omega, a=np.full(3, np.nan), alpha=np.full(3, np.nan))
    tip = robot.tips[0]
    for base in (moving, told):
        moves = robot.forward_dynamics(q, q, q, base_motion=base)
        forces = robot.inverse_dynamics(
            q,
            q,
            moves.qdd,
            base_motion=hp.BodyMotion(R=(0, 0, 0), S=S, v=v, omega=omega, a=moves.a1, alpha=moves.alpha1),
        )
        assert_near(forces.tau, q, 2**16)
        assert_near(forces.force1, 0.0, 2**16, 10)  # N
        biases = (
            robot.bias_forces(q, q, base_motion=base),
            robot.acceleration_bias(q, q, tip, base_motion=base),
        )
        assert all(np.isfinite(bias).all() for bias in biases)
    with pytest.raises(hp.ArgumentError, match=r"base_motion\.a: expected a value"):
        robot.inverse_dynamics(q, q, q, base_motion=moving)


@pytest.mark.slow
def test_a_base_given_by_its_pose_alone_is_at_rest(robot, motion):
    rng = np.random.default_rng(10)
    moving = base_motion(rng)
    pose = hp.BodyMotion(R=moving.R, S=moving.S)
    still = hp.BodyMotion(R=moving.R, S=moving.S, **dict.fromkeys(("v", "omega", "a", "alpha"), np.zeros(3)))
    for call in (robot.forward_kinematics, robot.inverse_dynamics, robot.forward_dynamics):
        found, expected = (call(*motion[:, 0], base_motion=base).arrays() for base in (pose, still))
        check_same(found, expected)
    # gravity turned by the attitude of the base, on a base that is not turned
    fall = moving.S.T @ (0, 0, -9.81)
    turned = robot.gravity_forces(motion[0], base_motion=pose)
    assert_near(turned, robot.gravity_forces(motion[0], gravity=fall), 64)


def test_robots_states_and_calls_can_be_copied(robot, motion):
    q = motion[0, 0]
    state, step = robot.forward_kinematics(q), robot.prepare("pose", backend="numpy")
    for again in (lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy):
        check_same(again(robot).forward_kinematics(q).arrays(), state.arrays())
        check_same(again(step)(q).arrays(), state.arrays())
        assert again(state).frames == state.frames
        check_same(again(state)["panda_hand_tcp"].arrays(), state["panda_hand_tcp"].arrays())


def arm(*masses):
    """Hinges about y in series; a mass of 0 is none."""
    body = hp.Body(mass=1, centre_of_mass=(0.1, 0, 0.1), inertia=(0.1, 0.1, 0.1))
    given = {"u1": (0, 0, 0.3), "u2": (0, 0, 0), "n": (0, 1, 0)}
    return weightless(
        [hp.HingePair(**given, name=f"joint_{k}", body2=body if m else None) for k, m in enumerate(masses)]
    )


def test_a_mass_that_was_never_given_is_asked_for_where_it_matters():
    body, given = hp.Body(mass=1, inertia=(1, 1, 1)), {"u1": (0, 0, 0.3), "u2": (0, 0, 0), "n": (0, 1, 0)}
    pairs = [hp.HingePair(**given, name="a", body2=body), hp.HingePair(**given, name="b")]
    robot, q = hp.Mechanism(pairs), np.zeros(2)
    assert robot.jacobian(q).shape == (6, 2)
    for ask in (robot.mass_matrix, lambda q: robot.error_bounds(q, q, q, outputs=("tau",)), robot.centre_of_mass):
        with pytest.raises(hp.ArgumentError, match=r"body2 of 'b': expected mass properties"):
            ask(q)
    assert robot.with_payload("b", body).mass_matrix(q)[1, 1] > 0
    with pytest.raises(hp.ArgumentError, match="body1 of the first pair"):
        hp.Mechanism(pairs[:1], base="free").mass_matrix(np.zeros(1))


@pytest.mark.slow
def test_a_joint_that_nothing_resists_is_named_and_its_samples_are_nan():
    q = np.random.default_rng(1).normal(size=(3, 3))
    robot = arm(1, 1, 0)
    with pytest.warns(hp.DynamicsWarning) as caught:
        found = robot.forward_dynamics(q, q, q)
    assert np.isnan(found.qdd).all()
    assert "joint_2" in str(caught[0].message)
    assert "no mass resists joint 'joint_2' at 3 of 3 samples" in str(caught[-1].message)
    with warnings.catch_warnings(record=True) as caught:  # what is assumed is said once
        warnings.simplefilter("always")
        robot.forward_dynamics(q[0], q[0], q[0])
    assert [str(one.message) for one in caught] == [
        "mechanism: no mass resists joint 'joint_2' here; accelerations are NaN there"
    ]
    assert np.isfinite(arm(1, 0, 1).forward_dynamics(q, q, q).qdd).all()


@pytest.mark.slow
def test_a_follower_without_mass_leaves_nothing_singular():
    tree = record_of(random_model(3, 8))
    robot = Robot(with_mimics(tree, {"joint_3": ("joint_6", -0.5, 0.25)}))
    q = np.zeros((2, len(tree_of(robot).joints) - 1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isfinite(robot.forward_dynamics(q, q, q).qdd).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["R", "S", "d", "v", "omega", "a", "alpha"])
def test_a_frame_with_the_name_of_an_output_is_a_frame(name):
    state = hp.Mechanism([hp.HingePair((0, 0, 1), (0, 0, 0), (1, 0, 0), name=name)]).forward_kinematics(
        [0.5], [1], [2]
    )
    assert state[name].R.tolist() == [0, 0, 1]
    assert set(state.arrays()) == {"R", "S", "d", "v", "omega", "a", "alpha"}
    assert all(getattr(state, output).shape[0] == 1 for output in state.arrays())
    assert pickle.loads(pickle.dumps(state))[name].omega.tolist() == [1, 0, 0]


def test_products_that_overflow_are_refused_where_masses_are_used():
    ball = hp.Body(1e10, inertia=(1, 1, 1))
    pairs = [hp.HingePair((0, 0, 1e160), (0, 0, 0), (1, 0, 0), name=name, body2=ball) for name in "ab"]
    robot = hp.Mechanism(pairs, name="huge")
    assert robot.forward_kinematics([0, 0])["b"].R.tolist() == [0, 0, 2e160]
    for ask in (
        *[lambda: robot.gravity_forces([0, 0])] * 2,
        lambda: robot.prepare("mass_matrix"),
        lambda: robot.error_bounds([0, 0], outputs=("mass_matrix",)),
    ):
        with pytest.raises(hp.ArgumentError, match="robot 'huge': expected masses and lengths"):
            ask()
    with pytest.raises(hp.ArgumentError, match="payload of a"):
        robot.with_payload("a", hp.Body(1e308)).with_payload("a", hp.Body(1e308))


def link(name, mass, moments, centre=(0, 0, 0)):
    """A link of URDF; a mass of 0 is none."""
    origin, (xx, yy, zz) = " ".join(map(str, centre)), moments
    inertia = f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/>'
    inner = f'<inertial><origin xyz="{origin}"/><mass value="{mass}"/>{inertia}</inertial>' if mass else ""
    return f'<link name="{name}">{inner}</link>'


def free(base, arm="", kind="continuous", origin='xyz="0.3 0.2 0.1" rpy="0.3 0.4 0.5"', mimics=False):
    """A robot on a free base, of one or two links, and a joint that follows where it is asked for."""
    end = '<child link="arm"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
    joint = f'<joint name="j" type="{kind}"><origin {origin}/><parent link="base"/>{end}' if arm else ""
    text = f"{link('base', *base)}{link('arm', *arm) if arm else ''}{joint}"
    if mimics:
        joint = joint.replace('name="j"', 'name="k"').replace('"arm"', '"hand"').replace('"base"', '"arm"')
        text += link("hand", 1, (1, 1, 1)) + joint.replace("</joint>", '<mimic joint="j"/></joint>')
    return hp.Mechanism.from_urdf(f'<robot name="r">{text}</robot>', base="free")


POINT, BALL, NOTHING = (3, (0, 0, 0), (1, 2, 3)), (2, (1, 1, 1), (1, 0, 0)), (0, (0, 0, 0))
SINGULAR = {
    "no mass": lambda: free(NOTHING, NOTHING),
    "one link without mass": lambda: free(NOTHING),
    "one point": lambda: free(POINT),
    "two points": lambda: free(POINT, (2, (0, 0, 0), (1, 0, 0))),
    "two points of which one is the base": lambda: free((3, (0, 0, 0)), (2, (0, 0, 0), (1, 0.25, 0))),
    "base without mass": lambda: free(NOTHING, BALL),
    "mass at the last of two coupled joints": lambda: free(NOTHING, NOTHING, mimics=True),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*no rigid body has")
@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("case", SINGULAR)
def test_accelerations_of_a_base_that_nothing_resists_are_nan(case, backend):
    robot = SINGULAR[case]()
    q = np.random.default_rng(5).normal(size=(4, robot.dof))
    step = robot.prepare("forward_dynamics", backend=backend)
    for call in (lambda *given: robot.forward_dynamics(*given, backend=backend), step):
        for given, where in ((q, "at 4 of 4 samples"), (q[0], "here")):
            with pytest.warns(hp.DynamicsWarning, match=f"no mass resists .*{where}; accelerations are NaN there"):
                found = call(given, given, given)
            assert np.isnan(np.concatenate((found.qdd, found.a1, found.alpha1), axis=-1)).all()


@pytest.mark.filterwarnings("ignore:.*no rigid body has")
def test_a_base_is_named_at_the_samples_where_nothing_resists_it():
    """A rod along x, and a point that a slider holds on its axis or beside it."""
    robot = free((3, (0, 1, 1)), (2, (0, 0, 0)), "prismatic", "")
    q = np.array([[0.0], [1.0], [0.0], [-0.5]])
    with pytest.warns(hp.DynamicsWarning, match="no mass resists the base at 2 of 4 samples"):
        found = robot.forward_dynamics(q, q, q)
    assert np.isnan(found.alpha1).any(axis=-1).tolist() == [True, False, True, False]


@pytest.mark.filterwarnings("ignore:.*no rigid body has")
@pytest.mark.parametrize("base", [BALL, (3, (0, 0, 0)), (3, (1e-5, 1e-5, 1e-5))], ids=["ball", "point", "small"])
def test_a_base_that_something_resists_accelerates(base):
    robot = free(base, BALL)
    q = np.random.default_rng(6).normal(size=(5, 1))
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*no mass resists")
        found = robot.forward_dynamics(q, q, q, force1=(1, 2, 3), torque1=(4, 5, 6))
    M = np.concatenate((found.a1, found.alpha1, found.qdd), axis=-1)[..., None]
    left = (robot.mass_matrix(q) @ M)[..., 0] + robot.bias_forces(q, q)
    expected = np.concatenate((np.broadcast_to((1, 2, 3, 4, 5, 6), (5, 6)), q), axis=-1)
    np.testing.assert_allclose(left, expected, rtol=0, atol=64 * U * np.abs(found.qdd).max())


@pytest.mark.slow
def test_tiny_numbers_do_not_raise_what_numpy_is_told_to_raise():
    tiny = 1e-170
    body = hp.Body(1e-200, (tiny, 0, 0), (tiny, tiny, tiny))
    pair = hp.HingePair(
        (tiny, 0, 1), (0, tiny, 1), (1, tiny, 0), home=hp.rodrigues((tiny, 1, 0), 0.4), body2=body, name="x"
    )
    text, one = hp.to_urdf(hp.Mechanism([pair])), [tiny]
    with np.errstate(all="raise"):
        robot = hp.Mechanism.from_urdf(text)
        robot.inverse_dynamics(one, one, one)
        robot.error_bounds(one, one, one, outputs=("R", "tau"))
        robot.with_frame("tool", "x", R=(tiny, tiny, tiny)).with_payload("tool", body)
        hp.from_urdf(text, "x")
        hp.cross_validate(robot, one, one, one)


BODILESS = '<robot name="x"><link name="a"/></robot>'


def test_robots_without_moving_joints_are_prepared():
    none = hp.Mechanism.from_urdf(BODILESS)
    for lead in ((), (3,), (0,)):
        for _ in range(2):
            np.testing.assert_array_equal(none.prepare("pose")(np.zeros((*lead, 0))).R, np.zeros((*lead, 1, 3)))
    flying = hp.load_robot("quadrotor_base", base="free")
    still = (np.zeros(0),) * 3
    for force in (np.array([0, 0, 20.0]), np.arange(15.0).reshape(5, 3)):
        found = flying.prepare(("q", "qd", "tau", "force1"))(*still, force).a1
        np.testing.assert_array_equal(found, flying.forward_dynamics(*still, force1=force).a1)
        assert found.any()


@pytest.mark.slow
def test_calls_after_the_first_see_what_has_changed(robot):
    """Lists, iterators, arrays and options are looked at anew."""
    q, names, outputs = np.linspace(-1.0, 1.0, robot.dof), ["panda_hand"], ["R"]
    away = np.array((0.0, 0.0, -9.81))
    for _ in range(2):
        state = robot.forward_kinematics(q, frames=names, outputs=outputs)
        torques = robot.gravity_forces(q, gravity=away)
    names[0], outputs[0], away[2] = "panda_link3", "S", 0.0
    changed = robot.forward_kinematics(q, frames=names, outputs=outputs)
    assert (state.frames, changed.frames, changed.outputs) == (("panda_hand",), ("panda_link3",), ("S",))
    assert torques.any()
    assert not robot.gravity_forces(q, gravity=away).any()
    used = iter(["panda_hand"])
    robot.forward_kinematics(q, frames=used)
    with pytest.raises(hp.ArgumentError):
        robot.forward_kinematics(q, frames=used)
    moved = hp.BodyMotion(R=(1.0, 2.0, 3.0), S=np.eye(3))
    shift = robot.forward_kinematics(q, base_motion=moved).R - robot.forward_kinematics(q).R
    assert_near(shift, [(1.0, 2.0, 3.0)] * 3, 16)
    out = {"R": np.empty((1, 3)), "S": np.empty((1, 3, 3)), "v": np.empty((1, 3))}
    with pytest.raises(hp.ArgumentError, match="qd"):
        robot.forward_kinematics(q, frames="panda_hand", out=out)
    rest = robot.inverse_dynamics(q, 0 * q, 0 * q).tau
    loaded = robot.inverse_dynamics(q, 0 * q, 0 * q, wrenches={"panda_hand": ((0.0, 0.0, 50.0), (0.0, 0.0, 0.0))}).tau
    assert np.abs(rest - loaded).max() > 1  # N m
