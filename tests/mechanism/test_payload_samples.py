"""Payloads that differ from sample to sample, against one robot for each; locked joints; the total mass."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.errors import ShapeError
from hingepair.mechanism.mechanism import tree_of
from support.near import U
from support.trees import random_model

pytestmark = pytest.mark.filterwarnings("ignore:.*no rigid body:hingepair.DynamicsWarning")

RNG = np.random.default_rng(11)
COUNT, STATES = 3, 2
MASS = RNG.uniform(0, 4, (COUNT, 1))
CENTRE = RNG.uniform(-0.3, 0.3, (COUNT, 1, 3))
HALF = RNG.uniform(-0.2, 0.2, (COUNT, 1, 3, 3))
INERTIA = np.trace(HALF @ np.swapaxes(HALF, -1, -2), axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
INERTIA = INERTIA - HALF @ np.swapaxes(HALF, -1, -2)
BASE = hp.BodyMotion(
    R=(1, 2, 3), S=hp.rotation_exp((0.3, -0.2, 0.5)), v=(1, 0, 2), omega=(0.5, 1, -1), a=(0, 1, 0), alpha=(1, 1, 2)
)
TIMES_ROUNDING = 256 * 2.0**-53


@pytest.fixture(scope="module", params=["fixed", "free"])
def robot(request):
    return hp.Mechanism.from_pinocchio(random_model(2, 5), base=request.param)


def results(robot, q, qd, qdd):
    options = {"base_motion": BASE, "backend": "numpy"}
    forces = robot.inverse_dynamics(q, qd, qdd, **options)
    found = {"tau": forces.tau, "torque1": forces.torque1, "mass": robot.mass_matrix(q, **options)}
    found |= {"qdd": robot.forward_dynamics(q, qd, forces.tau, **options).qdd}
    found |= {"kinetic": robot.energy(q, qd, **options).kinetic, "centre": robot.centre_of_mass(q, **options)}
    found |= {"wrench": robot.joint_wrenches(q, qd, qdd, **options).torque}
    found |= {"slopes": robot.inverse_dynamics_derivatives(q, qd, qdd, **options).tau_q}
    found |= {"rollout": robot.rollout(q, qd, qdd[:, None], 1e-3, steps=1).qd}
    found |= {"prepared": robot.prepare("inverse_dynamics", outputs=("tau",), backend="numpy")(q, qd, qdd).tau}
    return found | {"angular": robot.momentum(q, qd, about="centre", **options).angular}


@pytest.mark.slow
def test_every_sample_has_its_payload(robot):
    link = robot.tips[-1]
    q, qd, qdd = np.random.default_rng(4).uniform(-1, 1, (3, STATES, robot.dof))
    loaded = robot.with_payload(link, mass=MASS, centre_of_mass=CENTRE, inertia=INERTIA)
    found = results(loaded, q, qd, qdd)
    for k in range(COUNT):
        one = robot.with_payload(link, mass=MASS[k, 0], centre_of_mass=CENTRE[k, 0], inertia=INERTIA[k, 0])
        for name, expected in results(one, q, qd, qdd).items():
            error = np.abs(found[name][k] - expected).max()
            assert found[name].shape == (COUNT, *expected.shape), name
            # accelerations of the two differ by the condition of the mass matrix
            assert error <= (1e4 if name in ("qdd", "rollout") else 1) * TIMES_ROUNDING * max(
                1, np.abs(expected).max()
            ), name


def test_a_point_is_that_of_pinocchio():
    model = random_model(3, 4)
    robot = hp.Mechanism.from_pinocchio(model)
    mass, centre = 1.5, np.array((0.1, -0.2, 0.3))
    loaded = robot.with_payload("joint_3", mass=mass, centre_of_mass=centre)
    model.appendBodyToJoint(4, pin.Inertia(mass, centre, np.zeros((3, 3))), pin.SE3.Identity())
    q, qd, qdd = np.random.default_rng(4).uniform(-1, 1, (3, 4))
    expected = pin.rnea(model, model.createData(), q, qd, qdd)
    assert np.abs(loaded.inverse_dynamics(q, qd, qdd).tau - expected).max() <= TIMES_ROUNDING * np.abs(expected).max()


def test_the_total_mass_counts_a_free_base_and_payloads(robot):
    bodies = [joint.body.mass for joint in tree_of(robot).joints] + [tree_of(robot).base.mass] * (
        robot.base == "free"
    )
    assert robot.mass == pytest.approx(sum(bodies), rel=8 * U)
    loaded = robot.with_payload(robot.tips[-1], mass=MASS)
    assert np.abs(loaded.mass - robot.mass - MASS).max() <= 4 * 2.0**-53 * loaded.mass.max()


def test_payloads_that_do_not_fit_the_coordinates_are_named(robot):
    loaded = robot.with_payload(robot.tips[-1], mass=MASS[:, 0])
    q = np.zeros((STATES + 5, robot.dof))
    with pytest.raises(ShapeError, match=r"^payload: "):
        loaded.gravity_forces(q)
    with pytest.raises(ShapeError, match=r"^payload: expected leading shape"):
        loaded.rollout(q, q, np.zeros(robot.dof), 0.01, steps=2)


def lever_arms(turned, k=None):
    """A robot of pairs whose points, if `turned` also axes, differ from sample to sample, or the robot of one."""
    rng, own = np.random.default_rng(8), slice(None) if k is None else (k, 0)
    first, second, third, tool, axis, turn = (rng.uniform(-1, 1, (COUNT, 1, 3))[own] for _ in range(6))
    n, home = (axis, hp.rotation_exp(turn)) if turned else ((1, 1, 0), BASE.S)
    bodies = [hp.Body(m, centre_of_mass=(0.1, 0.2, m), inertia=(1, 1.1, 1.2)) for m in (2.0, 1.0, 0.5)]
    robot = hp.Mechanism(
        [
            hp.HingePair(u1=(0, 0, 1), u2=first, n=(0, 1, 0), name="a", body2=bodies[0]),
            hp.HingePair(u1=second, u2=(0, 0.1, 0), n=n, name="b", body2=bodies[1]),
            hp.HingePair(u1=(0.1, 0.2, 0.3), u2=third, n=(0, 1, 1), home=home, name="c", body2=bodies[2]),
        ]
    )
    robot = robot.with_frame("bent", "b", S=BASE.S).with_payload("c", hp.Body(0.3, inertia=(0.1, 0.1, 0.1)))
    return (
        robot.with_payload("a", mass=0.2).with_frame("tool", "bent", R=tool).with_frame("tip", "tool", R=(0.1, 0, 0))
    )


@pytest.mark.parametrize("turned", [False, True])
def test_every_sample_has_its_geometry(turned):
    robot = lever_arms(turned)
    q, qd, qdd = np.random.default_rng(4).uniform(-1, 1, (3, STATES, 3))

    def found(one):
        options = {"backend": "numpy"}
        state = one.forward_kinematics(q, qd, qdd, frames=("a", "b", "c", "tip"), **options)
        forces = one.inverse_dynamics(q, qd, qdd, wrenches={"c": ((1, 2, 3), (3, 2, 1))}, **options)
        motions = {"R": state.R, "a": state.a, "J": one.jacobian(q, "tip", **options)}
        return results(one, q, qd, qdd) | motions | {"loaded": forces.tau}

    together = found(robot)
    for k in range(COUNT):
        for name, expected in found(lever_arms(turned, k)).items():
            assert together[name].shape == (COUNT, *expected.shape), name
            error = np.abs(together[name][k] - expected).max()
            assert error <= TIMES_ROUNDING * max(1, np.abs(expected).max()), name


LEG = """<robot name="leg"><link name="base"/>{links}
<joint name="hip" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 1" rpy="0.1 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="6"/></joint>
<joint name="knee" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0 0.1 -0.4"/><axis xyz="1 1 0"/>
  <limit lower="-2" upper="2" effort="5" velocity="6"/><dynamics damping="0.5"/></joint>
