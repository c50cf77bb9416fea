"""What joints transmit and what wrenches do, against Pinocchio and Jacobians."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from support.states import generator, rotations
from support.trees import (
    Robot,
    base_motion,
    on_free_base,
    pinocchio_state,
    random_model,
    record_of,
    urdf_model,
)

pytestmark = pytest.mark.slow

SAMPLES = 3
ROBOTS = {
    "panda": lambda: urdf_model("panda"),
    "dog": lambda: urdf_model("solo12"),
    "random": lambda: random_model(1),
    "other": lambda: random_model(2, 9),
}


@pytest.fixture(scope="module", params=ROBOTS)
def model(request):
    return ROBOTS[request.param]()


@pytest.mark.parametrize("mode", ["fixed", "free"])
def test_joints_transmit_what_pinocchio_says(model, mode):
    """Its data.f: what acts on each joint's body, in the axes of the body."""
    rng = np.random.default_rng(5)
    q, qd, qdd = rng.uniform(-1.5, 1.5, (3, SAMPLES, model.nv))
    robot, base = Robot(record_of(model), mode), base_motion(rng, (SAMPLES,))
    flying = on_free_base(model)
    data = flying.createData()
    found = robot.joint_wrenches(q, qd, qdd, base_motion=base)
    outputs = ("tau", "force1", "torque1")
    scale = sum(robot.error_bounds(q, qd, qdd, outputs=outputs, base_motion=base).values())
    assert found.names == tuple(flying.names)[2:]
    for k in range(SAMPLES):
        one = hp.BodyMotion(**{x: getattr(base, x)[k] for x in ("R", "S", "v", "omega", "a", "alpha")})
        x, v, a = pinocchio_state(one, q[k], qd[k], qdd[k])
        pin.rnea(flying, data, x, v, a)
        pin.forwardKinematics(flying, data, x)
        for j, name in enumerate(found.names):
            S, exact = data.oMi[j + 2].rotation, data.f[j + 2]
            ours, theirs = (found[name].force[k], found.torque[k, j]), (S @ exact.linear, S @ exact.angular)
            assert np.abs(np.subtract(ours, theirs)).max() <= 4 * scale[k]  # Pinocchio rounds too


def test_a_wrench_at_a_frame_adds_its_jacobian_transposed():
    """Also where a prepared call takes it."""
    robot = hp.load_robot("ur5_robot").with_frame("tool", "tool0", R=(0.1, 0.2, 0.3), S=rotations(generator(2), 1)[0])
    q, qd, qdd = generator(3).uniform(-1, 1, (3, 6))
    force, torque = np.array((1.0, -2, 3)), np.array((0.5, 0.1, -0.4))
    pushed = robot.inverse_dynamics(q, qd, qdd, wrenches={"tool": (force, torque)}).tau
    expected = robot.inverse_dynamics(q, qd, qdd).tau - robot.jacobian(q, "tool").T @ (*force, *torque)
    assert np.abs(pushed - expected).max() <= 64 * 2.0**-53 * np.abs(expected).max()
    prepared = robot.prepare("inverse_dynamics", outputs=("tau",), wrenches="tool")
    assert np.abs(prepared(q, qd, qdd, force, torque).tau - expected).max() <= 64 * 2.0**-53 * np.abs(expected).max()
