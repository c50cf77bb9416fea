"""Scenes whose motion is samples in a file: what they say, what they find by differentiating, what they refuse."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import hingepair as hp
from hingepair.cli import app
from states import coordinates, generator

U = 2.0**-53
MODELS = Path(__file__).parent.parent / "models"
SCENE = """
[pair]
u1 = [0.5, 0.2, 0.1]
u2 = [-0.25, 0.1, 0.3]
n = [1, 2, 0]
[motion]
file = "{file}"
"""
EULER = ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")
RATES = ("v1_x", "v1_y", "v1_z", "phid_x", "phid_y", "phid_z", "psid")
SECOND = ("a1_x", "a1_y", "a1_z", "phidd_x", "phidd_y", "phidd_z", "psidd")
BODY = ("t", "x", "y", "z", "qx", "qy", "qz", "qw", "psi")


def moving(count=12, seed=0):
    """Columns of a random motion in Euler angles, with rates that belong to nothing in particular."""
    parts = coordinates(generator(90, seed), count)
    columns = {"t": np.cumsum(generator(91, seed).uniform(0.1, 1, count))}
    for names, part in zip((EULER, RATES, SECOND), parts, strict=True):
        columns |= dict(zip(names, part.T, strict=True))
    return columns


def some(columns, *names):
    return {name: columns[name] for name in names}


def write(path, columns):
    if path.suffix == ".npz":
        np.savez(path, **columns)
    elif path.suffix == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), path)
    else:
        rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
        path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n")


def scene_of(tmp_path, columns, more="", name="log.csv"):
    if isinstance(columns, dict):
        write(tmp_path / name, columns)
    else:
        (tmp_path / name).write_bytes(columns if isinstance(columns, bytes) else columns.encode())
    (tmp_path / "my.toml").write_text(SCENE.format(file=name) + more)
    return hp.load_scene(tmp_path / "my.toml")


def same(result, state):
    assert result.state.outputs == state.outputs
    for name, expected in state.arrays().items():
        np.testing.assert_allclose(getattr(result, name), expected, rtol=0, atol=16 * U * abs(expected).max())


@pytest.mark.parametrize("name", ["log.csv", "log.npz", "log.parquet", "LOG.CSV"])
def test_columns_are_the_coordinates(tmp_path, name):
    columns = moving()
    scene = scene_of(tmp_path, columns, 'sequence = "ZXZ"\n', name)
    given = [np.stack([columns[c] for c in names], axis=-1) for names in (EULER, RATES, SECOND)]
    same(scene.evaluate(), scene.pair.forward_kinematics(*given, sequence="ZXZ"))
    assert np.array_equal(scene.times(), columns["t"])
    assert (scene.samples, scene.start, scene.stop) == (12, columns["t"][0], columns["t"][-1])
    assert scene.cross_validate().ok
    assert scene.cross_validate(5).samples == 5


def test_stacked_arrays_are_the_columns_side_by_side(tmp_path):
    columns = moving()
    q, qd, qdd = (np.stack([columns[c] for c in names], axis=-1) for names in (EULER, RATES, SECOND))
    one = scene_of(tmp_path, columns).evaluate()
    parts = {"t": columns["t"], "R1": q[:, :3], "phi": q[:, 3:6], "psi": q[:, 6], "v1": qd[:, :3]}
    parts |= {"phid": qd[:, 3:6], "psid": qd[:, 6], "a1": qdd[:, :3], "phidd": qdd[:, 3:6], "psidd": qdd[:, 6]}
    for arrays in ({"t": columns["t"], "q": q, "qd": qd, "qdd": qdd}, parts):
        result = scene_of(tmp_path, arrays, name="log.npz").evaluate()
        assert all(np.array_equal(a, getattr(result, name)) for name, a in one.state.arrays().items())


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
    scene = scene_of(tmp_path, arrays, name="log.npz")
    body1 = hp.BodyMotion.from_quaternion_xyzw(R=R, quat_xyzw=quat, v=v, omega=omega, a=a, alpha=alpha)
    same(scene.evaluate(), scene.pair.forward_kinematics_from_body1(body1, *psi))
    assert scene.sequence is None
    assert scene.cross_validate().ok
    assert scene.plan().outputs == scene.evaluate().state.outputs


def test_what_the_file_lacks_is_not_there(tmp_path):
    columns = moving()
    pose = scene_of(tmp_path, some(columns, "t", *EULER))
    assert pose.evaluate().state.outputs == ("R2", "S2", "d")
    assert pose.evaluate().v2 is None
    assert ("first derivatives of the coordinates", "the motion does not give them") in pose.plan().skipped
    with pytest.raises(hp.ArgumentError, match=r"outputs: expected one of R2, S2, d, R1, S1; .*differentiate.* v2"):
        pose.evaluate(("R2", "v2"))
    with pytest.raises(hp.SceneError, match=r"my\.toml: outputs\.names: .* got omega1"):
        scene_of(tmp_path, some(columns, "t", *EULER), '[outputs]\nnames = ["omega1"]\n')
    velocity = scene_of(tmp_path, some(columns, "t", *EULER, *RATES))
    assert velocity.evaluate().state.outputs == ("R2", "S2", "d", "v2", "omega2")
    for name in ("expressions", "coordinates"):
        with pytest.raises(hp.ArgumentError, match="motion: expected a scene whose motion is expressions"):
            getattr(velocity, name) if name == "expressions" else velocity.coordinates(0.0)


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


def test_columns_that_never_change_cost_nothing_at_each_instant(tmp_path):
    columns = moving() | {name: np.zeros(12) for name in (*EULER[3:5], *RATES[3:5], *SECOND[3:5])}
    scene = scene_of(tmp_path, columns)
    assert "sine and cosine of phi_x at each instant: phi_x is constant" in str(scene.plan())
    still = {name: np.full(5, 0.5) for name in EULER} | {"t": np.arange(5.0)}
    result = scene_of(tmp_path, still).evaluate()
    assert result.R2.shape == (5, 3)
    assert not np.ptp(result.R2, axis=0).any()


# ---------------------------------------------------------------- differentiate = true


def logged(count, h=0.02):
    """The motion that models/logged_arm.toml states, and its derivatives from the same motion as a scene."""
    t = np.arange(count) * h
    angles = [0.5 * np.sin(t), 0.3 * np.sin(1.3 * t) - 0.4, 0.2 * np.cos(t)]
    quat = Rotation.from_euler("ZYX", np.stack(angles, axis=-1)).as_quat()
    place = (0.3 * np.sin(t), 0.2 * np.cos(0.7 * t), 1 + 0.1 * np.sin(1.3 * t))
    names = (*BODY, "phi_x", "phi_y", "phi_z")
    return dict(zip(names, (t, *place, *quat.T, 0.8 + 0.6 * np.sin(1.7 * t), *angles), strict=True))


ARM = """
[pair]
u1 = [0.3, 0, -0.02]
u2 = [-0.12, 0, 0.01]
n = [0, 1, 0]
[motion]
x = "0.3*sin(t)"
y = "0.2*cos(0.7*t)"
z = "1 + 0.1*sin(1.3*t)"
phi_x = "0.5*sin(t)"
phi_y = "0.3*sin(1.3*t) - 0.4"
phi_z = "0.2*cos(t)"
psi = "0.8 + 0.6*sin(1.7*t)"
sequence = "ZYX"
[time]
start = 0
stop = 4
samples = 201
"""
POSE = dict.fromkeys(("R2", "S2", "d"), 16 * U)
MIDDLE = POSE | {"v2": 3e-11, "omega2": 3e-11, "a2": 3e-10, "alpha2": 3e-10}
ENDS = POSE | {"v2": 1e-8, "omega2": 1e-8, "a2": 1e-6, "alpha2": 1e-6}
"""Truncation: (1.7 * 0.02)^6 times the constant of the stencil, 1/140 in the middle and 2.3 at the ends."""


def close(result, truth):
    for errors, rows in ((MIDDLE, slice(3, -3)), (ENDS, slice(None))):
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


@pytest.mark.parametrize("kind", ["quaternions", "Euler angles", "wrapped angles", "rates given"])
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
    if kind == "rates given":  # of which the second derivatives are found, at half the noise
        euler = some(columns, *BODY)
        for i, axis in enumerate("xyz"):
            euler |= {f"omega1_{axis}": truth.omega1[:, i], f"v1_{axis}": truth.v1[:, i]}
        more = ""
    scene = scene_of(tmp_path, euler, more + "differentiate = true\n")
    pair = hp.load_scene(tmp_path / "arm.toml").pair
    close(
        hp.scene.SceneResult(scene.times(), scene.motion.samples(slice(None), 2).forward_kinematics(pair, None)),
        truth,
    )


def test_given_derivatives_are_kept(tmp_path):
    columns = moving(20)
    kept = scene_of(tmp_path, columns, "differentiate = true\n").evaluate()
    assert np.array_equal(kept.a2, scene_of(tmp_path, columns).evaluate().a2)
    some_kept = scene_of(tmp_path, some(columns, "t", *EULER, *RATES[:3]), "differentiate = true\n")
    found = some_kept.evaluate(("v1", "omega1"))
    assert np.array_equal(found.v1, np.stack([columns[name] for name in RATES[:3]], axis=-1))


# ---------------------------------------------------------------- refused

GOOD = some(moving(), "t", *EULER)


def text_of(columns):
    stream = io.StringIO()
    csv.writer(stream).writerows([list(columns), *zip(*(c.tolist() for c in columns.values()), strict=True)])
    return stream.getvalue()


def changed(**columns):
    return {name: value for name, value in (GOOD | columns).items() if value is not None}


def with_value(name, index, value):
    column = GOOD[name].copy()
    column[index] = value
    return changed(**{name: column})


LINES = text_of(GOOD).splitlines()
REFUSED_CSV = {
    "empty file": ("", "", "log.csv: expected a first line of column names"),
    "no rows": (LINES[0] + "\n", "", "log.csv: expected at least one sample"),
    "no header": ("\n".join(LINES[1:]), "", "an unknown column"),
    "ragged": ("\n".join([*LINES[:4], LINES[4] + ",1", *LINES[5:]]), "", "line 5: expected 8 fields"),
    "short row": ("\n".join([*LINES[:4], "1,2", *LINES[5:]]), "", "line 5: expected 8 fields"),
    "decimal commas": ("\n".join([LINES[0], *(line.replace(".", ",") for line in LINES[1:])]), "", "decimal points"),
    "semicolons": (text_of(GOOD).replace(",", ";"), "", "separated by commas"),
    "empty cell": (
        "\n".join([*LINES[:2], LINES[2].rpartition(",")[0] + ",", *LINES[3:]]),
        "",
        "line 3: psi: expected a",
    ),
    "words": ("\n".join([*LINES[:2], "a" + LINES[2], *LINES[3:]]), "", "line 3: t: expected a number"),
    "unknown column": (changed(phi_w=GOOD["psi"]), "", "'phi_w': expected one of"),
    "column twice": (LINES[0].replace("y", "x", 1) + "\n" + LINES[1], "", "log.csv: x: expected a column once"),
    "no t": (changed(t=None), "", "log.csv: t: expected a column"),
    "no psi": (changed(psi=None), "", "log.csv: psi: expected a column"),
    "no position": (changed(x=None, y=None, z=None), "", "log.csv: x: expected a column"),
    "half a position": (changed(y=None), "", "y: expected a column beside x"),
    "no attitude": (changed(phi_x=None, phi_y=None, phi_z=None), "", "phi_x: expected columns phi_x"),
    "two attitudes": (changed(qx=GOOD["x"]), "", "qx: expected nothing of this kind beside phi_x"),
    "omega1 beside angles": (changed(omega1_x=GOOD["x"]), "", "omega1_x: expected nothing"),
    "only psid": (changed(psid=GOOD["psi"]), "", "v1_x: expected a column, beside rates"),
    "seconds alone": (changed(psidd=GOOD["psi"]), "", "v1_x: expected a column, beside rates"),
    "t is nan": (with_value("t", 5, np.nan), "", "log.csv: t: expected finite instants, got nan at index 5"),
    "t stands": (with_value("t", 5, GOOD["t"][4]), "", "at index 5"),
    "nan differentiated": (with_value("phi_y", 7, np.nan), "differentiate = true\n", "phi_y: .* nan at sample 7"),
    "too few": ({k: v[:6] for k, v in GOOD.items()}, "differentiate = true\n", "order \\+ 1 = 7"),
    "zero quaternion": (
        {name: np.zeros(3) for name in BODY} | {"t": np.arange(3)},
        "",
        "zero quaternion at sample 0",
    ),
    "turns too far": (
        {name: np.zeros(9) for name in BODY}
        | {"t": np.arange(9), "qx": np.sin(np.arange(9)), "qw": np.cos(np.arange(9))},
        "differentiate = true\n",
        "qx, qy, qz, qw: expected samples that turn by less than pi",
    ),
    "sequence of quaternions": (some(logged(9), *BODY), 'sequence = "XYZ"\n', "motion.sequence: expected nothing"),
    "sequence": (GOOD, 'sequence = "XXY"\n', "motion.sequence"),
    "time beside": (GOOD, "[time]\nstart = 0\nstop = 1\nsamples = 3\n", "my.toml: time: expected no such table"),
    "not a flag": (GOOD, "differentiate = 1\n", "motion.differentiate: expected true or false"),
    "expression beside": (GOOD, 'x = "t"\n', "motion.x: expected one of file"),
    "not UTF-8": (b"t,x\xff\n1,2\n", "", "log.csv"),
    "long header": ("t" * 20_000, "", "first line of column names"),
}


@pytest.mark.parametrize(("columns", "more", "message"), REFUSED_CSV.values(), ids=REFUSED_CSV)
def test_refused_in_one_line_that_names_file_and_column(tmp_path, columns, more, message):
    with pytest.raises(hp.SceneError, match=message) as caught:
        scene_of(tmp_path, columns, more)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


class Trap:
    """What must never be unpickled."""

    def __reduce__(self):
        return (exec, ("raise SystemExit('code from a file ran')",))


REFUSED_NPZ = {
    "pickle": ({"t": np.array([Trap()], dtype=object)}, "t: expected real numbers"),
    "complex": ({"t": np.zeros(3, complex)}, "t: expected real numbers"),
    "half precision": ({"t": np.zeros(3, np.float16)}, "t: expected real numbers"),
    "text": ({"t": np.array(["1"])}, "t: expected real numbers"),
    "unknown array": ({"time": np.arange(3)}, "'time': expected one of"),
    "scalar": ({"t": np.array(1.0)}, r"t: expected shape \(N,\)"),
    "transposed": ({"R1": np.zeros((3, 9))}, r"R1: expected shape \(N, 3\)"),
    "lengths": ({"t": np.arange(3), "psi": np.arange(4)}, "columns of one length, got t: 3, psi: 4"),
    "both ways": ({"R1": np.zeros((3, 3)), "x": np.zeros(3)}, "x: expected x once"),
    "empty": ({"t": np.empty(0)}, "at least one sample"),
}


@pytest.mark.parametrize(("arrays", "message"), REFUSED_NPZ.values(), ids=REFUSED_NPZ)
def test_arrays_refused(tmp_path, arrays, message):
    np.savez(tmp_path / "made.npz", **arrays)
    with pytest.raises(hp.SceneError, match=message):
        scene_of(tmp_path, (tmp_path / "made.npz").read_bytes(), name="log.npz")


def test_sizes_are_refused_before_anything_is_allocated(tmp_path, monkeypatch):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**13,)})
    import zipfile

    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("t.npy", header.getvalue())
    with pytest.raises(hp.SceneError, match="at most 10000000 samples, got 10000000000000"):
        scene_of(tmp_path, (tmp_path / "log.npz").read_bytes(), name="log.npz")
    for name in ("log.csv", "log.npz", "log.parquet"):
        with monkeypatch.context() as patch:
            patch.setattr("hingepair.sample_file.MAX_ROWS", 11)
            with pytest.raises(hp.SceneError, match="at most 11 samples, got 12"):
                scene_of(tmp_path, GOOD, name=name)
            patch.setattr("hingepair.sample_file.MAX_BYTES", 100)
            with pytest.raises(hp.SceneError, match="at most 100 bytes"):
                scene_of(tmp_path, GOOD, name=name)


@pytest.mark.parametrize("name", ["log.npz", "log.parquet"])
@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"PAR1junkPAR1", b"text"])
def test_no_such_format(tmp_path, name, content):
    with pytest.raises(hp.SceneError, match=name):
        scene_of(tmp_path, content, name=name)


def test_a_file_cut_short(tmp_path):
    for name in ("log.npz", "log.parquet"):
        write(tmp_path / name, GOOD)
        whole = (tmp_path / name).read_bytes()
        for length in (len(whole) // 3, len(whole) - 3):
            with pytest.raises(hp.SceneError, match=name):
                scene_of(tmp_path, whole[:length], name=name)


def test_parquet_nulls_are_lost_numbers_and_words_are_refused(tmp_path):
    columns = {name: column.tolist() for name, column in GOOD.items()}
    columns["y"][2] = None
    result = scene_of(tmp_path, columns, name="log.parquet").evaluate()
    assert np.flatnonzero(np.isnan(result.R2[:, 1])).tolist() == [2]
    columns["y"] = ["1.5"] * 12
    with pytest.raises(hp.SceneError, match="y: expected a column of numbers, got string"):
        scene_of(tmp_path, columns, name="log.parquet")


def test_parquet_without_pyarrow_says_what_to_install(tmp_path, monkeypatch):
    scene_of(tmp_path, GOOD, name="log.parquet")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(hp.MissingDependencyError, match=r"hingepair\[parquet\]"):
        hp.load_scene(tmp_path / "my.toml")


@pytest.mark.parametrize("name", ["log.txt", "log", "none.csv", "."])
def test_no_such_file(tmp_path, name):
    (tmp_path / "my.toml").write_text(SCENE.format(file=name))
    with pytest.raises(hp.SceneError, match=r"a file (name that ends in|of samples)"):
        hp.load_scene(tmp_path / "my.toml")


def test_commands_work_on_a_pose_only_log(tmp_path):
    scene_of(tmp_path, some(logged(30), *BODY))
    scene = str(tmp_path / "my.toml")
    found = json.loads(CliRunner().invoke(app, ["run", scene, "--json"]).stdout)
    assert found["residuals"].keys() == {"E1"}
    assert found["sequence"] is None
    assert "attitude as quaternions" in CliRunner().invoke(app, ["run", scene, "--explain"]).stdout
    done = CliRunner().invoke(app, ["check", scene, "--json"])
    assert done.exit_code == 0
    assert [row["output"] for row in json.loads(done.stdout)["rows"]] == ["R2", "S2", "d"]
