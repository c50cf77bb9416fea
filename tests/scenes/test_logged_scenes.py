"""Scenes whose motion is samples in a file: what they say, and the rates that smoothing finds."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import hingepair as hp
from hingepair.plans.arguments import CoordinateNames
from support.scenes import logged as described
from support.scenes import moved, toml
from support.states import coordinates, generator

U = 2.0**-53
MODELS = Path(__file__).parents[2] / "models"
SCENE = described([0.5, 0.2, 0.1], [-0.25, 0.1, 0.3], [1, 2, 0], "{file}")
EULER = ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")
RATES = ("v1_x", "v1_y", "v1_z", "phid_x", "phid_y", "phid_z", "psid")
SECOND = ("a1_x", "a1_y", "a1_z", "phidd_x", "phidd_y", "phidd_z", "psidd")
BODY = ("t", "x", "y", "z", "qx", "qy", "qz", "qw", "psi")


def moving(count=12):
    """Columns of a random motion in Euler angles, with rates that belong to nothing in particular."""
    parts = coordinates(generator(90, 0), count)
    columns = {"t": np.cumsum(generator(91, 0).uniform(0.1, 1, count))}
    for names, part in zip((EULER, RATES, SECOND), parts, strict=True):
        columns |= dict(zip(names, part.T, strict=True))
    return columns


def some(columns, *names):
    return {name: columns[name] for name in names}


def scene_of(tmp_path, columns, more="", name="log.csv"):
    path = tmp_path / name
    if path.suffix == ".npz":
        np.savez(path, **columns)
    else:
        frame = pd.DataFrame(columns)
        (frame.to_parquet if path.suffix == ".parquet" else frame.to_csv)(path, index=False)
    (tmp_path / "my.toml").write_text(SCENE.format(file=name) + more)
    return hp.load_scene(tmp_path / "my.toml")


def logged(count, h=0.02):
    """The motion that models/logged_arm.toml states, and its derivatives from the same motion as a scene."""
    t = np.arange(count) * h
    angles = [0.5 * np.sin(t), 0.3 * np.sin(1.3 * t) - 0.4, 0.2 * np.cos(t)]
    quat = Rotation.from_euler("ZYX", np.stack(angles, axis=-1)).as_quat()
    place = (0.3 * np.sin(t), 0.2 * np.cos(0.7 * t), 1 + 0.1 * np.sin(1.3 * t))
    names = (*BODY, "phi_x", "phi_y", "phi_z")
    return dict(zip(names, (t, *place, *quat.T, 0.8 + 0.6 * np.sin(1.7 * t), *angles), strict=True))


def same(result, state):
    assert result.state.outputs == state.outputs
    for name, expected in state.arrays().items():
        np.testing.assert_allclose(getattr(result, name), expected, rtol=0, atol=16 * U * abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["log.csv", "log.npz", "log.parquet", "LOG.CSV"])
def test_columns_are_the_coordinates(tmp_path, name):
    columns = moving()
    scene = scene_of(tmp_path, columns, 'sequence = "ZXZ"\n', name)
    given = [np.stack([columns[c] for c in names], axis=-1) for names in (EULER, RATES, SECOND)]
    same(scene.evaluate(), scene.pair.forward_kinematics(*given, sequence="ZXZ"))
    assert np.array_equal(scene.t, columns["t"])
    assert (scene.samples, scene.start, scene.stop) == (12, columns["t"][0], columns["t"][-1])
    assert scene.cross_validate().ok
    assert scene.cross_validate(5).samples == 5


@pytest.mark.slow
@pytest.mark.parametrize("order", ["columns", "quat_xyzw", "quat_wxyz"])
def test_quaternions_go_the_way_of_given_attitudes(tmp_path, order):
    rng = generator(92)
    R, omega, v, a, alpha = rng.normal(size=(5, 9, 3))
    quat, psi = rng.normal(size=(9, 4)), rng.normal(size=(3, 9))
    arrays = {"t": np.arange(9) / 4, "R1": R, "v1": v, "a1": a, "omega1": omega, "alpha1": alpha}
    arrays |= {"psi": psi[0], "psid": psi[1], "psidd": psi[2]}
    if order == "columns":
        arrays |= dict(zip(("qx", "qy", "qz", "qw"), quat.T, strict=True))
    else:
        arrays[order] = quat if order == "quat_xyzw" else np.roll(quat, 1, axis=-1)
    scene = scene_of(tmp_path, arrays, 'frame = "world"\n', name="log.npz")
    body1 = hp.BodyMotion.from_quaternion_xyzw(R=R, quat_xyzw=quat, v=v, omega=omega, a=a, alpha=alpha)
    same(scene.evaluate(), scene.pair.forward_kinematics_from_body1(body1, *psi))
    assert scene.motion.source.sequence is None
    assert scene.cross_validate().ok
    assert scene.plan().outputs == scene.evaluate().state.outputs
    assert ("first derivatives of the coordinates", "no output needs them") in scene.plan(("R2",)).skipped


def test_what_the_file_lacks_is_not_there(tmp_path):
    columns = moving()
    pose = scene_of(tmp_path, some(columns, "t", *EULER))
    assert pose.evaluate().state.outputs == ("R2", "S2", "d")
    assert pose.evaluate().v2 is None
    assert ("first derivatives of the coordinates", "the motion does not give them") in pose.plan().skipped
    with pytest.raises(hp.ArgumentError, match=r"one of R2, S2, d, R1, S1, psi, q, quat1, quat2; .*smooth.* 'v2'"):
        pose.evaluate(("R2", "v2"))
    velocity = scene_of(tmp_path, some(columns, "t", *EULER, *RATES))
    assert velocity.evaluate().state.outputs == ("R2", "S2", "d", "v2", "omega2")
    with pytest.raises(hp.ArgumentError, match="motion: expected a scene of a pair whose motion is functions of "):
        _ = velocity.expressions


def test_a_number_that_is_lost_stays_lost_in_its_sample(tmp_path):
    columns = moving()
    columns["phi_y"][4] = np.nan
    columns["psid"][7] = np.inf
    result = scene_of(tmp_path, columns).evaluate()
    assert np.flatnonzero(~np.isfinite(result.R2).all(axis=-1)).tolist() == [4]
    assert np.flatnonzero(~np.isfinite(result.v2).all(axis=-1)).tolist() == [4, 7]
    body = some(logged(30), *BODY)
    body["qz"][3] = np.nan
    scene = scene_of(tmp_path, body)
    assert np.flatnonzero(~np.isfinite(scene.evaluate().S2).all(axis=(-2, -1))).tolist() == [3]
    assert scene.cross_validate().skipped == 1


def test_a_log_of_the_library_is_coordinates_and_rates_at_once(tmp_path):
    """Its own columns, t and those of other derivatives among them, without a copy of any."""
    columns = moving(40)
    scene = scene_of(tmp_path, columns)
    log = pd.read_csv(scene.evaluate(("q", "qd", "qdd")).save(tmp_path / "kept.csv"))
    assert list(log.columns) == ["t", *EULER, *RATES, *SECOND]
    found = scene.pair.forward_kinematics(log, log, log)
    for output, array in scene.evaluate().state.arrays().items():
        np.testing.assert_allclose(found[output], array, rtol=0, atol=256 * U * (1 + np.abs(array).max()))
    for given in (log[[*RATES]], log[["t", *RATES]], log[[*reversed(RATES)]]):
        velocity = scene.pair.forward_kinematics(log[[*EULER, "t"]], given)
        np.testing.assert_allclose(velocity.v2, found.v2, rtol=0, atol=256 * U * np.abs(found.v2).max())
    frame = pd.DataFrame({name: column for name, column in columns.items() if name != "t"})
    taken = CoordinateNames(EULER, {"q": EULER, "qd": RATES, "qdd": SECOND}).of_table("q", frame)
    assert all(np.shares_memory(array, frame[name].to_numpy()) for name, array in taken.items())


# ---------------------------------------------------------------- rates


ARM = toml("pair", u1=[0.3, 0, -0.02], u2=[-0.12, 0, 0.01], n=[0, 1, 0]) + moved(
    0, 4, 201, x="0.3*sin(t)", y="0.2*cos(0.7*t)", z="1 + 0.1*sin(1.3*t)", phi_x="0.5*sin(t)",
    phi_y="0.3*sin(1.3*t) - 0.4", phi_z="0.2*cos(t)", psi="0.8 + 0.6*sin(1.7*t)", sequence="ZYX",
)  # fmt: skip
POSE = dict.fromkeys(("R2", "S2", "d"), 16 * U)
MIDDLE = dict.fromkeys(POSE, 1e-9) | {"v2": 1e-7, "omega2": 1e-7, "a2": 1e-5, "alpha2": 1e-5}
ENDS = dict.fromkeys(POSE, 1e-8) | {"v2": 1e-5, "omega2": 1e-5, "a2": 1e-3, "alpha2": 1e-3}
"""Errors of the spline between and beside the ends, in m, rad, s."""


def close(result, truth):
    for errors, rows in ((MIDDLE, slice(20, -20)), (ENDS, slice(None))):
        for name, error in errors.items():
            assert abs(getattr(result, name) - getattr(truth, name))[rows].max() <= error, name


def test_the_log_of_the_model_is_what_its_comment_says():
    with (MODELS / "logged_arm.csv").open() as file:
        header, *rows = csv.reader(file)
    found = np.array(rows, dtype=float)
    expected = some(logged(201), *BODY)
    assert tuple(header) == BODY
    assert abs(found - np.stack(list(expected.values()), axis=-1)).max() <= 8 * U
    assert all(repr(float(text)) == text for row in rows for text in row)
    assert (MODELS / "logged_arm.csv").stat().st_size < 60_000


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["quaternions", "Euler angles", "wrapped angles"])
def test_derivatives_found_are_those_of_the_motion(tmp_path, kind):
    (tmp_path / "arm.toml").write_text(ARM)
    truth = hp.load_scene(tmp_path / "arm.toml").evaluate((*ENDS, "omega1", "v1"))
    columns = logged(201)
    euler = some(columns, "t", *EULER)
    if kind == "quaternions":
        model = hp.load_scene(MODELS / "logged_arm.toml")
        close(model.evaluate(), truth)
        return
    more = 'sequence = "ZYX"\n'
    if kind == "wrapped angles":
        euler |= {name: np.mod(euler[name], 2 * np.pi) for name in (*EULER[3:6], "psi")}
        assert np.ptp(euler["phi_x"]) > 6
    scene = scene_of(tmp_path, euler, more + "smooth = true\n")
    pair = hp.load_scene(tmp_path / "arm.toml").pair
    known = scene.motion.source
    close(pair.forward_kinematics_from_body1(known.body1, *known.hinge), truth)


@pytest.mark.slow
def test_angular_velocities_beside_quaternions_say_their_axes(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM)
    names = ("S1", "v1", "a1", "omega1", "alpha1", "omega2", "alpha2", "psid", "psidd")
    truth = hp.load_scene(tmp_path / "arm.toml").evaluate(names)
    for frame in ("world", "body"):
        columns = some(logged(201), *BODY) | {"psid": truth.psid, "psidd": truth.psidd}
        for name in names[1:5]:
            own = getattr(truth, name)
            turned = frame == "body" and name in ("omega1", "alpha1")
            own = np.einsum("nji,nj->ni", truth.S1, own) if turned else own
            columns |= {f"{name}_{axis}": own[:, i] for i, axis in enumerate("xyz")}
        with pytest.raises(hp.SceneError, match=r"motion\.frame: expected the axes of omega1 in the log: \"body\""):
            scene_of(tmp_path, columns)
        result = scene_of(tmp_path, columns, f'frame = "{frame}"\n').evaluate(("omega1", "alpha1"))
        for name in ("omega1", "alpha1"):
            np.testing.assert_allclose(getattr(result, name), getattr(truth, name), rtol=0, atol=64 * U)
