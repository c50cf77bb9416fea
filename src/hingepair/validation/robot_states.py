"""States for comparisons of robots with Pinocchio: random states, and states at which computations tend to fail."""

from __future__ import annotations

import numpy as np

from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array

RANDOM_STATES = 200
"""Number of random states; the hard states come in addition."""

# Angles of hinges [rad] at which computations tend to fail; sliders have the position 0 in these states.
_HARD_ANGLES = (0.0, 1e-9, -1e-160, np.pi, np.pi - 1e-9, -np.pi / 2, 1e6, -1e15)
_HARD_RATES = (0.0, 1e3, 1e-9)  # of hinges [rad/s], of sliders [m/s]


def random_and_hard_states(robot: Mechanism, seed: int = 0) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return three float arrays q, q' and q'', shape (N, dof), of random states and of states at which computations
    tend to fail, such as hinge angles near pi.

    Args:
        robot: the robot.
        seed: seed of the random numbers.

    Returns:
        q [rad or m], q' [rad/s or m/s] and q'' [rad/s^2 or m/s^2]; shape (N, dof).
    """
    rng = np.random.default_rng(seed)
    size = RANDOM_STATES, robot.dof
    hinges = np.array([joint.kind == "hinge" for joint in robot.tree.joints if joint.mimic is None], dtype=bool)
    q = [rng.uniform(-np.pi, np.pi, size) * np.where(hinges, 1.0, 0.1)]
    qd, qdd = [rng.uniform(-2, 2, size)], [rng.uniform(-5, 5, size)]
    for angle in _HARD_ANGLES:
        for rate in _HARD_RATES:
            signs = rng.choice((-1.0, 1.0), (3, 1, robot.dof))
            q.append(signs[0] * np.where(hinges, angle, 0.0))
            qd.append(signs[1] * rate)
            qdd.append(signs[2] * rate * rate)
    return np.concatenate(q), np.concatenate(qd), np.concatenate(qdd)
