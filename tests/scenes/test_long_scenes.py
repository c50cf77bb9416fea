"""Motions longer than memory: piece by piece, into files, to the same bits; and the coordinates as results."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import hingepair as hp
from hingepair.cli.summary import RunSummary
from hingepair.formats.recordings import read_recording
from hingepair.scenes.motions.motion import UniformInstants
from support.sparse import sparse
from support.work import HANG

MODELS = Path(__file__).parents[2] / "models"
RUN = """
import signal
from hingepair.cli.main import main
signal.signal(signal.SIGINT, signal.SIG_DFL)  # ignored in what a shell runs in the background
main()
"""
PEAK = r"""
import re, sys
from hingepair.cli.main import main
try:
    main()
finally:
    with open("/proc/self/status") as file:  # ru_maxrss begins with that of the process it was forked from
        print("peak", *re.findall(r"VmHWM:\s*(\d+)", file.read()), file=sys.stderr)
"""


def long_scene(folder: Path, samples: int | str, model: str = "reference_3d") -> Path:
    path = folder / f"{model}_{samples}.toml"
    text = re.sub(r"(?m)^samples = \d+", f"samples = {samples}", (MODELS / f"{model}.toml").read_text())
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("start", "stop", "count"), [(0.0, 10.0, 10_001), (-1 / 3, 10 / 3, 14), (2.0, 2.0, 3), (5, 9, 1)]
)
def test_instants_are_those_of_linspace_in_pieces_too(start, stop, count):
    found, expected = UniformInstants(start, stop, count), np.linspace(start, stop, count)
    np.testing.assert_array_equal(found[:], expected)
    pieces = np.concatenate([found[i : i + 64] for i in range(0, count, 64)])
    np.testing.assert_array_equal(pieces, expected)
    some = np.array([0, count // 2, count - 1])
    np.testing.assert_array_equal(found[some], expected[some])
    assert (found[0], found[-1]) == (start, expected[-1])
    assert list(found) == expected.tolist()  # and iteration ends
    for index in (count, -count - 1, np.array([0, count])):
        with pytest.raises(IndexError, match=f"index out of range for {count} instants"):
            found[index]


@pytest.mark.slow
@pytest.mark.parametrize("model", sparse(["reference_2d", "landing_gear", "spinning_satellite", "logged_arm"], 4))
def test_pieces_are_the_whole_to_the_bit(tmp_path, monkeypatch, model):
    monkeypatch.setattr("hingepair.scenes.scene.RESULT_ROWS_PER_BLOCK", 1024)
    logged = model == "logged_arm"
    scene = hp.load_scene(MODELS / f"{model}.toml" if logged else long_scene(tmp_path, 5003, model))
    whole = scene.evaluate()
    parts = list(scene.blocks())
    assert sum(len(part.t) for part in parts) == scene.samples == len(whole.t)
    for name, array in whole.recorded().items():
        np.testing.assert_array_equal(np.concatenate([part.recorded()[name] for part in parts]), array)
    at_once, piecewise = RunSummary(scene), RunSummary(scene)
    at_once.add(scene.evaluate())
    for part in parts:
        piecewise.add(part)
    assert piecewise.ranges() == at_once.ranges()
    assert piecewise.notes() == at_once.notes() == scene.notes()


def test_kinks_between_pieces_are_counted_once(tmp_path, monkeypatch):
    path = tmp_path / "kinked.toml"
    motion = 'x = "abs(t - 1)"\ny = 0\nz = 0\nphi_x = 0\nphi_y = 0\nphi_z = 0\n'
    psi = "psi = { t = [0.5, 1], value = [0, 1] }\n[time]\nstart = 0\nstop = 2\nsamples = 33\n"
    path.write_text(
        f"[pair]\nu1 = [1, 0, 0]\nu2 = [1, 0, 0]\nn = [0, 0, 1]\nlimits = [0, 0.5]\n[motion]\n{motion}{psi}"
    )
    scene = hp.load_scene(path)
    whole = scene.notes()
    assert len(whole) == 2
    for rows in (1, 4, 7):
        monkeypatch.setattr("hingepair.scenes.scene.RESULT_ROWS_PER_BLOCK", rows)
        assert scene.notes() == whole


def test_what_memory_cannot_hold_says_what_can(tmp_path):
    scene = hp.load_scene(long_scene(tmp_path, "1e8"))
    assert scene.samples == 10**8
    for ask in (scene.evaluate, scene.times, scene.cross_validate):
        with pytest.raises(
            hp.ArgumentError, match=r"samples: expected at most 10000000 .*--out FILE\.parquet.*blocks\(\)"
        ):
            ask()
    first = next(scene.blocks(("R2",)))
    assert (len(first.t), first.first, first.R2.shape) == (131_072, 0, (131_072, 3))
    with pytest.raises(hp.SceneError, match=r"time\.samples: expected at most 10000000 where a motion is integrated"):
        hp.load_scene(long_scene(tmp_path, 100_000_000, "spinning_satellite"))
    with pytest.raises(hp.SceneError, match=r"time\.samples"):
        hp.load_scene(long_scene(tmp_path, 10**12))


@pytest.mark.proof
def test_a_long_run_takes_little_memory(tmp_path):
    """Four million instants: their outputs alone are 0.9 GB."""
    target = tmp_path / "long.parquet"
    arguments = ["run", str(long_scene(tmp_path, 4_000_000)), "--out", str(target), "--outputs", "v2"]
    done = subprocess.run([sys.executable, "-c", PEAK, *arguments], capture_output=True, check=True, text=True)
    (peak,) = re.findall(r"peak (\d+)", done.stderr)
    assert int(peak) < 700_000  # KiB
    import pyarrow.parquet

    assert pyarrow.parquet.read_metadata(target).num_rows == 4_000_000
    assert "E2" in done.stdout


@pytest.mark.slow
def test_a_run_that_is_stopped_leaves_nothing_half_written(tmp_path):
    target = tmp_path / "out" / "long.csv"
    target.parent.mkdir()
    target.write_text("before")
    command = sys.executable, "-c", RUN, "run", str(long_scene(tmp_path, 10**8)), "--out", str(target)
    run = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    while len(os.listdir(target.parent)) < 2 and run.poll() is None:  # the file beside it
        time.sleep(0.05)
    run.send_signal(signal.SIGINT)
    try:
        out, err = run.communicate(timeout=HANG)
    finally:
        run.kill()
    assert run.returncode == 130
    assert err == f"hingepair: stopped by a signal; {target} is not written\n"
    assert out == ""
    assert [path.name for path in target.parent.iterdir()] == ["long.csv"]
    assert target.read_text() == "before"


def test_coordinates_are_results(tmp_path):
    scene = hp.load_scene(long_scene(tmp_path, 11))
    t = scene.times()
    result = scene.evaluate()
    np.testing.assert_allclose(result.psi, 10 * t, rtol=1e-15)
    np.testing.assert_array_equal(result.qd[:, 3:], np.tile([3.0, 1, 5, 10], (11, 1)))
    assert (result.q.shape, result.qdd.shape, result.psidd.shape) == ((11, 7), (11, 7), (11,))
    named = scene.evaluate(("R2", "psi", "qd", "v1"))
    assert list(named.recorded())[:4] == ["R2", "v1", "psi", "phid_x"]
    assert set(named.recorded()) == {"R2", "v1", "x", "y", "z", "phi_x", "phi_y", "phi_z"} | {
        *("psi", "phid_x", "phid_y", "phid_z", "psid")
    }
    assert named.qdd is None
    alone = scene.evaluate(("psidd",))
    assert alone.state.outputs == ()
    np.testing.assert_array_equal(alone.psidd, np.zeros(11))
    assert scene.plan(("q",)).outputs == ()


@pytest.mark.slow
def test_coordinates_in_a_file_are_a_log_of_the_motion(tmp_path):
    """The names of the columns are those that a log has."""
    scene = hp.load_scene(long_scene(tmp_path, 31, "landing_gear"))
    part = scene.evaluate(("q", "qd", "qdd"))
    part.save(tmp_path / "log.csv")
    pair = scene.path.read_text().split("[motion]", maxsplit=1)[0]
    (tmp_path / "back.toml").write_text(f'{pair}[motion]\nfile = "log.csv"\nsequence = "ZYX"\n')
    back, there = hp.load_scene(tmp_path / "back.toml").evaluate(), scene.evaluate()
    for name in there.state.outputs:
        np.testing.assert_array_equal(back.state[name], there.state[name])


@pytest.mark.slow
def test_coordinates_of_the_plane_and_of_attitudes(tmp_path):
    flat = hp.load_scene(long_scene(tmp_path, 11, "reference_2d")).evaluate(("R2", "qd"))
    assert flat.qd.shape == (11, 4)
    assert {"v1_x", "v1_y", "phid", "psid"} <= set(flat.recorded())
    turned = hp.load_scene(long_scene(tmp_path, 101, "spinning_satellite"))
    result = turned.evaluate(("psi", "psid"))
    np.testing.assert_array_equal(result.psid, result.known.hinge[1])
    assert result.quat2 is None
    assert result.qdd is None
    whole = turned.evaluate(("R1", "S1", "v1", "omega1", "q", "qd", "quat1", "quat2"))
    np.testing.assert_array_equal(whole.q[:, :3], whole.R1)
    np.testing.assert_array_equal(whole.q[:, 3:7], whole.quat1)
    np.testing.assert_array_equal(whole.qd, np.column_stack([whole.v1, whole.omega1, whole.psid]))
    np.testing.assert_allclose(Rotation.from_quat(whole.quat1).as_matrix(), whole.S1, rtol=0, atol=1e-15)
    np.testing.assert_allclose(Rotation.from_quat(whole.quat2).as_matrix(), whole.S2, rtol=0, atol=1e-15)
    assert (whole.quat2[:, 3] >= 0).all()
    assert "S2" not in whole.recorded()  # that quat2 is made of
    assert [name for name in whole.recorded() if name[0] == "q"] == [
        *("qx", "qy", "qz", "qw"), *("qx1", "qy1", "qz1", "qw1"), *("qx2", "qy2", "qz2", "qw2")
    ]  # fmt: skip
    flat = hp.load_scene(long_scene(tmp_path, 11, "reference_2d"))
    with pytest.raises(hp.ArgumentError, match=r"outputs: expected one of .*psi, psid, psidd, got 'quat2'"):
        flat.evaluate(("quat2",))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["log.csv", "log.npz", "log.parquet"])
@pytest.mark.parametrize("model", sparse(["thrown_flail", "logged_arm", "gyro_log"], 2))
def test_motions_by_attitudes_are_written_and_read_back_as_quaternions(tmp_path, model, name):
    scene = hp.load_scene(MODELS / f"{model}.toml")
    scene.evaluate(("q", "qd", "qdd")[: scene.motion.level + 1]).save(tmp_path / name)
    pair = scene.path.read_text().split("[motion]", maxsplit=1)[0].split("[dynamics]", maxsplit=1)[0]
    (tmp_path / "back.toml").write_text(f'{pair}[motion]\nfile = "{name}"\nframe = "world"\n')
    back, there = hp.load_scene(tmp_path / "back.toml").evaluate(), scene.evaluate()
    assert back.state.outputs == there.state.outputs
    for output, array in there.state.arrays().items():
        np.testing.assert_allclose(back.state[output], array, rtol=0, atol=1e-14 * (1 + np.abs(array).max()))


def test_poses_as_quaternions_are_a_recording_that_fit_reads(tmp_path):
    scene = hp.load_scene(MODELS / "logged_arm.toml")
    result = scene.evaluate(("R1", "quat1", "R2", "quat2"))
    recording = read_recording(result.save(tmp_path / "poses.csv"))
    np.testing.assert_allclose(recording.body2.S, scene.evaluate(("S2",)).S2, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(recording.body1.R, result.R1)
