"""The contract beside the table: each further public call once, against SciPy, Pinocchio, MuJoCo or 60 digits."""

from __future__ import annotations

import functools
import json
import math
from pathlib import Path

import mpmath
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import approx_fprime
from scipy.spatial.transform import Rotation

import hingepair as hp
from hingepair.bench.truth import DIGITS, from_euler
from hingepair.formats.robots import robot_urdf
from support.recorded import N1, recording, truth
from support.states import generator, rotations

U = 2.0**-53
MODELS = Path(__file__).parents[1] / "models"
BODY = hp.Body(1.5, (-0.15, 0.1, 0.2), (0.2, 0.3, 0.25))
PAIR = hp.HingePair((0.5, 0.2, 0.1), (-0.25, 0.1, 0.3), (1, 0, 0), limits=(-40, 40), body1=BODY, body2=BODY)
SEQUENCES = [
    "".join(letters)
    for cased in ("XYZ", "xyz")
    for letters in [(a, b, c) for a in cased for b in cased for c in cased if b not in (a, c)]
]


def near(found, expected, allowed=64 * U):
    expected = np.asarray(expected)
    assert np.shape(found) == expected.shape
    np.testing.assert_allclose(found, expected, rtol=0, atol=allowed * max(1.0, np.abs(expected).max(initial=0)))


# ---- rotations


def test_rotations_are_those_of_scipy():
    rng = generator(43)
    vector, S = rng.normal(size=(5, 3)), rotations(rng, 5)
    psi = rng.normal(size=5)
    near(hp.rotation_exp(vector), Rotation.from_rotvec(vector).as_matrix())
    near(hp.rotation_log(S), Rotation.from_matrix(S).as_rotvec())
    near(hp.rodrigues((0, 0, 3), psi), Rotation.from_rotvec(psi[:, None] * (0, 0, 1)).as_matrix())
    near(hp.project_to_rotation(S + 1e-6), Rotation.from_matrix(S + 1e-6).as_matrix(), 1e-12)
    near((hp.skew(vector) @ vector[::-1, :, None])[..., 0], np.cross(vector, vector[::-1]))
    near(hp.unskew(hp.skew(vector)), vector)
    quat = rng.normal(size=(5, 4))
    turned = Rotation.from_quat(quat).as_matrix()
    near(hp.BodyMotion.from_quaternion_xyzw(R=vector, quat_xyzw=quat).S, turned)
    near(hp.BodyMotion.from_quaternion_wxyz(R=vector, quat_wxyz=quat[:, [3, 0, 1, 2]]).S, turned)
    near(hp.BodyMotion.from_rotvec(R=vector, rotvec=vector).S, Rotation.from_rotvec(vector).as_matrix())


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_euler_angles_are_those_of_scipy(sequence):
    phi = generator(44).uniform(0.3, 1.2, (5, 3))
    S = Rotation.from_euler(sequence, phi).as_matrix()
    near(hp.euler_to_matrix(phi, sequence), S)
    near(hp.matrix_to_euler(S, sequence), Rotation.from_matrix(S).as_euler(sequence))
    J = hp.euler_rate_matrix(phi, sequence)
    h = 1e-6
    for k, step in enumerate(h * np.eye(3)):
        high, low = (Rotation.from_euler(sequence, phi + sign * step) for sign in (1, -1))
        near(J[..., k], (high * low.inv()).as_rotvec() / (2 * h), 1e-9)
    rates = generator(45).normal(size=(5, 3))
    near(hp.euler_rates(phi, (J @ rates[..., None])[..., 0], sequence), rates, 1e-14)


def test_angular_velocity_of_rotations_and_of_samples():
    t = np.linspace(0, 1, 101)
    omega = np.array([0.3, -1.0, 0.5])
    S = Rotation.from_rotvec(t[:, None] * omega).as_matrix()
    near(hp.angular_velocity(S, hp.skew(omega) @ S), np.tile(omega, (101, 1)))
    found, alpha = hp.angular_velocity_from_samples(t, S, with_alpha=True)
    near(found, np.tile(omega, (101, 1)), 1e-11)
    near(alpha, np.zeros((101, 3)), 1e-8)


