"""Derivatives of what a robot computes: by definition, by Pinocchio, and alike however they are asked for."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.errors import ArgumentError
from hingepair.mechanism.mechanism import tree_of
from support.near import assert_near
from support.trees import (
    Robot,
    base_motion,
    on_free_base,
    pinocchio_state,
    random_model,
    record_of,
    weightless,
    with_mimics,
)

EPS = 2.0**-53


@pytest.fixture(scope="module")
def ur5():
    return hp.load_robot("ur5_robot")


@pytest.fixture(scope="module")
def states():
    return np.random.default_rng(3).uniform(-2, 2, (3, 4, 6))


@pytest.fixture(scope="module")
def torques(ur5):
    return ur5.prepare("inverse_dynamics", outputs=("tau",))


@pytest.fixture(scope="module")
def moving(ur5):
    """Motion of a frame on a base that turns: attitudes among arguments and results."""
    return ur5.prepare(("q", "qd", "R1", "S1", "omega1"), frames=("tool0", "wrist_1_link"), outputs=("R", "S", "v"))


@pytest.fixture(scope="module")
def moving_state(states):
    turn = hp.rotation_exp(np.array([0.3, -1.1, 0.7]))
    return states[0], states[1], np.array([0.1, 0.2, 0.3]), turn, np.array([0.4, -0.2, 0.9])


@pytest.mark.slow
def test_a_pose_changes_as_the_geometric_jacobian_says(ur5, states):
    q, qd, _ = states
    found = ur5.prepare("velocity", frames="tool0").jacobian((q, qd))
    J = ur5.jacobian(q, "tool0")
    np.testing.assert_allclose(found["R"]["q"], J[:, :3], atol=64 * EPS)
    np.testing.assert_allclose(found["S"]["q"], J[:, 3:], atol=64 * EPS)
    np.testing.assert_allclose(found["v"]["qd"], J[:, :3], atol=64 * EPS)
    assert not found["R"]["qd"].any()


@pytest.mark.slow
def test_a_turn_of_the_base_turns_all_that_it_carries(moving, moving_state):
    found = moving.jacobian(moving_state, wrt=("S1", "R1"))
    R, eye = moving(*moving_state).R - moving_state[2], np.eye(3)
    np.testing.assert_allclose(found["R"]["S1"], np.cross(eye, R[..., None, :]).swapaxes(-1, -2), atol=64 * EPS)
    np.testing.assert_allclose(found["S"]["S1"], np.broadcast_to(eye, (4, 2, 3, 3)), atol=64 * EPS)
    np.testing.assert_array_equal(found["R"]["R1"], np.broadcast_to(eye, (4, 2, 3, 3)))


@pytest.mark.slow
def test_products_with_the_jacobian_are_its_products(moving, moving_state):
    rng, sizes = np.random.default_rng(5), {"q": 6, "qd": 6, "R1": 3, "S1": 3, "omega1": 3}
    J, value = moving.jacobian(moving_state), moving(*moving_state)
    tangents = {name: rng.normal(size=(4, size)) for name, size in sizes.items()}
    cotangents = {name: rng.normal(size=(4, 2, 3)) for name in ("R", "S", "v")}
    same, rates = moving.jvp(moving_state, tangents)
    also, gradients = moving.vjp(moving_state, cotangents)
    for name, rate in rates.items():
        np.testing.assert_array_equal(same.arrays()[name], value.arrays()[name])
        np.testing.assert_array_equal(also.arrays()[name], value.arrays()[name])
        expected = sum(np.einsum("sfij,sj->sfi", J[name][one], tangents[one]) for one in sizes)
        np.testing.assert_allclose(rate, expected, atol=1000 * EPS)
    for name, gradient in gradients.items():
        expected = sum(np.einsum("sfij,sfi->sj", J[one][name], cotangents[one]) for one in cotangents)
        np.testing.assert_allclose(gradient, expected, atol=1000 * EPS)
    (only,) = moving.vjp(moving_state, {"v": cotangents["v"]})[1]["R1"][:1]
    assert not only.any()


@pytest.mark.slow
def test_numbers_that_fold_are_differentiated_all_the_same(ur5, torques, states):
    q, qd, qdd = states.copy()
    known = (0.0, 1.0, -1.0, 0.0, 0.0, 0.5)
    q[:], qd[:, 3] = known, qd[:, 1]
    columns = [qd[:, k] for k in (0, 1, 2, 1, 4, 5)]
    by_joint, shared = dict(zip(ur5.names, known, strict=True)), dict(zip(ur5.names, columns, strict=True))
    expected = torques.jacobian((q, qd, qdd))["tau"]
    for backend in ("numpy", "auto"):
        call = ur5.prepare("inverse_dynamics", outputs=("tau",), backend=backend)
        for given in ((q[0], qd, qdd), (by_joint, shared, qdd)):
            found = call.jacobian(given)["tau"]
            for name, array in expected.items():
                np.testing.assert_allclose(found[name], array, atol=256 * EPS * abs(array).max())


@pytest.mark.slow
@pytest.mark.parametrize("base", ["fixed", "free"])
def test_jacobians_in_both_axes_momentum_matrices_and_their_rates_are_those_of_pinocchio(base):
    model = random_model(4)
    robot, frames = Robot(record_of(model), base), ("link_3", "link_6")
    rng = np.random.default_rng(2)
    q, qd = rng.uniform(-2, 2, (2, robot.dof))
    motion = base_motion(rng) if base == "free" else hp.BodyMotion(R=np.zeros(3), S=np.eye(3))
    model = on_free_base(model) if base == "free" else model
    q_pin, v_pin, _ = pinocchio_state(motion, q, qd, qd) if base == "free" else (q, qd, qd)
    to_local, rate = np.eye(model.nv), np.zeros((model.nv, model.nv))  # of velocities, whose base is local there
    if base == "free":
        to_local[:3, :3] = to_local[3:6, 3:6] = motion.S.T
        rate[:3, :3] = rate[3:6, 3:6] = -motion.S.T @ hp.skew(motion.omega)
    data = model.createData()
    pin.computeJointJacobiansTimeVariation(model, data, q_pin, v_pin)
    pin.updateFramePlacements(model, data)
    for axes, reference in (("world", pin.LOCAL_WORLD_ALIGNED), ("frame", pin.LOCAL)):
        J = robot.jacobian(q, frames=frames, axes=axes, base_motion=motion)
        change = robot.jacobian_rate(q, qd, frames=frames, axes=axes, base_motion=motion)
        for k, frame in enumerate(frames):
            number = model.getFrameId(frame)
            theirs = pin.getFrameJacobian(model, data, number, reference)
            rates = pin.getFrameJacobianTimeVariation(model, data, number, reference) @ to_local + theirs @ rate
            np.testing.assert_allclose(J[k], theirs @ to_local, rtol=0, atol=128 * EPS * abs(theirs).max())
            np.testing.assert_allclose(change[k], rates, rtol=0, atol=256 * EPS * abs(rates).max())
            one = robot.jacobian(q, frame, axes=axes, base_motion=motion)
            np.testing.assert_allclose(one, J[k], rtol=0, atol=16 * EPS * abs(theirs).max())
    data = model.createData()
    pin.dccrba(model, data, q_pin, v_pin)
    A = robot.centroidal_momentum_matrix(q, base_motion=motion)
    change = robot.centroidal_momentum_matrix_rate(q, qd, base_motion=motion)
    np.testing.assert_allclose(A, data.Ag @ to_local, rtol=0, atol=128 * EPS * abs(A).max())
    theirs = data.dAg @ to_local + data.Ag @ rate
    np.testing.assert_allclose(change, theirs, rtol=0, atol=256 * EPS * abs(theirs).max())
    out = np.empty_like(change)
    assert robot.centroidal_momentum_matrix_rate(q, qd, base_motion=motion, out=out) is out
    np.testing.assert_array_equal(out, change)


@pytest.mark.slow
@pytest.mark.parametrize("base", ["fixed", "free"])
def test_torques_are_linear_in_masses_and_follow_lengths_as_pinocchio_says(base):
    model = random_model(4, 5)
    robot, free = Robot(record_of(model), base), on_free_base(model)
    rng = np.random.default_rng(2)
    q, qd, qdd = rng.uniform(-1, 1, (3, robot.dof))
    names = ("masses", "first_moments", "inertias", "lengths")
    found = robot.prepare("inverse_dynamics", outputs=("tau",)).jacobian((q, qd, qdd), names)["tau"]
    still = hp.BodyMotion(S=np.eye(3), **dict.fromkeys(("R", "v", "omega", "a", "alpha"), np.zeros(3)))
    resting = pinocchio_state(still, q, qd, qdd)
    state, model, first = (resting, free, 6) if base == "free" else ((q, qd, qdd), model, 0)
    regressor = pin.computeJointTorqueRegressor(model, model.createData(), *state)[first:]
    per_body = [found["masses"][..., None], found["first_moments"], found["inertias"]]
    ours = np.concatenate(per_body, axis=-1).reshape(robot.dof, -1)
    np.testing.assert_allclose(ours, regressor, rtol=0, atol=64 * EPS * abs(regressor).max())
    for joint in range(robot.dof):
        for k in range(3):
            tau = []
            for step in (1e-6, -1e-6):
                moved = model.copy()
                place = moved.jointPlacements[joint + 1 + (base == "free")]
                place.translation = place.translation + step * np.eye(3)[k]
                tau.append(pin.rnea(moved, moved.createData(), *state)[first:])
            slopes = (tau[0] - tau[1]) / 2e-6
            np.testing.assert_allclose(
                found["lengths"][:, joint, k], slopes, rtol=0, atol=64 * EPS / 1e-6 * abs(tau[0]).max()
            )


@pytest.mark.slow(8)
def test_forces_are_linear_in_masses_and_accelerations_take_back_what_constants_add():
    """M times the change of the accelerations, and that of the forces at these accelerations, make 0."""
    robot, rng = Robot(record_of(random_model(4, 3)), "free"), np.random.default_rng(5)
    q, qd, tau = rng.uniform(-1, 1, (3, robot.dof))
    names = ("masses", "first_moments", "inertias", "lengths")
    forward = robot.prepare("forward_dynamics")
    inverse = robot.prepare(("q", "qd", "qdd", "a1", "alpha1"), outputs=("force1", "torque1", "tau"))
    found, moved = forward(q, qd, tau), forward.jacobian((q, qd, tau), names)
    given = (q, qd, found.qdd, found.a1, found.alpha1)
    forces, added, M = inverse(*given), inverse.jacobian(given, names), robot.mass_matrix(q)
    parts = dict(zip(names, np.split(robot.inertial_parameters.reshape(-1, 10), (1, 4), axis=1), strict=False))
    for output in forces.outputs:
        size = np.abs(M).max() * np.abs(np.concatenate(given)).max()
        whole = sum(added[output][name].reshape(-1, part.size) @ part.ravel() for name, part in parts.items())
        np.testing.assert_allclose(whole, forces[output], rtol=0, atol=64 * EPS * size)
    for name in names:
        change, lacking = (
            np.concatenate([by[output][name].reshape(len(by[output][name]), -1) for output in outputs])
            for by, outputs in ((moved, ("a1", "alpha1", "qdd")), (added, forces.outputs))
        )
        near = 64 * EPS * np.linalg.cond(M) * np.abs(lacking).max()
        np.testing.assert_allclose(M @ change, -lacking, rtol=0, atol=near)


def torque_derivatives_by_pinocchio(model, base, force1, torque1, q, qd, qdd):
    """Derivatives of (force1, torque1, tau) by rotations of the base and q, and by omega1 and qd; world axes.

    Pinocchio's are by displacements and velocities in the axes of the base, at a constant spatial acceleration.
    """
    data, n = model.createData(), model.nv
    pin.computeRNEADerivatives(model, data, *pinocchio_state(base, q, qd, qdd))
    S, to_world = base.S, np.eye(n)
    to_world[:3, :3] = to_world[3:6, 3:6] = S
    M = np.triu(data.M) + np.triu(data.M, 1).T
    by_q, by_qd = to_world @ data.dtau_dq @ to_world.T, to_world @ data.dtau_dv @ to_world.T
    M = to_world @ M @ to_world.T
    for k, e in enumerate(np.eye(3)):
        turned = [np.cross(x, e) for x in (base.v, base.omega, base.a - np.cross(base.omega, base.v), base.alpha)]
        by_q[:, 3 + k] += by_qd[:, :3] @ turned[0] + by_qd[:, 3:6] @ turned[1]
        by_q[:, 3 + k] += M[:, :3] @ turned[2] + M[:, 3:6] @ turned[3]
        by_q[:3, 3 + k] += np.cross(e, force1)
        by_q[3:6, 3 + k] += np.cross(e, torque1)
    for k, e in enumerate(np.eye(3)):
        by_qd[:, k] -= M[:, :3] @ np.cross(base.omega, e)
        by_qd[:, 3 + k] -= M[:, :3] @ np.cross(e, base.v)
    return by_q, by_qd, M


@pytest.mark.slow
def test_derivatives_on_a_free_base_are_those_of_pinocchio_in_world_axes():
    model = random_model(3, 4)
    robot, free = Robot(record_of(model), "free"), on_free_base(model)
    rng = np.random.default_rng(3)
    base = base_motion(rng)
    q, qd, qdd = rng.uniform(-1, 1, (3, robot.dof))
    given = {"base_motion": base}
    f = robot.inverse_dynamics(q, qd, qdd, **given)
    expected = torque_derivatives_by_pinocchio(free, base, f.force1, f.torque1, q, qd, qdd)
    found = robot.inverse_dynamics_derivatives(q, qd, qdd, **given)
    for name, theirs in zip(("tau_q", "tau_qd", "tau_qdd"), expected, strict=True):
        np.testing.assert_allclose(found[name], theirs, rtol=0, atol=512 * EPS * max(map(np.max, map(abs, expected))))
    # what a change of q and qd adds to the torques at the given accelerations, the accelerations take away
    loads = {"force1": f.force1, "torque1": f.torque1}
    a = robot.forward_dynamics_derivatives(q, qd, f.tau, **loads, **given)
    M, left = found.tau_qdd, 256 * EPS * np.linalg.cond(found.tau_qdd)
    for ours, torques in ((a.qdd_q, found.tau_q), (a.qdd_qd, found.tau_qd)):
        np.testing.assert_allclose(M @ ours, -torques, rtol=0, atol=left * abs(M).max() * abs(ours).max())
    np.testing.assert_allclose(M @ a.qdd_tau, np.eye(len(M)), rtol=0, atol=left)


@pytest.mark.slow
def test_wrenches_the_motion_of_the_base_and_mimic_joints_count():
    model = random_model(1)
    tree = record_of(model)
    followed = with_mimics(tree, {tree.joints[4].name: (tree.joints[2].name, -0.7, 0.1)})
    rng = np.random.default_rng(6)
    for robot in (Robot(tree), Robot(followed)):
        q, qd, qdd = rng.uniform(-1, 1, (3, robot.dof))
        base = base_motion(rng)
        further = {"base_motion": base, "gravity": (1.0, 2.0, -3.0)}
        further["wrenches"] = {[*tree_of(robot).links][-1]: (rng.normal(size=3), rng.normal(size=3))}
        found = robot.inverse_dynamics_derivatives(q, qd, qdd, **further)
        for name, place in (("tau_q", 0), ("tau_qd", 1), ("tau_qdd", 2)):
            near = np.array([q, qd, qdd])[:, None, None].repeat(2, 1).repeat(robot.dof, 2)
            step = 1e-6 * np.eye(robot.dof)
            near[place, 0] += step
            near[place, 1] -= step
            tau = robot.inverse_dynamics(*near, **further).tau
            slopes = (tau[0] - tau[1]).T / 2e-6
            np.testing.assert_allclose(found[name], slopes, rtol=0, atol=512 * EPS / 1e-6 * abs(slopes).max())


@pytest.mark.slow
def test_a_second_call_heeds_all_that_differs_from_the_first(ur5, torques, states):
    q, qd, qdd = states
    first = ur5.inverse_dynamics_derivatives(q, qd, qdd)
    turned = hp.BodyMotion(R=np.zeros(3), S=hp.rotation_exp(np.array([0.3, -1.1, 0.7])))
    for changed in ({"gravity": (1.0, 2.0, 3.0)}, {"base_motion": turned}):
        found = ur5.inverse_dynamics_derivatives(q, qd, qdd, **changed)
        same = ur5.inverse_dynamics_derivatives(q, qd, qdd, backend="numpy", **changed)
        assert_near(found.tau_q, same.tau_q, 64)
        assert abs(found.tau_q - first.tau_q).max() > 1
    again = ur5.inverse_dynamics_derivatives(2 * q, qd, qdd, outputs=("tau_qd",))
    assert_near(again.tau_qd, torques.jacobian((2 * q, qd, qdd))["tau"]["qd"], 64)
    by_list, by_one = torques.jacobian((q, qd, qdd), ["qd", "q"]), torques.jacobian((q, qd, qdd), "q")
    assert_near(by_list["tau"]["q"], by_one["tau"]["q"], 64)
    assert list(by_one["tau"]) == ["q"]


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_derivatives_are_nan_where_nothing_resists(backend):
    body = hp.Body(mass=1, centre_of_mass=(0.1, 0, 0.1), inertia=(0.1, 0.1, 0.1))
    given = {"u1": (0, 0, 0.3), "u2": (0, 0, 0), "n": (0, 1, 0)}
    arm = weightless([hp.HingePair(**given, name=f"joint_{k}", body2=body if k < 2 else None) for k in range(3)])
    q = np.random.default_rng(1).normal(size=(4, 3))
    with pytest.warns(hp.DynamicsWarning) as caught:
        d = arm.forward_dynamics_derivatives(q, q, q, backend=backend)
    assert "no mass resists joint 'joint_2' at 4 of 4 samples" in str(caught[-1].message)
    for name in d.outputs:
        assert np.isnan(d[name]).all()
    gradient = arm.prepare("forward_dynamics", backend=backend).vjp((q, q, q), {"qdd": np.ones(3)})[1]
    assert np.isnan(gradient["q"]).all()


def test_prepared_calls_give_rates_of_jacobians_on_a_base_that_turns(ur5, states):
    """Of the base, S1 and omega1 are arguments; S1 is checked as in every prepared call."""
    q, qd, _ = states
    S1, omega1 = hp.rotation_exp(np.array([0.3, -1.1, 0.7])), np.array([0.2, 0.1, -0.4])
    step = ur5.prepare(("q", "qd", "S1", "omega1"), outputs="jacobian_rate", frames="tool0")
    base = hp.BodyMotion(R=np.zeros(3), S=S1, v=np.zeros(3), omega=omega1)
    expected = ur5.jacobian_rate(q, qd, "tool0", base_motion=base)
    np.testing.assert_allclose(step(q, qd, S1, omega1), expected, rtol=0, atol=64 * EPS * np.abs(expected).max())
    with pytest.raises(hp.errors.RotationError, match="S1"):
        step(q, qd, 2 * S1, omega1)


@pytest.mark.slow(3)
@pytest.mark.parametrize("base", ["fixed", "free"])
def test_one_prepared_call_computes_what_methods_do(base, states):
    robot, (q, qd, qdd) = hp.load_robot("ur5_robot", base=base), states
    wrench = np.random.default_rng(5).normal(size=(2, 4, 3))
    wrenches, frame = {"tool0": (wrench[0], wrench[1])}, "forearm_link"
    slopes = robot.inverse_dynamics_derivatives(q, qd, qdd, wrenches=wrenches)
    expected = {
        "jacobian": robot.jacobian(q, frame),
        "jacobian_rate": robot.jacobian_rate(q, qd, frame),
        "tau": robot.inverse_dynamics(q, qd, qdd, wrenches=wrenches).tau,
        "tau_q": slopes.tau_q,
        "tau_qd": slopes.tau_qd,
        "mass_matrix": slopes.tau_qdd,
        "torque_regressor": robot.torque_regressor(q, qd, qdd),
        "centroidal_momentum_matrix_rate": robot.centroidal_momentum_matrix_rate(q, qd),
    }
    f = robot.prepare(("q", "qd", "qdd"), outputs=expected, frames=frame, wrenches="tool0")
    found = f(q, qd, qdd, *wrench)
    for name, one in expected.items():
        np.testing.assert_allclose(found[name], one, rtol=0, atol=64 * EPS * np.abs(one).max())


@pytest.mark.parametrize("task", ["inverse_dynamics", "forward_dynamics"])
def test_prepared_calls_take_wrenches(ur5, states, task):
    force, torque, other = np.random.default_rng(5).normal(size=(3, 4, 3))
    step = ur5.prepare(task, wrenches=("tool0", "forearm_link"))
    assert step.given[3:] == ("force_0", "torque_0", "force_1", "torque_1")
    wrenches = {"tool0": (force, torque), "forearm_link": (other, 0)}
    found, expected = step(*states, force, torque, other, 0), getattr(ur5, task)(*states, wrenches=wrenches)
    for one in expected.outputs:
        np.testing.assert_array_max_ulp(found[one], expected[one], 0)
    with pytest.raises(ArgumentError, match="wrenches"):
        ur5.prepare(task, wrenches="no_link")
