"""Units in place of SI units: their names, factors and headings."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.equations.quantities import unit_of
from hingepair.tables.units import SCALES, Columns, Units, read_heading


def test_a_unit_of_lengths_or_angles_stands_for_its_rates_unless_these_have_their_own() -> None:
    units = Units("deg, mm, km/h")
    assert [units.unit(si) for si in ("rad", "rad/s", "rad/s^2")] == ["deg", "deg/s", "deg/s^2"]
    assert [units.unit(si) for si in ("m", "m/s", "m/s^2")] == ["mm", "km/h", "mm/s^2"]
    assert [units.unit(si) for si in ("N", "N m", "s", "1", "kg")] == ["N", "N m", "s", "1", "kg"]


def test_a_second_of_other_length_leaves_rates_alone() -> None:
    units = Units("ms, mm")
    assert (units.unit("s"), units.unit("m/s")) == ("ms", "mm/s")


@pytest.mark.parametrize("si", SCALES)
def test_every_heading_is_read_back_with_the_factor_that_undoes_the_conversion(si: str) -> None:
    for unit in (si, *SCALES[si]):
        units = Units(unit)
        name, factor = read_heading(units.heading("own", si), lambda _: si)
        values = np.array([0.0, -1.75, 3e6, np.nan])
        assert name == "own"
        np.testing.assert_allclose(factor * units.converted(values, si), values, rtol=4 * np.finfo(float).eps)


def test_headings_name_units_only_where_units_were_named() -> None:
    assert [Columns(Units("mm")).heading(name) for name in ("R2_x", "S2_xx", "psi")] == [
        "R2_x [mm]",
        "S2_xx",
        "psi [rad]",
    ]
    assert Columns().heading("R2_x") == "R2_x"


@pytest.mark.parametrize(
    "heading", ["psi [mm]", "psi [degrees]", "psi deg", "Knick [deg]", "psi []", "psi [deg] [deg]"]
)
def test_other_headings_are_names(heading: str) -> None:
    assert read_heading(heading, unit_of) == (heading, 1.0)
