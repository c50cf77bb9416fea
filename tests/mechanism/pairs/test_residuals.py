"""Residuals judged: motion of the library passes, a hundred times its round-off fails; measured data, reports."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hingepair as hp
from support.hinged import LETTERS, bodies, made, only
from support.sparse import sparse
from support.states import coordinates, generator
from support.states import pair as random_pair

U = {np.float64: 2.0**-53, np.float32: 2.0**-24}
KINDS = ("gap", "tilt", "gap_rate", "tilt_rate", "gap_acceleration", "tilt_acceleration")
VARIANTS = {
    "general": ({}, {}),
    "no_home": ({"home": None}, {}),
    "u1_zero": ({"u1": np.zeros(3)}, {}),
    "far": ({}, {0: 1e8}),
    "lock": ({}, {4: math.pi / 2}),
    "home_of_nine_digits": ({"home": np.round(random_pair(generator(85))[3], 9)}, {}),
}


@pytest.mark.parametrize("dtype", [np.float64, np.float32], ids=["f64", "f32"])
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("backend", sparse(["numpy", "compiled"], 2))
def test_motion_of_the_library_passes(variant, dtype, backend):
    """With a factor of four to spare."""
    changes, fixed = VARIANTS[variant]
    motion = [c.astype(dtype) for c in coordinates(generator(86), 300)]
    for index, value in fixed.items():
        motion[0][:, index] = value
    found = made(**changes).residuals(*bodies(made(**changes), motion, backend))
    assert found.ok, str(found)
    assert found.u == U[dtype]
    assert max(row.ratio for row in found.rows) < 0.25
    assert [row.residual for row in found.rows] == list(KINDS)


def sizes(pair, body1, body2):
    """The scales that the report names, one per sample."""
    norm = np.linalg.norm
    W, A = ([norm(getattr(b, k), axis=-1) for b in (body1, body2)] for k in ("omega", "alpha"))
    u1, u2 = norm(pair.u1), norm(pair.u2)

    def both(letter):
        return np.maximum(*(abs(getattr(b, letter)).max(axis=-1) for b in (body1, body2)))

    return {
        "R": both("R") + u1 + u2,
        "S": 1 + 0 * W[0],
        "v": both("v") + W[0] * u1 + W[1] * u2,
        "omega": W[0] + W[1],
        "a": both("a") + (A[0] + W[0] ** 2) * u1 + (A[1] + W[1] ** 2) * u2,
        "alpha": A[0] + A[1] + (W[0] + W[1]) ** 2,
    }


@pytest.mark.parametrize("dtype", [np.float64, np.float32], ids=["f64", "f32"])
@pytest.mark.parametrize(("letter", "kind"), list(zip(LETTERS, KINDS, strict=True)))
def test_a_hundred_times_round_off_fails(letter, kind, dtype):
    """One sample of many is moved by 100 u * scale, in each direction that the hinge does not allow."""
    pair, motion = made(), [c.astype(dtype) for c in coordinates(generator(89), 40)]
    body1, body2 = bodies(pair, motion)
    step = 100 * U[dtype] * sizes(pair, body1, body2)[letter][17]
    axis = body1.S[17] @ pair.n
    first = np.cross(axis, np.eye(3)[np.argmin(abs(axis))])
    across = [first / np.linalg.norm(first), np.cross(axis, first) / np.linalg.norm(first)]
    for direction in np.eye(3) if letter in "Rva" else across:
        value = np.array(getattr(body2, letter))
        if letter == "S":
            value[17] = hp.rotation_exp(direction * step) @ value[17]
        else:
            value[17] += direction * step
        found = pair.residuals(body1, bodies(pair, motion, **{letter: value})[1])
        failed = {row.residual: row for row in found.rows if not row.ok}
        assert kind in failed
        assert failed[kind].worst_sample == (17,)
        assert not found.ok
        assert 1.5 < failed[kind].ratio < 6


def test_an_axis_the_other_way_round_is_a_tilt_of_pi():
    """The tilt's components vanish there; its angle does not."""
    pair = hp.HingePair(u1=(0, 0, 0), u2=(0, 0, 0), n=(0, 0, 1))
    found = pair.residuals(
        hp.BodyMotion(R=np.zeros(3), S=np.eye(3)), hp.BodyMotion(R=np.zeros(3), S=np.diag((1, -1, -1)))
    )
    assert (found.tilt_angle, found.ok) == (np.pi, False)


# ---------------------------------------------------------------- what the inputs allow


