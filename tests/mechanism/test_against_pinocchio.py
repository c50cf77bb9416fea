"""Whole robots against Pinocchio: motion of frames, Jacobians, forces, energy, on a fixed, moving and free base."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.mechanism.mechanism import tree_of
from support.trees import (
    Robot,
    base_motion,
    on_free_base,
    pinocchio_state,
    random_model,
    record_of,
    urdf_model,
    with_mimics,
)

pytestmark = pytest.mark.slow

SAMPLES = 3
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
ROBOTS = {
    "panda": lambda: urdf_model("panda"),
    "dog": lambda: urdf_model("solo12"),
    "random": lambda: random_model(1),
    "other": lambda: random_model(2, 9),
}
ALLOWED = 4.0
"""Largest difference, in units of the proved bound of what is compared: Pinocchio rounds too."""


@pytest.fixture(scope="module", params=ROBOTS)
def model(request):
    return ROBOTS[request.param]()


def samples(model, seed=5):
    rng = np.random.default_rng(seed)
    return rng, *rng.uniform(-1.5, 1.5, (4, SAMPLES, model.nv))


def close(found, expected, bound):
    """Whether two arrays differ by no more than the bound allows, whose shape is the first axes of theirs."""
    excess = np.abs(np.asarray(found) - expected).reshape(*np.shape(bound), -1).max(axis=-1) / bound
    return excess.max() <= ALLOWED, f"{excess.max():.3g} bounds off"


def check(found, expected, bound):
    ok, text = close(found, expected, bound)
    assert ok, text


def test_frames_move_as_pinocchio_has_them(model):
    _, q, qd, qdd, _ = samples(model)
    robot, data = Robot(record_of(model)), model.createData()
    names = tuple(tree_of(robot).links)
    state = robot.forward_kinematics(q, qd, qdd, frames=names)
    bounds = robot.error_bounds(q, qd, qdd, frames=names)
    for k in range(SAMPLES):
        pin.forwardKinematics(model, data, q[k], qd[k], qdd[k])
        pin.updateFramePlacements(model, data)
        for j, name in enumerate(names):
            frame = model.getFrameId(name, pin.FrameType.BODY)
            v = pin.getFrameVelocity(model, data, frame, WORLD)
            a = pin.getFrameClassicalAcceleration(model, data, frame, WORLD)
            place = data.oMf[frame]
            expected = {
                "R": place.translation, "S": place.rotation, "d": place.translation, "v": v.linear,
                "omega": v.angular, "a": a.linear, "alpha": a.angular,
            }  # fmt: skip
            for output, value in expected.items():
                check(state[name].arrays()[output][k], value, np.maximum(bounds[output][k, j], 1e-15))


def test_jacobians_are_those_of_pinocchio(model):
    _, q, qd, _, _ = samples(model)
    robot, data = Robot(record_of(model)), model.createData()
    for name in tree_of(robot).tips[:2]:
        frame = model.getFrameId(name, pin.FrameType.BODY)
        jacobian, bias = robot.jacobian(q, name), robot.acceleration_bias(q, qd, name)
        bounds = robot.error_bounds(q, qd, frames=name, outputs=("jacobian", "acceleration_bias"))
        for k in range(SAMPLES):
            check(jacobian[k], pin.computeFrameJacobian(model, data, q[k], frame, WORLD), bounds["jacobian"][k])
            pin.forwardKinematics(model, data, q[k], qd[k], 0 * qd[k])
            a = pin.getFrameClassicalAcceleration(model, data, frame, WORLD)
            check(bias[k], np.concatenate([a.linear, a.angular]), np.maximum(bounds["acceleration_bias"][k], 1e-15))


def test_forces_are_those_of_pinocchio(model):
    _, q, qd, qdd, tau = samples(model)
    robot, data = Robot(record_of(model)), model.createData()
    forces = robot.inverse_dynamics(q, qd, qdd)
    outputs = ("tau", "force1", "torque1", "mass_matrix", "bias_forces", "gravity_forces")
    bounds = robot.error_bounds(q, qd, qdd, outputs=outputs)
    matrix, bias, held = robot.mass_matrix(q), robot.bias_forces(q, qd), robot.gravity_forces(q)
    qdd_found = robot.forward_dynamics(q, qd, tau).qdd
    reached = robot.inverse_dynamics(q, qd, qdd_found)
    allowed = robot.error_bounds(q, qd, qdd_found, outputs=("tau",))["tau"]
    for k in range(SAMPLES):
        check(forces.tau[k], pin.rnea(model, data, q[k], qd[k], qdd[k]), bounds["tau"][k])
        on_base = pin.Force.Zero()
        for joint in range(1, model.njoints):
            if model.parents[joint] == 0:
                on_base += data.liMi[joint].act(data.f[joint])
        check(forces.force1[k], on_base.linear, bounds["force1"][k])
        check(forces.torque1[k], on_base.angular, bounds["torque1"][k])
        upper = np.triu(pin.crba(model, data, q[k]))
        check(matrix[k], upper + np.triu(upper, 1).T, bounds["mass_matrix"][k])
        check(bias[k], pin.nonLinearEffects(model, data, q[k], qd[k]), bounds["bias_forces"][k])
        check(held[k], pin.computeGeneralizedGravity(model, data, q[k]), bounds["gravity_forces"][k])
        check(reached.tau[k], tau[k], allowed[k])
        expected = pin.aba(model, data, q[k], qd[k], tau[k])
        np.testing.assert_allclose(qdd_found[k], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("mode", ["fixed", "free"])
def test_joints_transmit_what_pinocchio_says(model, mode):
    """Its data.f: what acts on each joint's body, in the axes of the body."""
    rng, q, qd, qdd, _ = samples(model)
    robot, base = Robot(record_of(model), mode), base_motion(rng, (SAMPLES,))
    flying = on_free_base(model)
    data = flying.createData()
    found = robot.joint_wrenches(q, qd, qdd, base_motion=base)
    outputs = ("tau", "force1", "torque1")
    scale = sum(robot.error_bounds(q, qd, qdd, outputs=outputs, base_motion=base).values())
    assert found.names == tuple(flying.names)[2:]
    for k in range(SAMPLES):
        one = hp.BodyMotion(**{x: getattr(base, x)[k] for x in ("R", "S", "v", "omega", "a", "alpha")})
        x, v, a = pinocchio_state(one, q[k], qd[k], qdd[k])
        pin.rnea(flying, data, x, v, a)
        pin.forwardKinematics(flying, data, x)
        for j, name in enumerate(found.names):
            S, exact = data.oMi[j + 2].rotation, data.f[j + 2]
            check(found[name].force[k], S @ exact.linear, scale[k])
            check(found.torque[k, j], S @ exact.angular, scale[k])