# ---- a pair


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("sequence", ["XYZ", "ZYX", "zyx", "ZXZ"])
def test_coordinates_may_be_columns_in_any_sequence(sequence, backend):
    rng = generator(46)
    q, qd = rng.normal(size=(2, 9, 7))
    q[:, 2], qd[:, 2:4] = 0.5, 0
    columns = (q[:, 0], q[:, 1], 0.5, *q[:, 3:].T), (*qd[:, :2].T, 0.0, 0, *qd[:, 4:].T)
    exact = from_euler((PAIR.u1, PAIR.u2, PAIR.n, None), q[:2], qd[:2], None, sequence)
    outputs = ("R2", "S1", "v2", "omega2")
    ready = PAIR.prepare("velocity", outputs=outputs, sequence=sequence, backend=backend)
    out = {name: np.empty((9, 3)) for name in ("R2", "v2", "omega2")} | {"S1": np.empty((9, 3, 3))}
    ready(q, qd, out=out)
    options = {"outputs": outputs, "sequence": sequence, "backend": backend}
    for state in (out, ready(q, qd), *(PAIR.forward_kinematics(*rows, **options) for rows in ((q, qd), columns))):
        for name in outputs:
            assert exact.errors(name, state[name][:2]).max() <= 10, name


def test_default_outputs_follow_the_level():
    q = np.zeros(7)
    assert PAIR.forward_kinematics(q).outputs == ("R2", "S2", "d")
    assert PAIR.forward_kinematics(q, q).outputs == ("R2", "S2", "d", "v2", "omega2")
    assert PAIR.forward_kinematics(q).v2 is None
    assert PAIR.forward_kinematics(q, q, q).outputs == ("R2", "S2", "d", "v2", "omega2", "a2", "alpha2")


def test_bounds_hold_errors():
    rows = generator(47).normal(size=(3, 6, 7))
    exact = from_euler((PAIR.u1, PAIR.u2, PAIR.n, None), *rows)
    bounds, state = PAIR.error_bounds(*rows), PAIR.forward_kinematics(*rows)
    assert bounds.keys() == {*state.outputs}
    with mpmath.workdps(DIGITS):
        for name, bound in bounds.items():
            gap = np.abs(state[name].astype(object) - exact.values[name]).reshape(6, -1).max(axis=-1)
            assert (gap <= bound).all()
            assert (bound <= 1e-13).all()


def test_residuals_say_whether_the_hinge_holds():
    rows = generator(48).normal(size=(3, 20, 7))
    state = PAIR.forward_kinematics(*rows, outputs=[f"{letter}{k}" for k in "12" for letter in LETTERS])
    bodies = [hp.BodyMotion(**{letter: state[f"{letter}{k}"] for letter in LETTERS}) for k in "12"]
    kept = PAIR.residuals(*bodies)
    assert kept.ok
    assert "E1" in str(kept)
    shifted = hp.BodyMotion(R=bodies[1].R + np.array([1e-6, 0, 0]), S=bodies[1].S)
    assert not PAIR.residuals(bodies[0], shifted).ok
    assert PAIR.residuals(bodies[0], shifted, tolerances={"gap": 1e-5}).ok


LETTERS = ("R", "S", "v", "omega", "a", "alpha")


