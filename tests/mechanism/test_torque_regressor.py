"""The regressor of inertial parameters, and the combinations of them on which torques depend."""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from support.near import U
from support.trees import (
    Robot,
    base_motion,
    on_free_base,
    pinocchio_state,
    random_model,
    record_of,
    urdf_model,
)

SAMPLES = 3
ARM = {"panda_finger_joint1": 0.02}


@functools.cache
def model_of(name):
    return random_model(int(name)) if name.isdigit() else urdf_model(name)


def states(dof, count=SAMPLES, seed=5):
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (3, count, dof))


@pytest.mark.parametrize("backend", ["numpy", pytest.param("compiled", marks=pytest.mark.slow(4))])
@pytest.mark.parametrize("name", ["1", "panda", pytest.param("talos_reduced", marks=pytest.mark.slow(6))])
def test_regressor_is_that_of_pinocchio(name, backend):
    model = model_of(name)
    robot, data = Robot(record_of(model)), model.createData()
    q, qd, qdd = states(model.nv)
    Y = robot.torque_regressor(q, qd, qdd, backend=backend)
    for k in range(SAMPLES):
        expected = pin.computeJointTorqueRegressor(model, data, q[k], qd[k], qdd[k])
        assert np.abs(Y[k] - expected).max() <= 16 * U * np.abs(expected).max()


def test_regressor_of_a_free_base_has_rows_of_the_base():
    model = model_of("1")
    flying = on_free_base(model)
    data, robot = flying.createData(), Robot(record_of(model), "free")
    q, qd, qdd = states(model.nv)
    base = base_motion(np.random.default_rng(3), (SAMPLES,))
    Y = robot.torque_regressor(q, qd, qdd, base_motion=base, backend="numpy")
    assert Y.shape == (SAMPLES, 6 + model.nv, 10 * (1 + model.nv))
    for k in range(SAMPLES):
        one = hp.BodyMotion(**{x: getattr(base, x)[k] for x in ("R", "S", "v", "omega", "a", "alpha")})
        expected = pin.computeJointTorqueRegressor(flying, data, *pinocchio_state(one, q[k], qd[k], qdd[k]))
        expected[:6] = np.kron(np.eye(2), one.S) @ expected[:6]
        assert np.abs(Y[k] - expected).max() <= 16 * U * np.abs(expected).max()


def test_inertial_parameters_are_those_of_pinocchio():
    model = model_of("1")
    expected = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)])
    found = Robot(record_of(model), "free").inertial_parameters
    np.testing.assert_allclose(found, expected, rtol=0, atol=16 * U * np.abs(expected).max())
    np.testing.assert_array_equal(Robot(record_of(model)).inertial_parameters, found[10:])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "locked", "count"), [("panda", ARM, 43), ("ur5_robot", None, 36)])
def test_base_parameters_are_as_many_as_the_literature_says(name, locked, count):
    """43 of the Panda: Gaz et al., Dynamic identification of the Franka Emika Panda, 2019; 36 of a UR robot."""
    robot = hp.load_robot(name, locked=locked)
    base = robot.base_parameters()
    assert len(base.names) == len({*base.names}) == count
    q, qd, qdd = states(robot.dof, 20)
    Y, p = robot.torque_regressor(q, qd, qdd), robot.inertial_parameters
    tau = robot.inverse_dynamics(q, qd, qdd).tau
    assert np.abs(Y[..., base.columns] @ base.values - tau).max() < 1024 * U * np.abs(tau).max()
    assert np.linalg.matrix_rank(Y.reshape(-1, p.size)[:, base.columns]) == count
    np.testing.assert_allclose(
        Y @ p, Y[..., base.columns] @ (base.matrix @ p), rtol=0, atol=1024 * U * np.abs(tau).max()
    )


@pytest.mark.slow
def test_matter_on_an_axis_is_counted_with_the_body_that_carries_the_hinge():
    """T9, and a first joint along gravity: nothing but its inertia is felt."""
    post = hp.HingePair(u1=(0, 0, 0.5), u2=(0, 0, 0), n=(0, 0, 1), name="post", body2=hp.Body(2, inertia=(1, 1, 1)))
    arm = hp.HingePair(u1=(0.3, 0, 0), u2=(0, 0, 0), n=(0, 1, 0), name="arm", body2=hp.Body(1, inertia=(1, 1, 1)))
    base = hp.Mechanism([post, arm]).base_parameters()
    names, terms = base.parameter_names, dict(zip(base.names, base.matrix, strict=True))
    wanted = {"post Jzz": 1.0, "arm m": 0.09, "arm Jzz": 1.0}
    assert {names[k]: round(terms["post Jzz"][k], 12) for k in np.flatnonzero(terms["post Jzz"])} == wanted
    assert [*terms] == [
        f"{body} {one}"
        for body, one in [("post", "Jzz")] + [("arm", one) for one in ("hx", "hz", "Jxx", "Jxy", "Jyy", "Jxz", "Jyz")]
    ]


def test_a_robot_with_other_parameters_has_their_torques():
    robot = Robot(record_of(model_of("1")))
    p = robot.inertial_parameters * np.random.default_rng(0).uniform(0.9, 1.1, robot.inertial_parameters.size)
    p[-1] *= 9  # no rigid body has so large a Jzz
    q, qd, qdd = states(robot.dof)
    changed = robot.with_inertial_parameters(p)
    np.testing.assert_allclose(changed.inertial_parameters, p, rtol=0, atol=16 * U * np.abs(p).max())
    Y = robot.torque_regressor(q, qd, qdd, backend="numpy")
    with pytest.warns(hp.DynamicsWarning, match="no rigid body has"):
        tau = changed.inverse_dynamics(q, qd, qdd, backend="numpy").tau
    assert np.abs(tau - Y @ p).max() <= 64 * U * (np.abs(Y) @ np.abs(p)).max()
    p[0] = 0
    with pytest.raises(
        hp.ArgumentError, match=r"^parameters: expected no first moment of 'joint_0', whose mass is 0"
    ):
        robot.with_inertial_parameters(p)