@pytest.mark.parametrize("mode", ["fixed", "free"])
def test_wrenches_of_joints_in_every_form(mode):
    """Against the forces of inverse dynamics; prepared, in batches, loaded, with mimic joints."""
    tree = with_mimics(record_of(random_model(3, 8)), {"joint_3": ("joint_6", -0.5, 0.25)})
    robot, rng = Robot(tree, mode), np.random.default_rng(6)
    q, qd, qdd = rng.uniform(-1, 1, (3, 2, SAMPLES, len(robot.names)))
    link = tree_of(robot).tips[0]
    loads = {link: tuple(rng.normal(size=(2, 3)))}
    found = robot.joint_wrenches(q, qd, qdd, wrenches=loads)
    assert found.force.shape == (2, SAMPLES, 8, 3)
    forces = robot.inverse_dynamics(q, qd, qdd, wrenches=loads)
    poses = robot.forward_kinematics(q, frames=found.names)
    first = [k for k, joint in enumerate(tree.joints) if joint.parent == 0]
    if mode == "fixed":
        near = 1e-13 * np.abs(forces.torque1).max()
        np.testing.assert_allclose(found.force[..., first, :].sum(axis=-2), forces.force1, rtol=0, atol=near)
        about = (found.torque + np.cross(poses.d, found.force))[..., first, :].sum(axis=-2)
        np.testing.assert_allclose(about, forces.torque1, rtol=0, atol=near)
    last = found.names[-1]
    axis = poses[last].S @ tree.joints[-1].n
    along = (axis * (found[last].torque if tree.joints[-1].kind == "hinge" else found[last].force)).sum(axis=-1)
    np.testing.assert_allclose(along, forces.tau[..., -1], rtol=0, atol=1e-13 * np.abs(forces.tau).max())
    prepared = robot.prepare("joint_wrenches")
    plain = robot.joint_wrenches(q, qd, qdd)
    np.testing.assert_allclose(prepared(q, qd, qdd).torque, plain.torque, rtol=0, atol=1e-13)
    one = prepared(q[0, 0], qd[0, 0], qdd[0, 0])
    np.testing.assert_allclose(one[last].force, plain[last].force[0, 0], rtol=0, atol=1e-13)
    assert robot.joint_wrenches(q[0], qd[0], qdd[0]).to_dataframe().shape == (SAMPLES, 48)
    with pytest.raises(hp.ArgumentError, match=r"^joint: expected .* \(nearest: joint_3\)"):
        found["joint3"]


