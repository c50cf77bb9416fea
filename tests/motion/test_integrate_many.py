"""Many motions in one call of `integrate`: the bits of single calls, what a trajectory of many can do, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
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


def test_motions_in_the_plane_have_the_bits_of_calls_of_their_own():
    flat_names = ("phi", "psi", "R2", "phi2", "d", "v2", "omega2", "a2", "alpha2")
    arguments = {"omega1": OMEGA1[..., 0].copy(), "psid": PSID, "R1": R1[..., :2].copy(), "phi_0": PSI_0}
    check_bits(FLAT, arguments | {"psi_0": PSI_0[::-1].copy(), "backend": "numpy"}, flat_names)


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
