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
from scipy.spatial.transform import Rotation

import hingepair as hp
from hingepair.bench.truth import DIGITS, from_euler
from hingepair.formats.robots import robot_urdf
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
    near(hp.angular_velocity(S, hp.skew(vector) @ S), vector)
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
            assert (bound <= 512 * U).all()


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
    assert min(np.abs(place.translation - R2).max() for place in data.oMf) <= 8 * U
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
    assert isinstance(caught.value, hp.errors.AxisError)
    assert (caught.value.name, caught.value.expected) == ("n", "a non-zero axis")
    assert str(caught.value) == "n: expected a non-zero axis, got (0, 0, 0)"
    assert issubclass(hp.errors.MissingDependencyError, ImportError)
    assert issubclass(hp.FitError, hp.HingePairError)