def test_centre_of_mass_energy_and_momentum_are_those_of_pinocchio(model):
    _, q, qd, _, _ = samples(model)
    robot, data = Robot(record_of(model)), model.createData()
    centre = robot.centre_of_mass(q)
    J, change = robot.prepare("centre_of_mass_jacobian").jvp((q,), {"q": qd})
    jacobian, bias = np.asarray(J), (change["centre_of_mass_jacobian"] @ qd[..., None])[..., 0]
    energy, about_origin = robot.energy(q, qd), robot.momentum(q, qd)
    about_centre = robot.momentum(q, qd, about="centre")
    for k in range(SAMPLES):
        pin.centerOfMass(model, data, q[k], qd[k], 0 * qd[k])
        size = 1e-13 * (1 + np.abs(qd[k]).max() ** 2) * model.njoints
        np.testing.assert_allclose(centre[k], data.com[0], atol=size)
        np.testing.assert_allclose(bias[k], data.acom[0], atol=size)
        np.testing.assert_allclose(jacobian[k], pin.jacobianCenterOfMass(model, data, q[k]), atol=size)
        momentum = pin.computeCentroidalMomentum(model, data, q[k], qd[k])
        weight = sum(body.mass for body in model.inertias.tolist()[1:])
        np.testing.assert_allclose(about_centre.linear[k], momentum.linear, atol=size * weight)
        np.testing.assert_allclose(about_centre.angular[k], momentum.angular, atol=size * weight)
        turned = momentum.angular + np.cross(data.com[0], momentum.linear)
        np.testing.assert_allclose(about_origin.angular[k], turned, atol=size * weight)
        kinetic = pin.computeKineticEnergy(model, data, q[k], qd[k])
        potential = pin.computePotentialEnergy(model, data, q[k])
        np.testing.assert_allclose(energy.kinetic[k], kinetic, atol=size * weight)
        np.testing.assert_allclose(energy.potential[k], potential, atol=10 * size * weight)


@pytest.mark.parametrize("mode", ["fixed", "free"])
def test_a_base_that_moves_is_a_free_flyer_of_pinocchio(model, mode):
    rng, q, qd, qdd, _ = samples(model)
    flying = on_free_base(model)
    data, robot, base = flying.createData(), Robot(record_of(model), mode), base_motion(rng, (SAMPLES,))
    names = tree_of(robot).tips
    state = robot.forward_kinematics(q, qd, qdd, frames=names, base_motion=base)
    bounds = robot.error_bounds(q, qd, qdd, frames=names, base_motion=base)
    forces = robot.inverse_dynamics(q, qd, qdd, base_motion=base)
    outputs = ("tau", "force1", "torque1", "mass_matrix", "bias_forces", "gravity_forces")
    allowed = robot.error_bounds(q, qd, qdd, outputs=outputs, base_motion=base)
    for k in range(SAMPLES):
        one = hp.BodyMotion(**{x: getattr(base, x)[k] for x in ("R", "S", "v", "omega", "a", "alpha")})
        x, v, a = pinocchio_state(one, q[k], qd[k], qdd[k])
        pin.forwardKinematics(flying, data, x, v, a)
        pin.updateFramePlacements(flying, data)
        for j, name in enumerate(names):
            frame = flying.getFrameId(name, pin.FrameType.BODY)
            velocity = pin.getFrameVelocity(flying, data, frame, WORLD)
            change = pin.getFrameClassicalAcceleration(flying, data, frame, WORLD)
            expected = {
                "R": data.oMf[frame].translation, "S": data.oMf[frame].rotation, "v": velocity.linear,
                "omega": velocity.angular, "a": change.linear, "alpha": change.angular,
            }  # fmt: skip
            for output, value in expected.items():
                check(state[name].arrays()[output][k], value, 4 * bounds[output][k, j] + 1e-14)
        found = pin.rnea(flying, data, x, v, a)
        check(forces.tau[k], found[6:], 2 * allowed["tau"][k])
        if mode == "free":
            check(forces.force1[k], one.S @ found[:3], 2 * allowed["force1"][k])
            check(forces.torque1[k], one.S @ found[3:6], 2 * allowed["torque1"][k])
            upper = np.triu(pin.crba(flying, data, x))
            local = upper + np.triu(upper, 1).T
            turn = np.eye(flying.nv)
            turn[:3, :3] = turn[3:6, 3:6] = one.S
            check(robot.mass_matrix(q[k], base_motion=one), turn @ local @ turn.T, 2 * allowed["mass_matrix"][k])
            frame = flying.getFrameId(names[0], pin.FrameType.BODY)
            jacobian = pin.computeFrameJacobian(flying, data, x, frame, WORLD) @ turn.T
            np.testing.assert_allclose(
                robot.jacobian(q[k], names[0], base_motion=one), jacobian, atol=1e-13 * flying.nv
            )
            held = turn @ pin.computeGeneralizedGravity(flying, data, x)
            check(robot.gravity_forces(q[k], base_motion=one), held, 2 * allowed["gravity_forces"][k])