<joint name="sole" type="fixed"><parent link="l2"/><child link="l3"/><origin xyz="0 0 -0.4" rpy="0 0.2 0"/></joint>
<joint name="toe" type="revolute"><parent link="l2"/><child link="l4"/><origin xyz="0.1 0 -0.4"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="5" velocity="6"/><mimic joint="knee" multiplier="0.5" offset="0.1"/></joint>
</robot>""".format(
    links="".join(
        f"""<link name="l{k}"><inertial><origin xyz="0.0{k} 0.01 0"/><mass value="{k}"/>
<inertia ixx="0.{k}" iyy="0.{k}" izz="0.{k}" ixy="0.01" ixz="0" iyz="0"/></inertial></link>"""
        for k in range(1, 5)
    )
)


@pytest.mark.parametrize(
    "locked", [{"knee": 0.3}, {"hip": -0.5}, {"toe": 0.2, "knee": 0.3}, {"hip": 0.1, "knee": -1.0}]
)
def test_joints_are_locked_after_reading_as_while_reading(locked):
    expected = hp.Mechanism.from_urdf(LEG, locked=locked)
    found = hp.Mechanism.from_urdf(LEG).with_locked(locked)
    assert (found.names, found.links, found.tips) == (expected.names, expected.links, expected.tips)
    assert tree_of(found).source == tree_of(expected).source
    assert str(found) == str(expected)
    assert tree_of(found).frames.keys() == tree_of(expected).frames.keys()
    for one, other in zip(tree_of(found).joints, tree_of(expected).joints, strict=True):
        assert one.load == other.load
        for got, wanted in ((one.u, other.u), (one.S, other.S), (one.body.inertia, other.body.inertia)):
            assert np.abs(got - wanted).max() <= 16 * 2.0**-53
        assert np.abs(one.body.centre_of_mass - other.body.centre_of_mass).max() <= 16 * 2.0**-53
    again = expected.with_locked({})
    assert (again.names, again.tips) == (expected.names, expected.tips)
