"""Struts: their lengths and rates, what they do at the joints, and their energy."""

from dataclasses import replace

import numpy as np
import pytest

import hingepair as hp
from support.near import TOL, assert_near
from support.sparse import sparse

U = 2.0**-53
LID = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 1, 0), name="lid", body2=hp.Body(12, (0.4, 0, 0), (0.1, 0.8, 0.9)))
HATCH = hp.Mechanism([LID]).with_frame("a", "base", R=(0.3, 0, -0.2)).with_frame("b", "lid", R=(0.5, 0, 0))
Q = np.linspace(-1.2, 0.3, 31)[:, None]
FORCES = {
    "gas": {"force": hp.GasSpring(300, 400, 0.6, friction=20), "free_length": 0.7},
    "spring": {"stiffness": 900.0, "free_length": 0.5, "damping": 30.0},
    "table": {"force": ([0.1, 0.2, 0.4, 0.7], [500, 300, 320, 100])},
}


FREE = {"gas": 0.7, "spring": 0.5}  # m


def by_hand(kind: str, length: np.ndarray, rate: np.ndarray) -> np.ndarray:
    if kind == "gas":  # the data sheet's line on extension; friction adds to it on compression
        return 300 + 100 * (0.7 - length) / 0.6 + np.where(rate < 0, 20, 0)
    if kind == "spring":
        return 900 * (0.5 - length) - 30 * rate
    return np.interp(length, *FORCES["table"]["force"])