def test_pinocchio_agrees_with_a_pair_and_with_a_robot():
    rows = generator(49).normal(size=(3, 20, 7))
    robot = hp.load_robot("ur5")
    for one, own in ((PAIR, rows), (robot, rows[..., :6])):
        report = hp.cross_validate(one, *own)
        assert report.ok
        assert json.loads(report.to_json())
        assert "Pinocchio" in str(report)
    twin = hp.to_pinocchio(PAIR)
    body1 = hp.BodyMotion(R=(1, 2, 3), S=np.eye(3), v=(1, 0, 0), omega=(0, 1, 0), a=(0, 0, 1), alpha=(1, 1, 1))
    state = PAIR.forward_kinematics_from_body1(body1, 0.4, 0.5)
    pin.forwardKinematics(twin.model, twin.data, twin.configuration(body1, 0.4), twin.velocity(body1, 0.4, 0.5))
    pin.updateFramePlacements(twin.model, twin.data)
    near(twin.data.oMf[twin.body2_frame].translation, state.R2)
    near(pin.getFrameVelocity(twin.model, twin.data, twin.body2_frame, pin.LOCAL_WORLD_ALIGNED).linear, state.v2)


def test_models_are_those_that_pinocchio_and_mujoco_read(tmp_path):
    import mujoco

    q = np.array([0.1, 0.2, 0.3, 0, 0, 0, 0.7])
    R2 = PAIR.forward_kinematics(q).R2
    urdf = tmp_path / "pair.urdf"
    urdf.write_text(hp.to_urdf(PAIR))
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([0.1, 0.2, 0.3, 0, 0, 0, 1, 0.7]))
    assert min(np.abs(place.translation - R2).max() for place in data.oMf) <= 1e-15
    spec = mujoco.MjModel.from_xml_string(hp.to_mjcf(PAIR))
    state = mujoco.MjData(spec)
    state.qpos[:] = [0.1, 0.2, 0.3, 1, 0, 0, 0, 0.7]
    mujoco.mj_forward(spec, state)
    near(state.qpos.shape, (8,))
    back = hp.from_urdf(urdf, joint=model.names[2], body2_frame=model.frames[-1].name)
    near(back.u1, PAIR.u1)
    near(back.u2, PAIR.u2)


def test_a_hinge_of_a_robot_is_a_pair():
    pair = hp.load_robot_hinge("talos_reduced", "arm_left_4_joint")
    model = pin.buildModelFromUrdf(str(robot_urdf("talos_reduced")))
    place = model.jointPlacements[model.getJointId("arm_left_4_joint")]
    near(pair.u1, place.translation)
    near(pair.home, place.rotation)


# ---- time


def test_integration_is_the_reference_example():
    """Body 1 turns by phi = (3 t, t, 5 t): omega1 in closed form, as a function and as samples."""

    def omega1(t):
        t = np.asarray(t)
        return np.stack([
            3 + 5 * np.sin(t),
            np.cos(3 * t) - 2.5 * np.sin(2 * t) - 2.5 * np.sin(4 * t),
            np.sin(3 * t) + 2.5 * np.cos(4 * t) + 2.5 * np.cos(2 * t),
        ], axis=-1)  # fmt: skip

    t = np.linspace(0, 2, 401)
    exact = Rotation.from_euler("XYZ", t[:, None] * (3, 1, 5)).as_matrix()
    for given, allowed in ((omega1, 1e-12), (omega1(t), 1e-9)):
        traj = hp.integrate(PAIR, t, given, 10.0, R1=lambda t: np.stack([3 * t] * 3, axis=-1), psi_0=0.0)
        near(traj.S1, exact, allowed)
        near(traj.psi, 10 * t, 1e-14)
        state = PAIR.forward_kinematics(tuple(np.array([3, 3, 3, 3, 1, 5, 10])[:, None] * t))
        near(traj.R2, state.R2, allowed)
    assert hp.integrate(PAIR, t, omega1, 10.0, tol=1e-6).error_estimate <= 1e-6


def pendulum():
    return hp.HingePair((0, 0, 0), (0, 0, 0), (0, 1, 0), body2=hp.Body(2.0, (0.5, 0, 0), (0.1, 0.2, 0.3)))


