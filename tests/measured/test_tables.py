"""Results of smoothing and of fits as tables."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp

T = np.linspace(0.0, 4.0, 200)


@pytest.fixture(scope="module")
def body1():
    angles = np.stack([0.5 * np.sin(T), 0.7 * np.cos(2 * T), T], axis=-1)
    return hp.BodyMotion(R=np.stack([np.sin(T), T, 0 * T], axis=-1), S=hp.euler_to_matrix(angles))


def test_a_fit_is_a_table_that_is_saved(body1, tmp_path):
    pair = hp.HingePair((0.5, 0, 0.1), (-0.3, 0.1, 0), (0, 0.2, 1))
    state = pair.forward_kinematics_from_body1(body1, 1.2 * np.sin(T))
    noise = 1e-3 * np.random.default_rng(0).normal(size=(T.size, 3))
    fit = hp.fit(body1, hp.BodyMotion(R=state.R2 + noise, S=state.S2), t=T, clock_offset=0.0)
    table = fit.to_dataframe("deg, mm")
    assert table.columns.tolist() == ["t [s]", "psi [deg]", "psi_std [deg]", "gap [mm]", "tilt [deg]", "weight"]
    np.testing.assert_allclose(table["psi [deg]"], np.degrees(fit.psi), rtol=1e-15)
    fit.record().save(tmp_path / "psi.csv")
    np.testing.assert_array_equal(np.genfromtxt(tmp_path / "psi.csv", delimiter=",", names=True)["psi"], fit.psi)
