"""Programs that shrink by what is known beforehand keep the accuracy contract, against 60 digits.

Each structure of a pair and of its motion, both backends, batches and single states.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import OUTPUTS
from hingepair.rotations.sequences import SEQUENCE_NAMES
from support import states, truths
from support.sparse import sparse
from support.truths import require

pytestmark = pytest.mark.usefixtures("each_backend")

AXES = {"x": (1, 0, 0), "-y": (0, -3, 0), "z": (0, 0, 1), "-z": (0, 0, -0.1), "xz": (0.6, 0, 0.8)}
QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
LEVERS = {
    "levers": ((0.5, -0.2, 0.3), (-0.25, 0.1, 0.7)),
    "u1 = 0": ((0, 0, 0), (-0.25, 0.1, 0.7)),
    "u2 = 0": ((0.5, -0.2, 0.3), (0, 0, 0)),
    "u2 along n": ((1, 0, 0), (0, 0, 2.0)),
    "in the plane": ((0.5, -0.2, 0), (-0.25, 0.1, 0)),
}
MOTIONS = {
    "upright": (0, 1, 0, 0, 0, None, None),
    "upright and still": (None, None, 0.5, 0, 0, 0.25, None),
    "only psi": (0, 0, 0, 0, 0, 0, None),
    "no psi": (None, 0, None, None, None, None, 0),
    "one turn": (None, None, None, 0, None, 0, -1),
    "ones": (1, -1, 1, 1, -1, 1, None),
}


def known_in_part(pattern, rng):
    """A tuple of seven coordinates, numbers where the pattern has them."""
    return tuple(rng.uniform(-3, 3, 3) if c is None else float(c) for c in pattern)


KNOWN = [(axis, motion) for i, axis in enumerate(AXES) for motion in [*MOTIONS][i % 2 :: 2]]


@pytest.mark.parametrize(("axis", "motion"), sparse(KNOWN, 4))
def test_known_numbers(axis, motion):
    """Coordinates, their rates, axis, levers and home, of which some are 0, 1 or -1."""
    place = list(AXES).index(axis), list(MOTIONS).index(motion)
    rng = states.generator(110, *place)
    sequence = SEQUENCE_NAMES[rng.integers(len(SEQUENCE_NAMES))]
    u1, u2 = list(LEVERS.values())[sum(place) % len(LEVERS)]  # every pair of structures once: a kernel each
    home = QUARTER if rng.random() < 0.5 else None
    q, qd, qdd = (known_in_part(MOTIONS[motion], rng) for _ in range(3))
    full = [np.broadcast_to(np.stack(np.broadcast_arrays(*c), axis=-1), (3, 7)) for c in (q, qd, qdd)]
    truth = truths.from_euler(tuple(map(_array, (u1, u2, AXES[axis], home))), *full, sequence=sequence)
    pair = hp.HingePair(u1=u1, u2=u2, n=AXES[axis], home=home)
    require(truth, pair.forward_kinematics(q, qd, qdd, sequence=sequence, outputs=OUTPUTS).arrays())


def _array(constant):
    return None if constant is None else np.asarray(constant, float)


@pytest.mark.parametrize("axis", sparse(AXES, 5))
def test_one_state(axis):
    rng = states.generator(111, list(AXES).index(axis))
    for (u1, u2), pattern in zip(LEVERS.values(), itertools.cycle(("upright", "only psi")), strict=False):
        constants = tuple(map(_array, (u1, u2, AXES[axis], None)))
        motion = [
            np.array([0.3 * rng.normal() if c is None else c for c in MOTIONS[pattern]], float) for _ in range(3)
        ]
        truth = truths.from_euler(constants, *(c[None] for c in motion))
        state = hp.HingePair(*constants[:3]).forward_kinematics(*(tuple(c.tolist()) for c in motion), outputs=OUTPUTS)
        require(truth, {name: np.asarray(getattr(state, name))[None] for name in OUTPUTS})
