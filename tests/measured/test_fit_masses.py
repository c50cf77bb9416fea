"""Masses and friction of a robot from recorded motions and torques."""

from __future__ import annotations

import functools
import json
import re

import numpy as np
import pytest

import hingepair as hp
from hingepair.measured.torques import JOINT_TERMS
from hingepair.mechanism.mechanism import tree_of
from support.near import U
from support.trees import Robot, random_model, record_of, with_mimics

NOISE = 0.1  # N m
VISCOUS, COULOMB = np.random.default_rng(2).uniform(0.1, 1.0, (2, 7))


@functools.cache
def panda():
    return hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})


def sines(t, w, phase, size=1.0):
    """q, qd and qdd: sums along the last axis."""
    angle = w * t[:, None, None] + phase
    s, c = size * np.sin(angle), size * np.cos(angle)
    return [part.sum(axis=-1) for part in (s, w * c, -(w**2) * s)]


@functools.cache
def motion(seconds):
    """q, qd and qdd within the limits, sums of sines, at 100 Hz."""
    robot, rng = panda(), np.random.default_rng(0)
    t, w = np.arange(0, seconds, 0.01)[:, None], 2 * np.pi * 0.1 * np.arange(1, 6)
    a, b = rng.normal(size=(2, robot.dof, 5))
    s, c = np.sin(t * w), np.cos(t * w)
    low, high = robot.position_limits.T
    q, qd = s @ (a / w).T - c @ (b / w).T, c @ a.T + s @ b.T
    size = np.minimum(0.9 * (high - low) / np.ptp(q, axis=0), 0.9 * robot.rate_limits / np.abs(qd).max(axis=0))
    return (
        (low + high) / 2 + size * (q - (q.max(0) + q.min(0)) / 2),
        size * qd,
        size * ((c * w) @ b.T - (s * w) @ a.T),
    )


def torques(robot, q, qd, qdd):
    return robot.inverse_dynamics(q, qd, qdd).tau + VISCOUS * qd + COULOMB * np.sign(qd)


def noise(shape, seed, correlation=0.0):
    """Noise of one size, with this correlation of neighbouring samples."""
    rows = np.random.default_rng(seed).normal(size=shape)
    for k in range(1, len(rows) if correlation else 0):
        rows[k] = correlation * rows[k - 1] + np.sqrt(1 - correlation**2) * rows[k]
    return NOISE * rows


@pytest.mark.slow
def test_masses_and_friction_are_found_whatever_was_described():
    heavier = panda().with_payload("panda_hand", hp.Body(1.5, (0.02, 0.03, 0.1), inertia=(0.01, 0.01, 0.004)))
    q, qd, qdd = motion(10)
    tau = torques(heavier, q, qd, qdd) + noise(q.shape, 0)
    fit = hp.fit_masses(panda(), q, qd, qdd, tau)
    assert fit.ok, fit.findings
    assert fit.samples == 1000
    exact = np.concatenate((fit.base.matrix @ heavier.inertial_parameters, VISCOUS, COULOMB))
    assert (np.abs(fit.values - exact) < 5 * fit.std).all()
    assert np.abs(fit.values - fit.described).max() > 100 * fit.std.min()
    np.testing.assert_allclose(fit.noise, NOISE, rtol=0.1)  # of 1000 samples: 2.2 %
    assert (fit.rms_described > 2 * fit.rms).all()
    other = q[::100], -0.5 * qd[::100], qdd[::100]
    tau = torques(heavier, *other)
    np.testing.assert_allclose(fit.torques(*other), tau, rtol=0, atol=NOISE)
    loaded = fit.robot.inverse_dynamics(*other, joint_loads=True).tau
    np.testing.assert_allclose(loaded, fit.torques(*other), rtol=0, atol=0.1 * NOISE)  # those of rigid bodies


@pytest.mark.slow
def test_exact_torques_give_exact_parameters():
    q, qd, qdd = motion(10)
    wrong = panda().with_inertial_parameters(0.5 * panda().inertial_parameters)
    fit = hp.fit_masses(wrong, q, qd, qdd, torques(panda(), q, qd, qdd))
    exact = np.concatenate((panda().base_parameters().values, VISCOUS, COULOMB))
    np.testing.assert_allclose(fit.values, exact, rtol=0, atol=8192 * U)
    assert fit.ok