def arm(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The length of the strut and its derivative by q, the lever arm, by plane geometry."""
    x, z = 0.5 * np.cos(q) - 0.3, -0.5 * np.sin(q) + 0.2
    length = np.hypot(x, z)
    return length, (-0.5 * np.sin(q) * x - 0.5 * np.cos(q) * z) / length


@pytest.mark.parametrize("kind", FORCES)
@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_a_strut_acts_by_its_lever_arm(kind: str, backend: str) -> None:
    robot = HATCH.with_strut("a", "b", "strut", **FORCES[kind])
    length, lever = arm(Q[:, 0])
    for rate in (-0.7, 0.4):
        qd = np.full_like(Q, rate)
        strut = robot.struts(Q, qd, backend=backend)["strut"]
        force = by_hand(kind, length, lever * rate)
        assert np.abs(strut.length - length).max() < 8 * U
        assert np.abs(strut.rate - lever * rate).max() < 16 * U
        assert np.abs(strut.force - force).max() < 64 * U * 1000
        without = HATCH.inverse_dynamics(Q, qd, Q, backend=backend).tau[:, 0]
        tau = robot.inverse_dynamics(Q, qd, Q, backend=backend).tau
        assert np.abs(without - tau[:, 0] - force * lever).max() < 64 * U * 1000
        assert np.abs(robot.forward_dynamics(Q, qd, tau, backend=backend).qdd - Q).max() < 8192 * U


@pytest.mark.parametrize("kind", FORCES)
def test_energy_is_what_the_force_along_the_length_leaves(kind: str) -> None:
    robot = HATCH.with_strut("a", "b", "strut", **FORCES[kind])
    stored = robot.energy(Q, 0 * Q).potential - HATCH.energy(Q, 0 * Q).potential
    lengths = arm(Q[:, 0])[0]
    for k in (5, 20):
        steps = np.linspace(lengths[k], lengths[k + 1], 20_001)
        middle = (steps[1:] + steps[:-1]) / 2
        still = 10.0 if kind == "gas" else 0.0  # half of the friction, at rest
        work = ((by_hand(kind, middle, np.zeros_like(middle)) + still) * np.diff(steps)).sum()
        assert abs(stored[k] - stored[k + 1] - work) < 1e-6 * abs(work) + 1e-9  # J, of 20,000 intervals
    if kind in FREE:
        q = np.linspace(-1.4, 0.3, 20_001)
        near = q[np.abs(arm(q)[0] - (FREE[kind] - 1e-4)).argmin(), None]
        stored = robot.energy(near, 0 * near).potential - HATCH.energy(near, 0 * near).potential
        assert abs(stored) < 0.1  # the energy is counted from there


def test_a_spring_keeps_the_energy_of_a_motion() -> None:
    robot = HATCH.with_strut("a", "b", "strut", stiffness=900, free_length=0.5)
    motion = hp.simulate(robot, np.linspace(0, 1, 21), [-0.6], [0.0])
    energy = robot.energy(motion.q, motion.qd)
    assert np.ptp(energy.kinetic + energy.potential) < 10 * TOL * np.ptp(energy.kinetic)


def test_a_strut_between_moving_bodies_pushes_both() -> None:
    second = hp.HingePair(
        (0.8, 0, 0), (0, 0, 0), (0, 1, 0), name="flap", body2=hp.Body(3, (0.2, 0, 0), (0.1, 0.1, 0.1))
    )
    arm = (
        hp.Mechanism([LID, second]).with_frame("a", "lid", R=(0.2, 0.1, 0.3)).with_frame("b", "flap", R=(0.3, 0, 0.1))
    )
    robot = arm.with_strut("a", "b", "strut", stiffness=700, free_length=0.3, damping=12)
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.uniform(-1, 1, (3, 20, 2))
    h = 1e-6
    force = robot.struts(q, qd)["strut"].force
    tau = arm.inverse_dynamics(q, qd, qdd).tau - robot.inverse_dynamics(q, qd, qdd).tau
    for k in range(2):
        step = np.eye(2)[k] * h
        lever = (robot.struts(q + step)["strut"].length - robot.struts(q - step)["strut"].length) / (2 * h)
        assert np.abs(tau[:, k] - force * lever).max() < 1e-8 * np.abs(force).max()  # of differences of steps h
    base = arm.inverse_dynamics(q, qd, qdd).force1, robot.inverse_dynamics(q, qd, qdd).force1
    assert np.abs(base[0] - base[1]).max() < 64 * U * np.abs(base[0]).max()  # the base feels nothing of it


def springy(length: np.ndarray, rate: np.ndarray) -> np.ndarray:
    return 900 * (0.5 - length) - 30 * rate


METHODS = {
    "inverse_dynamics": lambda robot, *motion: robot.inverse_dynamics(*motion).tau,
    "inverse_dynamics, wrenches": lambda robot, *motion: (
        robot.inverse_dynamics(*motion, wrenches={"lid": ((1, 2, 3), (3, 4, 5))}).tau
    ),
    "base": lambda robot, *motion: robot.inverse_dynamics(*motion).torque1,
    "forward_dynamics": lambda robot, *motion: robot.forward_dynamics(*motion).qdd,
    "joint_wrenches": lambda robot, *motion: robot.joint_wrenches(*motion)["lid"].force,
    "bias_forces": lambda robot, q, qd, _: robot.bias_forces(q, qd),
    "gravity_forces": lambda robot, q, *_: robot.gravity_forces(q),
    "struts": lambda robot, q, qd, _: robot.struts(q, qd)["strut"].force,
    "simulate": lambda robot, *_: hp.simulate(robot, [0, 0.5], [-0.3], [0.2]).q,
}


@pytest.mark.parametrize("base", sparse(("fixed", "free"), 2))
@pytest.mark.parametrize("method", METHODS)
def test_a_function_acts_as_the_same_spring_does(base: str, method: str) -> None:
    lid = hp.HingePair(
        (0, 0, 0), (0, 0, 0), (0, 1, 0), name="lid", body1=hp.Body(5, inertia=(1, 1, 1)), body2=LID.body2
    )
    open_robot = hp.Mechanism([lid], base=base).with_frame("a", "base", R=(0.3, 0, -0.2))
    open_robot = open_robot.with_frame("b", "lid", R=(0.5, 0, 0))
    spring = open_robot.with_strut("a", "b", "strut", stiffness=900, free_length=0.5, damping=30)
    function = open_robot.with_strut("a", "b", "strut", force=springy)
    motion = Q, np.sin(3 * Q), np.cos(Q)
    for _ in range(2):  # the second call takes the program of the first
        found, wanted = (METHODS[method](robot, *motion) for robot in (function, spring))
        assert np.abs(found - wanted).max() < 256 * U * 100
    assert np.abs(wanted).max() > 0.1


def test_the_stroke_of_a_gas_spring_is_its_limits() -> None:
    def limits(**strut: object) -> list[float]:
        robot = HATCH.with_strut("a", "b", "strut", **strut).closed(coordinates="strut", at={"lid": -0.6})
        return robot.position_limits[0].tolist()

    assert_near(limits(**FORCES["gas"]), (0.1, 0.7), 8)
    assert limits(limits=(0.2, 0.7), **FORCES["gas"]) == [0.2, 0.7]


BEYOND = {
    "gas": {"force": hp.GasSpring(300, 400, 0.2), "free_length": 0.6},
    "function": {"force": springy, "limits": (0.4, 0.6)},
}
ASKED = {
    "struts": lambda robot, q: robot.struts(q)["strut"].force,
    "inverse_dynamics": lambda robot, q: robot.inverse_dynamics(q, 0 * q, 0 * q).tau[..., 0],
    "forward_dynamics": lambda robot, q: robot.forward_dynamics(q, 0 * q, 0 * q).qdd[..., 0],
    "gravity_forces": lambda robot, q: robot.gravity_forces(q)[..., 0],
    "energy": lambda robot, q: robot.energy(q, 0 * q).potential,
    "derivatives": lambda robot, q: robot.inverse_dynamics_derivatives(q, 0 * q, 0 * q).tau_q[..., 0, 0],
}


OF_NO_FUNCTION = ("energy", "derivatives")


@pytest.mark.parametrize(
    ("kind", "method"), [(k, m) for k in BEYOND for m in ASKED if k != "function" or m not in OF_NO_FUNCTION]
)
def test_no_force_is_known_beyond_a_stroke(kind: str, method: str) -> None:
    robot = HATCH.with_strut("a", "b", "strut", **BEYOND[kind])
    length = arm(Q[:, 0])[0]
    beyond = (length < 0.4) | (length > 0.6)
    counted = rf"'strut': {length.min():.4g} m is beyond its stroke, 0.4 to 0.6 m, .*{beyond.sum()} of 31 samples"
    for _ in range(2):
        with pytest.warns(hp.DynamicsWarning, match=counted):
            found = ASKED[method](robot, Q)
        np.testing.assert_array_equal(np.isnan(found), beyond)
    assert np.isfinite(ASKED[method](robot, Q[~beyond])).all()  # and no warning


def test_a_pair_has_struts_between_its_points() -> None:
    lid = replace(LID, points1={"foot": (0.3, 0, -0.2)}, points2={"eye": (0.5, 0, 0)})
    found = lid.with_strut("foot", "eye", name="strut", **FORCES["gas"])
    wanted = HATCH.with_strut("a", "b", "strut", **FORCES["gas"])
    assert (found.names, found.base) == (("lid",), "fixed")
    assert (found.gravity_forces(Q) == wanted.gravity_forces(Q)).all()
    cylinder = lid.with_strut("foot", "eye", name="cylinder").closed(coordinates=("cylinder",), at={"lid": -0.6})
    assert cylinder.all_coordinates([float(arm(-0.6)[0])])[0] == pytest.approx(-0.6, abs=64 * U)
