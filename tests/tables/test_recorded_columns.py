"""Columns of recordings by the names of this package: frame numbers, units in headings."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.tables.recorded_columns import Vocabulary, open_columns, read_recorded, read_sources
from support.near import U, assert_near

VOCABULARY = Vocabulary(("t", "psi", "x"), {"t": "s", "psi": "rad", "x": "m"}.__getitem__)
T = np.arange(200) * 0.01


def read(columns, entries):
    table = open_columns(columns)
    sources = read_sources(entries, VOCABULARY, table)
    return read_recorded(table, sources, VOCABULARY).columns


def test_frame_numbers_with_a_rate_are_instants():
    t = read({"Frame": np.arange(10, 15), "x": np.zeros(5)}, {"t": {"name": "Frame", "rate": "250 Hz"}})["t"]
    np.testing.assert_allclose(t, np.arange(10, 15) / 250, rtol=4 * U)


@pytest.mark.parametrize("heading", ["Angle [deg]", "Angle (\N{DEGREE SIGN})"])
def test_a_unit_in_a_heading_counts_where_the_column_is_named(heading):
    assert read({"t": T, heading: 90.0 + 0 * T}, {"psi": heading})["psi"][0] == np.pi / 2
    assert read({"t": T, heading: 90.0 + 0 * T}, {"psi": {"name": heading, "unit": "rad"}})["psi"][0] == 90.0


@pytest.mark.parametrize("unit", ["grad", "degree", "DEG", "dm", "inch", "mil", "compass"])
def test_an_unknown_unit_in_brackets_is_refused(unit):
    for name in ("psi", "x"):
        with pytest.raises(hp.ArgumentError, match=rf"columns.{name}.unit: .* got '{unit}'"):
            read({"t": T, f"w [{unit}]": T}, {name: f"w [{unit}]"})
    assert read({"t": T, f"w [{unit}]": T}, {"x": {"name": f"w [{unit}]", "unit": "m"}})["x"][9] == T[9]
    for heading in ("w (left)", "w[0]", "w [-]"):
        assert read({"t": T, heading: T}, {"psi": heading})["psi"][9] == T[9]


def test_the_zone_of_dates_in_brackets_is_no_unit(tmp_path):
    for first, zone in (("2026-11-23T10:00:00", "UTC"), ("3,5", "Sek")):
        (tmp_path / "log.csv").write_text(f"Zeit [{zone}];psi\n{first};1,5\n")
        table = open_columns(tmp_path / "log.csv")
        if zone == "UTC":
            assert read_sources({"t": "Zeit [UTC]"}, VOCABULARY, table)["t"].scale == 1
        else:
            with pytest.raises(hp.ArgumentError, match=r"columns\.t\.unit"):
                read_sources({"t": "Zeit [Sek]"}, VOCABULARY, table)


def test_a_compass_and_a_sign_in_brackets_count():
    vocabulary = VOCABULARY._replace(headings=("psi",))
    for entries in ({}, {"psi": "psi [{}]"}):
        for unit, expected in (("compass", np.pi / 3), ("-deg", -np.pi / 6), ("-mrad", -0.03)):
            table = open_columns({"t": T, f"psi [{unit}]": 30 + 0 * T})
            sources = read_sources({name: text.format(unit) for name, text in entries.items()}, vocabulary, table)
            found = read_recorded(table, sources, vocabulary)
            assert_near(found.columns["psi"], expected, 4)
            assert "psi" in found.stated


def test_a_column_comes_once_and_all_have_one_length():
    with pytest.raises(hp.ArgumentError, match="psi once, from columns or from a column of this name"):
        read({"t": T, "psi": T, "enc": T}, {"psi": "enc"})
    with pytest.raises(hp.ArgumentError, match="columns of one length, got t: 200, x: 3"):
        read({"t": T, "x": T[:3]}, {})
    with pytest.raises(hp.ArgumentError, match="at least one sample"):
        read({"t": T[:0], "x": T[:0]}, {})