@pytest.mark.slow
def test_sliders_followers_and_tilted_gravity_are_fitted():
    """From masses that no rigid body has."""
    tree = with_mimics(record_of(random_model(1)), {"joint_3": ("joint_6", -0.5, 0.25)})
    robot, gravity = Robot(tree), (1.0, 2.0, -9.0)
    p = robot.inertial_parameters.reshape(-1, 10).copy()
    p[:, 4:] = 0.1 * p[:, :1] * (1, 0, 1, 0, 0, 1)
    for row in p:
        c = row[1:4] / row[0]
        row[4:] += (row[0] * (c @ c * np.eye(3) - np.outer(c, c)))[(0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)]
    real = robot.with_inertial_parameters(p.ravel())
    motion = sines(np.arange(0, 8, 0.02), *np.random.default_rng(0).uniform(0.5, 5, (2, robot.dof, 5)), 0.5)
    tau = real.inverse_dynamics(*motion, gravity=gravity).tau
    tau = tau + 0.2 * motion[1] + noise(tau.shape, 0)
    fit = hp.fit_masses(robot, *motion, tau, gravity=gravity, joint_terms=("viscous",))
    assert fit.ok, fit.findings
    exact = np.concatenate((fit.base.matrix @ real.inertial_parameters, np.full(6, 0.2)))
    assert (np.abs(fit.values - exact) < 5 * fit.std).all()
    loaded = fit.robot.inverse_dynamics(*motion, gravity=gravity, joint_loads=True).tau
    np.testing.assert_allclose(loaded, fit.torques(*motion), rtol=0, atol=0.1 * NOISE)


@pytest.mark.parametrize(
    ("seconds", "runs", "correlation"),
    [
        (5, 12, 0.0),
        pytest.param(60, 12, 0.9, marks=pytest.mark.slow),
        pytest.param(60, 100, 0.0, marks=pytest.mark.proof(20)),
        pytest.param(60, 40, 0.9, marks=pytest.mark.proof(10)),
    ],
)
def test_intervals_cover_the_parameters(seconds, runs, correlation):
    q, qd, qdd = motion(seconds)
    tau = torques(panda(), q, qd, qdd)
    exact = np.concatenate((panda().base_parameters().values, VISCOUS, COULOMB))
    inside = []
    for seed in range(runs):
        fit = hp.fit_masses(panda(), q, qd, qdd, tau + noise(q.shape, seed, correlation))
        low, high = fit.values - 1.96 * fit.std, fit.values + 1.96 * fit.std
        inside.append((low <= exact) & (exact <= high))
    share = np.mean(inside, axis=0)[:43].mean()
    assert 0.92 <= share <= 0.98


@pytest.mark.slow
def test_rotors_and_offsets_are_found_where_asked_for():
    """The rotor of the first joint cannot be told from the inertia of its body."""
    q, qd, qdd = motion(10)
    rotors, offsets = np.full(7, 0.3), np.linspace(-1, 1, 7)
    real = panda().with_inertial_parameters(panda().inertial_parameters, armature=rotors)
    tau = torques(real, q, qd, qdd) + offsets + noise(q.shape, 3)
    fit = hp.fit_masses(panda(), q, qd, qdd, tau, joint_terms=JOINT_TERMS)
    assert fit.names[-1] == "panda_joint7 armature"
    assert (np.abs(fit.values[57:64] - offsets) < 5 * fit.std[57:64]).all()
    assert not any("below 0" in finding for finding in fit.findings)  # offsets may be
    assert (np.abs(fit.values[65:] - rotors[1:]) < 5 * fit.std[65:]).all()
    assert np.isinf(fit.std[[0, 64]]).all()
    assert "Of panda_joint1, the armature term is not determined by this motion." in fit.findings
    known = hp.fit_masses(real, q, qd, qdd, tau, joint_terms=("viscous", "coulomb", "offset"))
    assert known.ok
    np.testing.assert_array_equal(known.robot.armature, rotors)
    assert not hp.fit_masses(panda(), q, qd, qdd, tau, joint_terms=("viscous",)).ok


