"""Gradients through rollouts, against central differences of the rollouts themselves."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
import hingepair.rollouts.gradients as rollout_gradients
from support.near import U
from support.sparse import sparse
from support.trees import Robot, base_motion, random_model, record_of

STEPS, H, MOTIONS = 6, 0.02, 3
MODEL = random_model(1, 4)
ROBOT = Robot(record_of(MODEL))
FREE = Robot(record_of(MODEL), "free")
ARM = """<robot name="arm"><link name="base"/>{}</robot>""".format("".join(
    f"""<link name="{link}"><inertial><origin xyz="0.1 0 -0.3"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="{link}_joint" type="continuous"><parent link="{parent}"/><child link="{link}"/><axis xyz="{axis}"/>
    <origin xyz="0.2 0.1 0"/><dynamics damping="0.3" friction="{friction}"/></joint>"""
    for link, parent, axis, friction in (
        ("one", "base", "0 1 0", 0.5), ("two", "one", "1 0 0", 0.1),
        ("three", "two", "0 1 1", 0), ("four", "two", "0 0 1", 2),
    )
))  # fmt: skip
LOADED = hp.Mechanism.from_urdf(ARM)
DOF = ROBOT.dof
RNG = np.random.default_rng(3)
Q, QD = RNG.uniform(-1, 1, (2, MOTIONS, DOF))
TAU = RNG.uniform(-3, 3, (MOTIONS, STEPS, DOF))
BASE = base_motion(np.random.default_rng(8), (MOTIONS,))
FULL = {
    "K": RNG.normal(size=(DOF, DOF)),
    "D": RNG.normal(size=(DOF, DOF)),
    "q_ref": RNG.normal(size=(STEPS, DOF)),
    "qd_ref": RNG.normal(size=DOF),
    "tau_ff": RNG.normal(size=(MOTIONS, STEPS, DOF)),
}
DIAGONAL = FULL | {"K": RNG.uniform(1, 9, DOF), "D": RNG.uniform(0, 1, DOF)}
CASES = {
    "efforts": (ROBOT, {"tau": TAU}, {}),
    "efforts_that_hold": (ROBOT, {"tau": TAU[:, :1]}, {"steps": STEPS}),
    "every": (ROBOT, {"tau": TAU}, {"every": 3}),
    "behind_the_last_record": (ROBOT, {"tau": TAU}, {"every": 4}),
    "limits": (ROBOT, {"tau": TAU}, {"effort_limits": np.full(DOF, 1.5)}),
    "feedback": (ROBOT, DIAGONAL, {}),
    "full_feedback": (ROBOT, FULL, {"every": 2}),
    "damping_and_friction": (LOADED, {"tau": TAU}, {"joint_loads": True}),
    "free": (FREE, {"tau": TAU}, {"every": 2}),
}


def moved(name, value, change):
    """An attitude that turns about the axes of the world, or a vector."""
    return hp.rotation_exp(change) @ value if name == "S1" else value + change


@pytest.mark.slow
@pytest.mark.parametrize("method", sparse(["rk4", "semi_implicit"], 2))
@pytest.mark.parametrize("case", CASES)
def test_gradients_are_those_of_central_differences(case, method):
    """Along random directions of each argument, motion by motion."""
    robot, control, options = CASES[case]
    arguments = {"q0": Q, "qd0": QD} | control
    start = {"R1": BASE.R, "S1": BASE.S, "v1": BASE.v, "omega1": BASE.omega} if robot is FREE else {}
    arguments |= start

    def rollout(**given):
        law = hp.Feedback(**{name: given[name] for name in control}) if "K" in control else given["tau"]
        base = (
            {"base_motion": hp.BodyMotion(**{x: given[f"{x}1"] for x in ("R", "S", "v", "omega")})} if start else {}
        )
        return robot.rollout(given["q0"], given["qd0"], law, H, method=method, **options, **base)

    found = rollout(**arguments)
    rng = np.random.default_rng(4)
    weights = {name: rng.normal(size=array.shape) for name, array in found.arrays().items()}
    cotangents = dict(weights)
    if start:  # the sum of entries times weights changes like this where S1 turns
        S, W = found.S1, weights["S1"]
        cotangents["S1"] = np.cross(S, W, axis=-2).sum(axis=-1)
    gradient = found.vjp(cotangents)
    assert set(gradient) == set(arguments)

    def losses(**given):
        parts = rollout(**given).arrays()
        return sum((parts[name] * weights[name]).reshape(MOTIONS, -1).sum(axis=1) for name in parts)

    for name, value in arguments.items():
        change = rng.normal(size=value.shape[:-1] if name == "S1" else value.shape)
        e = 1e-5
        ahead, behind = (losses(**arguments | {name: moved(name, value, s * e * change)}) for s in (1, -1))
        rate = (gradient[name] * change).reshape(MOTIONS, -1).sum(axis=1)
        np.testing.assert_allclose(rate, (ahead - behind) / (2 * e), rtol=1e-6, atol=1e-6, err_msg=name)  # of steps e


@pytest.mark.parametrize("method", ["semi_implicit", "rk4"])
@pytest.mark.slow
def test_gradients_hold_where_a_base_does_not_turn(method):
    weights = np.random.default_rng(0).normal(size=(STEPS + 1, 3, 3))

    def rollout(omega):
        base = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), v=(0, 0, 0), omega=omega)
        return FREE.rollout(
            Q[0], 0 * Q[0], 0, H, steps=STEPS, method=method, base_motion=base, gravity=(0, 0, 0)
        )  # fmt: skip

    still = rollout((0, 0, 0))
    gradient = still.vjp({"S1": np.cross(still.S1, weights, axis=-2).sum(axis=-1)}, wrt="omega1")["omega1"]
    change = 1e-6 * np.eye(3)
    ahead, behind = ([(rollout(s * x).S1 * weights).sum() for x in change] for s in (1, -1))
    np.testing.assert_allclose(gradient, (np.array(ahead) - behind) / 2e-6, rtol=1e-6, atol=1e-7)  # of steps of 1e-6


def test_gradients_of_many_motions_are_those_of_each(monkeypatch):
    """In chunks of motions and of records, by two threads; weights that broadcast."""
    monkeypatch.setattr(rollout_gradients, "_KEPT_BYTES", 1000)
    rng = np.random.default_rng(7)
    q0, tau = rng.uniform(-1, 1, (21, DOF)), rng.uniform(-1, 1, (21, STEPS, DOF))
    whole = ROBOT.rollout(q0, 0 * q0, tau, H, workers=2).vjp({"qd": 1.0})
    monkeypatch.undo()
    for k in (0, 20):
        one = ROBOT.rollout(q0[k], 0 * q0[k], tau[k], H).vjp({"qd": np.ones((STEPS + 1, DOF))})
        for name, array in one.items():
            np.testing.assert_allclose(whole[name][k], array, rtol=8192 * U, atol=512 * U)