@pytest.mark.slow
@pytest.mark.parametrize(
    ("letters", "names"),
    [
        ("R S", (*KINDS[:2], "psi")),
        ("R S omega", (*KINDS[:2], "tilt_rate", "psi", "psid")),
        ("R S v omega", (*KINDS[:4], "psi", "psid")),
        ("R S omega alpha", (*KINDS[:2], "tilt_rate", "tilt_acceleration", "psi", "psid", "psidd")),
        ("R S v a", (*KINDS[:2], "psi")),
    ],
)
def test_what_both_motions_hold_is_judged(letters, names):
    pair, motion = made(), coordinates(generator(92), 5)
    body1, body2 = bodies(pair, motion)
    for both in ((only(body1, *letters.split()), body2), (body1, only(body2, *letters.split()))):
        found = pair.residuals(*both)
        assert tuple(row.residual for row in found.rows) == tuple(name for name in names if name in KINDS)
        assert {*found.outputs} == {*names, "tilt_angle"}
        assert found.ok


def test_measured_motion_passes_with_tolerances_of_its_own():
    pair, motion = made(), coordinates(generator(93), 50)
    rng = generator(94)
    body1, clean = bodies(pair, motion)
    S = hp.rotation_exp(rng.normal(size=(50, 3)) * 1e-4) @ clean.S
    _, body2 = bodies(pair, motion, R=clean.R + rng.normal(size=(50, 3)) * 1e-4, S=S)
    poses = only(body1, "R", "S"), only(body2, "R", "S")
    assert not pair.residuals(*poses).ok
    assert pair.residuals(*poses, tolerances={"gap": 2e-3, "tilt": 1e-3}).ok
    half = pair.residuals(*poses, tolerances={"gap": 2e-3})
    assert [row.ok for row in half.rows] == [True, False]
    assert [row.basis for row in half.rows] == ["given", "32 u * scale"]
    size = np.linalg.norm(half.gap, axis=-1)
    assert half.rows[0].worst_sample == (int(np.argmax(size)),)
    assert abs(half.rows[0].ratio - size.max() / 2e-3) <= 4 * U[np.float64]
    assert abs(np.linalg.norm(half.tilt, axis=-1) - np.sin(half.tilt_angle)).max() <= 8 * U[np.float64]


def test_the_least_precise_array_sets_the_tolerance():
    pair, motion = made(), coordinates(generator(103), 20)
    body1, body2 = bodies(pair, motion)
    coarse = hp.BodyMotion(R=body2.R.astype(np.float32), S=body2.S)
    assert not pair.residuals(body1, hp.BodyMotion(R=coarse.R.astype(float), S=body2.S)).ok
    found = pair.residuals(body1, coarse)
    assert (found.ok, found.u, found.gap.dtype) == (True, U[np.float32], np.float64)


# ---------------------------------------------------------------- samples apart, reports


@pytest.mark.parametrize("letter", LETTERS)
@pytest.mark.parametrize("hole", [math.nan, math.inf])
def test_a_hole_stays_in_its_sample_and_is_counted(letter, hole):
    pair, motion = made(), coordinates(generator(96), 6)
    body1, body2 = bodies(pair, motion)
    value = np.array(getattr(body2, letter))
    value[2] = hole
    found = pair.residuals(body1, bodies(pair, motion, **{letter: value})[1])
    whole = pair.residuals(body1, body2)
    keep = np.arange(6) != 2
    for name in (*KINDS, "psi", "psid", "psidd"):
        assert np.array_equal(getattr(found, name)[keep], getattr(whole, name)[keep]), name
    assert (found.ok, found.skipped) == (True, 1)
    assert "(1 of 6 samples is not finite and was left out)" in found.verdict
    assert min(row.samples for row in found.rows) == 5


def test_nothing_compared_is_not_ok():
    pair, motion = made(), coordinates(generator(97), 3)
    body1, body2 = bodies(pair, motion, R=np.full((3, 3), np.nan))
    found = pair.residuals(body1, body2)
    assert not found.ok
    assert found.verdict.startswith("NOTHING COMPARED: no finite sample of gap")
    empty = pair.residuals(*bodies(pair, [c[:0] for c in motion]))
    assert (empty.ok, empty.shape, empty.psi.shape) == (False, (0,), (0,))


def test_the_report_says_how_large_on_the_whole_and_when() -> None:
    pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
    gaps = np.array([3e-3, 0.0, 4e-3])
    body2 = hp.BodyMotion(R=np.stack((2 + gaps, 0 * gaps, 0 * gaps), axis=-1), S=np.eye(3))
    body1 = hp.BodyMotion(R=np.zeros(3), S=np.eye(3))
    report = pair.residuals(body1, body2, {"gap": 1e-2}, t=[10.0, 10.5, 11.3])
    assert report.rows[0].rms == pytest.approx(np.sqrt(25e-6 / 3), abs=2.0**-52)  # m, of positions of 2 m
    assert report.rows[0].worst_time == 11.3
    assert " 11.3 " in str(report)
    days = np.array(["2026-11-20", "2026-11-21", "2026-11-22"], dtype="datetime64[D]")
    assert pair.residuals(body1, body2, t=days).rows[0].worst_time == "2026-11-22"
    assert pair.residuals(body1, body2).rows[0].worst_time is None