def test_what_the_motion_does_not_determine_is_said_and_stays_as_described():
    q, qd, qdd = (one.copy() for one in motion(10))
    q[:, 4], qd[:, 4], qdd[:, 4] = 0.3, 0, 0
    heavier = panda().with_payload("panda_hand", hp.Body(1, inertia=(0.01, 0.01, 0.01)))
    fit = hp.fit_masses(panda(), q, qd, qdd, torques(heavier, q, qd, qdd) + noise(q.shape, 0))
    assert not fit.ok
    assert (
        "panda_joint5 does not move: its viscous and coulomb terms are not determined by this motion." in fit.findings
    )
    assert np.isinf(fit.std[43 + 4])
    np.testing.assert_allclose(fit.values[43 + 4], fit.described[43 + 4], rtol=1e-9)  # which it stays near
    still = np.zeros_like(q[::10])
    tau = panda().inverse_dynamics(q[::10], still, still).tau + noise(still.shape, 0)
    held = hp.fit_masses(panda(), q[::10], still, still, tau, joint_terms=())
    assert any(
        text.startswith("Jxx, Jxy, Jxz, Jyz, Jzz of panda_link3 are not determined by this motion: let panda_joint3")
        for text in held.findings
    )
    assert not any("hx" in text for text in held.findings[:3])


def test_torques_that_masses_do_not_explain_are_reported():
    q, qd, qdd = motion(10)
    tau = torques(panda(), q, qd, qdd) + noise(q.shape, 0)
    smooth = hp.fit_masses(panda(), q, qd, qdd, tau - VISCOUS * qd - COULOMB * np.sign(qd))
    assert smooth.ok, smooth.findings  # friction of 0 is not below 0
    spring = hp.fit_masses(panda(), q, qd, qdd, tau + 5 * np.sin(2 * q))
    assert not spring.ok
    assert any("is not random: filtered noise, or what the parameters lack" in text for text in spring.findings)
    flipped = hp.fit_masses(panda(), q, qd, qdd, -tau)
    assert any(text.endswith("is below 0: do tau and qd have the same sign?") for text in flipped.findings)
    degrees = hp.fit_masses(panda(), np.degrees(q), qd, qdd, tau)
    assert any("is it in radians?" in text for text in degrees.findings)


def test_friction_left_out_is_reported_of_samples_in_any_order():
    rng = np.random.default_rng(0)
    low, high = panda().position_limits.T
    q, qd, qdd = rng.uniform(low, high, (400, 7)), *rng.uniform(-2, 2, (2, 400, 7))
    exact = panda().inverse_dynamics(q, qd, qdd, joint_loads=False).tau
    tau = exact + noise(q.shape, 0)
    fit = hp.fit_masses(panda(), q, qd, qdd, tau, joint_terms=())
    assert fit.ok, fit.findings
    for extra in (0.6 * qd + 0.4 * np.sign(qd), 5 * np.sin(2 * q), 0.3 * qdd):
        lacking = hp.fit_masses(panda(), q, qd, qdd, tau + extra, joint_terms=())
        assert not lacking.ok
        assert "dependence" in {finding.name for finding in lacking.findings}