def test_simulated_motion_is_that_of_scipy():
    """A pendulum, as a pair and as a robot; and where it passes an angle."""
    moment = 0.2 + 2 * 0.25
    t = np.linspace(0, 2, 21)

    def rates(_, y):
        return y[1], (2 * 9.81 * 0.5 * np.cos(y[0]) - 0.3 * y[1]) / moment

    expected = solve_ivp(rates, (0, 2), (0.1, 0.0), t_eval=t, rtol=1e-12, atol=1e-12).y
    rest = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
    load = hp.HingeLoad(damping=0.3)
    assert load(0.0, 0.1, 2.0) == pytest.approx(-0.6)
    motion = hp.simulate(pendulum(), t, rest, 0.1, 0.0, hinge_torque=load, base="fixed")
    near(motion.psi, expected[0], 1e-8)
    assert motion.psi_error_estimate <= 1e-8
    assert motion.steps > 0
    robot = hp.Mechanism([pendulum()])
    found = hp.simulate(robot, t, [0.1], [0.0], loads={robot.names[0]: load})
    near(found.q[:, 0], expected[0], 1e-8)
    passed = hp.simulate(pendulum(), t, rest, 0.1, 0.0, base="fixed", until=lambda _t, now: now.psi - 1.0, tol=1e-9)
    assert passed.ended_by_event
    assert passed.psi[-1] == pytest.approx(1.0, abs=1e-7)


def test_linearized_motion_is_that_of_differences():
    rest = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
    found = hp.linearize(pendulum(), rest, 0.4, base="fixed")
    near(found.A, [[0, 1], [-2 * 9.81 * 0.5 * math.sin(0.4) / 0.7, 0]], 1e-10)


def test_a_robot_moves_in_steps_as_by_aba():
    robot, model = hp.load_robot("ur5"), pin.buildModelFromUrdf(str(robot_urdf("ur5")))
    data, rng = model.createData(), generator(50)
    q, v, tau = rng.normal(size=6), rng.normal(size=6), rng.normal(size=(4, 6))
    feedback = hp.Feedback(20.0, 2.0, np.zeros(6))
    moved, held = robot.rollout(q, v, tau, 1e-3), robot.rollout(q, v, feedback, 1e-3, steps=4)
    for found, law in ((moved, lambda k, _q, _v: tau[k]), (held, lambda _, q, v: -20 * q - 2 * v)):
        x, rate = q, v
        for k in range(4):
            rate = rate + 1e-3 * pin.aba(model, data, x, rate, law(k, x, rate))
            x = x + 1e-3 * rate
        near(found.q[-1], x, 1e-13)
        near(found.qd[-1], rate, 1e-12)


# ---- robots


@functools.cache
def panda():
    return hp.load_robot("panda", base="fixed", locked={"panda_finger_joint1": 0.02})


def test_a_robot_is_what_its_file_says():
    robot, path = hp.load_robot("ur5"), robot_urdf("ur5")
    model = pin.buildModelFromUrdf(str(path))
    for one in (robot, hp.Mechanism.from_urdf(path), hp.Mechanism.from_pinocchio(model)):
        assert one.names == tuple(model.names)[1:]
        assert one.dof == model.nv
        near(one.position_limits, np.stack([model.lowerPositionLimit, model.upperPositionLimit], axis=-1))
        near(one.rate_limits, model.velocityLimit)
        near(one.effort_limits, model.effortLimit)
    assert robot["shoulder_pan_joint"].name == "shoulder_pan_joint"
    assert "tool0" in robot.links


def test_pairs_make_a_robot_with_branches_and_sliders():
    trunk = hp.HingePair((0, 0, 1), (0, 0, 0), (0, 0, 1), name="trunk", body2=BODY)
    lift = hp.Slider((0.5, 0, 0), (0, 0, 0), (0, 0, 1), name="a_lift", body2=BODY)
    screw = hp.Screw((-0.5, 0, 0), (0, 0, 0), (0, 0, 1), pitch=0.1, name="b_screw", body2=BODY)
    robot = hp.Mechanism([trunk, lift, screw], parents=[0, 1, 1], base="fixed", name="tree")
    assert robot.names == ("trunk", "a_lift", "b_screw")
    state = robot.forward_kinematics([math.pi / 2, 0.3, 2.0])
    near(state.R, [(0, 0.5, 1.3), (0, -0.5, 1.2)])


