"""`bench integrate` measures what it says, and its reports are whole. No speed here."""

from __future__ import annotations

import json
import math

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hingepair.bench import integrate
from hingepair.bench.integrate import MOTIONS
from support.commands import run_command
from support.drawn import drawn_texts
from support.spins import REFERENCE


def test_the_motions_are_what_their_closed_forms_say():
    """Omega is that of the exact attitudes, which agree with the tests' own."""
    t = np.array([0.3, 1.7])
    for motion in MOTIONS:
        near = motion.exact_attitudes(np.concatenate([t - 1e-6, t + 1e-6]))
        for k, omega in enumerate(motion.omega(t)):
            rate = (near[k + 2] - near[k]) / mpmath.mpf(2e-6) @ motion.exact_attitudes(t)[k].T
            found = [rate[2, 1], rate[0, 2], rate[1, 0]]
            np.testing.assert_allclose([float(w) for w in found], omega, rtol=0, atol=1e-9)
        np.testing.assert_allclose(
            np.array(motion.exact_attitudes(np.zeros(1))[0].tolist(), dtype=float),
            motion.initial_attitude(),
            rtol=0,
            atol=1e-15,
        )
    exact = np.array(MOTIONS[0].exact_attitudes(t)[0].tolist(), dtype=float)
    np.testing.assert_allclose(exact, REFERENCE.exact(t[0]).astype(float), rtol=0, atol=1e-15)


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: motion.name)
def test_the_error_column_sees_an_error(motion):
    """A turn by 1e-7 rad is found, half a turn is not taken for none, and no number is no attitude."""
    exact = motion.exact_attitudes(np.linspace(0, 1, 4))
    found = Rotation.from_matrix(np.array([matrix.tolist() for matrix in exact], dtype=float))
    quats = found.as_quat()[:, [3, 0, 1, 2]]
    assert motion.largest_error(quats, exact) < 1e-15
    assert motion.largest_error(-quats, exact) < 1e-15
    for off in (1e-7, np.pi):
        turned = (Rotation.from_rotvec([off, 0, 0]) * found).as_quat()[:, [3, 0, 1, 2]]
        assert motion.largest_error(2 * turned, exact) == pytest.approx(off, rel=1e-7)
    quats[2, 1] = np.nan
    assert motion.largest_error(quats, exact) == math.inf


@pytest.mark.proof
def test_integrate_prints_writes_and_draws(tmp_path, monkeypatch):
    methods = ("magnus6", "midpoint")
    monkeypatch.setattr(integrate, "METHODS", methods)
    monkeypatch.setattr(integrate, "STEPS", (500, 1000))
    monkeypatch.setattr(integrate, "SOLVERS", ("LSODA",))
    monkeypatch.setattr(integrate, "TOLERANCES", (1e-2, 1e-4))
    picture = tmp_path / "i.svg"
    options = ("bench", "integrate", "--repeats", 1, "--steps", 3000)
    shown = run_command(*options, "--plot", picture).stdout
    assert all(name in shown for name in (*methods, "SciPy LSODA"))
    assert {name for name in (*methods, "SciPy LSODA") if any(name in text for text in drawn_texts(picture))} == {
        *methods,
        "SciPy LSODA",
    }
    found = json.loads(run_command(*options, "--json").stdout, parse_constant=pytest.fail)
    assert len([row for row in found["rows"] if row["case"] == "turned"]) == 2 * 3
    orders = {row["method"]: row["extra_columns"].get("order") for row in found["rows"] if row["case"] == "turned"}
    assert round(orders["magnus6, 1000 steps"]) == 6
    assert round(orders["midpoint, 1000 steps"]) == 2
    assert orders["SciPy LSODA, 0.0001"] is None
    long = [row for row in found["rows"] if row["count"] == 3000]
    assert [row["error"] < 1e-12 for row in long] == [True, True]


def test_the_time_to_an_error_is_read_between_finenesses():
    rows = [
        integrate.Row("turned", f"magnus6, {n} steps", 1, t, t, 1.0, error)
        for n, t, error in ((10, 1.0, 1e-9), (20, 2.0, 1e-11), (40, 4.0, 1e-13))
    ]
    rows.append(integrate.Row("turned", "midpoint, 10 steps", 1, 1.0, 1.0, 1.0, math.inf))
    assert integrate.times_to_target(rows, "turned") == {"magnus6": pytest.approx(2.0)}
