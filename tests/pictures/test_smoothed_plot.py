"""Plots of smoothed recordings."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp

T = np.arange(300) / 100


def test_an_angle_is_drawn_with_the_band_of_its_standard_deviation():
    rng = np.random.default_rng(0)
    found = hp.smooth(T, np.sin(3 * T) + 2e-3 * rng.standard_normal(300))
    figure = hp.plot(found)
    assert [axes.get_title() for axes in figure.axes] == ["psi", "psid", "psidd"]
    for axes, name in zip(figure.axes, ("psi", "psid", "psidd"), strict=True):
        (band,) = axes.collections
        corners = band.get_paths()[0].vertices
        values, std = getattr(found, name), found.std[name]
        assert corners[:, 1].max() == pytest.approx((values + 2 * std).max())
        assert corners[:, 1].min() == pytest.approx((values - 2 * std).min())
