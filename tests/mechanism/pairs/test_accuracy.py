"""The accuracy contract (docs/concepts/accuracy.md) against the 60-digit reference; errors in units of u * scale."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.bench import truth as reference
from hingepair.bench.truth import OUTPUTS
from support import states, truths
from support.exact import attitude_of_quaternion, attitude_of_rotvec
from support.hinged import pair_of
from support.sparse import sparse
from support.truths import require

pytestmark = pytest.mark.usefixtures("each_backend")

HARD = states.hard_states()
IMMENSE = states.immense_rates()


def outputs_of(state):
    return {name: getattr(state, name) for name in OUTPUTS}


def batch(pair, motion, **options):
    return outputs_of(pair.forward_kinematics(*motion, outputs=OUTPUTS, **options))


def one_by_one(pair, motion, **options):
    found = [batch(pair, [c[i] for c in motion], **options) for i in range(len(motion[0]))]
    return {name: np.stack([f[name] for f in found]) for name in OUTPUTS}


@pytest.mark.parametrize("sequence", sparse(["XYZ", "ZYX", "zyx", "XZY", "ZXZ", "zxz", "YXY", "xyz", "yzy"], 9))
def test_random_states(sequence):
    rng = states.generator(3)
    constants, motion = states.pair(rng), states.coordinates(rng, 25)
    truth, pair = truths.from_euler(constants, *motion, sequence=sequence), pair_of(constants)
    require(truth, batch(pair, motion, sequence=sequence))
    require(truth, one_by_one(pair, motion, sequence=sequence))


@pytest.mark.slow
def test_only_the_hinge_moves():
    """Body 1 does not turn and u1 = 0: the scale holds the hinge's terms alone and nothing dilutes their rounding."""
    rng = states.generator(11)
    constants, (q, qd, qdd) = states.pair(rng, home=False), states.coordinates(rng, 60)
    constants = (np.zeros(3), *constants[1:])
    q[:, :3], qd[:, :6], qdd[:, :6] = 0, 0, 0
    truth = truths.from_euler(constants, q, qd, qdd)
    found = batch(pair_of(constants), (q, qd, qdd))
    require(truth, found)


@pytest.mark.parametrize("name", sparse(HARD, 6))
def test_hard_state(name):
    """Alone, and in a batch whose other samples are ordinary."""
    constants, *motion = HARD[name]
    assert len(HARD) + len(states.hard_attitudes()) >= 60
    neighbours = states.coordinates(states.generator(6), 2)
    motion = [np.stack([a[0], c, a[1]]) for a, c in zip(neighbours, motion, strict=True)]
    truth, pair = truths.from_euler(constants, *motion), pair_of(constants)
    require(truth, batch(pair, motion))
    require(truth, one_by_one(pair, motion))


@pytest.mark.parametrize("name", IMMENSE)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_no_square_of_a_rate_is_formed_alone(name, dtype):
    """psi'^2 leaves the range of numbers where a2 and its scale do not."""
    (u1, u2, n, home), *motion = IMMENSE[name]
    if dtype is np.float32:  # 1e308 becomes 1e38 or so
        u1, u2, *motion = (np.sign(x) * abs(x) ** np.float64(0.122) for x in (u1, u2, *motion))
        u1, u2, n, home = (x.astype(dtype) for x in (u1, u2, n, np.eye(3)))
    motion = [c[None].astype(dtype) for c in motion]
    truth, pair = truths.from_euler((u1, u2, n, home), *motion), pair_of((u1, u2, n, home))
    assert all(np.isfinite(scale).all() for scale in truth.scales.values())
    require(truth, batch(pair, motion))
    require(truth, one_by_one(pair, motion))


GIVEN = states.hard_attitudes()
_TRUTH_OF = {
    "quat_xyzw": attitude_of_quaternion,
    "quat_wxyz": lambda quat: attitude_of_quaternion(np.roll(quat, -1, axis=-1)),
    "rotvec": attitude_of_rotvec,
    "S": reference.exactly,
}
_MAKERS = {
    "quat_xyzw": hp.BodyMotion.from_quaternion_xyzw,
    "quat_wxyz": hp.BodyMotion.from_quaternion_wxyz,
    "rotvec": hp.BodyMotion.from_rotvec,
    "S": hp.BodyMotion,
}


@pytest.mark.parametrize("name", sparse(GIVEN, 6))
def test_hard_attitude(name):
    """Given from outside, alone and between ordinary ones."""
    kind, numbers = GIVEN[name]
    rng = states.generator(13)
    constants, pieces = states.pair(rng), list(states.body1(rng, 3))
    ordinary = {"quat_xyzw": rng.normal(size=(3, 4)), "rotvec": rng.normal(size=(3, 3)), "S": pieces[1]}
    given = np.array(ordinary["quat_xyzw" if kind == "quat_wxyz" else kind])
    given[1] = numbers
    pieces[1] = _TRUTH_OF[kind](given)
    psi, psid, psidd = rng.normal(size=(3, 3))
    truth, pair = reference.from_attitude(constants, pieces, psi, psid, psidd), pair_of(constants)
    names = ("R", "v", "omega", "a", "alpha")
    rest = dict(zip(names, (pieces[0], *pieces[2:]), strict=True))
    state = pair.forward_kinematics_from_body1(
        _MAKERS[kind](**{kind: given}, **rest), psi, psid, psidd, outputs=OUTPUTS
    )
    require(truth, outputs_of(state))
    alone = [_MAKERS[kind](**{kind: given[i]}, **{k: c[i] for k, c in rest.items()}) for i in range(3)]
    found = [
        outputs_of(pair.forward_kinematics_from_body1(body1, psi[i], psid[i], psidd[i], outputs=OUTPUTS))
        for i, body1 in enumerate(alone)
    ]
    together = {key: np.stack([f[key] for f in found]) for key in OUTPUTS}
    require(truth, together)


def test_small_turn_through_the_pair():
    """The same digits arrive in S2 when nothing else turns."""
    pair = hp.HingePair(u1=(1, 2, 3), u2=(3, 2, 1), n=(1, 1, 0))
    S2 = pair.forward_kinematics((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.array([1e-9, 1e-7, 1e-5]))).S2
    for S, psi in zip(S2, (1e-9, 1e-7, 1e-5), strict=True):
        exact = np.sin(psi / 2) ** 2
        assert abs(S[0, 1] - exact) <= 16 * 2.0**-53 * exact