@pytest.mark.slow
def test_masses_are_those_of_rigid_bodies():
    """Without any description, too, and where none explain the torques."""
    q, qd, qdd = motion(10)
    tau = torques(panda(), q, qd, qdd) + noise(q.shape, 0)
    unknown = panda().with_inertial_parameters(0 * panda().inertial_parameters)
    for robot in (panda(), unknown):
        fit = hp.fit_masses(robot, q, qd, qdd, tau)
        assert fit.ok, fit.findings
        assert not tree_of(fit.robot).mass_notes(True)
        left = fit.robot.inverse_dynamics(q, qd, qdd, joint_loads=True).tau - fit.torques(q, qd, qdd)
        assert np.sqrt(np.mean(left**2)) < 0.05 * NOISE
    rotors = panda().with_inertial_parameters(panda().inertial_parameters, armature=5.0 * np.eye(7)[0])
    for robot, recorded, words in ((panda(), -tau, "sign?"), (rotors, tau, "as light as `armature` says?")):
        fit = hp.fit_masses(robot, q, qd, qdd, recorded)
        assert not fit.ok
        (finding,) = (one for one in fit.findings if one.name == "bodies")
        assert finding.endswith(words)
        assert not tree_of(fit.robot).mass_notes(True)


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.0, 1e-9, 0.2])
def test_masses_that_torques_do_not_determine_stay_near_those_described(size):
    robot, rng = hp.load_robot("ur5_robot"), np.random.default_rng(0)
    t, w, amplitude = np.arange(0, 20, 0.02), 2 * np.pi * np.array((0.08, 0.17, 0.29, 0.43)), 0.5 / np.arange(1, 5)
    q, qd, qdd = sines(t, w, rng.uniform(0, 2 * np.pi, (robot.dof, 4)), amplitude)
    tau = robot.inverse_dynamics(q, qd, qdd).tau + size * rng.standard_normal(q.shape)
    fit = hp.fit_masses(robot, q, qd, qdd, tau)
    assert fit.ok, fit.findings
    p, described = (one.inertial_parameters.reshape(-1, 10) for one in (fit.robot, robot))
    np.testing.assert_allclose(p[:, 0], described[:, 0], rtol=8192 * U + min(1.5 * size, 0.3))
    np.testing.assert_allclose(
        p[:, 1:4] / p[:, :1], described[:, 1:4] / described[:, :1], atol=9e6 * U + 0.4 * size
    )  # m


@pytest.mark.slow
def test_recordings_come_in_every_form_and_with_gaps():
    q, qd, qdd = (one[:300] for one in motion(5))
    tau = torques(panda(), q, qd, qdd) + noise(q.shape, 0)
    plain = hp.fit_masses(panda(), q, qd, qdd, tau)
    tables = [dict(zip(panda().names, one.T, strict=True)) for one in (q, qd, qdd, tau)]
    np.testing.assert_array_equal(hp.fit_masses(panda(), *tables).values, plain.values)
    gap = tau.copy()
    gap[10:20, 2] = np.nan
    fit = hp.fit_masses(panda(), q, qd, qdd, gap)
    assert fit.samples == 290
    assert fit.findings[-1] == "10 of 300 samples are missing."
    assert (np.abs(fit.values - plain.values) < 3 * plain.std).all()
    report = json.loads(plain.to_json())
    assert report["parameters"]["panda_link2 hy"]["value"] == plain.values[plain.names.index("panda_link2 hy")]
    assert report["joints"]["panda_joint7"]["noise"] == plain.noise[6]
    assert "panda_joint7 coulomb" in str(plain)


@functools.cache
def recorded(seed=0):
    """Two joints' worth of a planar arm: described robot, q, qd, qdd, and torques by Lagrange's equations."""
    t, rng = np.arange(0, 20, 0.01), np.random.default_rng(seed)
    w, p, a = 2 * np.pi * rng.uniform(0.1, 0.7, (2, 5)), rng.uniform(0, 6.28, (2, 5)), 0.5 * rng.normal(size=(2, 5))
    q, qd, qdd = sines(t, w, p, a)
    (q1, q2), (d1, d2), (s1, s2) = q.T, qd.T, qdd.T
    h, c, far = 1.5 * 0.5 * 0.2 * np.sin(q2), np.cos(q2), -1.5 * 0.2 * 9.81 * np.cos(q1 + q2)
    m22 = 0.03 + 1.5 * 0.2**2
    m12, m11 = m22 + 1.5 * 0.1 * c, 0.05 + 2 * 0.25**2 + m22 + 1.5 * (0.25 + 0.2 * c)
    first = m11 * s1 + m12 * s2 - h * (2 * d1 * d2 + d2**2) - (2 * 0.25 + 1.5 * 0.5) * 9.81 * np.cos(q1) + far
    tau = np.stack((first, m12 * s1 + m22 * s2 + h * d1**2 + far), axis=-1) + 0.3 * qd + 0.8 * np.sign(qd)
    return planar_arm(2.5, 1.2, 0.25, 0.05), q, qd, qdd, tau + 0.05 * rng.normal(size=q.shape)


