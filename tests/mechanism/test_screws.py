"""Screws: joints that turn a body and shift it by one coordinate."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hingepair as hp
from support.sparse import sparse

U = 2.0**-53
PITCH = 0.03


def body(mass, *centre):
    return hp.Body(mass=mass, centre_of_mass=centre, inertia=mass * np.diag((0.01, 0.02, 0.025)))


def robot(base: str) -> hp.Mechanism:
    """A hinge that carries a screw, which carries a slider and a hinge."""
    tilt = hp.HingePair(
        (0, 0, 0.1), (0, 0, 0), (0, 1, 0.3), name="tilt", body1=body(5, 0, 0, 0), body2=body(2, 0.1, 0.2, 0)
    )
    screw = hp.Screw(
        (0.2, 0, 0.1), (0, 0.05, 0), (1, 0, 0.2), pitch=PITCH, name="screw", body2=body(1.5, 0.05, 0.02, 0.1)
    )
    shift = hp.Slider((0.1, 0, 0), (0, 0, 0.02), (0, 0, 1), name="shift", body2=body(1, 0.01, 0, 0.1))
    turn = hp.HingePair((0.1, 0, 0), (0, 0, 0.02), (0, 1, 1), name="turn", body2=body(0.7, 0.11, 0, 0.1))
    return hp.Mechanism([tilt, screw, shift, turn], base=base)


@pytest.mark.slow
@pytest.mark.parametrize("base", sparse(["free", "fixed"], 2))
def test_robots_with_screws_agree_with_pinocchio(base):
    q, qd, qdd = np.random.default_rng(1).normal(size=(3, 20, 4))
    report = hp.cross_validate(robot(base), q, qd, qdd)
    assert report.ok, str(report)


def test_a_turn_advances_the_body_by_its_lead():
    spindle = hp.Mechanism([hp.Screw((1, 2, 3), (0, 0, 0.5), (0, 0, -2), pitch=-0.005 / math.tau, name="spindle")])
    state = spindle.forward_kinematics([math.tau])["spindle"]
    np.testing.assert_allclose(state.R, (1, 2, 3 + 0.005 - 0.5), rtol=8 * U)
    np.testing.assert_allclose(state.S, np.eye(3), atol=8 * U)


def test_power_of_the_motor_is_what_lifts():
    load = hp.Screw((0, 0, 0), (0, 0, 0), (0, 0, 1), pitch=PITCH, body2=body(20, 0, 0, 0))
    assert hp.Mechanism([load]).inverse_dynamics([0.3], [0], [0]).tau == pytest.approx(20 * 9.81 * PITCH, rel=8 * U)


@pytest.mark.slow
def test_closed_forms_agree_with_numbers():
    import sympy

    arm, q = robot("fixed"), np.array([0.3, -0.7, 0.2, 1.1])
    forms = hp.derive(arm, frame="turn")
    values = dict(zip(forms.q, map(sympy.Float, q), strict=True))
    R = np.array(forms.R.subs(values), float)[:, 0]
    np.testing.assert_allclose(R, arm.forward_kinematics(q)["turn"].R, atol=1e3 * U)


def test_a_screw_comes_back_and_is_read_from_scenes(tmp_path):
    found = robot("fixed")["screw"]
    assert isinstance(found, hp.Screw)
    assert (found.name, found.pitch) == ("screw", PITCH)
    scene = tmp_path / "lift.toml"
    scene.write_text(
        '[[joint]]\nname = "spindle"\nkind = "screw"\nu1 = [0, 0, 0]\nu2 = [0, 0, 0]\nn = [0, 0, 1]\npitch = 0.002\n'
        '[motion]\nspindle = "3*t"\n[time]\nstart = 0\nstop = 1.0\nsamples = 3\n'
    )
    result = hp.load_scene(scene).evaluate(("R",))
    np.testing.assert_allclose(result.state["spindle"].R[:, 2], 0.006 * result.t, atol=U)


def test_urdf_has_no_screws():
    with pytest.raises(hp.errors.URDFError, match="'screw'"):
        hp.to_urdf(robot("fixed"))
