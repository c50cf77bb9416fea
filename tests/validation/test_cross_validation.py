"""The cross-validation passes what is right and nothing else, and its report says so."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.validation.cross_validate import cross_validate
from support import states
from support.hinged import pair_of
from support.sparse import sparse

HARD = states.hard_states()


# ---------------------------------------------------------------- what is right passes


@pytest.mark.slow
def test_lengths_and_rates_of_any_size_agree_with_pinocchio():
    """Each over twelve orders of magnitude, or zero: every term of a scale is the largest once."""
    for k in range(40):
        rng = states.generator(49, k)
        u1, u2, n, home = states.pair(rng)
        lengths = 10.0 ** rng.uniform(-6, 6, 2) * (rng.random(2) > 0.2)
        q, qd, qdd = states.coordinates(rng, 10)
        rates = 10.0 ** rng.uniform(-6, 6, (2, 10, 7)) * (rng.random((2, 10, 7)) > 0.3)
        report = cross_validate(
            pair_of((u1 * lengths[0], u2 * lengths[1], n, home)), q, qd * rates[0], qdd * rates[1]
        )
        assert report.ok, report


@pytest.mark.slow
@pytest.mark.parametrize("name", sparse(HARD, 5))
def test_hard_states_agree_with_pinocchio(name):
    constants, *motion = HARD[name]
    report = cross_validate(pair_of(constants), *motion)
    assert report.ok, report


def test_d_stays_good_far_from_the_origin():
    rng = states.generator(57)
    q, qd, qdd = states.coordinates(rng, 50)
    q[:, :3] *= 1e7
    report = cross_validate(pair_of(states.pair(rng)), q, qd, qdd)
    assert report.ok, report
    assert next(row for row in report.rows if row.output == "d").max_error <= 32 * 2.0**-53


POINTS = {"points1": {"sensor": (100, -2, 3)}, "points2": {"handle": (-3, 40, 1)}}
OF_POINTS = [f"{name}{ending}" for name in ("sensor", "handle") for ending in ("", "_v", "_a")]


@pytest.mark.slow
@pytest.mark.parametrize("levels", [1, 2, 3])
def test_points_are_compared_with_frames_of_pinocchio(levels):
    rng = states.generator(66)
    pair = pair_of(states.pair(rng), **POINTS)
    report = cross_validate(pair, *states.coordinates(rng, 20)[:levels], sequence="ZYX")
    assert report.ok, report
    expected = {name for name in OF_POINTS if name[-2:] not in ("_v", "_a")[levels - 1 :]}
    assert {row.output for row in report.rows[2 * levels + 1 :]} == expected
    assert max(row.max_ratio for row in report.rows[2 * levels + 1 :]) > 0.2
    R, S, v, omega, a, alpha = states.body1(rng, 10)
    body1 = BodyMotion(R=R, S=S, v=v, omega=omega, a=a, alpha=alpha)
    report = cross_validate(pair, body1, *rng.uniform(-3, 3, (3, 10))[:levels])
    assert report.ok, report
    flat = hp.PlanarPair((1, 0.5), (-1, 0.2), points1={"sensor": (100, 2)}, points2={"handle": (0.3, 40)})
    report = cross_validate(flat, *rng.normal(size=(3, 10, 4))[:levels])
    assert report.ok, report
    assert expected <= {row.output for row in report.rows}


# ---------------------------------------------------------------- what is wrong fails


GENUINE = HingePair.forward_kinematics


def faulty(fault):
    """Forward kinematics whose results went through a fault."""

    def changed(pair, q, qd, qdd, **options):
        found = GENUINE(pair, q, qd, qdd, **{**options, "outputs": (*options["outputs"], "omega1", "R1")})
        return type(found)({**found.arrays(), **fault(pair, found, q, qd, qdd)}, found.shape)

    return changed


def other_pair(**change):
    def fault(pair, _found, q, qd, qdd):
        parts = {name: getattr(pair, change.get(name, name)) for name in ("u1", "u2", "n", "home")}
        return GENUINE(HingePair(**parts), q, qd, qdd).arrays()

    return fault


def other_motion(change):
    return lambda pair, _, *motion: GENUINE(pair, *change(*(one.copy() for one in motion))).arrays()


def minus_psid(q, qd, qdd):
    qd[:, 6] *= -1
    return q, qd, qdd


def reduced_psi(q, qd, qdd):
    q[:, 6] %= 2 * np.pi
    return q, qd, qdd


FAULTS = {
    "u1 and u2 swapped": (other_pair(u1="u2", u2="u1"), {"R2", "d", "v2", "a2"}),
    "sign in E2": (other_motion(minus_psid), {"v2", "omega2", "a2", "alpha2"}),
    "psi reduced in double": (other_motion(reduced_psi), {"S2", "d", "v2", "a2"}),
    "S2 transposed": (lambda _p, found, *_m: {"S2": found["S2"].swapaxes(-1, -2)}, {"S2"}),
    "spatial for classical acceleration": (
        lambda _p, found, *_m: {"a2": found["a2"] - np.cross(found["omega2"], found["v2"])},
        {"a2"},
    ),
    "omega1 x n psi' dropped": (
        lambda _p, found, *_m: {"alpha2": found["alpha2"] - np.cross(found["omega1"], found["omega2"])},
        {"alpha2"},
    ),
    "d as R2 - R1": (lambda _p, found, *_m: {"d": found["R2"] - found["R1"]}, {"d"}),
    "single precision in v2": (lambda _p, found, *_m: {"v2": found["v2"].astype(np.float32)}, {"v2"}),
    "one sample NaN": (
        lambda _p, found, *_m: {"omega2": np.where(np.arange(30)[:, None] == 7, np.nan, found["omega2"])},
        {"omega2"},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_found(name, monkeypatch):
    fault, outputs = FAULTS[name]
    rng = states.generator(60)
    q, qd, qdd = states.coordinates(rng, 30)
    q[:, :3] += 1e8
    q[:, 6] += 1e5
    pair = pair_of(states.pair(rng))
    assert cross_validate(pair, q, qd, qdd).ok
    monkeypatch.setattr(HingePair, "forward_kinematics", faulty(fault))
    report = cross_validate(pair, q, qd, qdd)
    assert not report.ok
    failed = {row.output for row in report.rows if not row.ok}
    assert outputs <= failed if len(outputs) > 1 else outputs == failed, report
    assert str(report).splitlines()[-1].startswith("FAILED: ")


# ---------------------------------------------------------------- the report


def test_nothing_compared_is_no_pass():
    pair = pair_of(states.REFERENCE_PAIR)
    for q in (np.empty((0, 7)), np.full((3, 7), np.nan)):
        report = cross_validate(pair, q, q, q)
        assert not report.ok
        assert report.compared == 0
        assert str(report).splitlines()[-1].startswith("NOTHING COMPARED")
        assert json.loads(report.to_json())["compared"] == 0


def test_samples_that_are_not_finite_are_counted_and_left_out():
    rng = states.generator(65)
    q, qd, qdd = states.coordinates(rng, 10)
    q[2, 0], qd[5, 6], qdd[7, 3] = np.nan, np.inf, -np.inf
    report = cross_validate(pair_of(states.pair(rng)), q, qd, qdd)
    assert (report.ok, report.skipped, report.compared) == (True, 3, 7)
    assert "3 of 10 samples are not finite" in str(report)
    assert json.loads(report.to_json())["skipped"] == 3