def test_robots_get_frames_and_payloads():
    robot, q = panda(), np.full(7, 0.3)
    hand = robot.forward_kinematics(q, frames="panda_hand")["panda_hand"]
    tool = robot.with_frame("tool", link="panda_hand", R=(0, 0, 0.1)).forward_kinematics(q, frames="tool")["tool"]
    near(tool.R, hand.R + 0.1 * hand.S[:, 2])
    masses = np.array([0.5, 1.0])
    heavy = robot.with_payload("panda_hand", mass=masses, centre_of_mass=(0, 0, 0.1))
    alone = robot.with_payload("panda_hand", hp.Body(1.0, (0, 0, 0.1), (0.01, 0.01, 0.01)))
    added = heavy.gravity_forces(q)
    near(added[1], alone.gravity_forces(q))
    lifted = robot.with_frame("c", link="panda_hand", R=(0, 0, 0.1)).jacobian(q, "c")[2]
    near(added - robot.gravity_forces(q), 9.81 * masses[:, None] * lifted, 1e-13)


@pytest.mark.parametrize("ask", ["pair", "robot"])
def test_slopes_of_prepared_calls_are_those_of_differences(ask):
    rng = generator(51)
    if ask == "pair":
        call, rows, output = PAIR.prepare("velocity", outputs=("v2",)), rng.normal(size=(2, 7)), "v2"
    else:
        call = panda().prepare("inverse_dynamics", outputs=("tau",), joint_loads=False)
        rows, output = rng.normal(size=(3, 7)), "tau"
    wrt = ("q", "qd")
    found = call.jacobian(tuple(rows), wrt=wrt)[output]
    assert found.keys() == {*wrt}
    for k, name in enumerate(wrt):
        moved = [*rows]

        def value(x, k=k, moved=moved):
            moved[k] = x
            return np.array(call(*moved)[output])

        np.testing.assert_allclose(found[name], approx_fprime(rows[k], value, 1e-7), atol=1e-4)
    weight, step = rng.normal(size=np.shape(call(*rows)[output])), rng.normal(size=7)
    value, gradient = call.vjp(tuple(rows), {output: weight})
    near(value[output], call(*rows)[output])
    near(gradient["q"], weight @ found["q"], 1e-13)
    value, tangent = call.jvp(tuple(rows), {"q": step})
    near(tangent[output], found["q"] @ step, 1e-13)
    assert isinstance(call.ufunc, np.ufunc)
    near(call.ufunc(*rows), call(*rows)[output])


def test_inverse_kinematics_reaches_poses():
    robot, model = panda(), pin.buildModelFromUrdf(str(robot_urdf("panda")))
    low, high = robot.position_limits.T
    wanted = robot.forward_kinematics(generator(52).uniform(low, high, (20, 7)), frames="panda_hand")["panda_hand"]
    found = robot.inverse_kinematics(wanted.R, wanted.S, frame="panda_hand", seed=0)
    assert found.ok.mean() >= 0.9
    assert found.q.shape == (20, 7)
    data = model.createData()
    for k in np.flatnonzero(found.ok):
        assert ((low <= found.q[k]) & (found.q[k] <= high)).all()
        pin.framesForwardKinematics(model, data, np.r_[found.q[k], 0.02, 0.02])
        place = data.oMf[model.getFrameId("panda_hand")]
        near(place.translation, wanted.R[k], 2e-9)
        near(place.rotation, wanted.S[k], 2e-9)
    assert found.position_error.shape == found.angle_error.shape == found.steps.shape == found.starts.shape == (20,)
    line = np.linspace(0, 1, 10)[:, None] * (0.05, 0, 0)
    path = robot.inverse_kinematics_path(wanted.R[0] + 0 * line, wanted.S[0], frame="panda_hand", q0=found.q[0])
    near(path.q, np.tile(found.q[0], (10, 1)), 1e-6)


