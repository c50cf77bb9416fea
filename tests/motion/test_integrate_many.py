"""Many motions in one call of `integrate`: the bits of single calls, what a trajectory of many can do, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.motion import integrate, magnus
from support.many_motions import ERROR_NAMES, FLAT, PAIR, SPATIAL_NAMES, many_motions

COUNT, MOTIONS = 70, 3
T = np.linspace(0, 1, COUNT)
OMEGA1, PSID, R1, V1, S1_0, PSI_0 = many_motions(700, MOTIONS, T)


def one_of(pair, arguments: dict, index: int) -> dict:
    """The arguments of one motion: those with an axis of motions without it."""
    axes = {"omega1": 2, "alpha1": 2, "psid": 1, "psidd": 1, "R1": 2, "S1_0": 2, "phi_0": 0, "psi_0": 0}
    axes |= {"omega1": 1} if pair is FLAT else {}

    def select(name, value):
        if isinstance(value, tuple):
            return tuple(select(name, part) for part in value)
        return value[index] if isinstance(value, np.ndarray) and value.ndim > axes[name] else value

    return {name: select(name, value) if name in axes else value for name, value in arguments.items()}


def check_bits(pair, arguments, names) -> None:
    many = hp.integrate(pair, T, **arguments)
    assert many.motions == (MOTIONS,)
    for index in range(MOTIONS):
        single, part = hp.integrate(pair, T, **one_of(pair, arguments, index)), many[index]
        assert (single.motions, part.motions) == ((), ())
        for name in (*names, *ERROR_NAMES):
            expected = getattr(single, name)
            if expected is None:
                assert getattr(many, name) is None
                continue
            assert type(getattr(part, name)) is type(expected)
            np.testing.assert_array_equal(getattr(part, name), expected)
            np.testing.assert_array_equal(getattr(many, name)[index], expected)
    assert sum(getattr(many, name) is not None for name in names) >= 3


CASES = {
    "rates": {"omega1": OMEGA1, "psid": PSID},
    "one rate for all": {"omega1": OMEGA1, "psid": PSID[0], "psi_0": PSI_0},
    "starts": {"omega1": OMEGA1, "psid": PSID, "R1": (R1, V1), "S1_0": S1_0, "psi_0": PSI_0},
    "constant rates": {"omega1": OMEGA1[:, :1].copy(), "psid": PSID[:, :1].copy(), "alpha1": (0, 0, 0), "psidd": 0.0},
    "callables": {"omega1": lambda t: np.stack([np.cos(t), t, t], -1), "psid": np.cos, "psi_0": PSI_0},
    "body axes": {"omega1": OMEGA1, "psid": PSID, "frame": "body", "alpha1": np.cos(OMEGA1), "psidd": PSID},
    "tolerance": {"omega1": OMEGA1, "psid": PSID, "tol": 1e-9},
}


@pytest.mark.parametrize("backend", ["numpy", pytest.param("compiled", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", CASES)
def test_motions_have_the_bits_of_calls_of_their_own(name, backend):
    arguments = CASES[name] | {"backend": backend}
    check_bits(PAIR, arguments, SPATIAL_NAMES)


@pytest.mark.parametrize("count", [1, 2, 40])
def test_few_instants_and_groups_of_motions_change_no_bit(count, monkeypatch):
    monkeypatch.setattr(integrate, "_MAX_STEPS_TOGETHER", 2 * count)  # two motions, then the last alone
    calls, together = [], integrate.solve_together
    monkeypatch.setattr(integrate, "solve_together", lambda *given: calls.append(1) or together(*given))
    t, arguments = T[:count], {"S1_0": S1_0, "psi_0": PSI_0, "backend": "numpy", "frame": "body"}
    many = hp.integrate(PAIR, t, OMEGA1[:, :count], PSID[:, :count], **arguments)
    assert len(calls) == 1
    for index in range(MOTIONS):
        own = one_of(PAIR, arguments, index)
        single = hp.integrate(PAIR, t, OMEGA1[index, :count], PSID[index, :count], **own)
        for name in ("quat_wxyz", "psi", "R2", "v2", *ERROR_NAMES):
            np.testing.assert_array_equal(getattr(many, name)[index], getattr(single, name))


@pytest.mark.parametrize("backend", ["numpy", pytest.param("compiled", marks=pytest.mark.slow)])
def test_chunks_of_steps_change_no_bit_of_motions(backend, monkeypatch):
    monkeypatch.setattr(magnus, "CHUNK", 320)  # whole groups of a scan
    t = np.linspace(0, 1, 1001)
    omega1, psid = PSI_0[:, None, None] * np.sin(t[:, None] * (1, 2, 3) + 1), np.cos(t) * PSI_0[:, None]
    many = hp.integrate(PAIR, t, omega1, psid, S1_0=S1_0, outputs=(), backend=backend)
    for index in range(MOTIONS):
        single = hp.integrate(PAIR, t, omega1[index], psid[index], S1_0=S1_0[index], outputs=(), backend=backend)
        np.testing.assert_array_equal(many.quat_wxyz[index], single.quat_wxyz)
        np.testing.assert_array_equal(many.psi[index], single.psi)


def test_motions_in_the_plane_have_the_bits_of_calls_of_their_own():
    flat_names = ("phi", "psi", "R2", "phi2", "d", "v2", "omega2", "a2", "alpha2")
    arguments = {"omega1": OMEGA1[..., 0].copy(), "psid": PSID, "R1": R1[..., :2].copy(), "phi_0": PSI_0}
    check_bits(FLAT, arguments | {"psi_0": PSI_0[::-1].copy(), "backend": "numpy"}, flat_names)


def test_points_at_rest_may_differ_by_motion():
    points = R1[:, :1].copy()
    many = hp.integrate(PAIR, T, OMEGA1, PSID, R1=points, backend="numpy")
    for index in range(MOTIONS):
        single = hp.integrate(PAIR, T, OMEGA1[index], PSID[index], R1=points[index, 0], backend="numpy")
        np.testing.assert_array_equal(many.R1[index], single.R1)
        np.testing.assert_array_equal(many.R2[index], single.R2)
        np.testing.assert_array_equal(many.v2[index], single.v2)


def test_leading_axes_broadcast_and_select_motions():
    many = hp.integrate(PAIR, T, OMEGA1[:, None], PSID[:2], psi_0=PSI_0[:, None], backend="numpy")
    assert many.motions == many.steps.shape == many.error_estimate.shape == (MOTIONS, 2)
    assert many.R2.shape == (MOTIONS, 2, COUNT, 3)
    single = hp.integrate(PAIR, T, OMEGA1[2], PSID[1], psi_0=PSI_0[2], backend="numpy")
    for part in (many[2, 1], many[2][1], many[1:, 1][1]):
        assert part.motions == ()
        np.testing.assert_array_equal(part.R2, single.R2)
        assert part.error_estimate == single.error_estimate
    some = many[::2, :1]
    assert (some.motions, some.state.shape) == ((2, 1), (2, 1, COUNT))
    assert len(list(many)) == MOTIONS


def test_there_may_be_no_motion():
    none = hp.integrate(PAIR, T, OMEGA1[:0], PSID[:0], alpha1=OMEGA1[:0])
    assert none.R2.shape == (0, COUNT, 3)
    assert none.error_estimate.shape == (0,)
    assert repr(none) == (
        "Trajectory(magnus6, steps=0, motions=(0,), samples=70, t=0..1, outputs=(R2, S2, d, v2, omega2))"
    )


def test_euler_angles_are_continuous_in_each_motion():
    many = hp.integrate(PAIR, T, 20 * OMEGA1, PSID, backend="numpy")
    for sequence in ("XYZ", "zxz"):
        angles = many.euler_angles(1, sequence)
        for index in range(MOTIONS):
            np.testing.assert_array_equal(angles[index], many[index].euler_angles(1, sequence))


@pytest.mark.slow
def test_labels_name_the_axes_of_motions(tmp_path):
    xarray = pytest.importorskip("xarray")
    many = hp.integrate(PAIR, T, OMEGA1, PSID)
    labelled = many.to_xarray()
    assert labelled.R2.dims == ("motion", "time", "xyz")
    assert labelled.S1.dims == ("motion", "time", "xyz", "body_xyz")
    assert labelled.psi.dims == ("motion", "time")
    assert labelled.R2.attrs["units"] == "m"
    xarray.testing.assert_identical(labelled.isel(motion=1), many[1].to_xarray())
    labelled.to_netcdf(tmp_path / "motions.nc", engine="scipy")
    wide = hp.integrate(PAIR, T, OMEGA1[:, None], PSID, outputs=()).to_xarray()
    assert wide.psi.dims == ("motion_0", "motion_1", "time")