def planar_arm(m1, m2, c2, i2, length=0.5):
    one = hp.Body(m1, inertia=(1e-3, 0.05, 0.05), centre_of_mass=(0.25, 0, 0))
    two = hp.Body(m2, inertia=(1e-3, i2, i2), centre_of_mass=(c2, 0, 0))
    joints = [((0, 0, 0), one, "a"), ((length, 0, 0), two, "b")]
    return hp.Mechanism([hp.HingePair(u1, (0, 0, 0), (0, 1, 0), body2=body, name=name) for u1, body, name in joints])


def by_differences(q, noise):
    q = q + noise * np.random.default_rng(9).normal(size=q.shape)
    qd = np.gradient(q, 0.01, axis=0)
    return q, qd, np.gradient(qd, 0.01, axis=0)


def with_spikes(tau):
    tau = tau.copy()
    tau[np.random.default_rng(5).choice(len(tau), 20, replace=False)] += 50.0
    return tau


SPOILT = {  # of q, qd, qdd and tau
    "noise of positions": lambda *x: (*by_differences(x[0], 1e-4), x[3]),
    "noise of accelerations": lambda *x: (*x[:2], x[2] + np.random.default_rng(4).normal(size=x[2].shape), x[3]),
    "N mm": lambda *x: (*x[:3], 1e3 * x[3]),
    "Stribeck": lambda *x: (*x[:3], x[3] + np.sign(x[1]) * 0.6 * np.exp(-((x[1] / 0.3) ** 2))),
    "spikes": lambda *x: (*x[:3], with_spikes(x[3])),
}
NAMED = {
    "noise of positions": "noise of the motion", "noise of accelerations": "noise of the motion", "N mm": "unit",
    "Stribeck": "dependence", "spikes": "outliers",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("what", SPOILT)
def test_recordings_that_make_parameters_wrong_are_not_relied_on(what):
    robot, *record = recorded()
    fit = hp.fit_masses(robot, *SPOILT[what](*record))
    assert not fit.ok
    assert NAMED[what] in {finding.name for finding in fit.findings if finding.severity == "serious"}


WRONG_MODELS = {  # length of the first link, tilt of gravity, zero of the first joint; what is named, with its size
    "gravity tilted by 10 deg": (0.5, np.radians(10), 0.0, "gravity that is tilted", 10.0),
    "gravity tilted by 1 deg": (0.5, np.radians(1), 0.0, "gravity that is tilted", 1.0),
    "link 10 % too long": (0.55, 0.0, 0.0, "a place of b that is off", 50.0),
    "encoder off by 2 deg": (0.5, 0.0, np.radians(2), "a zero of a that is off", 2.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG_MODELS)
def test_errors_of_the_model_are_named_with_their_size(name):
    """Within what is known of it: the value of the finding is the size in its standard deviations."""
    length, tilt, off, words, size = WRONG_MODELS[name]
    _, q, qd, qdd, tau = recorded()
    gravity = (9.81 * np.sin(tilt), 0, -9.81 * np.cos(tilt))
    robot = planar_arm(2.5, 1.2, 0.25, 0.05, length)
    fit = hp.fit_masses(robot, q + np.array((off, 0)), qd, qdd, tau, gravity=gravity)
    assert not fit.ok
    (found,) = (finding for finding in fit.findings if "A probable cause" in finding)
    said = float(re.search(rf"{words} by ([\d.]+) (deg|mm)", found)[1])
    # Two digits are printed, and an angle of 10 deg is linear to 1.5 %.
    assert said == pytest.approx(size, abs=4 * size / found.value + 0.05 * size)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [-2, 1, 3, 8, 24])
def test_torques_that_are_late_are_found_with_their_delay(samples):
    q, qd, qdd, tau = (
        np.roll(one, shift, axis=0) for one, shift in zip(recorded()[1:], (0, 0, 0, samples), strict=True)
    )
    inner = slice(50, -50)
    fit = hp.fit_masses(recorded()[0], q[inner], qd[inner], qdd[inner], tau[inner])
    assert not fit.ok
    (found,) = (finding for finding in fit.findings if finding.name == "delay")
    said = re.search("torques that are (late|early) by ([0-9.e+]+) ms", found)
    assert said[1] == ("late" if samples > 0 else "early")
    assert float(said[2]) == pytest.approx(10 * abs(samples), abs=2.5)  # a quarter of a sample


def test_a_robot_that_stands_still_is_not_said_to_have_other_units():
    """Gravity does not load all of its joints: of these, the ratio to the torques as described is none."""
    robot = hp.load_robot("ur5_robot")
    still = np.zeros((200, 6))
    q = np.tile((0.3, -1, 1, 0, 0.5, 0), (200, 1))
    tau = robot.inverse_dynamics(q, still, still).tau
    noisy = tau + 0.1 * np.random.default_rng(0).normal(size=tau.shape)
    assert "unit" not in {finding.name for finding in hp.fit_masses(robot, q, still, still, noisy).findings}
    (found,) = (one for one in hp.fit_masses(robot, q, still, still, 1e3 * noisy).findings if one.name == "unit")
    assert 900 < found.value < 1100


def test_a_joint_whose_rates_are_rounding_stands_still():
    robot, q, qd, qdd, _ = recorded()
    q, qd, qdd = (one * (1, 0) + (0, held) for one, held in ((q, 0.3), (qd, 0), (qdd, 0)))
    rounded = qd + (0, 1e-15) * np.sin(np.arange(len(qd)))[:, None]
    tau = robot.inverse_dynamics(q, qd, qdd).tau + noise(q.shape, 0)
    fit = hp.fit_masses(robot, q, rounded, qdd, tau)
    assert fit.std[[fit.names.index("b viscous"), fit.names.index("b coulomb")]].tolist() == [np.inf, np.inf]
    assert fit.values.tolist() == hp.fit_masses(robot, q, qd, qdd, tau).values.tolist()
    assert any("b does not move" in finding for finding in fit.findings)


def test_a_recording_of_zeros_is_no_error_of_numpy():
    zeros = np.zeros((200, 2))
    assert not hp.fit_masses(recorded()[0], zeros, zeros, zeros, zeros).ok


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_recordings_that_are_good_enough_are_relied_on(noise):
    """Differences of positions to 0.01 mrad flip dry friction in single samples."""
    robot, q, qd, qdd, tau = recorded()
    fit = hp.fit_masses(robot, *(by_differences(q, noise) if noise else (q, qd, qdd)), tau)
    count = len(fit.base.names)
    true = planar_arm(2, 1.5, 0.2, 0.03).base_parameters().values
    assert fit.ok, fit.findings
    assert np.abs(fit.values[:count] - true).max() < 4 * fit.std[:count].max()


@pytest.mark.slow
def test_a_loss_makes_spikes_count_little():
    robot, q, qd, qdd, tau = recorded()
    fit = hp.fit_masses(robot, q, qd, qdd, with_spikes(tau), loss="cauchy")
    true = planar_arm(2, 1.5, 0.2, 0.03).base_parameters().values
    count = len(true)
    assert fit.ok, fit.findings
    assert (np.abs(fit.values[:count] - true) < 4.5 * fit.std[:count]).all()


@pytest.mark.slow
def test_a_payload_alone_is_fitted_beside_what_is_described():
    described = panda().with_joint_loads({f"panda_joint{k}": hp.HingeLoad(damping=0.5, friction=0.3) for k in (1, 2)})
    q, qd, qdd = motion(5)
    loaded = described.with_payload("panda_hand", hp.Body(2.3, (0, 0, 0.1), inertia=(0.01, 0.01, 0.01)))
    tau = loaded.inverse_dynamics(q, qd, qdd, joint_loads=True).tau + noise(q.shape, 0)
    fit = hp.fit_masses(described, q, qd, qdd, tau, unknown=["panda_hand"])
    assert fit.ok, fit.findings
    assert fit.unknown == ("panda_hand",)
    mass = next(k for k, name in enumerate(fit.names) if name.endswith(" m"))
    assert fit.values[mass] - fit.described[mass] == pytest.approx(2.3, abs=4.5 * fit.std[mass])
    assert fit.std[mass] < 0.02
    still = np.ones(described.inertial_parameters.size, dtype=bool)
    still[fit.base.columns] = False
    np.testing.assert_allclose(
        fit.robot.inertial_parameters[still], described.inertial_parameters[still], rtol=0, atol=9e6 * U
    )
    assert np.abs(fit.torques(q, qd, qdd) - loaded.inverse_dynamics(q, qd, qdd, joint_loads=True).tau).max() < 0.2