# ---- recordings


def motions(made):
    return hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=made.R2, S=made.S2)


def test_a_recorded_hinge_is_found():
    made = recording(400)
    found = hp.fit(*motions(made))
    u1, u2, n, home = truth(np.sign(found.pair.n @ N1))
    for got, expected in ((found.pair.u1, u1), (found.pair.u2, u2), (found.pair.n, n), (found.pair.home, home)):
        near(got, expected, 1e-13)
    assert found.ok
    assert found.findings == ()
    assert max(found.rms_position, found.rms_angle) < 1e-14
    assert found.covariance.shape[0] == found.covariance.shape[1]
    point = hp.fit(motions(made)[0], hp.BodyMotion(R=made.R2))
    assert np.abs(np.cross(point.pair.n, N1)).max() < 1e-9
    still = hp.BodyMotion(R=np.zeros((50, 3)), S=np.broadcast_to(np.eye(3), (50, 3, 3)))
    with pytest.raises(hp.FitError):
        hp.fit(still, still)


def test_smoothed_motion_is_nearer_than_what_was_recorded():
    made, noisy = recording(2000), recording(2000, 1e-3, 1e-3)
    clean = hp.smooth(noisy.t, motions(noisy)[0])
    assert np.abs(clean.R - made.R1).mean() < 0.5 * np.abs(noisy.R1 - made.R1).mean()
    for name in ("v", "omega", "a", "alpha"):
        assert getattr(clean, name).shape == (2000, 3)
    assert np.median(np.abs(clean.v - np.gradient(made.R1, made.t, axis=0))) < 0.05
    angle = hp.smooth(noisy.t, made.psi + 1e-3 * generator(53).normal(size=2000))
    assert np.shape(angle.std["psidd"]) == (2000,)
    assert angle.noise["psi"] == pytest.approx(1e-3, rel=0.2)


def test_samples_are_taken_at_other_instants():
    t = np.linspace(0, 2, 101)
    S = Rotation.from_rotvec(t[:, None] * (0.3, -1, 0.5)).as_matrix()
    to = np.linspace(0.1, 1.9, 37)
    near(hp.resample(t, np.sin(t), to), np.sin(to), 1e-6)
    body = hp.resample(t, hp.BodyMotion(R=np.stack([t] * 3, axis=-1), S=S), to)
    near(body.S, Rotation.from_rotvec(to[:, None] * (0.3, -1, 0.5)).as_matrix(), 1e-8)
    gap = np.delete(np.arange(101), np.arange(40, 60))
    assert np.isnan(hp.resample(t[gap], np.sin(t[gap]), to)).any()


def test_two_inertial_sensors_give_the_hinge():
    pair = hp.HingePair((0.3, 0.1, -0.2), (-0.2, 0.25, 0.1), N1)
    t = np.arange(2000) / 100
    angles = [(np.sin(t + k), np.cos(t + k), -np.sin(t + k)) for k in range(6)]
    parts = [*angles, (np.sin(2.3 * t), 2.3 * np.cos(2.3 * t), -5.29 * np.sin(2.3 * t))]
    state = pair.forward_kinematics(*zip(*parts, strict=True), outputs=("S1", "omega1", "a1", "S2", "omega2", "a2"))
    g, rng = np.array([0, 0, -9.81]), generator(54)
    recordings = []
    for k in "12":
        S, omega, a = (state[f"{name}{k}"] for name in ("S", "omega", "a"))
        own = [np.einsum("nji,nj->ni", S, v) for v in (omega, a - g)]
        noisy = (v + size * rng.normal(size=v.shape) for v, size in zip(own, (1e-3, 1e-2), strict=True))
        recordings.append(hp.ImuRecording(t, *noisy))
    found = hp.fit_imus(*recordings)
    assert found.ok
    assert abs(found.pair.n @ N1) == pytest.approx(1, abs=1e-6)
    near(found.pair.u1 - found.pair.n * (found.pair.n @ found.pair.u1), pair.u1 - N1 * (N1 @ pair.u1), 5e-3)
    assert abs(found.clock_offset) <= 1e-4


