"""Gradients through rollouts, against central differences of the rollouts themselves."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.trees import Robot, base_motion, random_model, record_of

STEPS, H, MOTIONS = 6, 0.02, 3
MODEL = random_model(1, 4)
ROBOT = Robot(record_of(MODEL))
FREE = Robot(record_of(MODEL), "free")
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
    "free": (FREE, {"tau": TAU}, {"every": 2}),
}


def moved(name, value, change):
    """An attitude that turns about the axes of the world, or a vector."""
    return hp.rotation_exp(change) @ value if name == "S1" else value + change


@pytest.mark.parametrize("method", ["semi_implicit", "rk4"])
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
        np.testing.assert_allclose(rate, (ahead - behind) / (2 * e), rtol=1e-6, atol=1e-6, err_msg=name)
