"""Units in place of SI units: their names, factors and headings."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.tables.units import SCALES, Units, read_heading
from support.near import U


def test_a_unit_of_lengths_or_angles_stands_for_its_rates_unless_these_have_their_own() -> None:
    units = Units("deg, mm, km/h")
    assert [units.unit(si) for si in ("rad", "rad/s", "rad/s^2")] == ["deg", "deg/s", "deg/s^2"]
    assert [units.unit(si) for si in ("m", "m/s", "m/s^2")] == ["mm", "km/h", "mm/s^2"]
    assert [units.unit(si) for si in ("N", "N m", "s", "1", "kg")] == ["N", "N m", "s", "1", "kg"]


@pytest.mark.parametrize("si", SCALES)
def test_every_heading_is_read_back_with_the_factor_that_undoes_the_conversion(si: str) -> None:
    for unit in (si, *SCALES[si]):
        units = Units(unit)
        name, factor = read_heading(units.heading("own", si), lambda _: si)
        values = np.array([0.0, -1.75, 3e6, np.nan])
        assert name == "own"
        np.testing.assert_allclose(factor * units.converted(values, si), values, rtol=4 * np.finfo(float).eps)


def test_units_are_as_large_as_they_are_defined():
    """A mile by sea 1852 m and a foot 12 inches of 25.4 mm; the factors are written out here."""
    quarter = np.arctan2(1, 0)
    sizes = {
        "s": {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60, "h": 3600},
        "m": {"mm": 1e-3, "um": 1e-6, "cm": 1e-2, "km": 1e3, "in": 25.4e-3, "ft": 12 * 25.4e-3},
        "rad": {"mrad": 1e-3, "deg": quarter / 90, "turn": 4 * quarter},
        "m/s": {"km/h": 1000 / 3600, "kn": 1852 / 3600, "mm/s": 1e-3},
        "rad/s": {"rpm": 4 * quarter / 60, "turn/s": 4 * quarter, "deg/s": quarter / 90},
        "m/s^2": {"g": 9.80665, "km/s^2": 1e3},
        "N": {"kN": 1e3},
        "N m": {"N mm": 1e-3, "kN m": 1e3},
    }
    for si, units in sizes.items():
        assert {unit: SCALES[si][unit] for unit in units} == pytest.approx(units, rel=4 * U)