def test_a_free_base_moves_as_the_forces_make_it(model):
    rng, q, qd, qdd, _ = samples(model)
    robot, base = Robot(record_of(model), "free"), base_motion(rng, (SAMPLES,))
    links = tree_of(robot).tips[:1]
    wrenches = {link: tuple(rng.normal(size=(2, SAMPLES, 3))) for link in links}
    forces = robot.inverse_dynamics(q, qd, qdd, base_motion=base, wrenches=wrenches)
    moves = robot.forward_dynamics(
        q, qd, forces.tau, force1=forces.force1, torque1=forces.torque1, base_motion=base, wrenches=wrenches
    )
    size = max(1.0, np.abs(qdd).max())
    np.testing.assert_allclose(moves.qdd, qdd, atol=1e-9 * size)
    np.testing.assert_allclose(moves.a1, base.a, atol=1e-9 * size)
    np.testing.assert_allclose(moves.alpha1, base.alpha, atol=1e-9 * size)
    columns = np.concatenate([base.a, base.alpha, qdd], axis=-1)
    bias = robot.bias_forces(q, qd, base_motion=base)
    unloaded = robot.inverse_dynamics(q, qd, qdd, base_motion=base)
    total = np.concatenate([unloaded.force1, unloaded.torque1, unloaded.tau], axis=-1)
    product = (robot.mass_matrix(q, base_motion=base) @ columns[..., None])[..., 0] + bias
    np.testing.assert_allclose(product, total, atol=1e-11 * np.abs(total).max())


def test_wrenches_on_links_are_handed_to_the_joints_by_the_jacobian(model):
    rng, q, qd, qdd, _ = samples(model)
    robot = Robot(record_of(model))
    links = [link for link, frame in tree_of(robot).links.items() if frame.body][-2:]
    wrenches = {link: tuple(rng.normal(size=(2, SAMPLES, 3))) for link in links}
    loaded, alone = robot.inverse_dynamics(q, qd, qdd, wrenches=wrenches), robot.inverse_dynamics(q, qd, qdd)
    handed = sum(
        np.einsum("nij,ni->nj", robot.jacobian(q, link), np.concatenate(pair, axis=-1))
        for link, pair in wrenches.items()
    )
    size = 1 + np.abs(alone.tau).max() + np.abs(handed).max()
    np.testing.assert_allclose(loaded.tau, alone.tau - handed, atol=1e-13 * size)
    np.testing.assert_allclose(
        loaded.force1, alone.force1 - sum(pair[0] for pair in wrenches.values()), atol=1e-12 * size
    )


@pytest.mark.parametrize("mode", ["fixed", "free"])
def test_followers_move_with_their_leader_and_hand_it_their_effort(mode):
    model = random_model(3, 8)
    tree = record_of(model)
    rules = {"joint_3": ("joint_6", -0.5, 0.25), "joint_4": ("joint_2", 2.0, -0.1)}
    robot, alone = Robot(with_mimics(tree, rules), mode), Robot(tree, mode)
    names = [joint.name for joint in tree.joints]
    own = [name for name in names if name not in rules]
    rng = np.random.default_rng(8)
    q, qd, qdd = rng.uniform(-1, 1, (3, SAMPLES, len(own)))
    P, shift = np.zeros((len(names), len(own))), np.zeros(len(names))
    for k, name in enumerate(names):
        leader, ratio, offset = rules.get(name, (name, 1.0, 0.0))
        P[k, own.index(leader)], shift[k] = ratio, offset
    every = q @ P.T + shift, qd @ P.T, qdd @ P.T
    state, expected = robot.forward_kinematics(q, qd, qdd), alone.forward_kinematics(*every)
    np.testing.assert_allclose(state.a, expected.a, atol=1e-12)
    np.testing.assert_allclose(
        robot.jacobian(q, "link_7")[..., -len(own) :],
        alone.jacobian(every[0], "link_7")[..., -len(names) :] @ P,
        atol=1e-13,
    )
    forces, each = robot.inverse_dynamics(q, qd, qdd), alone.inverse_dynamics(*every)
    np.testing.assert_allclose(forces.tau, each.tau @ P, atol=1e-11)
    whole = np.eye(len(names) + 6 * (mode == "free"))[:, : 6 * (mode == "free")]
    lower = np.vstack([np.zeros((whole.shape[1], len(own))), P])
    columns = np.hstack([whole, lower])
    matrix = columns.T @ alone.mass_matrix(every[0]) @ columns
    np.testing.assert_allclose(robot.mass_matrix(q), matrix, atol=1e-12)
    loads = {} if mode == "fixed" else {"force1": forces.force1, "torque1": forces.torque1}
    found = robot.forward_dynamics(q, qd, forces.tau, **loads)
    np.testing.assert_allclose(found.qdd, qdd, atol=1e-9)