def test_markers_give_the_motion_of_a_body():
    made, points = recording(50), generator(55).normal(size=(5, 3))
    seen = made.R1[:, None] + np.einsum("nij,kj->nki", made.S1, points)
    found = hp.fit_cluster(seen, reference=points)
    near(found.body.R, made.R1, 1e-13)
    near(found.body.S, made.S1, 1e-13)


def test_torques_give_masses():
    robot = hp.load_robot("ur5")
    heavy = robot.with_payload("tool0", hp.Body(2.0, (0, 0, 0.1), (0.01, 0.01, 0.01)))
    t = np.arange(400)[:, None] / 50
    w, p = np.arange(1, 7) / 2, np.arange(6)
    rows = [np.sin(w * t + p), w * np.cos(w * t + p), -w * w * np.sin(w * t + p)]
    found = hp.fit_masses(robot, *rows, heavy.inverse_dynamics(*rows).tau, joint_terms=())
    near(found.torques(*rows), heavy.inverse_dynamics(*rows).tau, 1e-9)


# ---- scenes and results


def test_a_scene_is_computed_said_and_saved(tmp_path):
    import pandas as pd
    import xarray as xr

    scene = hp.load_scene(MODELS / "reference_3d.toml")
    result = scene.evaluate()
    t = result.t
    exact = from_euler(
        (scene.pair.u1, scene.pair.u2, scene.pair.n, None), t[:3, None] * (3, 3, 3, 3, 1, 5, 10),
        np.broadcast_to([3.0, 3, 3, 3, 1, 5, 10], (3, 7)),
    )  # fmt: skip
    for name in ("R2", "S2", "v2", "omega2"):
        assert exact.errors(name, result[name][:3]).max() <= 12
    assert str(scene.plan())
    frame, dataset = result.to_dataframe(), result.to_xarray()
    near(frame["R2_x"].to_numpy(), result.R2[:, 0])
    near(dataset["R2"].to_numpy(), result.R2)
    read = {
        ".csv": lambda path: pd.read_csv(path, comment="#")["R2_x"],
        ".npz": lambda path: np.load(path)["R2"][:, 0],
        ".parquet": lambda path: pd.read_parquet(path)["R2_x"],
        ".nc": lambda path: xr.load_dataset(path)["R2"][:, 0],
    }
    for suffix, reader in read.items():
        result.save(path := tmp_path / f"result{suffix}")
        near(np.asarray(reader(path)), result.R2[:, 0])
    assert hp.plot(result).axes
    page = tmp_path / "page.html"
    hp.view(scene, path=page)
    assert page.read_text().lower().startswith("<!doctype html>")


def test_closed_forms_are_the_numbers():
    scene = hp.load_scene(MODELS / "reference_3d.toml")
    forms, numbers = hp.derive(scene), scene.evaluate(("R2", "S2", "v2", "omega2", "omega1"))
    instant = 7
    for name in numbers.outputs:
        value = getattr(forms, name).subs(forms.t, numbers.t[instant]).evalf(30)
        near(np.array(value, dtype=float).reshape(numbers[name][instant].shape), numbers[name][instant], 1e-13)


def test_errors_are_ours_and_pythons():
    with pytest.raises(hp.HingePairError) as caught:
        hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 0))
    assert isinstance(caught.value, ValueError)
    assert caught.value.name == "n"
    assert issubclass(hp.errors.MissingDependencyError, ImportError)
    assert issubclass(hp.FitError, hp.HingePairError)
