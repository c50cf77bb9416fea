"""`prepare` gives what the plain calls give: of every kind of input, one by one and many, with every output."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import hingepair as hp
from support.hinged import pair_of
from support.sparse import sparse
from support.states import coordinates, generator, pair
from support.work import in_threads

U = 2.0**-53
BACKENDS = ("numpy", "compiled")


def close(found, expected, ulps=64):
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape
    size = max(1.0, np.nanmax(np.abs(expected), initial=0.0))
    assert np.nanmax(np.abs(found - expected), initial=0.0) <= ulps * U * size


@pytest.mark.parametrize("backend", sparse(BACKENDS, 2))
@pytest.mark.parametrize("given", ["quat_xyzw", "quat_wxyz"])
def test_a_quaternion_stands_for_its_attitude(given, backend):
    rng = generator(1002)
    one, count = pair_of(pair(rng)), 30
    quat = rng.normal(size=(count, 4)) * 10.0 ** rng.uniform(-200, 200, (count, 1))
    v, omega = rng.normal(size=(2, count, 3))
    S = getattr(hp.BodyMotion, f"from_{given.replace('quat', 'quaternion')}")(R=v, **{given: quat}).S
    psi, psid = rng.normal(size=(2, count))
    outputs = ("S2", "d", "v2", "omega2", "S1", "jacobian", "acceleration_bias")
    expected = one.prepare(("S1", "psi", "v1", "omega1", "psid"), outputs=outputs)(S, psi, v, omega, psid)
    ready, arrays = one.prepare((given, "psi", "v1", "omega1", "psid"), outputs=outputs, backend=backend), (
        quat, psi, v, omega, psid,
    )  # fmt: skip
    many, single = ready(*arrays), ready(*(c[7].tolist() for c in arrays))
    for name in outputs:
        close(many[name], expected[name])
        close(single[name], expected[name][7])


@pytest.mark.parametrize("backend", BACKENDS)
def test_quaternions_keep_the_promise_of_an_attitude(backend):
    """S1 to 6 u, from quaternions near length 1 and far from it."""
    rng = generator(1003)
    quat = rng.normal(size=(3000, 4))
    quat[:1000] /= np.linalg.norm(quat[:1000], axis=-1, keepdims=True)
    quat[2000:] *= 10.0 ** rng.uniform(-300, 300, (1000, 1))
    exact = hp.BodyMotion.from_quaternion_xyzw(R=np.zeros(3), quat_xyzw=quat.astype(np.longdouble).astype(float)).S
    S1 = pair_of(pair(rng)).prepare(("quat_xyzw",), outputs=("S1",), backend=backend)(quat).S1
    assert np.abs(S1 - exact).max() <= (6 + 3.5) * U  # the other is within 3.5 u of the truth


@pytest.mark.parametrize("backend", sparse(BACKENDS, 2))
def test_two_bodies(backend):
    rng = generator(1005)
    one, (q, qd, qdd) = pair_of(pair(rng)), coordinates(rng, 11)
    s = one.forward_kinematics(q, qd, qdd, outputs=("R2", "S2", "v2", "omega2", "S1", "omega1"))
    letters = ("R1", "S1", "v1", "omega1", "R2", "S2", "v2", "omega2")
    arrays = (q[:, :3], s.S1, qd[:, :3], s.omega1, s.R2, s.S2, s.v2, s.omega2)
    outputs = ("gap", "tilt", "tilt_angle", "psi", "gap_rate", "psid")
    found = one.prepare(letters, outputs=outputs, backend=backend)(*arrays)
    b1 = hp.BodyMotion(R=q[:, :3], S=s.S1, v=qd[:, :3], omega=s.omega1)
    b2 = hp.BodyMotion(R=s.R2, S=s.S2, v=s.v2, omega=s.omega2)
    residuals = one.residuals(b1, b2)
    for name in outputs:
        close(found[name], getattr(residuals, name), 600)
    close(np.sin(found["psi"] - q[:, 6]), np.zeros(11), 64)


def test_threads_do_not_mix():
    rng = generator(1012)
    fk = pair_of(pair(rng)).prepare("acceleration", backend="compiled")
    motion = coordinates(rng, 8)
    batch = [np.repeat(c[:, None], 50, axis=1) for c in motion]
    expected = [fk(*(c[i] for c in motion)).a2.copy() for i in range(8)]

    def work(i):
        for _ in range(300):
            assert np.array_equal(fk(*(c[i] for c in motion)).a2, expected[i])
            assert (fk(*(c[i] for c in batch)).a2 == expected[i]).all()

    in_threads(work, 8)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("count", [(), (3,)])
def test_an_attitude_of_body_2_that_is_none_is_refused(backend, count):
    at = pair_of(pair(generator(1021))).prepare(
        ("R1", "S1", "R2", "S2"), outputs=("tilt_angle", "psi"), backend=backend
    )
    R, S = np.zeros((*count, 3)), np.broadcast_to(np.eye(3), (*count, 3, 3)).copy()
    for _ in range(2):
        assert np.isfinite(at(R, S, R, S)["psi"]).all()
        for bad in (2 * S, -S, S[..., [1, 0, 2], :]):
            with pytest.raises(hp.RotationError, match=r"^S2: "):
                at(R, S, R, bad)
            with pytest.raises(hp.RotationError, match=r"^S1: "):
                at(R, bad, R, S)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("quaternion", [(0, 0, 0, np.nan), (np.nan, 0, 0, 0), (np.nan, 1, 0, 0), (0, np.inf, 0, 0)])
def test_a_quaternion_that_is_no_number_stays_in_its_sample(backend, quaternion):
    at = pair_of(pair(generator(1022))).prepare(("quat_xyzw", "psi"), outputs=("S2",), backend=backend)
    quat = np.array([(0, 0, 0, 1.0), quaternion, (0, 0, 1.0, 0)])
    for _ in range(2):
        S2 = at(quat, np.zeros(3)).S2
        assert np.isfinite(S2[[0, 2]]).all()
        assert np.isnan(S2[1]).any()
        assert np.isnan(at(quat[1], 0.0).S2).any()


def test_a_prepared_call_can_be_copied_and_pickled():
    rng = generator(1024)
    one, motion = pair_of(pair(rng)), coordinates(rng, 5)
    for fk in (
        one.prepare("velocity", outputs=("R2", "omega2"), sequence="zyx", backend="numpy"),
        one.prepare("pose"),
    ):
        rows = motion[: len(fk.given)]
        for other in (copy.copy(fk), copy.deepcopy(fk), pickle.loads(pickle.dumps(fk))):
            assert (other.given, other.outputs) == (fk.given, fk.outputs)
            for name in fk.outputs:
                np.testing.assert_array_equal(other(*rows)[name], fk(*rows)[name])
