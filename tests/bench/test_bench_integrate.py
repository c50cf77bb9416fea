"""`bench integrate` measures what it says, and its reports are whole. No speed here."""

from __future__ import annotations

import json

import mpmath
import numpy as np
import pytest
from typer.testing import CliRunner

from hingepair.bench import integrate as bench_integrate
from hingepair.bench.spins import SPINS, compared, ways
from hingepair.cli.main import app
from support.spins import REFERENCE


@pytest.fixture
def few(monkeypatch):
    """Two finenesses of each method are enough."""
    some = tuple(
        way._replace(finenesses=(1e-3, 1e-5) if way.solver else (500.0, 1000.0), run=way.run) for way in ways()
    )
    monkeypatch.setattr(bench_integrate, "ways", lambda: some)


def test_the_motions_are_what_their_closed_forms_say():
    """Omega is that of the exact attitudes, which agree with the tests' own."""
    t = np.array([0.3, 1.7])
    for spin in SPINS:
        near = spin.exact(np.concatenate([t - 1e-6, t + 1e-6]))
        for k, omega in enumerate(spin.omega(t)):
            rate = (near[k + 2] - near[k]) / mpmath.mpf(2e-6) * spin.exact(t)[k].T
            found = [rate[2, 1], rate[0, 2], rate[1, 0]]
            np.testing.assert_allclose([float(w) for w in found], omega, rtol=0, atol=1e-9)
    exact = np.array(SPINS[0].exact(t)[0].tolist(), dtype=float)
    np.testing.assert_allclose(exact, REFERENCE.exact(t[0]).astype(float), rtol=0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("spin", SPINS, ids=lambda spin: spin.name)
def test_the_error_column_sees_an_error(spin):
    """A turn by 1e-7 rad is found, and half a turn is not taken for none."""
    way = ways()[0]
    exact = spin.exact(compared())
    quats = way.run(spin, 2000.0)
    assert spin.error(quats, exact) < 1e-11
    for off in (1e-7, np.pi):
        turn = np.array([np.cos(off / 2), np.sin(off / 2)])
        w, x, y, z = quats.T
        turned = np.stack([turn[0] * w - turn[1] * x, turn[0] * x + turn[1] * w,
                           turn[0] * y - turn[1] * z, turn[0] * z + turn[1] * y], axis=-1)  # fmt: skip
        assert spin.error(turned, exact) == pytest.approx(off, rel=1e-3)


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_integrate_prints_writes_and_draws(tmp_path):
    picture = tmp_path / "i.png"
    options = ["bench", "integrate", "--repeats", "1"]
    done = CliRunner().invoke(app, [*options, "--plot", str(picture), "--long", "3000"])
    assert done.exit_code == 0, done.output
    assert all(way.name in done.output for way in ways())
    assert "3,000 steps of magnus6" in done.output
    assert picture.read_bytes().startswith(b"\x89PNG")
    found = json.loads(CliRunner().invoke(app, [*options, "--json"]).stdout)
    assert len(found["rows"]) == 2 * 2 * len(ways())
    orders = {row["method"]: row["order"] for row in found["rows"] if row["spin"] == "turned" and row["order"]}
    assert {name: round(order) for name, order in orders.items()} == {
        "magnus6": 6, "magnus4": 4, "cf4": 4, "midpoint": 2, "rk4_quaternion": 4, "euler_angles": 4,
    }  # fmt: skip
    assert found["ms_to_error"]["turned"].keys() == {way.name for way in ways()}
